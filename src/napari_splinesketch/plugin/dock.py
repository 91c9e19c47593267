"""The dock: sketch, refine, export."""

import atexit
from contextlib import suppress
from dataclasses import replace
from html import escape
from pathlib import Path
from weakref import WeakSet

from napari.viewer import Viewer
from qtpy.QtCore import QEvent, Qt, QTimer
from qtpy.QtGui import QHideEvent
from qtpy.QtWidgets import (
    QCheckBox,
    QComboBox,
    QFormLayout,
    QFrame,
    QHBoxLayout,
    QPushButton,
    QScrollArea,
    QVBoxLayout,
    QWidget,
)

from napari_splinesketch.plugin import engine, words
from napari_splinesketch.plugin.adapter.space import ruler_of
from napari_splinesketch.plugin.autosave.offer_box import OfferBox
from napari_splinesketch.plugin.autosave.saver import Saver
from napari_splinesketch.plugin.controller import Controller
from napari_splinesketch.plugin.curve_box import CurveBox
from napari_splinesketch.plugin.export_dialog import ask_where
from napari_splinesketch.plugin.films import Films
from napari_splinesketch.plugin.films_box import SuggestRow, TrackRow
from napari_splinesketch.plugin.folded_box import FoldedBox
from napari_splinesketch.plugin.folded_text import FoldedText
from napari_splinesketch.plugin.jobs import Job
from napari_splinesketch.plugin.layer_combo import LayerCombo
from napari_splinesketch.plugin.look_box import LookBox
from napari_splinesketch.plugin.panel_keeper import PanelKeeper
from napari_splinesketch.plugin.progress_box import ProgressBox
from napari_splinesketch.plugin.proof_menu import ProofMenu
from napari_splinesketch.plugin.refine_menu import RefineMenu
from napari_splinesketch.plugin.settings_box import SettingsBox
from napari_splinesketch.plugin.text_label import TextLabel
from napari_splinesketch.plugin.visibility_row import VisibilityRow

WARM_UP_AFTER_MS = 500
"""The window is shown first."""
_open: WeakSet["SplinesketchDock"] = WeakSet()


@atexit.register
def _close_all() -> None:
    """Save what is open when Python ends: a little later, Qt takes everything apart."""
    for dock in tuple(_open):
        with suppress(RuntimeError):  # Qt has deleted it
            dock.close_work()


class SplinesketchDock(QScrollArea):
    """Shows the controller's state and passes on what the user does.

    Parameters
    ----------
    napari_viewer
        The viewer that it is docked in.
    """

    def __init__(self, napari_viewer: Viewer):
        super().__init__()
        # napari hands out a proxy, whose layers are never identical with the real ones.
        viewer = getattr(napari_viewer, "__wrapped__", napari_viewer)
        self.controller = Controller(viewer)
        self.panel = PanelKeeper(self.controller)
        self.films = Films(self.controller)
        self.controller.use_keys()
        self.saver = Saver(self.controller, self)
        self._build()
        self._lay_out()
        self._connect()
        self._show_layers()
        self._show()
        self._warm_up()

    def _build(self) -> None:
        self.image = LayerCombo("no image yet", "The image that the bodies are in")
        self.sketches = LayerCombo(
            "none yet", "The Shapes layer with your rough lines; it is never changed"
        )
        self.new = QPushButton("New sketch")
        self.offer = OfferBox(self.controller, self.saver)
        self.suggest, self.track = SuggestRow(self.films), TrackRow(self.films)
        self.preset = QComboBox()
        self.preset.addItems([name.capitalize() for name in engine.PRESETS])
        self.preset.setMinimumWidth(60)
        tips = [words.PRESET_TIPS[name] for name in engine.PRESETS]
        for i, tip in enumerate(tips):
            self.preset.setItemData(i, tip, Qt.ItemDataRole.ToolTipRole)
        self.preset.setToolTip("How much work to do.\n" + "\n".join(tips))
        self.refine = QPushButton("Refine")
        self.refine.setStyleSheet("font-weight: bold; padding: 6px;")
        self.more = RefineMenu(self.controller)
        self.at_once = QCheckBox("as soon as a line is drawn")
        self.hint = TextLabel()
        self.progress = ProgressBox()
        self.notice = TextLabel()
        self.results = TextLabel()
        self.notes = FoldedText("What the image needed", words.NOTES_TIP)
        self.curve = CurveBox(self.controller)
        self.visibility = VisibilityRow()
        self.look = LookBox()
        self.proofs = ProofMenu()
        self.review = QPushButton("Review curves")
        self.review.setCheckable(True)
        self.review.setToolTip("Show the table of curves and the plots of the selected one")
        self.settings_box = SettingsBox()
        self.settings = FoldedBox("Settings", "What you choose once for all", self.settings_box)
        self.export = QPushButton("Export…")
        self.rejected = QCheckBox("Export rejected curves too")
        self.rejected.setToolTip("As a rule, what you rejected is left out of the file")
        self.undo, self.redo = QPushButton("Undo"), QPushButton("Redo")
        self.restore = QPushButton("Restore")

    def _lay_out(self) -> None:
        form = QFormLayout()
        form.setFieldGrowthPolicy(QFormLayout.FieldGrowthPolicy.AllNonFixedFieldsGrow)
        form.addRow("Image", self.image)
        form.addRow("Sketches", self.sketches)
        form.addRow("", self.new)
        form.addRow("", self.suggest)
        form.addRow("Preset", self.preset)
        self.content = QWidget()
        layout = QVBoxLayout(self.content)
        layout.addWidget(self.offer)
        layout.addLayout(form)
        row = QHBoxLayout()
        row.setSpacing(2)
        row.addWidget(self.refine, 1)
        row.addWidget(self.more)
        layout.addLayout(row)
        texts = (self.hint, self.progress, self.notice, self.results)
        for widget in (self.at_once, self.track, *texts):
            layout.addWidget(widget)
        layout.addWidget(self.curve)
        layout.addWidget(self.notes)
        layout.addWidget(self.visibility)
        layout.addWidget(self.look)
        row = QHBoxLayout()
        row.setSpacing(4)
        for button in (self.review, self.proofs):
            button.setMinimumWidth(30)
            row.addWidget(button)
        layout.addLayout(row)
        steps = QHBoxLayout()
        steps.setSpacing(4)
        for button in (self.undo, self.redo, self.restore):
            button.setMinimumWidth(30)
            steps.addWidget(button)
        layout.addLayout(steps)
        layout.addWidget(self.export)
        layout.addWidget(self.rejected)
        layout.addWidget(self.settings)
        layout.addStretch(1)
        self.setWidget(self.content)
        self.setWidgetResizable(True)
        self.setFrameShape(QFrame.Shape.NoFrame)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.setMinimumWidth(220)

    def _connect(self) -> None:
        controller, choices = self.controller, self.controller.choices
        choices.changed.connect(self._show_layers)
        controller.changed.connect(self._show)
        _open.add(self)
        self.destroyed.connect(controller.close)
        self.image.picked.connect(lambda layer: setattr(choices, "image", layer))
        self.sketches.picked.connect(lambda layer: setattr(choices, "sketches", layer))
        self.new.clicked.connect(controller.new_sketches)
        self.preset.activated.connect(lambda i: setattr(controller, "preset", engine.PRESETS[i]))
        self.look.valueChanged.connect(
            lambda by: controller.change(replace(controller.settings, colour_by=by))
        )
        self.settings_box.valueChanged.connect(controller.change)
        self.proofs.refused.connect(controller.say)
        self.review.clicked.connect(self.panel.show_or_hide)
        self.panel.toggled.connect(self._on_panel)
        self.refine.clicked.connect(lambda: controller.refine())
        self.at_once.clicked.connect(controller.toggle_at_once)
        self.progress.cancelled.connect(controller.cancel)
        self.export.clicked.connect(self._ask_where)
        self.undo.clicked.connect(controller.undo)
        self.redo.clicked.connect(controller.redo)
        self.restore.clicked.connect(lambda: controller.restore())

    def _warm_up(self) -> None:
        job = Job(engine.warm_up, parent=self)
        job.done.connect(lambda _: engine.tidy())
        timer = QTimer(self)
        timer.setSingleShot(True)
        timer.timeout.connect(job.start)
        timer.start(WARM_UP_AFTER_MS)

    def changeEvent(self, a0: QEvent | None) -> None:
        """End what runs when the dock is closed: napari then takes the widget out of it."""
        super().changeEvent(a0)
        if a0 and a0.type() == QEvent.Type.ParentChange and self.parent() is None:
            self.panel.hide()
            self.close_work()

    def close_work(self) -> None:
        """Write down what is still to be written, and hear of nothing any more."""
        _open.discard(self)
        self.saver.close()
        self.controller.close()

    def hideEvent(self, a0: QHideEvent | None) -> None:
        """Write down what is still to be written: the window may be closing."""
        super().hideEvent(a0)
        self.saver.flush()

    def _show_layers(self) -> None:
        choices = self.controller.choices
        self.image.show_layers(choices.images(), choices.image)
        self.sketches.show_layers(choices.sketch_layers(), choices.sketches)
        _enable(
            self.new,
            "" if choices.image else "Open an image first",
            "Add a layer for lines that lies on the image, and start drawing:\n"
            "press where a body begins, release where it ends",
        )

    def _show(self) -> None:
        controller = self.controller
        request = controller.request()
        led = controller.selection[:1] if controller.knots.active else ()
        self.refine.setText(f"Refine curve {led[0][1]}" if led else words.button(request.plan))
        running = "A refinement is running" if controller.progress else ""
        _enable(
            self.refine,
            running or ("" if led else request.problem),
            f"Fit a smooth curve with width to the body under each line ({_key(controller)})",
        )
        self.at_once.setChecked(controller.at_once)
        self.at_once.setToolTip(
            f"Refine each line at once, while you draw the next ({_key(controller, 'at_once')})"
        )
        left_out = words.skipped(request.drawn.strays, request.drawn.unusable)
        alone = words.left_alone(request.plan)
        said = " ".join(filter(None, (request.problem, left_out, alone)))
        self.hint.say("" if running or led else escape(said, quote=False))
        self.progress.show_progress(controller.progress, controller.cancellable)
        self.notice.say(words.notice(controller.notice.kind, controller.notice.text))
        work = controller.work
        records = controller.records(request.frame)
        seconds = work.seconds.get(request.frame) if work else None
        self.results.say(words.summary(records, seconds) if records else "")
        notes = work.notes.get(request.frame, ()) if work and records else ()
        self.notes.say(words.notes(notes))
        self.preset.setCurrentIndex(engine.PRESETS.index(controller.preset))
        self.curve.show_selection()
        self.visibility.show_work(work)
        curves = [record.curve for record in controller.records()]
        self.proofs.show_work(work)
        for widget in (self.visibility, self.look, self.review, self.proofs):
            widget.setVisible(bool(curves))
        self.look.show_look(controller.settings.colour_by, curves, controller.ruler)
        self.settings_box.show_ruler(ruler_of(controller.choices.image))
        self.settings_box.show_actions(controller.actions)
        self.settings_box.setValue(controller.settings)
        _enable(
            self.export,
            "" if controller.records() else "Nothing to export yet: refine first",
            "Write the curves of all frames to a file: a table, or another format",
        )
        rejected = any(record.review == "rejected" for record in controller.records())
        self.rejected.setVisible(rejected)

        self.suggest.show_state()
        self.track.show_state()
        self._show_steps()

    def _show_steps(self) -> None:
        controller = self.controller
        work = controller.work
        deleted = work.state.deleted if work else ()
        steps = controller.knots.steps if controller.knots.active else work and work.history
        done, undone = (steps.done, steps.undone) if steps else ("", "")
        running = "Wait until the refinement is over" if controller.progress else ""
        for button, name, what, none in (
            (self.undo, "undo", done, "There is nothing to undo"),
            (self.redo, "redo", undone, "There is nothing to redo"),
            (self.restore, "restore", f"curve {deleted[-1].id}" if deleted else "", ""),
        ):
            action = controller.actions[name]
            tip = f"{action.tip} ({action.key}): {what[:1].lower()}{what[1:]}"
            _enable(button, "" if what and not running else running or none, tip)
            button.setVisible(bool(done or undone if button is not self.restore else deleted))

    def _on_panel(self, shown: bool) -> None:
        self.review.setChecked(shown)

    def _ask_where(self) -> None:
        image = self.controller.choices.image
        if image is None:
            return
        source = image.source.path
        folder = Path(source).parent if source else Path.home()
        answer = ask_where(self, folder, f"{image.name}_labels")
        if answer:
            path, overwrite = answer
            also = self.rejected.isChecked()
            self.controller.export(path, overwrite=overwrite, rejected=also)


def _key(controller: Controller, action: str = "refine") -> str:
    return controller.actions[action].key


def _enable(button: QPushButton, problem: str, tip: str) -> None:
    """Enable a button, or let its tooltip say why not."""
    button.setEnabled(not problem)
    button.setToolTip(problem or tip)

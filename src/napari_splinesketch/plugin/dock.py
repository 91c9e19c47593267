"""The dock: sketch, refine, export."""

import atexit
from contextlib import suppress
from html import escape
from pathlib import Path
from weakref import WeakSet

from napari.layers import Shapes
from napari.viewer import Viewer
from qtpy.QtCore import QEvent, Qt, QTimer
from qtpy.QtGui import QHideEvent, QShowEvent
from qtpy.QtWidgets import (
    QCheckBox,
    QComboBox,
    QDockWidget,
    QFormLayout,
    QLabel,
    QSizePolicy,
    QVBoxLayout,
    QWidget,
)
from superqt import QElidingLabel

from napari_splinesketch.plugin import boxes, engine, widgets, words
from napari_splinesketch.plugin.autosave.resume import OfferBox
from napari_splinesketch.plugin.autosave.saver import Saver
from napari_splinesketch.plugin.controller import Controller
from napari_splinesketch.plugin.files import open_tables
from napari_splinesketch.plugin.jobs import Job
from napari_splinesketch.plugin.layers.space import ruler_of
from napari_splinesketch.plugin.plan import Request
from napari_splinesketch.plugin.review.panel import PanelKeeper
from napari_splinesketch.plugin.widgets import TextLabel, button, enable

TITLE = "Splinesketch"
WARM_UP_AFTER_MS = 500
"""The window is shown first."""
LINES = 3
"""Of text that there is always room for above Export, so that nothing moves."""
IMAGE_TIP = "The image that the bodies are in"
SKETCHES_TIP = "The Shapes layer with your rough lines; it is never changed"
DRAW_TIP = "Draw lines: press where a body begins, release where it ends"
_open: WeakSet["SplinesketchDock"] = WeakSet()


@atexit.register
def _close_all() -> None:
    """Save what is open when Python ends: a little later, Qt takes everything apart."""
    for dock in tuple(_open):
        with suppress(RuntimeError):  # Qt has deleted it
            dock.close_work()


class SplinesketchDock(QWidget):
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
        self.saver = Saver(self.controller, self)
        open_tables()
        self._build()
        self._lay_out()
        self._connect()
        self._show_layers()
        self._show_place()
        self._show()
        self._warm_up()

    def _build(self) -> None:
        controller = self.controller
        choices = controller.choices
        self.image = widgets.layer_choice(
            choices.images, lambda layer: setattr(choices, "image", layer), IMAGE_TIP
        )
        self.sketches = widgets.layer_choice(
            choices.sketch_layers, self._pick_sketches, SKETCHES_TIP, "New layer"
        )
        self.draw = button("Draw lines", DRAW_TIP, controller.draw)
        self.offer = OfferBox(controller, self.saver)
        self.suggest = boxes.SuggestBox(controller)
        self.preset = QComboBox()
        self.preset.addItems([name.capitalize() for name in engine.PRESETS])
        self.preset.setMinimumWidth(widgets.NARROW)
        tips = [words.PRESET_TIPS[name] for name in engine.PRESETS]
        for i, tip in enumerate(tips):
            self.preset.setItemData(i, tip, Qt.ItemDataRole.ToolTipRole)
        self.preset.setToolTip("How much work to do.\n" + "\n".join(tips))
        self.at_once = QCheckBox(controller.actions["at_once"].name)
        self.refine = button("Refine", "", controller.refine)
        self.refine.setStyleSheet("font-weight: bold; padding: 6px;")
        self.more = boxes.RefineMenu(controller)
        self.curve = boxes.CurveBox(controller)
        self.track = widgets.CommandButtons(controller.actions, "film", 2)
        self.results = TextLabel()
        self.review = button("Review", words.REVIEW_TIP, self.panel.show_or_hide)
        self.review.setCheckable(True)
        self.eyes = boxes.EyeBox()
        self.look = boxes.LookBox()
        self.undo, self.redo = (
            widgets.CommandButton(controller.actions, name) for name in ("undo", "redo")
        )
        self.said = QLabel()
        self.said.setWordWrap(True)
        self.notes = widgets.Folded("Model", words.NOTES_TIP, self.said)
        self.settings_form = boxes.SettingsForm()
        self.settings = widgets.Folded(
            "Settings", "What you choose once and for all", self.settings_form
        )
        self.stage, self.notice, self.hint = TextLabel(), TextLabel(), TextLabel()
        self.progress = boxes.ProgressBox()
        self.saved = QElidingLabel()
        self.export = button("Export…", "", self._ask_where)
        self.rejected = QCheckBox("Export rejected curves too")
        self.rejected.setToolTip("As a rule, what you rejected is left out of the file")

    def _lay_out(self) -> None:
        form = QFormLayout()
        form.setFieldGrowthPolicy(QFormLayout.FieldGrowthPolicy.AllNonFixedFieldsGrow)
        form.addRow("Image", self.image.native)
        form.addRow("Sketches", self.sketches.native)
        form.addRow("Preset", self.preset)
        self.content = QWidget()
        column = QVBoxLayout(self.content)
        column.setContentsMargins(4, 4, 4, 4)
        column.setSpacing(3)
        column.addLayout(form)
        begin = QWidget()
        widgets.grid(begin, (self.draw, self.suggest.button), 2)
        for widget in (begin, self.suggest, self.at_once):
            column.addWidget(widget)
        column.addLayout(widgets.row(self.refine, self.more))
        column.addWidget(self.curve)
        column.addWidget(self.track)
        column.addLayout(widgets.row(self.results, self.review))
        column.addWidget(self.eyes)
        column.addWidget(self.look)
        column.addLayout(widgets.row(self.undo, self.redo))
        for folded in (self.notes, self.settings):
            column.addWidget(folded)
        column.addStretch(1)
        self.texts = QWidget()
        texts = QVBoxLayout(self.texts)
        texts.setContentsMargins(0, 0, 0, 0)
        texts.setSpacing(0)
        texts.addStretch(1)
        for label in (self.stage, self.notice, self.hint):
            texts.addWidget(label)
        self.texts.setMinimumHeight(LINES * self.fontMetrics().lineSpacing())
        self.texts.setSizePolicy(QSizePolicy.Policy.Preferred, QSizePolicy.Policy.Maximum)
        below = QVBoxLayout()
        below.setContentsMargins(4, 0, 4, 0)
        for widget in (
            self.offer,
            self.texts,
            self.progress,
            self.rejected,
            self.export,
            self.saved,
        ):
            below.addWidget(widget)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 4)
        layout.setSpacing(3)
        layout.addWidget(widgets.Column(self.content), 1)
        layout.addLayout(below)
        self.setMinimumWidth(220)

    def _connect(self) -> None:
        controller = self.controller
        controller.choices.changed.connect(self._show_layers)
        controller.changed.connect(self._show)
        _open.add(self)
        self.destroyed.connect(controller.close)
        self.preset.activated.connect(lambda i: controller.choose(preset=engine.PRESETS[i]))
        self.look.valueChanged.connect(lambda by: controller.choose(colour_by=by))
        self.saver.found.connect(self._show_place)
        self.settings_form.valueChanged.connect(lambda changes: controller.choose(**changes))
        self.eyes.refused.connect(controller.say)
        self.panel.toggled.connect(lambda on: self.review.setChecked(on))
        self.at_once.clicked.connect(controller.toggle_at_once)
        self.progress.cancelled.connect(controller.cancel)

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

    def showEvent(self, a0: QShowEvent | None) -> None:
        """Take a title that fits: napari's has the plugin's name in brackets, and is cut off."""
        super().showEvent(a0)
        around = self.parent()
        while around is not None and not isinstance(around, QDockWidget):
            around = around.parent()
        bar = around.titleBarWidget() if around else None
        for label in bar.findChildren(QLabel) if bar else ():
            if label.text().startswith(TITLE):
                label.setText(TITLE)

    def hideEvent(self, a0: QHideEvent | None) -> None:
        """Write down what is still to be written: the window may be closing."""
        super().hideEvent(a0)
        self.saver.flush()

    def _show_layers(self) -> None:
        choices = self.controller.choices
        widgets.show_layers(self.image, choices.image, IMAGE_TIP)
        widgets.show_layers(self.sketches, choices.sketches, SKETCHES_TIP)
        tip = f"{DRAW_TIP} ({self.controller.actions['draw'].key})"
        enable(self.draw, "" if choices.image else "Open an image first", tip)

    def _show(self) -> None:
        controller = self.controller
        request = controller.request()
        self._show_refine(request)
        self.suggest.button.show_state()
        self.track.show_state()
        self.track.setVisible(controller.films.frames() > 1)
        self.curve.show_state()
        self._show_results(request)
        self.preset.setCurrentIndex(engine.PRESETS.index(controller.settings.preset))
        ruler = ruler_of(controller.choices.image)
        self.settings_form.show_settings(controller.settings, ruler)
        self._show_steps()

    def _show_place(self) -> None:
        """Say where work is saved: a folder appears beside the user's data."""
        place, wanted = self.saver.place, self.controller.settings.save_work
        said = f"Saved in {place.name}" if place else "" if wanted else "Work is not saved"
        self.saved.setText(said)
        self.saved.setToolTip(f"{place or said}\nChange it under Settings")
        self.saved.setVisible(bool(said))

    def _show_refine(self, request: Request) -> None:
        controller = self.controller
        edited = controller.selection[:1] if controller.knots.active else ()
        self.refine.setText(
            f"Refine curve {edited[0][1]}" if edited else words.button(request.plan)
        )
        running = "Something is running" if controller.progress else ""
        problem = running or ("" if edited else request.problem)
        enable(self.refine, problem, words.REFINE_TIP.format(controller.actions["refine"].key))
        self.at_once.setChecked(controller.at_once)
        self.at_once.setToolTip(controller.actions.tip("at_once"))
        left_out = words.skipped(request.drawn.strays, request.drawn.unusable)
        alone = words.left_alone(request.plan)
        said = " ".join(filter(None, (request.problem, left_out, alone)))
        self.hint.say("" if running or edited else escape(said, quote=False))
        self.stage.say(words.stage(controller.progress, controller.left))
        self.notice.say(words.notice(controller.notice.kind, controller.notice.text))
        self.progress.show_progress(controller.progress, controller.cancellable)

    def _show_results(self, request: Request) -> None:
        controller, work = self.controller, self.controller.work
        records = controller.records()
        here = controller.records(request.frame)
        self.results.say(words.summary(here))
        self.results.setToolTip(words.SUMMARY_TIP)
        notes = work.state.notes.get(request.frame, ()) if work and here else ()
        self.notes.setVisible(bool(notes))
        self.said.setText(words.notes(notes))
        self.eyes.show_work(work)
        for widget in (self.eyes, self.look, self.review):
            widget.setVisible(bool(records))
        self.look.show_look(controller.settings.colour_by, records, controller.ruler)
        nothing = "" if records else "Nothing to export yet: refine first"
        running = "Something is running" if controller.progress else ""
        enable(self.export, nothing or running, words.EXPORT_TIP)
        self.rejected.setVisible(any(record.review == "rejected" for record in records))

    def _show_steps(self) -> None:
        controller, steps = self.controller, self.controller.steps
        for widget, what in ((self.undo, steps.done), (self.redo, steps.undone)):
            widget.show_state(f": {what[:1].lower()}{what[1:]}")
            widget.setVisible(bool(controller.records() or steps.done or steps.undone))

    def _pick_sketches(self, layer: Shapes | None) -> None:
        """Choose a layer, or add one."""
        if layer is None:
            self.controller.new_sketches()
        else:
            self.controller.choices.sketches = layer

    def _ask_where(self) -> None:
        image = self.controller.choices.image
        if image is None:
            return
        source = image.source.path
        folder = Path(source).parent if source else Path.home()
        answer = boxes.ask_where(self, folder, f"{image.name}_labels")
        if answer:
            path, overwrite = answer
            also = self.rejected.isChecked()
            self.controller.export(path, overwrite=overwrite, rejected=also)

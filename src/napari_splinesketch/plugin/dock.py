"""The dock: sketch, refine, export."""

import atexit
import gc
import re
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from html import escape
from typing import TYPE_CHECKING, Any
from weakref import WeakSet

from napari.layers import Image, Shapes
from napari.viewer import Viewer
from qtpy import QtWidgets as qt
from qtpy.QtCore import QEvent, Qt, QTimer
from qtpy.QtGui import QHideEvent, QShowEvent
from superqt import QElidingLabel

from napari_splinesketch.files import counted
from napari_splinesketch.labels.formats import WRITERS
from napari_splinesketch.plugin import engine, files, words
from napari_splinesketch.plugin import widgets as ui
from napari_splinesketch.plugin.controller import Controller
from napari_splinesketch.plugin.layers.space import frame_count, ruler_of, times_of
from napari_splinesketch.plugin.saver import Saver

if TYPE_CHECKING:
    from napari_splinesketch.plugin.review import ReviewPanel

TITLE = "Splinesketch"
WARM_UP_AFTER_MS = 500  # the window is shown first
MORE_LOOK = "QPushButton { padding: 6px 2px; } QPushButton::menu-indicator { width: 0; }"
KINDS = {f"{writer.name} (*{writer.suffix})": writer.suffix for writer in WRITERS}
"""The formats as a file dialog lists them, the first one proposed, and how their names end."""
NO_NAME = r'[\\/:*?"<>|]'  # in names of layers, but on some system not in those of files
_open: WeakSet["SplinesketchDock"] = WeakSet()


@atexit.register
def _close_all() -> None:
    """Save what is open when Python ends, before Qt takes everything apart."""
    for dock in tuple(_open):
        with suppress(RuntimeError):  # Qt has deleted it
            dock.close_work()


class SplinesketchDock(qt.QWidget):
    """Shows the controller's state and passes on what the user does."""

    def __init__(self, napari_viewer: Viewer):
        super().__init__()
        # napari hands out a proxy, whose layers are never identical with the real ones.
        self._viewer = getattr(napari_viewer, "__wrapped__", napari_viewer)
        self.controller = Controller(self._viewer)
        self.panel: ReviewPanel | None = None
        self.saver = Saver(self.controller)
        files.open_tables()
        self._build()
        self._lay_out()
        self._connect()
        job = engine.Job(engine.warm_up, parent=self)
        job.done.connect(self._settle)
        QTimer.singleShot(WARM_UP_AFTER_MS, job.start)

    def _build(self) -> None:
        controller, actions = self.controller, self.controller.actions
        self.image = ui.LayerChoice(controller, Image, "Image", "The image that the bodies are in")
        tip = "The Shapes layer with your rough lines; what you drew is never changed"
        self.sketches = ui.LayerChoice(controller, Shapes, "Sketches", tip)
        self.draw = ui.CommandButton(actions, "draw")
        self.suggest = ui.CommandButton(actions, "suggest")
        self.sensitivity = ui.Sensitivity(controller.suggestions)
        self.settings_form = ui.SettingsForm(controller)
        self.preset = self.settings_form.widgets["preset"]
        self.colour_by = self.settings_form.widgets["colour_by"]
        self.at_once = qt.QCheckBox(actions.table["at_once"].name)
        self.refine = ui.CommandButton(actions, "refine")
        # A border of our own: napari's theme gives one to what is disabled, and all below moves.
        self.refine.setStyleSheet("font-weight: bold; padding: 6px; border: 1px solid transparent;")
        scopes = {name: partial(controller.refine, scope) for scope, name in words.SCOPES.items()}
        self.more = ui.MenuButton("▾", "Refine selected or all unreviewed curves", scopes)
        self.more.setStyleSheet(MORE_LOOK)
        self.more.setMinimumWidth(20)
        self.curve = ui.CommandButtons(actions, "curve", 4)
        self.curve.setStyleSheet("QPushButton { padding: 3px 1px; }")
        self.track = ui.CommandButtons(actions, "film", 2)
        self.steps = ui.CommandButtons(actions, "steps", 2)
        self.undo, self.redo = self.steps.buttons.values()
        labels = (ui.TextLabel() for _ in range(6))
        self.results, self.legend, self.said, self.stage, self.notice, self.hint = labels
        said = "Curves of this frame: good or accepted, to check (?), failed (!) and rejected (✗)"
        self.results.setToolTip(said)
        self.legend.setWordWrap(False)  # or a scroll bar that comes would make itself necessary
        tip = "Show the table of curves and the plots of the selected one"
        self.review = ui.Button("Review", tip, self._show_or_hide_panel)
        self.review.setCheckable(True)
        self.eyes = ui.EyeBox(controller)
        for each in (self.said, self.legend):
            each.setIndent(0)  # Qt counts it twice, and leaves a gap
        tip = "What this image needed of the model, and why"
        self.notes = ui.Folded("Model", tip, self.said)
        self.settings = ui.Folded("Settings", "Options, kept for next time", self.settings_form)
        self.offer = OfferBox(controller, self.saver)
        self.bar, self.cancel = qt.QProgressBar(), ui.Button("Cancel", "Stop", controller.cancel)
        self.bar.setToolTip("Progress")
        self.bar.setMinimumWidth(ui.NARROW)
        self.export = ui.Button("Export…", "", self._ask_where)
        self.saved = QElidingLabel()
        self.saved.setElideMode(Qt.TextElideMode.ElideMiddle)
        self.saved.setEllipsesWidth(8)  # napari's style pads labels, which superqt does not know

    def _lay_out(self) -> None:
        below, self.content, self.progress = (qt.QWidget() for _ in range(3))
        chosen = ui.form(self.image, self.sketches, self.preset)
        rows = (
            *(chosen, [self.draw, self.suggest]),
            *(self.sensitivity.ends, self.sensitivity, self.at_once),
            *((self.refine, self.more), self.curve, self.track, (self.results, self.review)),
            *(self.eyes, self.colour_by.native, self.legend, self.steps, self.notes, self.settings),
        )
        ui.stack(self.content, *rows, margin=4).addStretch(1)
        texts = ui.Texts(self.offer, self.stage, self.notice, self.hint)
        ui.stack(self.progress, (self.bar, self.cancel))
        policy = self.progress.sizePolicy()
        policy.setRetainSizeWhenHidden(True)  # so that nothing moves
        self.progress.setSizePolicy(policy)
        ui.stack(below, texts, self.progress, self.export, self.saved, margin=4)
        ui.stack(self, ui.Column(self.content), below).setStretch(0, 1)
        ui.leave_keys(self)

    def _connect(self) -> None:
        controller, c = self.controller, self.controller.changes
        listeners: dict[Callable[[], None], tuple[Any, ...]] = {
            self.image.show_state: (c.layers,),
            self.sketches.show_state: (c.layers,),
            self._show_commands: (c.layers, c.lines, c.curves, c.mode, c.busy, c.settings),
            self._show_selected: (c.selection,),
            self._show_results: (c.layers, c.lines, c.curves, c.shown, c.settings),
            self._show_running: (c.busy, c.progress, c.said),
            self._show_saved: (c.layers, c.settings, c.saved),
            self.settings_form.show_state: (c.layers, c.settings),
            self.offer.show_state: (c.layers, c.curves, c.busy, c.saved),
        }
        for show, signals in listeners.items():
            for signal in signals:
                signal.connect(show)
            show()
        _open.add(self)
        self.destroyed.connect(controller.close)
        self.at_once.clicked.connect(controller.toggle_at_once)

    def _settle(self) -> None:
        """Keep Python from looking for garbage in what is there by now, amid a refinement."""
        gc.collect()
        if self.isVisible():
            gc.freeze()

    def changeEvent(self, a0: QEvent | None) -> None:
        """End what runs when the dock is closed: napari then takes the widget out of it."""
        super().changeEvent(a0)
        if a0 and a0.type() == QEvent.Type.ParentChange and self.parent() is None:
            if self.panel is not None:
                self._viewer.window.remove_dock_widget(self.panel)
            self.close_work()

    def _show_or_hide_panel(self) -> None:
        window: Any = self._viewer.window
        if self.panel is not None and self.review.isChecked():  # behind something, or hidden
            around: Any = self.panel.parent()
            around.show()
            around.raise_()
            return
        if self.panel is not None:
            window.remove_dock_widget(self.panel)
            return
        # Plots take 0.4 s to import: not before they are wanted.
        from napari_splinesketch.plugin.review import ReviewPanel

        self.panel = ReviewPanel(self.controller)
        self.panel.closed.connect(self._on_panel_closed)
        # The docks at the right keep their height: the panel goes below the canvas alone.
        corner, area = Qt.Corner.BottomRightCorner, Qt.DockWidgetArea.RightDockWidgetArea
        window._qt_window.setCorner(corner, area)
        around = window.add_dock_widget(self.panel, name="Curves", area="bottom")
        around.visibilityChanged.connect(self.review.setChecked)

    def _on_panel_closed(self) -> None:
        self.panel = None
        self.review.setChecked(False)
        self._show_results()

    def close_work(self) -> None:
        """Write down what is still to be written, and hear of nothing any more."""
        _open.discard(self)
        self.saver.close()
        self.controller.close()

    def showEvent(self, a0: QShowEvent | None) -> None:
        """Take a title that fits: napari's has the plugin's name in brackets, and is cut off."""
        super().showEvent(a0)
        window = self.window()
        for label in window.findChildren(qt.QLabel) if window else ():
            if label.text().startswith(f"{TITLE} ("):
                label.setText(TITLE)

    def hideEvent(self, a0: QHideEvent | None) -> None:
        """Write down what is still to be written: the window may be closing."""
        super().hideEvent(a0)
        gc.unfreeze()
        self.saver.flush()

    def _show_commands(self) -> None:
        controller, records = self.controller, self.controller.records()
        image, running, steps = controller.image, controller.progress, controller.steps
        self.curve.setVisible(bool(records or controller.state.deleted))
        self.track.setVisible(image is not None and frame_count(image) > 1)
        self.steps.setVisible(bool(records or steps.done or steps.undone))
        for each in (self.draw, self.suggest, self.refine, self.steps):
            each.show_state()
        self.at_once.setChecked(controller.at_once)
        self.at_once.setToolTip(controller.actions.tip("at_once"))
        self.more.setEnabled(not running)
        nothing = "" if records else "Nothing to export yet: refine first"
        tip = "Write the curves of all frames to a file: a table, or another format"
        self.export.allow("Something is running" if running else nothing, tip)
        self._to_do = words.to_do(controller.request())  # a plan of all lines: once a change
        self._show_selected()

    def _show_selected(self) -> None:
        controller, chosen = self.controller, self.controller.selected_records()
        place = times_of(controller.image).place
        self.curve.show_state(words.selected(chosen, controller.frame, place))
        self.track.show_state()
        said = words.doubts(chosen) or self._to_do
        self.hint.say("" if controller.progress or controller.knots else escape(said, quote=False))

    def _show_results(self) -> None:
        controller, frame = self.controller, self.controller.frame
        records, here = controller.records(), controller.records(frame)
        self.results.say(words.summary(here))
        notes = controller.state.notes.get(frame, ()) if here else ()
        self.notes.setVisible(bool(notes))
        self.said.setText(words.notes(notes))
        for each in (self.eyes, self.colour_by.native):
            each.setVisible(bool(records))
        self.eyes.show_state()
        self.review.setVisible(bool(records) or self.panel is not None)
        look = controller.settings.colour_by, ruler_of(controller.image)
        self.legend.say(words.legend(records, look) if records else "")

    def _show_running(self) -> None:
        controller, progress = self.controller, self.controller.progress
        self.stage.say(words.stage(progress, controller.left))
        self.cancel.setEnabled(controller.job is not None)
        self.bar.setValue(round(100 * progress.fraction) if progress else 0)
        self.progress.setVisible(progress is not None)
        self.notice.say(words.notice(*controller.notice))

    def _show_saved(self) -> None:
        place, image = self.saver.place, self.controller.image
        source = image.source.path if image else None
        said = words.saved(place, source, self.controller.settings.save_work)
        self.saved.setText(said)
        self.saved.setToolTip(f"{place or said}\nChange it under Settings")

    def _ask_where(self) -> None:
        if (image := self.controller.image) is None:
            return
        name = f"{re.sub(NO_NAME, ' ', image.name)}_labels{WRITERS[0].suffix}"
        if path := files.ask_where(self, self.controller, "Export curves", name, KINDS):
            self.controller.export(path)


class OfferBox(qt.QFrame):
    """Says what was found, with a button to go on and one to ignore it; hidden otherwise."""

    def __init__(self, controller: Controller, saver: Saver):
        super().__init__()
        self._controller, self._saver = controller, saver
        self.setFrameShape(qt.QFrame.Shape.StyledPanel)
        self.said, self.problem = ui.TextLabel(), ui.TextLabel()
        tip = "Bring the saved lines and curves back, in a layer of their own"
        self.resume = ui.Button("Resume", tip, saver.resume)
        tip = "Do not ask again; the saved work stays on the disk"
        self.decline = ui.Button("Ignore saved work", tip, saver.decline)
        tip = "Use these curves as results, with their review"
        self.labels = ui.Button("", tip, saver.take_up)
        rows = self.said, (self.resume, self.decline), self.labels, self.problem
        ui.stack(self, *rows, margin=4)

    def show_state(self) -> None:
        """Show what is offered now."""
        offers, curves, problem = self._saver.offers(), self._saver.brought, self._saver.problem
        for each, shown in ((self.resume, offers), (self.decline, offers), (self.labels, curves)):
            each.setVisible(bool(shown))
            each.setEnabled(self._controller.progress is None or each is self.decline)
        self.said.say(words.offered(list(offers.values())))
        self.labels.setText(f"Continue with {counted(curves, 'curve')}")
        self.problem.say(words.notice("failed", problem))
        self.setVisible(bool(curves or offers or problem))

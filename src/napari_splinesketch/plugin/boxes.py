"""The parts of the dock: each shows what it is told to, and passes on what the user does."""

from collections.abc import Sequence
from functools import partial
from typing import Any

from napari.layers import Layer
from qtpy.QtCore import Qt, Signal  # pyright: ignore[reportPrivateImportUsage]
from qtpy.QtGui import QAction
from qtpy.QtWidgets import (
    QComboBox,
    QFrame,
    QGridLayout,
    QHBoxLayout,
    QLabel,
    QMenu,
    QProgressBar,
    QPushButton,
    QSizePolicy,
    QSlider,
    QToolButton,
    QVBoxLayout,
    QWidget,
)
from superqt import QElidingLabel

from napari_splinesketch.engine.types import Curve, Progress
from napari_splinesketch.plugin import words
from napari_splinesketch.plugin.columns import COLUMNS
from napari_splinesketch.plugin.controller import Controller
from napari_splinesketch.plugin.layers.looks import COLOUR_BY, COLUMN, RAMP, ColourBy, scale_of
from napari_splinesketch.plugin.layers.pictures import Proof
from napari_splinesketch.plugin.layers.slot import Role
from napari_splinesketch.plugin.measures import Ruler, three_digits
from napari_splinesketch.plugin.plan import Scope
from napari_splinesketch.plugin.text_label import TextLabel
from napari_splinesketch.plugin.widgets import NARROW, button, enable, grid
from napari_splinesketch.plugin.work import Work


class ProgressBox(QWidget):
    """Bar and Cancel; keeps its room while nothing runs, so that nothing moves."""

    cancelled = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.bar = QProgressBar()
        self.bar.setRange(0, 100)
        self.bar.setToolTip("How far it is")
        self.bar.setMinimumWidth(NARROW)
        self.cancel = button("Cancel", "Stop", self.cancelled.emit)
        layout = QHBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(self.bar, 1)
        layout.addWidget(self.cancel)
        policy = self.sizePolicy()
        policy.setRetainSizeWhenHidden(True)
        self.setSizePolicy(policy)
        self.hide()

    def show_progress(self, progress: Progress | None, cancellable: bool) -> None:
        """Show where it stands, and whether it can be cancelled; None when nothing runs."""
        self.cancel.setEnabled(cancellable)
        if progress is not None:
            self.bar.setValue(round(100 * progress.fraction))
        self.setVisible(progress is not None)


class CurveBox(QWidget):
    """A button for each correction of the selected curve, and what is known of it.

    Parameters
    ----------
    controller
        Owns the state.
    """

    def __init__(self, controller: Controller):
        super().__init__()
        self._controller = controller
        self.title = QElidingLabel()
        self.title.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Fixed)
        self.buttons = {
            name: button(run=partial(controller.actions.run, name))
            for name in controller.actions.at("curve")
        }
        for each in self.buttons.values():
            each.setStyleSheet("padding: 3px 1px;")
        buttons = QWidget()
        grid(buttons, list(self.buttons.values()), 4, even=False)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(3)
        layout.addWidget(self.title)
        layout.addWidget(buttons)

    def show_selection(self) -> None:
        """Show what is selected, and what can be done to it."""
        controller = self._controller
        state = controller.work.state if controller.work else None
        found = [state.record(key) for key in controller.selection] if state else []
        records = [record for record in found if record is not None]
        deleted = bool(state and state.deleted)
        self.setVisible(bool(controller.records() or deleted))
        said = words.selected(records)
        self.title.setText(said)
        self.title.setToolTip(said)
        number, locked = len(records), bool(records) and all(r.locked for r in records)
        for name, widget in self.buttons.items():
            action = controller.actions[name]
            needed = action.curves
            few = "" if not needed or number in needed else f"Select {words.wanted(needed)}"
            if name == "restore" and not deleted:
                few = "No curve is deleted"
            problem = few or ("Something is running" if controller.progress else "")
            enable(widget, problem, controller.actions.tip(name))
            widget.setText("Unlock" if name == "lock" and locked else action.name)
        self.buttons["knots"].setText("Done" if controller.knots.active else "Knots")


class LookBox(QWidget):
    """What the colour of a curve says, and the legend that tells."""

    valueChanged = Signal(str)

    def __init__(self) -> None:
        super().__init__()
        self._seen: object = None
        self.by = QComboBox()
        self.by.addItems([f"Colour by {called(by)}" for by in COLOUR_BY])
        self.by.setMinimumWidth(NARROW)
        self.by.setToolTip("What the colour of a curve says; its marks always tell its status")
        self.words = TextLabel()
        self.ramp = QFrame()
        stops = ", ".join(f"stop: {i / (len(RAMP) - 1)} {c}" for i, c in enumerate(RAMP))
        self.ramp.setStyleSheet(
            f"QFrame {{ background: qlineargradient(x1: 0, y1: 0, x2: 1, y2: 0, {stops}); }}"
        )
        self.ramp.setMinimumSize(40, 10)
        self.low, self.high = QLabel(), QLabel()
        self.scale = QWidget()
        row = QHBoxLayout(self.scale)
        row.setContentsMargins(0, 0, 0, 0)
        row.addWidget(self.low)
        row.addWidget(self.ramp, 1)
        row.addWidget(self.high)
        grid(self, (self.by, self.words, self.scale), 1)
        self.by.activated.connect(lambda index: self.valueChanged.emit(COLOUR_BY[index]))

    def show_look(self, by: ColourBy, curves: Sequence[Curve], ruler: Ruler) -> None:
        """Show what the colours of these curves say."""
        seen = by, ruler, tuple(map(id, curves))
        if seen == self._seen:
            return
        self._seen = seen
        self.by.setCurrentIndex(COLOUR_BY.index(by))
        scale = scale_of(curves, (by, ruler))
        self.scale.setVisible(scale is not None)
        self.words.say(words.LEGEND if by == "status" else "")
        if scale is not None:
            unit = f" {ruler.unit}" if by != "residual" else ""
            self.low.setText(three_digits(scale[0]))
            self.high.setText(three_digits(scale[1]) + unit)


def called(by: ColourBy) -> str:
    """Say what a choice of colours is called."""
    return next(column.colour for column in COLUMNS if column.name == COLUMN.get(by, by))


class EyeBox(QWidget):
    """Buttons that show and hide layers, and a menu of more of them; follows the layers' eyes."""

    refused = Signal(str)
    """There is nothing to show, and why."""

    def __init__(self) -> None:
        super().__init__()
        self._work: Work | None = None
        self.buttons: dict[Role | str, QPushButton] = {}
        for role, (name, tip) in words.EYES.items():
            self.buttons[role] = made = button(name, tip)
            made.setCheckable(True)
            made.clicked.connect(partial(self._show, role))
        self.more = button("More", "Show more: residual, background, uncertainty, masks")
        self._entries: dict[Proof, Any] = {}
        menu = QMenu(self.more)
        menu.setToolTipsVisible(True)
        for proof, (name, tip) in words.PROOFS.items():
            self._entries[proof] = entry = QAction(name, menu)
            entry.setToolTip(tip)
            entry.setCheckable(True)
            entry.triggered.connect(partial(self._ask, proof))
            menu.addAction(entry)
        self.more.setMenu(menu)
        grid(self, [*self.buttons.values(), self.more], 3)

    def entry(self, proof: Proof) -> Any:
        """Give an entry of the menu."""
        return self._entries[proof]

    def show_work(self, work: Work | None) -> None:
        """Show which layers are visible."""
        self._work = work
        for role, made in self.buttons.items():
            layer = self._layer(role)
            made.setEnabled(layer is not None)
            made.setChecked(layer is not None and layer.visible)
        for proof, entry in self._entries.items():
            entry.setChecked(work is not None and work.proofs.shown(proof))

    def _layer(self, role: Any) -> Layer | None:
        return self._work.layer(role) if self._work is not None else None

    def _show(self, role: Role | str, on: bool) -> None:
        layer = self._layer(role)
        if layer is not None:
            layer.visible = on

    def _ask(self, proof: Proof, on: bool) -> None:
        if self._work is not None and not self._work.proofs.ask(proof, on):
            self._entries[proof].setChecked(False)
            self.refused.emit(words.NOTHING.get(proof, words.NOTHING_YET))


class RefineMenu(QToolButton):
    """An arrow beside the Refine button; its menu says what each choice would do now.

    Parameters
    ----------
    controller
        Who refines.
    """

    def __init__(self, controller: Controller):
        super().__init__()
        self._controller = controller
        self.setText("▾")
        self.setToolTip("Refine the selected curves, or all again")
        self.setPopupMode(QToolButton.ToolButtonPopupMode.InstantPopup)
        # napari's theme would draw an arrow of its own over the text.
        self.setStyleSheet("QToolButton::menu-indicator { image: none; }")
        self._menu = QMenu(self)
        self._menu.setToolTipsVisible(True)
        self._menu.aboutToShow.connect(self._fill)
        self.setMenu(self._menu)

    def _fill(self) -> None:
        self._menu.clear()
        scopes: dict[Scope, str] = {
            "selected": "Refine the selected",
            "all": "Refine all that are open",
        }
        for scope, name in scopes.items():
            request = self._controller.request(scope)
            possible = not request.problem and not self._controller.progress
            action = self._menu.addAction(words.button(request.plan) if possible else name)
            if action is not None:
                action.setEnabled(possible)
                action.setToolTip(request.problem)
                action.triggered.connect(partial(self._controller.refine, scope))


class SuggestBox(QWidget):
    """Suggest, and how much is taken for a body: the lines follow the slider.

    Parameters
    ----------
    controller
        Who suggests.
    """

    def __init__(self, controller: Controller):
        super().__init__()
        self._controller = controller
        self.button = button("Suggest lines", "", partial(controller.actions.run, "suggest"))
        self.slider = QSlider(Qt.Orientation.Horizontal)
        self.slider.setRange(0, 100)
        self.slider.setValue(round(100 * controller.films.sensitivity))
        self.slider.setMinimumWidth(40)
        self.slider.setAccessibleName("Sensitivity")
        layout = QGridLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(3)
        layout.setColumnStretch(1, 1)
        layout.addWidget(self.button, 0, 0, 1, 3)
        name = QLabel("Sensitivity")
        name.setAlignment(Qt.AlignmentFlag.AlignCenter)
        for i, widget in enumerate((QLabel("clear only"), name, QLabel("faint too"))):
            layout.addWidget(widget, 1, i)
        layout.addWidget(self.slider, 2, 0, 1, 3)
        self.slider.valueChanged.connect(self._on_slider)
        self._on_slider(self.slider.value())

    def show_state(self) -> None:
        """Show what can be done now."""
        controller = self._controller
        enable(self.button, controller.films.problem(), controller.actions.tip("suggest"))

    def _on_slider(self, value: int) -> None:
        self.slider.setToolTip(f"Sensitivity of Suggest, {value} %: {words.SENSITIVITY_TIP}")
        self._controller.films.change_sensitivity(value / 100)


class TrackBox(QWidget):
    """Carry curves through a film, both ways; hidden where there is but one frame.

    Parameters
    ----------
    controller
        Who tracks.
    """

    def __init__(self, controller: Controller):
        super().__init__()
        self._controller = controller
        actions = controller.actions
        self.buttons = {
            name: button(actions[name].name, run=partial(actions.run, name))
            for name in actions.at("film")
        }
        grid(self, list(self.buttons.values()), 2)

    def show_state(self) -> None:
        """Show what can be done now."""
        controller = self._controller
        self.setVisible(controller.films.frames() > 1)
        for name, made in self.buttons.items():
            way = -1 if name in ("previous_frame", "track_back") else 1
            enable(made, controller.films.tracking_problem(way), controller.actions.tip(name))

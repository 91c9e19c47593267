"""The parts of the dock: each shows what it is told to, and passes on what the user does."""

from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import Any

from magicgui.widgets import create_widget
from qtpy import QtWidgets as qt
from qtpy.QtCore import Qt  # pyright: ignore[reportPrivateImportUsage]
from superqt import QElidingLabel

from napari_splinesketch.engine.types import Progress
from napari_splinesketch.labels.formats import WRITERS
from napari_splinesketch.plugin import widgets, words
from napari_splinesketch.plugin.choices import FORM, Settings
from napari_splinesketch.plugin.columns import COLOUR_BY, COLOURED, RAMP, scale_of, three_digits
from napari_splinesketch.plugin.controller import Controller
from napari_splinesketch.plugin.layers.pictures import MAKERS
from napari_splinesketch.plugin.layers.space import Ruler
from napari_splinesketch.plugin.model import Record
from napari_splinesketch.plugin.plan import Scope

FOLDER_TIP = "Where lines and curves are saved as they are made; what is saved stays where it is"
KEYS_TIP = "Opens napari's preferences: the keys are on the page of Splinesketch"
DECIMALS = 3
"""Of half-widths."""
KINDS = {f"{writer.name} (*{writer.suffix})": writer.suffix for writer in WRITERS}
"""The formats as a file dialog lists them, the first one proposed, and how their names end."""
DEFAULT = WRITERS[0].suffix


class ProgressBox(qt.QWidget):
    """Bar and Cancel; keeps its room while nothing runs, so that nothing moves."""

    def __init__(self, cancel: Callable[[], None]) -> None:
        super().__init__()
        self.bar = qt.QProgressBar()
        self.bar.setRange(0, 100)
        self.bar.setToolTip("Progress")
        self.bar.setMinimumWidth(widgets.NARROW)
        self.cancel = widgets.button("Cancel", "Stop", cancel)
        widgets.stack(self, (self.bar, self.cancel))
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


class CurveBox(qt.QWidget):
    """A button for each correction of the selected curve, and what is known of it."""

    def __init__(self, controller: Controller):
        super().__init__()
        self._controller = controller
        self.title = QElidingLabel()
        self.title.setSizePolicy(qt.QSizePolicy.Policy.Ignored, qt.QSizePolicy.Policy.Fixed)
        corrections = widgets.CommandButtons(controller.actions, "curve", 4, even=False)
        self.buttons, self._corrections = corrections.buttons, corrections
        for each in self.buttons.values():
            each.setStyleSheet("padding: 3px 1px;")
        widgets.stack(self, self.title, corrections)

    def show_state(self) -> None:
        """Show what is selected, and what can be done to it."""
        controller = self._controller
        known = bool(controller.records() or controller.state.deleted)
        self.setVisible(known)
        if not known:
            return
        said = words.selected(controller.selected_records(), controller.frame)
        self.title.setText(said)
        self.title.setToolTip(said)
        self._corrections.show_state()


class LookBox(qt.QWidget):
    """What the colour of a curve says, and the legend that tells."""

    def __init__(self, choose: Callable[[str], object]) -> None:
        super().__init__()
        self._seen: object = None
        self.by = qt.QComboBox()
        self.by.addItems([f"Colour by {column.colour}" for column in COLOURED.values()])
        self.by.setMinimumWidth(widgets.NARROW)
        self.by.setToolTip("What colours show; the marks beside curves always show the status")
        self.words = widgets.TextLabel()
        # A legend that wraps when a scroll bar comes would itself make that necessary.
        self.words.setWordWrap(False)
        ramp = qt.QFrame()
        stops = ", ".join(f"stop: {i / (len(RAMP) - 1)} {c}" for i, c in enumerate(RAMP))
        ramp.setStyleSheet(
            f"QFrame {{ background: qlineargradient(x1: 0, y1: 0, x2: 1, y2: 0, {stops}); }}"
        )
        ramp.setMinimumSize(40, 10)
        self.low, self.high, self.scale = qt.QLabel(), qt.QLabel(), qt.QWidget()
        widgets.grid(self.scale, (self.low, ramp, self.high), 3, even=False)
        widgets.stack(self, self.by, self.words, self.scale)
        self.by.activated.connect(lambda index: choose(COLOUR_BY[index]))

    def show_look(self, by: str, records: Sequence[Record], ruler: Ruler) -> None:
        """Show what the colours of these curves say."""
        if (by, ruler, records) == self._seen:
            return
        self._seen = by, ruler, records
        self.by.setCurrentIndex(COLOUR_BY.index(by))
        scale = scale_of(records, (by, ruler))
        self.scale.setVisible(scale is not None)
        self.words.say(words.LEGEND if by == "status" else "")
        if scale is not None:
            unit = f" {ruler.unit}" if COLOURED[by].kind == "length" else ""
            self.low.setText(three_digits(scale[0]))
            self.high.setText(three_digits(scale[1]) + unit)


class EyeBox(qt.QWidget):
    """Buttons that show and hide layers, and a menu of more of them; follows the layers' eyes."""

    def __init__(self, controller: Controller) -> None:
        super().__init__()
        self._controller = controller
        self.buttons = {role: widgets.button(name, tip) for role, (name, tip) in words.EYES.items()}
        for role, made in self.buttons.items():
            made.setCheckable(True)
            made.clicked.connect(partial(self._show, role))
        more = widgets.button("More", "Show more: residual, background, uncertainty, masks")
        menu = qt.QMenu(more)
        menu.setToolTipsVisible(True)
        self.entries: dict[str, Any] = {}
        for proof, maker in MAKERS.items():
            if maker.title:
                entry: Any = menu.addAction(maker.title)
                self.entries[proof] = entry
                entry.setToolTip(maker.tip)
                entry.setCheckable(True)
                entry.triggered.connect(partial(self._ask, proof))
        more.setMenu(menu)
        widgets.grid(self, [*self.buttons.values(), more], 3)

    def show_state(self) -> None:
        """Show which layers are visible."""
        work = self._controller.work
        for role, made in self.buttons.items():
            layer = work.layer(role) if work else None
            made.setEnabled(layer is not None)
            made.setChecked(layer is not None and layer.visible)
        for proof, entry in self.entries.items():
            entry.setChecked(work is not None and work.layers.made[proof].shown)

    def _show(self, role: str, on: bool) -> None:
        work = self._controller.work
        layer = work.layer(role) if work else None
        if layer is not None:
            layer.visible = on

    def _ask(self, proof: str, on: bool) -> None:
        work = self._controller.work
        if work is not None and not work.layers.ask(proof, on):
            self.entries[proof].setChecked(False)
            self._controller.say(MAKERS[proof].nothing)


class RefineMenu(qt.QToolButton):
    """An arrow beside the Refine button; its menu says what each choice would do now."""

    def __init__(self, controller: Controller):
        super().__init__()
        self._controller = controller
        self.setText("▾")
        self.setToolTip("Refine the selected curves, or all again")
        self.setPopupMode(qt.QToolButton.ToolButtonPopupMode.InstantPopup)
        # napari's theme would draw an arrow of its own over the text.
        self.setStyleSheet("QToolButton::menu-indicator { image: none; }")
        self._menu = qt.QMenu(self)
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
            plan = self._controller.request(scope)
            possible = not plan.problem and not self._controller.progress
            action: Any = self._menu.addAction(words.button(plan) if possible else name)
            action.setEnabled(possible)
            action.setToolTip(plan.problem)
            action.triggered.connect(partial(self._controller.refine, scope))


class SuggestBox(qt.QWidget):
    """How much Suggest takes for a body: the lines follow the slider."""

    def __init__(self, controller: Controller):
        super().__init__()
        self._suggestions = controller.suggestions
        self.button = widgets.CommandButton(controller.actions, "suggest")
        self.slider = qt.QSlider(Qt.Orientation.Horizontal)
        self.slider.setRange(0, 100)
        self.slider.setValue(round(100 * controller.suggestions.sensitivity))
        self.slider.setMinimumWidth(40)
        self.slider.setAccessibleName("Sensitivity")
        name, ends = qt.QLabel("Sensitivity"), qt.QWidget()
        name.setAlignment(Qt.AlignmentFlag.AlignCenter)
        widgets.grid(ends, (qt.QLabel("clear only"), name, qt.QLabel("faint too")), 3, even=False)
        widgets.stack(self, ends, self.slider)
        self.slider.valueChanged.connect(self._on_slider)
        self._on_slider(self.slider.value())

    def _on_slider(self, value: int) -> None:
        self.slider.setToolTip(f"Sensitivity of Suggest, {value} %: {words.SENSITIVITY_TIP}")
        self._suggestions.change_sensitivity(value / 100)


class SettingsForm(qt.QWidget):
    """Widgets for the settings in `FORM`, which magicgui makes; the preset's stands elsewhere."""

    def __init__(self, choose: Callable[..., object]) -> None:
        super().__init__()
        self._choose = choose
        self._settings, self._ruler = Settings(), Ruler()
        self.widgets = {each.name: _widget(each) for each in fields(Settings) if each.name in FORM}
        for name, made in self.widgets.items():
            made.changed.connect(partial(self._take, name))
        rest = widgets.form(*(made for name, made in self.widgets.items() if name != "preset"))
        keys = widgets.button("Change keys…", KEYS_TIP, _open_preferences)
        elsewhere = widgets.button("Save work elsewhere…", FOLDER_TIP, self._ask_for_folder)
        beside = widgets.button(
            "Save work beside the image", FOLDER_TIP, partial(self._take, "work_folder", "")
        )
        widgets.stack(self, rest, keys, elsewhere, beside)
        self.half_width = self.widgets["half_width"].native
        self.half_width.setDecimals(DECIMALS)
        self.half_width.setKeyboardTracking(False)
        self.half_width.setSpecialValueText("auto")

    def show_settings(self, settings: Settings, ruler: Ruler) -> None:
        """Show what is chosen, silently; lengths in the unit of the image."""
        self._settings, self._ruler = settings, ruler
        self.half_width.setSuffix(f" {ruler.unit}")
        width = (settings.half_width_in(ruler) or 0.0) * ruler.pixel
        for name, made in self.widgets.items():
            value = round(width, DECIMALS) if name == "half_width" else getattr(settings, name)
            if made.value != value:
                with made.changed.blocked():
                    made.value = value

    def _take(self, name: str, value: Any) -> None:
        changes = {name: value}
        if name == "half_width":
            changes = {"half_width": value or None, "half_width_unit": self._ruler.unit}
        if replace(self._settings, **changes) != self._settings:
            self._choose(**changes)

    def _ask_for_folder(self) -> None:
        folder = qt.QFileDialog.getExistingDirectory(
            self, "Save work in", self._settings.work_folder
        )
        if folder:
            self._take("work_folder", folder)


def _widget(each: Any) -> Any:
    """Make the widget of a setting."""
    how, help_text = dict(FORM[each.name]), each.metadata["help"].partition(" (")[0]
    options = {"tooltip": help_text[0].upper() + help_text[1:], **how}
    label = options.pop("label")
    value = 0.0 if each.default is None else each.default
    kind = "ComboBox" if "choices" in how else None
    made = create_widget(value, name=each.name, label=label, widget_type=kind, options=options)
    made.native.setMinimumWidth(widgets.NARROW)
    return made


def _open_preferences() -> None:
    """Open napari's preferences."""
    from napari._app_model import get_app_model

    get_app_model().commands.execute_command("napari.window.file.show_preferences_dialog")


def ask_where(parent: qt.QWidget, folder: Path, name: str) -> tuple[Path, bool] | None:
    """Let the user choose a file, and say whether it may be replaced; None if she does not.

    The dialog asks for the name that was typed, not for one that it got an ending for.
    """
    chosen, kind = qt.QFileDialog.getSaveFileName(
        parent, "Export curves", str(folder / f"{name}{DEFAULT}"), ";;".join(KINDS)
    )
    if not chosen:
        return None
    path = with_ending(chosen, KINDS.get(kind, DEFAULT))
    return Path(path), path == chosen


def with_ending(path: str, suffix: str) -> str:
    """Give a path the ending of the chosen format, in the place of any that it has.

    Dialogs keep the ending when another format is chosen: `labels.json`, then COCO, becomes
    `labels.coco.json`. A name that ends like another format is left alone while the format is the
    one that was proposed: then the name says what is wanted.
    """
    low, suffixes = path.lower(), set(KINDS.values())
    known = suffixes | {Path(f"x{each}").suffix for each in suffixes}
    ending = max((each for each in known if low.endswith(each)), key=len, default="")
    if low.endswith(suffix) or (suffix == DEFAULT and ending in suffixes):
        return path
    return path[: len(path) - len(ending)] + suffix

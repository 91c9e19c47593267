"""The parts of the dock: each shows what it is told to, and passes on what the user does."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from magicgui.widgets import create_widget
from napari._app_model import get_app_model
from qtpy import QtWidgets as qt
from qtpy.QtCore import Qt  # pyright: ignore[reportPrivateImportUsage]
from superqt import QElidingLabel

from napari_splinesketch.engine.types import Progress
from napari_splinesketch.labels.formats import WRITERS
from napari_splinesketch.plugin import widgets, words
from napari_splinesketch.plugin.choices import FORM, Settings
from napari_splinesketch.plugin.controller import Controller
from napari_splinesketch.plugin.layers.pictures import MAKERS
from napari_splinesketch.plugin.layers.space import ruler_of
from napari_splinesketch.plugin.plan import Scope
from napari_splinesketch.plugin.saver import Saver

FOLDER_TIP = "Where lines and curves are saved as they are made; what is saved stays where it is"
PREFERENCES = "napari.window.file.show_preferences_dialog"
RESUME_TIP = "Bring the saved lines and curves back, in a layer of their own"
IGNORE_TIP = "Do not ask again; the saved work stays on the disk"
LABELS_TIP = "Take these curves up as results, as they were judged"
KEYS_TIP = "Opens napari's preferences: the keys are on the page of Splinesketch"
APART = ("preset", "colour_by")
DECIMALS = 3
"""Of half-widths."""
SCOPES: dict[Scope, str] = {"selected": "Refine the selected", "all": "Refine all that are open"}
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
        self.cancel = widgets.Button("Cancel", "Stop", cancel)
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


class OfferBox(qt.QFrame):
    """Says what was found, with a button to go on and one to ignore it; hidden otherwise."""

    def __init__(self, controller: Controller, saver: Saver):
        super().__init__()
        self._controller, self._saver = controller, saver
        self.setFrameShape(qt.QFrame.Shape.StyledPanel)
        self.said, self.problem = widgets.TextLabel(), widgets.TextLabel()
        self.resume = widgets.Button("Resume", RESUME_TIP, saver.resume)
        self.decline = widgets.Button("Ignore saved work", IGNORE_TIP, saver.decline)
        self.labels = widgets.Button("", LABELS_TIP, saver.take_up)
        rows = self.said, (self.resume, self.decline), self.labels, self.problem
        widgets.stack(self, *rows, margin=4)
        changes = controller.changes
        for signal in (saver.found, changes.layers, changes.curves, changes.busy):
            signal.connect(self.show_state)
        self.destroyed.connect(lambda: saver.found.disconnect(self.show_state, missing_ok=True))
        self.show_state()

    def show_state(self) -> None:
        """Show what is offered now."""
        offers, curves = self._saver.offers(), self._saver.brought
        for each in (self.resume, self.labels):
            each.setEnabled(self._controller.progress is None)
        for each in (self.resume, self.decline):
            each.setVisible(bool(offers))
        self.said.say(words.offered(list(offers.values())))
        self.labels.setText(f"Continue with these {words.count(curves, 'curve')}")
        self.labels.setVisible(bool(curves))
        self.problem.say(words.notice("failed", self._saver.problem))
        self.setVisible(bool(curves or offers or self._saver.problem))


class CurveBox(qt.QWidget):
    """A button for each correction of the selected curve, and what is known of it."""

    def __init__(self, controller: Controller):
        super().__init__()
        self._controller = controller
        self.title = QElidingLabel()
        self.title.setSizePolicy(qt.QSizePolicy.Policy.Ignored, qt.QSizePolicy.Policy.Fixed)
        self._corrections = widgets.CommandButtons(controller.actions, "curve", 4)
        self._corrections.setStyleSheet("QPushButton { padding: 3px 1px; }")
        self.buttons = self._corrections.buttons
        widgets.stack(self, self.title, self._corrections)

    def show_state(self) -> None:
        """Show what is selected, and what can be done to it."""
        controller = self._controller
        self.setVisible(bool(controller.records() or controller.state.deleted))
        if not self.isHidden():
            said = words.selected(controller.selected_records(), controller.frame)
            self.title.setText(said)
            self.title.setToolTip(said)
            self._corrections.show_state()


class EyeBox(qt.QWidget):
    """Buttons that show and hide layers, and a menu of more of them; follows the layers' eyes."""

    def __init__(self, controller: Controller) -> None:
        super().__init__()
        self._controller = controller
        self.buttons = {role: widgets.Button(name, tip) for role, (name, tip) in words.EYES.items()}
        more = widgets.Button("More", "Show more: residual, background, uncertainty, masks")
        menu: Any = qt.QMenu(more)
        menu.setToolTipsVisible(True)
        self.entries: dict[str, Any] = {}
        for role, maker in MAKERS.items():
            if maker.title:
                self.entries[role] = menu.addAction(maker.title)
                self.entries[role].setToolTip(maker.tip)
        more.setMenu(menu)
        eyes: dict[str, Any] = {**self.buttons, **self.entries}
        for role, eye in eyes.items():
            eye.setCheckable(True)
            (eye.triggered if role in self.entries else eye.clicked).connect(
                partial(self._ask, role)
            )
        made = [*self.buttons.values(), more]
        widgets.stack(self, made[:3], made[3:])

    def show_state(self) -> None:
        """Show which layers are visible."""
        work = self._controller.work
        for role, eye in (self.buttons | self.entries).items():
            layer = work.layer(role) if work else None
            eye.setEnabled(layer is not None or role in self.entries)
            eye.setChecked(layer is not None and layer.visible)

    def _ask(self, role: str, on: bool) -> None:
        work = self._controller.work
        if work is not None and not work.ask(role, on):
            self.show_state()
            self._controller.say(MAKERS[role].nothing)


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
        for scope, name in SCOPES.items():
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
        ends = [qt.QLabel(said) for said in ("clear only", "Sensitivity", "faint too")]
        for label, side in zip(ends[1:], ("AlignHCenter", "AlignRight"), strict=True):
            label.setAlignment(getattr(Qt.AlignmentFlag, side) | Qt.AlignmentFlag.AlignVCenter)
        widgets.stack(self, ends, self.slider)
        self.slider.valueChanged.connect(self._on_slider)
        self._on_slider(self.slider.value())

    def _on_slider(self, value: int) -> None:
        self.slider.setToolTip(f"Sensitivity of Suggest, {value} %: {words.SENSITIVITY_TIP}")
        self._suggestions.change_sensitivity(value / 100)


class SettingsForm(qt.QWidget):
    """Widgets for the settings in `FORM`, which magicgui makes; some stand `APART` from it."""

    def __init__(self, controller: Controller) -> None:
        super().__init__()
        self._controller = controller
        self.widgets: dict[str, Any] = {}
        for name, how in FORM.items():
            options, value = dict(how), getattr(Settings, name)
            kind = "ComboBox" if "choices" in how else None
            named: Any = {"name": name, "label": options.pop("label"), "widget_type": kind}
            made: Any = create_widget(0.0 if value is None else value, **named, options=options)
            made.native.setMinimumWidth(widgets.NARROW)
            made.changed.connect(partial(self._take, name))
            self.widgets[name] = made
        rest = widgets.form(*(made for name, made in self.widgets.items() if name not in APART))
        run = partial(get_app_model().commands.execute_command, PREFERENCES)
        keys = widgets.Button("Change keys…", KEYS_TIP, run)
        elsewhere = widgets.Button("Save work elsewhere…", FOLDER_TIP, self._ask_for_folder)
        beside = widgets.Button(
            "Save work beside the image", FOLDER_TIP, partial(self._take, "work_folder", "")
        )
        widgets.stack(self, rest, keys, elsewhere, beside)
        self.half_width = self.widgets["half_width"].native
        self.half_width.setDecimals(DECIMALS)
        self.half_width.setKeyboardTracking(False)
        self.half_width.setSpecialValueText("auto")

    def show_state(self) -> None:
        """Show what is chosen, silently; lengths in the unit of the image."""
        settings, ruler = self._controller.settings, ruler_of(self._controller.choices.image)
        self.half_width.setSuffix(f" {ruler.unit}")
        width = (settings.half_width_in(ruler) or 0.0) * ruler.pixel
        for name, made in self.widgets.items():
            value = round(width, DECIMALS) if name == "half_width" else getattr(settings, name)
            if made.value != value:
                with made.changed.blocked():
                    made.value = value

    def _take(self, name: str, value: Any) -> None:
        controller, changes = self._controller, {name: value}
        if name == "half_width":
            unit = ruler_of(controller.choices.image).unit
            changes = {"half_width": value or None, "half_width_unit": unit}
        if replace(controller.settings, **changes) != controller.settings:
            controller.choose(**changes)

    def _ask_for_folder(self) -> None:
        before = self._controller.settings.work_folder
        if folder := qt.QFileDialog.getExistingDirectory(self, "Save work in", before):
            self._take("work_folder", folder)


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

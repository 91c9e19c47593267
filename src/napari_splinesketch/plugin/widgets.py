"""The parts of the dock and of its panel."""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, cast

from magicgui.widgets import CheckBox, create_widget
from napari._app_model import get_app_model
from napari.layers import Layer, Shapes
from qtpy import QtWidgets as qt
from qtpy.QtCore import QEvent, QObject, QSize, Qt  # pyright: ignore[reportPrivateImportUsage]
from qtpy.QtGui import QKeyEvent, QResizeEvent
from superqt import QElidingLabel

from napari_splinesketch.plugin import choices, films, words
from napari_splinesketch.plugin.commands import Commands, Place
from napari_splinesketch.plugin.controller import Controller
from napari_splinesketch.plugin.layers.pictures import ASKED, MAKERS
from napari_splinesketch.plugin.layers.results import Work
from napari_splinesketch.plugin.layers.space import ruler_of

WIDTH = 250  # least of the dock, px: with its own font, napari gives it no more
NARROW = 60  # least width of a combo box, px: a dock of 250 px has room for it beside its label
FOLDER_TIP = "Where lines and curves are saved as they are made; what is saved stays where it is"
PREFERENCES = "napari.window.file.show_preferences_dialog"
APART = ("preset", "colour_by")
DECIMALS = 3  # of half-widths, at least: more where a pixel is small in its unit
LINES = 5  # of text that there is always room for above Export
RIGHT = Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter


class Button(qt.QPushButton):
    """A button that leaves the keys to the canvas when it is clicked."""

    def __init__(self, text: str = "", tip: str = "", run: Callable[[], object] = lambda: None):
        super().__init__(text)
        self.setToolTip(tip)
        self.setMinimumWidth(30)
        self.setFocusPolicy(Qt.FocusPolicy.TabFocus)
        self.clicked.connect(lambda: run())

    def allow(self, problem: str, tip: str) -> None:
        """Enable it, or let its tooltip say why not."""
        self.setEnabled(not problem)
        self.setToolTip(f"{tip}\n{problem}".rstrip())


class MenuButton(Button):
    """A button that opens a menu: its `entries` by what they are called, and what each does."""

    def __init__(self, text: str, tip: str, runs: Mapping[str, Callable[[], object]]):
        super().__init__(text, tip)
        menu: Any = qt.QMenu(self)
        menu.setToolTipsVisible(True)
        self.setMenu(menu)
        self.entries: list[Any] = [menu.addAction(name) for name in runs]
        for entry, run in zip(self.entries, runs.values(), strict=True):
            entry.triggered.connect(lambda *_, run=run: run())


def stack(
    widget: qt.QWidget, *rows: qt.QWidget | Sequence[qt.QWidget], margin: int = 0
) -> qt.QVBoxLayout:
    """Lay widgets out below each other; those of a list share a row, of a tuple the first grows."""
    column = _tight(qt.QVBoxLayout(widget), margin)
    for each in rows:
        if isinstance(each, qt.QWidget):
            column.addWidget(each)
            continue
        row = _tight(qt.QHBoxLayout())
        for i, one in enumerate(each):
            row.addWidget(one, isinstance(each, list) or not i)
        column.addLayout(row)
    return column


def form(*rows: Any) -> qt.QWidget:
    """Lay magicgui's widgets out below each other, with their labels."""
    made = qt.QWidget()
    layout = _tight(qt.QFormLayout(made))
    layout.setRowWrapPolicy(qt.QFormLayout.RowWrapPolicy.WrapLongRows)
    layout.setFieldGrowthPolicy(qt.QFormLayout.FieldGrowthPolicy.AllNonFixedFieldsGrow)
    for each in rows:
        layout.addRow("" if isinstance(each, CheckBox) else each.label, each.native)
    return made


def leave_keys(parent: qt.QWidget) -> None:
    """Leave the keys to the canvas when something is chosen with the mouse: boxes would take them.

    A letter then chose the entry that begins with it. The wheel is left to what scrolls: it would
    choose something else wherever it passes.
    """
    for kind in (qt.QComboBox, qt.QAbstractSpinBox, qt.QSlider):
        for box in parent.findChildren(kind):
            cast(Any, box).wheelEvent = QEvent.ignore
    for box in parent.findChildren(qt.QComboBox):
        box.setFocusPolicy(Qt.FocusPolicy.TabFocus)


def _tight(layout: Any, margin: int = 0) -> Any:
    layout.setContentsMargins(margin, margin, margin, margin)
    layout.setSpacing(3)
    return layout


class CommandButton(Button):
    """A button that carries out a command, or says why it cannot."""

    def __init__(self, actions: Commands, name: str):
        super().__init__(run=lambda: actions.run(name, by_button=True))
        self._actions, self._name = actions, name
        self.show_state()

    def show_state(self) -> None:
        """Show what the command is called now, and whether it can be carried out."""
        self.setText(self._actions.label(self._name))
        self.allow(self._actions.problem(self._name), self._actions.tip(self._name))


class CommandButtons(qt.QWidget):
    """A button for each command of a place, in so many columns, below a title."""

    def __init__(self, actions: Commands, place: Place, columns: int):
        super().__init__()
        self.title = QElidingLabel()
        self.title.setSizePolicy(qt.QSizePolicy.Policy.Ignored, qt.QSizePolicy.Policy.Fixed)
        names = [name for name, command in actions.table.items() if command.place == place]
        self.buttons = {name: CommandButton(actions, name) for name in names}
        layout = _tight(qt.QGridLayout())
        for i, made in enumerate(self.buttons.values()):
            made.setMinimumWidth(0)  # as broad as its text, at least
            alone = i % columns == 0 and i == len(self.buttons) - 1
            layout.addWidget(made, i // columns, i % columns, 1, columns if alone else 1)
            layout.setColumnStretch(i % columns, 1)
        stack(self, self.title).addLayout(layout)

    def show_state(self, title: str = "") -> None:
        """Show what can be done now, below a title."""
        for made in () if self.isHidden() else self.buttons.values():
            made.show_state()
        self.title.setText(title)
        self.title.setToolTip(title)
        self.title.setVisible(bool(title))


class TextLabel(qt.QLabel):
    """Wraps its text, can be copied from, and takes no room while it says nothing."""

    def __init__(self) -> None:
        super().__init__()
        self.setWordWrap(True)
        self.setTextFormat(Qt.TextFormat.RichText)
        self.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.setSizePolicy(qt.QSizePolicy.Policy.Ignored, qt.QSizePolicy.Policy.Minimum)
        self.hide()

    def say(self, text: str) -> None:
        """Show a rich text, or nothing."""
        self.setText(text)
        self.setVisible(bool(text))


class Folded(qt.QWidget):
    """A title with an arrow that unfolds a widget, of any height: superqt's cuts long texts off."""

    def __init__(self, title: str, tip: str, content: qt.QWidget):
        super().__init__()
        self.title, self.content = qt.QToolButton(), content
        self.title.setText(title)
        self.title.setToolTip(tip)
        self.title.setCheckable(True)
        self.title.setToolButtonStyle(Qt.ToolButtonStyle.ToolButtonTextBesideIcon)
        self.title.setStyleSheet("QToolButton { border: none; background: transparent; }")
        stack(self, self.title, content)
        self.title.toggled.connect(self._fold)
        self._fold(False)

    def _fold(self, open_: bool) -> None:
        self.title.setArrowType(Qt.ArrowType.DownArrow if open_ else Qt.ArrowType.RightArrow)
        self.content.setVisible(open_)


class Column(qt.QScrollArea):
    """Scrolls when the user scrolls, and never by itself."""

    least = WIDTH

    def __init__(self, content: qt.QWidget):
        super().__init__()
        self.setWidget(content)
        self.setWidgetResizable(True)
        self.setFrameShape(qt.QFrame.Shape.NoFrame)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)

    def minimumSizeHint(self) -> QSize:
        """Leave room for the width of the content: napari's font may be large."""
        least, widget, bar = super().minimumSizeHint(), self.widget(), self.verticalScrollBar()
        if widget and bar:
            room = widget.minimumSizeHint().width() + bar.sizeHint().width()
            least.setWidth(max(self.least, room))
        return least

    def event(self, a0: QEvent | None) -> bool:
        """Ask for another width when the content does."""
        if a0 and a0.type() == QEvent.Type.LayoutRequest:
            self.updateGeometry()
        return super().event(a0)

    def focusNextPrevChild(self, next: bool) -> bool:  # noqa: A002
        """Move the focus; a button that is disabled gives it away, and nothing scrolls for that."""
        bar, before = self.verticalScrollBar(), qt.QApplication.focusWidget()
        place = bar.value() if bar else 0
        moved = super().focusNextPrevChild(next)
        if bar and not (before and before.isEnabled() and before.isVisible()):
            bar.setValue(place)
        return moved


class Texts(Column):
    """Texts below each other, which scroll where they are long and the dock is low.

    There is always room for some lines, so that nothing around moves.
    """

    least = NARROW

    def __init__(self, *texts: qt.QWidget):
        content = qt.QWidget()
        super().__init__(content)
        self._content, self._last = content, texts[-1]
        stack(content, *texts).insertStretch(0, 1)
        # As high as its texts in this width, not as what Qt thinks of them in a narrower one.
        content.setSizePolicy(qt.QSizePolicy.Policy.Preferred, qt.QSizePolicy.Policy.Ignored)
        self.setSizePolicy(qt.QSizePolicy.Policy.Preferred, qt.QSizePolicy.Policy.Maximum)

    def sizeHint(self) -> QSize:
        """Ask for all of the texts, beside a bar: one that is there stays while they need it."""
        least, bar, frame = self.minimumSizeHint(), self.verticalScrollBar(), 2 * self.frameWidth()
        width = self.width() - frame - (bar.sizeHint().width() if bar else 0)
        height = self._content.heightForWidth(width) + frame
        return QSize(least.width(), max(height, least.height()))

    def minimumSizeHint(self) -> QSize:
        """Make room in the font of the texts, which napari sets when they are shown."""
        lines = LINES * self._last.fontMetrics().lineSpacing()
        return QSize(super().minimumSizeHint().width(), lines)

    def resizeEvent(self, a0: QResizeEvent | None) -> None:
        """Ask for another height where lines are longer or shorter now."""
        super().resizeEvent(a0)
        self.updateGeometry()


class LayerChoice(qt.QComboBox):
    """A choice of the image, or of the sketches, which may be a new layer."""

    def __init__(self, controller: Controller, kind: type[Layer], label: str, tip: str):
        super().__init__()
        self.native, self.label, self._tip = self, label, tip
        self.choices: list[Layer | None] = []
        self._controller, self._kind = controller, kind
        self.setSizePolicy(qt.QSizePolicy.Policy.Ignored, qt.QSizePolicy.Policy.Fixed)
        self.setMinimumWidth(NARROW)
        self.activated.connect(self._pick)

    def show_state(self) -> None:
        """Offer the layers that there are now, and show the chosen one."""
        found = self._controller.layers(self._kind)
        chosen = self._controller.chosen(self._kind)
        self.choices = [*found, *([None] if self._kind is Shapes and found else [])]
        self.clear()
        self.addItems([layer.name if layer else "New layer" for layer in self.choices])
        self.setCurrentIndex(self.choices.index(chosen) if chosen in self.choices else -1)
        self.setToolTip(f"{self._tip}\n{chosen.name}" if chosen else self._tip)
        self.setEnabled(bool(found))

    def _pick(self, index: int) -> None:
        controller, layer = self._controller, self.choices[index]
        if layer is not None:
            controller.choose_layer(self._kind, layer)
        elif controller.image is not None:
            controller.choose_layer(self._kind, None)
            controller.draw()

    def initStyleOption(self, option: qt.QStyleOptionComboBox | None) -> None:
        """Shorten a long name in the middle: those of an image and its sketches end differently."""
        super().initStyleOption(option)
        if option is not None and (style := self.style()) is not None:
            parts = qt.QStyle.ComplexControl.CC_ComboBox, qt.QStyle.SubControl.SC_ComboBoxEditField
            room = style.subControlRect(parts[0], option, parts[1], self).width() - 2
            middle, text = Qt.TextElideMode.ElideMiddle, self.currentText()
            option.currentText = self.fontMetrics().elidedText(text, middle, room)


class EyeBox(qt.QWidget):
    """Buttons that show and hide layers, and a menu of more of them; follows the layers' eyes."""

    def __init__(self, controller: Controller) -> None:
        super().__init__()
        self._controller = controller
        self.buttons = {
            role: Button(name, tip, partial(self._ask, role))
            for role, (name, tip) in words.EYES.items()
        }
        asked = {MAKERS[role].title: partial(self._ask, role) for role in ASKED}
        more = MenuButton("More", "Show more: residual, background, uncertainty, masks", asked)
        self.entries = dict(zip(ASKED, more.entries, strict=True))
        self._eyes: dict[str, Any] = {**self.buttons, **self.entries}
        for role, eye in self._eyes.items():
            eye.setCheckable(True)
            eye.setToolTip(MAKERS[role].tip if role in ASKED else eye.toolTip())
        made = [*self.buttons.values(), more]
        stack(self, made[:3], made[3:])

    def show_state(self) -> None:
        """Show which layers are visible."""
        work, runs = self._controller.work, self._controller.drawing.runs
        for role, eye in self._eyes.items():
            layer = work.layer(role) if work else None
            eye.setEnabled(layer is not None or role in ASKED)
            eye.setChecked((work, role) in runs or (layer is not None and layer.visible))

    def _ask(self, role: str) -> None:
        drawing, work = self._controller.drawing, self._controller.work
        if work is None:
            return
        layer, on = work.layer(role), self._eyes[role].isChecked()
        if on and role in ASKED:
            drawing.start((work, role), work.ask(role), partial(self._on_asked, work, role))
        else:
            drawing.runs.pop((work, role), None)
            if layer is not None:
                layer.visible = on
        self.show_state()

    def _on_asked(self, work: Work, role: str) -> None:
        self.show_state()
        if work is self._controller.work and work.layer(role) is None:
            self._controller.say(MAKERS[role].nothing)


class Sensitivity(qt.QSlider):
    """How much Suggest takes for a body: the lines follow the slider."""

    def __init__(self, suggestions: films.Suggestions):
        super().__init__(Qt.Orientation.Horizontal)
        self.setMinimumWidth(40)
        self.setAccessibleName("Sensitivity")
        self.setToolTip(
            "Sensitivity of Suggest: to the left only what stands out,\n"
            "to the right also what is faint or short"
        )
        self.setRange(0, 100)
        self.setValue(round(100 * suggestions.sensitivity))
        self.valueChanged.connect(lambda value: suggestions.change_sensitivity(value / 100))
        self.ends = [qt.QLabel(said) for said in ("clear only", "Sensitivity", "faint too")]
        self.ends[1].setAlignment(Qt.AlignmentFlag.AlignCenter)
        self.ends[2].setAlignment(RIGHT)


class SettingsForm(qt.QWidget):
    """Widgets for the settings in `FORM`, which magicgui makes; some stand `APART` from it."""

    def __init__(self, controller: Controller) -> None:
        super().__init__()
        self._controller, self.widgets = controller, dict[str, Any]()
        for name, options in choices.FORM.items():
            made: Any = create_widget(getattr(choices.Settings, name), name=name, options=options)
            made.native.setMinimumWidth(NARROW)
            made.changed.connect(partial(self._take, name))
            self.widgets[name] = made
        self.half_width = self.widgets["half_width"].native
        self.half_width.setDecimals(DECIMALS)
        self.half_width.setKeyboardTracking(False)
        self.half_width.setSpecialValueText("auto")
        # What was cleared is measured: Qt would bring back what was there before.
        self.half_width.setCorrectionMode(qt.QDoubleSpinBox.CorrectionMode.CorrectToNearestValue)
        for each in (self.half_width, self.half_width.lineEdit()):
            each.installEventFilter(self)
        chosen = form(*(made for name, made in self.widgets.items() if name not in APART))
        run = partial(get_app_model().commands.execute_command, PREFERENCES)
        tip = "Opens napari's preferences: the keys are on the page of Splinesketch"
        keys = Button("Change keys…", tip, run)
        elsewhere = Button("Save work elsewhere…", FOLDER_TIP, self._ask_for_folder)
        back = partial(self._take, "work_folder", "")
        beside = Button("Save work beside the image", FOLDER_TIP, back)
        stack(self, chosen, keys, elsewhere, beside)

    def show_state(self) -> None:
        """Show what is chosen, silently; lengths in the unit of the image.

        What is shown already stays: to set it again would undo what is being typed.
        """
        settings, ruler = self._controller.settings, ruler_of(self._controller.image)
        if self.half_width.suffix() != (unit := f" {ruler.unit}"):
            self.half_width.setSuffix(unit)
        decimals = max(DECIMALS, 2 - math.floor(math.log10(ruler.pixel)))
        if self.half_width.decimals() != decimals:
            with self.widgets["half_width"].changed.blocked():
                self.half_width.setDecimals(decimals)
        width = round((settings.half_width_in(ruler) or 0.0) * ruler.pixel, decimals)
        for name, made in self.widgets.items():
            chosen = width if name == "half_width" else getattr(settings, name)
            with made.changed.blocked():
                if made.value != chosen:
                    made.value = chosen

    def eventFilter(self, a0: QObject | None, a1: QEvent | None) -> bool:
        """Let what is typed after a click replace "auto", and take both . and , for decimals.

        Qt would refuse to add the one, and where commas are usual take 2.75 for 275.
        """
        box = self.half_width
        pressed = a1 if isinstance(a1, QKeyEvent) and a1.type() == QEvent.Type.KeyPress else None
        if pressed and pressed.text() in (".", ","):
            box.lineEdit().insert(box.locale().decimalPoint())
            return True
        released = a1 is not None and a1.type() == QEvent.Type.MouseButtonRelease
        if released and box.text() == box.specialValueText():
            box.selectAll()
        return super().eventFilter(a0, a1)

    def _take(self, name: str, value: Any) -> None:
        chosen = {name: value}
        if name == "half_width":
            chosen["half_width_unit"] = self.half_width.suffix().strip()  # as it was shown
        self._controller.choose(**chosen)

    def _ask_for_folder(self) -> None:
        before = self._controller.settings.work_folder
        if folder := qt.QFileDialog.getExistingDirectory(self, "Save work in", before):
            self._take("work_folder", folder)

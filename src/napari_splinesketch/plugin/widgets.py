"""Widgets that the dock is made of."""

from collections.abc import Callable, Sequence
from typing import Any

from magicgui.widgets import CheckBox
from napari.layers import Layer
from qtpy import QtWidgets as qt
from qtpy.QtCore import Qt  # pyright: ignore[reportPrivateImportUsage]
from qtpy.QtGui import QPaintEvent

from napari_splinesketch.plugin.commands import Commands, Place

NARROW = 60
"""Least width of a combo box, px: a dock of 250 px has room for it beside its label."""


class Button(qt.QPushButton):
    """A button that leaves the keys to the canvas when it is clicked."""

    def __init__(self, text: str = "", tip: str = "", run: Callable[[], object] | None = None):
        super().__init__(text)
        self.setToolTip(tip)
        self.setMinimumWidth(30)
        self.setFocusPolicy(Qt.FocusPolicy.TabFocus)
        if run is not None:
            self.clicked.connect(lambda: run())


def enable(widget: qt.QWidget, problem: str, tip: str) -> None:
    """Enable a widget, or let its tooltip say why not."""
    widget.setEnabled(not problem)
    widget.setToolTip(problem or tip)


def stack(
    widget: qt.QWidget, *rows: qt.QWidget | Sequence[qt.QWidget], margin: int = 0
) -> qt.QVBoxLayout:
    """Lay widgets out below each other in a widget.

    Those of a list share a row evenly; of others, the first one takes what is left.
    """
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


def _tight(layout: Any, margin: int = 0) -> Any:
    layout.setContentsMargins(margin, margin, margin, margin)
    layout.setSpacing(3)
    return layout


def form(*rows: Any) -> qt.QWidget:
    """Lay magicgui's widgets out below each other, with their labels beside or in them."""
    made = qt.QWidget()
    layout = _tight(qt.QFormLayout(made))
    layout.setRowWrapPolicy(qt.QFormLayout.RowWrapPolicy.WrapLongRows)
    layout.setFieldGrowthPolicy(qt.QFormLayout.FieldGrowthPolicy.AllNonFixedFieldsGrow)
    for each in rows:
        layout.addRow("" if isinstance(each, CheckBox) else each.label, each.native)
    return made


class CommandButton(Button):
    """A button that carries out a command, and says why it cannot."""

    def __init__(self, actions: Commands, name: str):
        super().__init__(run=lambda: actions.run(name))
        self._actions, self._name = actions, name
        self.show_state()

    def show_state(self) -> None:
        """Show what the command is called now, and whether it can be carried out."""
        self.setText(self._actions.label(self._name))
        enable(self, self._actions.problem(self._name), self._actions.tip(self._name))


class CommandButtons(qt.QWidget):
    """A button for each command that belongs to a place; there `when` something holds."""

    def __init__(
        self, actions: Commands, place: Place, columns: int, when: Callable[[], bool] = lambda: True
    ):
        super().__init__()
        self._when = when
        here = [command.id for command in actions if command.place == place]
        self.buttons = {name: CommandButton(actions, name) for name in here}
        layout = _tight(qt.QGridLayout(self))
        for i, made in enumerate(self.buttons.values()):
            made.setMinimumWidth(0)  # as broad as its text, at least
            alone = i % columns == 0 and i == len(here) - 1
            layout.addWidget(made, i // columns, i % columns, 1, columns if alone else 1)
            layout.setColumnStretch(i % columns, 1)

    def show_state(self) -> None:
        """Show what can be done now."""
        self.setVisible(self._when())
        for made in () if self.isHidden() else self.buttons.values():
            made.show_state()


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
        if text != self.text():
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
        self.title.toggled.connect(self._on_toggled)
        self._on_toggled(False)

    def _on_toggled(self, on: bool) -> None:
        self.title.setArrowType(Qt.ArrowType.DownArrow if on else Qt.ArrowType.RightArrow)
        self.content.setVisible(on)


class Column(qt.QScrollArea):
    """Scrolls when the user scrolls, and never by itself."""

    def __init__(self, content: qt.QWidget):
        super().__init__()
        self.setWidget(content)
        self.setWidgetResizable(True)
        self.setFrameShape(qt.QFrame.Shape.NoFrame)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)

    def focusNextPrevChild(self, next: bool) -> bool:  # noqa: A002
        """Move the focus; a button that is disabled gives it away, and nothing scrolls for that."""
        bar, before = self.verticalScrollBar(), qt.QApplication.focusWidget()
        place = bar.value() if bar else 0
        moved = super().focusNextPrevChild(next)
        if bar and not (before and before.isEnabled() and before.isVisible()):
            bar.setValue(place)
        return moved


class LayerChoice(qt.QComboBox):
    """A choice of layers, which calls `pick` when the user makes it.

    `new` names an entry for one more layer, which picks None. Long names are shortened in the
    middle, rather than widening the dock: those of an image and its sketches differ at the end.
    """

    def __init__(
        self,
        label: str,
        layers: Callable[[], Sequence[Layer]],
        pick: Callable[[Any], object],
        tip: str,
        new: str = "",
    ):
        super().__init__()
        self.label, self.native = label, self
        self.choices: list[Layer | None] = []
        self._layers, self._tip, self._new = layers, tip, new
        self.setSizePolicy(qt.QSizePolicy.Policy.Ignored, qt.QSizePolicy.Policy.Fixed)
        self.setMinimumWidth(NARROW)
        self.activated.connect(lambda index: pick(self.choices[index]))

    def show_layers(self, chosen: Layer | None) -> None:
        """Offer the layers that there are now, and show the chosen one."""
        found = self._layers()
        self.choices = [*found, *([None] if self._new and found else [])]
        self.clear()
        self.addItems([layer.name if layer else self._new for layer in self.choices])
        self.setCurrentIndex(self.choices.index(chosen) if chosen in self.choices else -1)
        self.setToolTip("\n".join([self._tip, *([chosen.name] if chosen else [])]))
        self.setEnabled(bool(found))

    def shortened(self, room: int) -> str:
        """Give the name of the chosen layer in so many px."""
        middle = Qt.TextElideMode.ElideMiddle
        return self.fontMetrics().elidedText(self.currentText(), middle, room)

    def paintEvent(self, e: QPaintEvent | None) -> None:
        """Paint a name that has an end."""
        option, painter = qt.QStyleOptionComboBox(), qt.QStylePainter(self)
        self.initStyleOption(option)
        parts = qt.QStyle.ComplexControl.CC_ComboBox, qt.QStyle.SubControl.SC_ComboBoxEditField
        style = self.style()
        room = style.subControlRect(parts[0], option, parts[1], self).width() if style else 0
        option.currentText = self.shortened(room - 2)
        painter.drawComplexControl(parts[0], option)
        painter.drawControl(qt.QStyle.ControlElement.CE_ComboBoxLabel, option)

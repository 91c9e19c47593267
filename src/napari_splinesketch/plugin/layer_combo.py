"""A combo box of layers."""

from collections.abc import Sequence

from napari.layers import Layer
from qtpy.QtCore import QSignalBlocker, Qt, Signal  # pyright: ignore[reportPrivateImportUsage]
from qtpy.QtGui import QPaintEvent
from qtpy.QtWidgets import (
    QComboBox,
    QSizePolicy,
    QStyle,
    QStyleOptionComboBox,
    QStylePainter,
    QWidget,
)

MARGIN = 2
"""Beside the name, px."""


class LayerCombo(QComboBox):
    """Offers layers by name; says which one the user picks.

    Parameters
    ----------
    empty
        What it says when there is nothing to offer.
    tip
        What it is for.
    parent
        The widget that it belongs to.
    """

    picked = Signal(object)

    def __init__(self, empty: str, tip: str, parent: QWidget | None = None):
        super().__init__(parent)
        self._empty = empty
        self._tip = tip
        self._layers: tuple[Layer, ...] = ()
        # Long names are shortened rather than widening the dock.
        self.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Fixed)
        self.setMinimumWidth(60)
        self.activated.connect(lambda index: self.picked.emit(self._layers[index]))

    def value(self) -> Layer | None:
        """Give the layer shown, or None."""
        index = self.currentIndex()
        return self._layers[index] if 0 <= index < len(self._layers) else None

    def show_layers(self, layers: Sequence[Layer], chosen: Layer | None) -> None:
        """Offer these layers and show the chosen one, silently."""
        with QSignalBlocker(self):
            self._layers = tuple(layers)
            self.clear()
            self.addItems([layer.name for layer in layers] or [self._empty])
            for i, layer in enumerate(layers):
                self.setItemData(i, layer.name, Qt.ItemDataRole.ToolTipRole)
            if chosen in self._layers:
                self.setCurrentIndex(self._layers.index(chosen))
        self.setEnabled(bool(layers))
        self.setToolTip("\n".join([self._tip, *([chosen.name] if chosen else [])]))

    def paintEvent(self, e: QPaintEvent | None) -> None:
        """Leave out the middle of a long name: names of layers differ at their end."""
        style, option = self.style(), QStyleOptionComboBox()
        if style is None:
            super().paintEvent(e)
            return
        self.initStyleOption(option)
        field = QStyle.SubControl.SC_ComboBoxEditField
        room = style.subControlRect(QStyle.ComplexControl.CC_ComboBox, option, field, self).width()
        option.currentText = self.fontMetrics().elidedText(
            option.currentText, Qt.TextElideMode.ElideMiddle, room - 2 * MARGIN
        )
        painter = QStylePainter(self)
        painter.drawComplexControl(QStyle.ComplexControl.CC_ComboBox, option)
        painter.drawControl(QStyle.ControlElement.CE_ComboBoxLabel, option)

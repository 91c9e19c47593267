"""A combo box of layers."""

from collections.abc import Sequence

from napari.layers import Layer
from qtpy.QtCore import QSignalBlocker, Qt, Signal  # pyright: ignore[reportPrivateImportUsage]
from qtpy.QtWidgets import QComboBox, QSizePolicy, QWidget


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
        # Long names are cut off rather than widening the dock.
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

"""Which image and which sketches are worked on, as layers come and go."""

from collections.abc import Callable
from typing import Any

from napari.components import ViewerModel
from napari.layers import Image, Layer, Shapes
from napari.layers.base import ActionType
from psygnal import Signal

from napari_splinesketch.plugin.adapter.roles import is_result


class Choices:
    """The chosen layers; follows the viewer.

    A layer that the user adds is chosen; when the chosen one is removed, the topmost of those left
    is. Layers of results are no choice.

    Parameters
    ----------
    viewer
        The viewer whose layers there are to choose from.
    """

    changed = Signal()
    """There are other layers, or another one is chosen, or one has another name."""
    edited = Signal()
    """What the chosen layers hold, or where they lie, or what is in view may have changed."""

    drawn = Signal()
    """The user has finished a line."""

    def __init__(self, viewer: ViewerModel):
        self._viewer = viewer
        self._image: Image | None = None
        self._sketches: Shapes | None = None
        active = viewer.layers.selection.active
        self._choose(*viewer.layers, *([active] if active else []))
        layers = viewer.layers.events
        self._connections: list[tuple[Any, Callable[[Any], None]]] = [
            (layers.inserted, self._on_inserted),
            (layers.removed, self._on_removed),
            (layers.reordered, self._on_layers),
            (layers.renamed, self._on_layers),
            (viewer.dims.events, self._on_edited),
        ]
        for signal, slot in self._connections:
            signal.connect(slot)

    def close(self) -> None:
        """Follow the viewer no longer, and choose nothing."""
        for signal, slot in self._connections:
            signal.disconnect(slot)
        self._listen(self._image, None)
        self._listen(self._sketches, None)
        self._image = self._sketches = None
        for signal in (self.changed, self.edited, self.drawn):
            signal.disconnect()

    def images(self) -> list[Image]:
        """Give the images to choose from, topmost first."""
        return [x for x in reversed(self._viewer.layers) if isinstance(x, Image) and free(x)]

    def sketch_layers(self) -> list[Shapes]:
        """Give the layers of sketches to choose from, topmost first."""
        return [x for x in reversed(self._viewer.layers) if isinstance(x, Shapes) and free(x)]

    @property
    def image(self) -> Image | None:
        """The image."""
        return self._image if self._is_there(self._image) else None

    @image.setter
    def image(self, layer: Image | None) -> None:
        self._listen(self._image, layer)
        self._image = layer
        self.changed.emit()

    @property
    def sketches(self) -> Shapes | None:
        """The layer of sketches."""
        return self._sketches if self._is_there(self._sketches) else None

    @sketches.setter
    def sketches(self, layer: Shapes | None) -> None:
        self._listen(self._sketches, layer)
        self._sketches = layer
        self.changed.emit()

    def _is_there(self, layer: Layer | None) -> bool:
        # napari tells of its sliders before it tells that a layer is gone.
        return layer in self._viewer.layers

    def _choose(self, *layers: Layer) -> None:
        for layer in layers:
            if isinstance(layer, Image) and free(layer):
                self.image = layer
            elif isinstance(layer, Shapes) and free(layer):
                self.sketches = layer

    def _listen(self, old: Layer | None, new: Layer | None) -> None:
        for layer, what in ((old, "disconnect"), (new, "connect")):
            if layer is None:
                continue
            for name in ("data", "scale", "translate", "rotate", "shear", "affine", "units"):
                getattr(getattr(layer.events, name), what)(self._on_edited)
            if isinstance(layer, Shapes):
                getattr(layer.events.mode, what)(self._on_edited)
                getattr(layer.selected_data.events.items_changed, what)(self._on_selected)

    def _on_inserted(self, event: Any) -> None:
        if free(event.value):
            self._choose(event.value)
            self.changed.emit()

    def _on_removed(self, event: Any) -> None:
        if event.value is self._image:
            self.image = next(iter(self.images()), None)
        if event.value is self._sketches:
            self.sketches = next(iter(self.sketch_layers()), None)
        self.changed.emit()

    def _on_layers(self, event: Any) -> None:
        self.changed.emit()

    def _on_edited(self, event: Any) -> None:
        self.edited.emit()
        if event.source is self._sketches and getattr(event, "action", None) == ActionType.ADDED:
            self.drawn.emit()

    def _on_selected(self) -> None:
        self.edited.emit()


def free(layer: Layer) -> bool:
    """Whether a layer is the user's own."""
    return not is_result(layer)

"""What may change in the window, and which image and sketches are worked on as layers come and go.

napari's own choice of layers would list results as well, and keeps the first one where work goes on
in the latest: so the choice is made here, and its combo boxes show it.
"""

from collections.abc import Callable
from typing import Any, TypeVar

from napari.components import ViewerModel
from napari.layers import Image, Layer, Shapes
from napari.layers.base import ActionType
from psygnal import Signal, SignalGroup

from napari_splinesketch.plugin.layers.slot import is_result

L = TypeVar("L", bound=Layer)
PLACED = ("data", "scale", "translate", "rotate", "shear", "affine", "units")
"""Events after which lines may lie elsewhere."""


LOOKED = ("point", "order", "ndisplay")
"""Events of the sliders after which something else is in view; their range says nothing of that."""


class Changes(SignalGroup):
    """All that may change, a signal for each kind: whoever shows something listens to that."""

    layers = Signal()
    """There are other layers, or another one is chosen, or one has another name."""
    edited = Signal()
    """What the chosen layers hold, or where they lie, or what is in view may have changed."""
    lines = Signal()
    """The same, but once for many edits in a row where there are many lines."""
    drawn = Signal()
    """The user has finished a line."""
    curves = Signal()
    """What is known of the curves, and what can be undone."""
    selection = Signal()
    """Which curves are selected."""
    clicked = Signal(bool)
    """The user has clicked into the layer of curves; with Shift, or without."""
    shown = Signal()
    """Which layers of results are there and in view."""
    mode = Signal()
    """Knots are shown or no longer, or were moved; lines are refined as they are drawn or not."""
    busy = Signal()
    """Something runs, or no longer, or can no longer be cancelled."""
    progress = Signal()
    """Where what runs stands."""
    said = Signal()
    """What the user is told."""
    settings = Signal()
    """What the user chose."""


def listen(*pairs: tuple[Any, Callable[..., Any]]) -> Callable[[], None]:
    """Connect signals to slots; gives what ends that."""
    for signal, slot in pairs:
        signal.connect(slot)

    def end() -> None:
        for signal, slot in pairs:
            signal.disconnect(slot)

    return end


class Choices:
    """The chosen layers; follows the viewer.

    A layer that the user adds is chosen; when the chosen one is removed, the topmost of those left
    is. Layers of results are no choice.
    """

    def __init__(self, viewer: ViewerModel, changes: Changes):
        self._viewer, self._changes = viewer, changes
        self._chosen: dict[type[Layer], Layer | None] = {Image: None, Shapes: None}
        active = viewer.layers.selection.active
        for layer in (*viewer.layers, *([active] if active else [])):
            self._choose(layer)
        layers = viewer.layers.events
        self._end = listen(
            (layers.inserted, self._on_inserted),
            (layers.removed, self._on_removed),
            (layers.reordered, self._on_layers),
            (layers.renamed, self._on_layers),
            *[(getattr(viewer.dims.events, name), self._on_edited) for name in LOOKED],
        )

    def close(self) -> None:
        """Follow the viewer no longer, and choose nothing."""
        self._end()
        for kind in self._chosen:
            self._set(kind, None)

    def images(self) -> list[Image]:
        """Give the images to choose from, topmost first."""
        return self._free(Image)

    def sketch_layers(self) -> list[Shapes]:
        """Give the layers of sketches to choose from, topmost first."""
        return self._free(Shapes)

    @property
    def image(self) -> Image | None:
        """The image, or None."""
        return self._there(Image)

    @image.setter
    def image(self, layer: Image | None) -> None:
        self._set(Image, layer)

    @property
    def sketches(self) -> Shapes | None:
        """The layer of sketches, or None."""
        return self._there(Shapes)

    @sketches.setter
    def sketches(self, layer: Shapes | None) -> None:
        self._set(Shapes, layer)

    def _free(self, kind: type[L]) -> list[L]:
        layers = [layer for layer in self._viewer.layers if not is_result(layer)]
        return [layer for layer in reversed(layers) if isinstance(layer, kind)]

    def _there(self, kind: type[L]) -> L | None:
        # napari tells of its sliders before it tells that a layer is gone.
        layer = self._chosen[kind]
        return layer if isinstance(layer, kind) and layer in self._viewer.layers else None

    def _set(self, kind: type[Layer], new: Layer | None) -> None:
        for layer, what in ((self._chosen[kind], "disconnect"), (new, "connect")):
            if layer is None:
                continue
            for name in PLACED:
                getattr(getattr(layer.events, name), what)(self._on_edited)
            if isinstance(layer, Shapes):
                getattr(layer.events.mode, what)(self._on_edited)
                getattr(layer.selected_data.events.items_changed, what)(self._on_selected)
        self._chosen[kind] = new
        self._changes.layers.emit()

    def _choose(self, layer: Layer) -> None:
        for kind in self._chosen:
            if isinstance(layer, kind) and not is_result(layer):
                self._set(kind, layer)

    def _on_inserted(self, event: Any) -> None:
        if not is_result(event.value):
            self._choose(event.value)
            self._changes.layers.emit()

    def _on_removed(self, event: Any) -> None:
        for kind, others in ((Image, self.images), (Shapes, self.sketch_layers)):
            if event.value is self._chosen[kind]:
                self._set(kind, next(iter(others()), None))
        self._changes.layers.emit()

    def _on_layers(self, event: Any) -> None:
        self._changes.layers.emit()

    def _on_edited(self, event: Any) -> None:
        self._changes.edited.emit()
        added = getattr(event, "action", None) == ActionType.ADDED
        if event.source is self._chosen[Shapes] and added:
            self._changes.drawn.emit()

    def _on_selected(self) -> None:
        self._changes.edited.emit()

"""Layers that are made when the user asks for them; they follow what is known while in view."""

from collections.abc import Mapping
from typing import Any

from napari.components import ViewerModel
from napari.layers import Labels, Layer, Shapes
from psygnal import Signal

from napari_splinesketch.plugin.adapter.pictures import MAKERS, Made, Proof, Proven
from napari_splinesketch.plugin.adapter.roles import OWNER, ROLE

NAMES: Mapping[Proof, str] = {
    "residual": "residual",
    "background": "background",
    "body": "selected body",
    "ribbon": "uncertainty",
    "masks": "masks",
    "stack": "masks, one a body",
}


class ProofLayers:
    """Residual, background, the selected body alone, uncertainty and masks of one image.

    Parameters
    ----------
    viewer
        Where the layers are added.
    name
        What their names begin with.
    owner
        What they show; kept in their metadata.
    """

    toggled = Signal()
    """A layer was made, shown or hidden."""

    def __init__(self, viewer: ViewerModel, name: str, owner: Proven):
        self._viewer = viewer
        self._name = name
        self._owner = owner
        self._layers: dict[Proof, Layer] = {}
        self._sources: dict[Proof, tuple[Any, ...]] = {}

    def layer(self, proof: Proof) -> Layer | None:
        """Give a layer, or None where it was not asked for or the user removed it."""
        layer = self._layers.get(proof)
        return layer if layer in self._viewer.layers else None

    def shown(self, proof: Proof) -> bool:
        """Whether a layer is in view."""
        layer = self.layer(proof)
        return layer is not None and layer.visible

    def ask(self, proof: Proof, on: bool) -> bool:
        """Show or hide a layer; False if there is nothing to show."""
        layer = self.layer(proof)
        if layer is not None:
            layer.visible = on
        elif on:
            self._update(proof)
        self.toggled.emit()
        return self.layer(proof) is not None or not on

    def update(self) -> None:
        """Bring the layers that are in view in step with what is known."""
        for proof in tuple(self._layers):
            if self.shown(proof):
                self._update(proof)

    def _update(self, proof: Proof) -> None:
        maker = MAKERS[proof]
        source, layer = maker.source(self._owner), self.layer(proof)
        if layer is not None and _same(self._sources.get(proof, ()), source):
            return
        self._sources[proof] = source
        made = maker.make(self._owner)
        active = self._viewer.layers.selection.active
        if layer is None:
            if made is not None:
                self._add(proof, made, None)
        elif made is None:
            self._viewer.layers.remove(layer)
        elif not made.into(layer):
            self._add(proof, made, layer)
        if active in self._viewer.layers:
            self._viewer.layers.selection.active = active

    def _add(self, proof: Proof, made: Made, old: Layer | None) -> None:
        layers, image = self._viewer.layers, self._owner.image
        marks = {ROLE: proof, OWNER: self._owner}
        layer = made.layer(f"{self._name} {NAMES[proof]}", marks)
        place = len(layers) if isinstance(layer, Shapes) else layers.index(image) + 1
        if old is not None:
            place = layers.index(old)
            layers.remove(old)
        self._layers[proof] = layer
        layers.insert(place, layer)
        if isinstance(layer, Labels):
            layer.editable = False
        layer.events.visible.connect(self._on_visible)

    def _on_visible(self, event: Any) -> None:
        self.update()
        self.toggled.emit()


def _same(a: tuple[Any, ...], b: tuple[Any, ...]) -> bool:
    return len(a) == len(b) and all(x is y for x, y in zip(a, b, strict=True))

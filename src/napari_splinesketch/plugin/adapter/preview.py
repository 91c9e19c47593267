"""Curves that are still on their way, in a light layer of their own."""

import gc
from collections.abc import Sequence
from contextlib import contextmanager

import numpy as np
from jaxtyping import Float
from napari.components import ViewerModel
from napari.layers import Image, Vectors

from napari_splinesketch import palette
from napari_splinesketch.plugin.adapter.pieces import pieces
from napari_splinesketch.plugin.adapter.roles import ROLE, put, undisturbed
from napari_splinesketch.plugin.adapter.sketches import line_style
from napari_splinesketch.plugin.adapter.space import in_stack, placement


class Preview:
    """Shows lines as vectors end to end, which napari draws anew in a few milliseconds.

    Parameters
    ----------
    viewer
        Where the layer is added when there is something to show.
    image
        The layer that the lines lie on.
    name
        What the layer is called.
    """

    def __init__(self, viewer: ViewerModel, image: Image, name: str):
        self._viewer = viewer
        self._image = image
        self._name = name
        self._layer: Vectors | None = None
        self._shown = False

    def show(self, frame: int, lines: Sequence[Float[np.ndarray, "N 2"]]) -> None:
        """Show lines of one frame, px; nothing if the user has removed the layer.

        The first time the layer is only made, hidden: that alone takes napari up to 0.1 s.
        """
        layer = self._layer
        if layer is None:
            self._layer = self._made()
            put(self._viewer, self._layer)
        elif layer in self._viewer.layers:
            stack = [in_stack(self._image, frame, line) for line in lines]
            layer.data = np.concatenate(pieces(stack))
            if not self._shown:
                self._shown = layer.visible = True

    def remove(self) -> None:
        """Take the layer away."""
        layer, self._layer, self._shown = self._layer, None, False
        if layer is not None and layer in self._viewer.layers:
            with undisturbed(self._viewer), _without_collecting():
                self._viewer.layers.remove(layer)

    def _made(self) -> Vectors:
        shape = self._image.level_shapes[0][self._image.ndim - 2 : self._image.ndim]
        return Vectors(
            ndim=self._image.ndim,
            name=self._name,
            vector_style="line",
            edge_width=line_style(shape)["edge_width"],
            edge_color=palette.MOVING,
            visible=False,
            metadata={ROLE: "preview"},
            **placement(self._image),
        )


@contextmanager
def _without_collecting():
    """Spare the window 0.13 s: napari collects all garbage whenever a layer goes."""
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()

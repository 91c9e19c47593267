"""The mark of the selected curves: broad lines in a light layer of their own.

To change one shape, napari draws a whole layer of shapes anew.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from napari.components import ViewerModel
from napari.layers import Image, Vectors

from napari_splinesketch.plugin.adapter.pieces import pieces
from napari_splinesketch.plugin.adapter.space import in_stack, placement
from napari_splinesketch.plugin.records import Key, Record, key_of

Mark = tuple[Key, int, str, float]
"""What a mark shows: a curve as it is, its colour and its breadth."""


class Highlight:
    """Draws curves over their lines.

    Parameters
    ----------
    viewer
        Where the layer is added, on top of all.
    image
        What the curves lie on.
    keywords
        Name and metadata of the layer.
    """

    def __init__(self, viewer: ViewerModel, image: Image, keywords: Mapping[str, Any]):
        self._viewer, self._image, self._keywords = viewer, image, keywords
        self._layer: Vectors | None = None
        self._shown: list[Mark] = []

    @property
    def layer(self) -> Vectors | None:
        """The layer, or None where there is none or the user removed it."""
        return self._layer if self._layer in self._viewer.layers else None

    def make(self) -> None:
        """Add the layer, with nothing in it."""
        self._shown = []
        self._layer = Vectors(
            ndim=self._image.ndim,
            vector_style="line",
            **self._keywords,
            **placement(self._image),
        )
        self._viewer.layers.append(self._layer)

    def show(self, records: Sequence[Record], colours: Sequence[str], breadth: float) -> None:
        """Mark these curves, and no others."""
        layer = self.layer
        shown = [
            (key_of(r), id(r.curve), colour, breadth)
            for r, colour in zip(records, colours, strict=True)
        ]
        if layer is None or shown == self._shown:
            return
        self._shown = shown
        lines = [in_stack(self._image, r.frame, r.curve.points) for r in records]
        cut = pieces(lines)
        layer.data = np.concatenate(cut) if cut else np.zeros((0, 2, self._image.ndim))
        if cut:
            layer.edge_width = breadth
            layer.edge_color = [
                c for c, some in zip(colours, cut, strict=True) for _ in range(len(some))
            ]

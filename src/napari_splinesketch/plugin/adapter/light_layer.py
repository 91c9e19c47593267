"""Lines as vectors end to end: napari draws thousands anew in the time that one shape takes."""

from collections.abc import Mapping, Sequence
from operator import is_
from typing import Any

import numpy as np
from jaxtyping import Float
from napari.components import ViewerModel
from napari.layers import Image, Vectors

from napari_splinesketch.plugin.adapter.colours import rgba
from napari_splinesketch.plugin.adapter.roles import put
from napari_splinesketch.plugin.adapter.space import placement

SAME_BREADTH = 0.1
"""Lines are not drawn anew for a breadth that differs less, relative."""
Pieces = Float[np.ndarray, "P 2 D"]
"""Where each piece of a line begins, and how far it goes."""


class LightLayer:
    """A layer of lines that are only looked at.

    Parameters
    ----------
    viewer
        Where the layer is added, on top of all.
    image
        What the lines lie on.
    keywords
        Name and metadata of the layer.
    """

    def __init__(self, viewer: ViewerModel, image: Image, keywords: Mapping[str, Any]):
        self._viewer, self._image, self._keywords = viewer, image, keywords
        self._layer: Vectors | None = None
        self._lines: tuple[Pieces, ...] = ()
        self._colours: tuple[str, ...] = ()

    @property
    def layer(self) -> Vectors | None:
        """The layer, or None where there is none or the user removed it."""
        return self._layer if self._layer in self._viewer.layers else None

    def make(self, *, visible: bool = True) -> Vectors:
        """Add the layer, with nothing in it."""
        self._lines, self._colours = (), ()
        self._layer = Vectors(
            ndim=self._image.ndim,
            vector_style="line",
            visible=visible,
            **self._keywords,
            **placement(self._image),
        )
        put(self._viewer, self._layer)
        return self._layer

    def draw(self, lines: Sequence[Pieces], colours: Sequence[str], breadth: float) -> None:
        """Draw these lines, and no others, as far as they are not there already.

        Parameters
        ----------
        lines
            The same arrays for the same lines.
        colours
            One for each.
        breadth
            Of all, px.
        """
        layer, here, wanted = self.layer, tuple(lines), tuple(colours)
        same = len(here) == len(self._lines) and all(map(is_, here, self._lines))
        if layer is None or (same and wanted == self._colours):
            return
        if not same:
            layer.data = np.concatenate(here) if here else np.zeros((0, 2, self._image.ndim))
        if here:
            if abs(layer.edge_width - breadth) > SAME_BREADTH * breadth:
                layer.edge_width = breadth
            layer.edge_color = np.repeat(rgba(colours), [len(line) for line in lines], axis=0)
        self._lines, self._colours = here, wanted

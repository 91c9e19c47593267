"""Suggested lines in the user's own layer: added, and taken back while they are as they came."""

from collections.abc import Iterator, Sequence
from typing import Protocol

import numpy as np
from napari.components import ViewerModel
from napari.layers import Image, Shapes

from napari_splinesketch.plugin.adapter.sketches import line_style
from napari_splinesketch.plugin.adapter.space import (
    frame_numbers,
    from_pixels,
    in_stack,
    to_pixels,
)
from napari_splinesketch.plugin.gently import add_shapes
from napari_splinesketch.plugin.records import Record
from napari_splinesketch.plugin.suggestions import Suggestion

FADED = 0.3
"""How opaque a line is that has become a curve."""


class Suggested(Protocol):
    """Whoever knows what is suggested."""

    @property
    def suggestions(self) -> tuple[Suggestion, ...]:
        """The suggestions of all frames."""
        ...


class SuggestedLines:
    """Brings a layer of sketches in step with what is suggested.

    A line that the user has moved, mended or deleted is hers: it is not touched again.

    Parameters
    ----------
    viewer
        Holds both layers.
    image, sketches
        The user's layers.
    owner
        Knows what is suggested.
    """

    def __init__(self, viewer: ViewerModel, image: Image, sketches: Shapes, owner: Suggested):
        self._viewer, self._image, self._sketches = viewer, image, sketches
        self._owner = owner
        self._shown: dict[Suggestion, np.ndarray] = {}

    def show(self) -> Iterator[None]:
        """Add and remove lines, some at each step."""
        if not {self._image, self._sketches} <= set(self._viewer.layers):
            return
        wanted = self._owner.suggestions
        gone = [self._shown.pop(one) for one in set(self._shown).difference(wanted)]
        if gone:
            self._remove(gone)
            yield
        fresh = [one for one in wanted if one not in self._shown]
        if fresh:
            shapes = self._vertices(fresh)
            self._shown |= dict(zip(fresh, shapes, strict=True))
            image = self._image
            style = line_style(image.level_shapes[0][image.ndim - 2 : image.ndim])
            for _ in add_shapes(self._sketches, shapes, ["path"] * len(shapes), **style):
                yield

    def fade(self, records: Sequence[Record]) -> None:
        """Let the lines that have become curves step back behind them, and no others."""
        layer = self._sketches
        if not {self._image, layer} <= set(self._viewer.layers) or not layer.nshapes:
            return
        refined = {(r.frame, _rounded(r.sketch)) for r in records if r.drawn}
        shapes = layer.data
        first = np.cumsum([0] + [len(shape) for shape in shapes[:-1]])
        pixels = to_pixels(self._viewer, layer, self._image, np.concatenate(shapes))
        frames = frame_numbers(self._image, pixels[first])
        lines = np.split(pixels[:, -2:], first[1:])
        back = [(f, _rounded(line)) in refined for f, line in zip(frames, lines, strict=True)]
        colours = np.array(layer.edge_color)
        # A transparency that the user has chosen stays.
        ours = np.isin(np.round(colours[:, 3], 3), (1.0, FADED))
        wanted = np.where(ours, np.where(back, FADED, 1.0), colours[:, 3])
        if not np.allclose(wanted, colours[:, 3], atol=1e-3):
            colours[:, 3] = wanted
            layer.edge_color = colours

    def _remove(self, gone: list[np.ndarray]) -> None:
        prints = {_print(vertices) for vertices in gone}
        found = [i for i, data in enumerate(self._sketches.data) if _print(data) in prints]
        if found:
            self._sketches.selected_data = set()
            self._sketches.remove(found)

    def _vertices(self, some: Sequence[Suggestion]) -> list[np.ndarray]:
        points = np.concatenate([in_stack(self._image, one.frame, one.line) for one in some])
        vertices = from_pixels(self._viewer, self._image, self._sketches, points)
        ends = np.cumsum([len(one.line) for one in some])[:-1]
        return np.split(vertices.astype(np.float32), ends)


def _print(vertices: np.ndarray) -> bytes:
    """Shapes layers hold single precision."""
    return np.ascontiguousarray(vertices, np.float32).tobytes()


def _rounded(line: np.ndarray) -> bytes:
    """What lines have in common that are the same, in single precision or not."""
    return (np.round(line, 2) + 0.0).tobytes()

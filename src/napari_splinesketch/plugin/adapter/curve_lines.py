"""The layer with a line for each curve, brought in step with what is known."""

from collections.abc import Collection, Iterator, Sequence

import numpy as np
from jaxtyping import Float
from napari.layers import Image, Shapes

from napari_splinesketch.engine.types import Curve
from napari_splinesketch.plugin.adapter.colours import ColourBy, colours_of
from napari_splinesketch.plugin.adapter.look import BREADTHS, breadth
from napari_splinesketch.plugin.adapter.space import in_stack
from napari_splinesketch.plugin.adapter.thinning import thinned
from napari_splinesketch.plugin.columns import features, in_pixels
from napari_splinesketch.plugin.gently import CHUNK, add_shapes
from napari_splinesketch.plugin.measures import Ruler
from napari_splinesketch.plugin.records import Key, Record

Look = tuple[ColourBy, Ruler]


class CurveLines:
    """Takes out the lines of curves that are gone, and adds those of new ones.

    Parameters
    ----------
    layer
        Where they are.
    image
        What the curves lie on.
    """

    def __init__(self, layer: Shapes, image: Image):
        self.layer, self._image = layer, image
        self._curves: tuple[Curve, ...] = ()
        self._records: list[Record] = []
        self._colours: list[str] = []
        self._known: list[Key] = []
        self._written: frozenset[Key] = frozenset()

    def missing(self) -> set[Key]:
        """(frame, id) of the curves that the user has deleted."""
        return set(self._written.difference(self.keys()))

    def keys(self) -> list[Key]:
        """(frame, id) of the curves that are there."""
        if "id" not in self.layer.features:
            return []
        return list(zip(self.layer.features["frame"], self.layer.features["id"], strict=True))

    def colours(self) -> dict[Curve, str]:
        """Give the curves that are there, with their colours."""
        return dict(zip(self._curves, self._colours, strict=True))

    def show(self, records: Sequence[Record], look: Look) -> Iterator[None]:
        """Show these curves, and no others; some come at each step."""
        wanted = {id(record.curve): record for record in records}
        gone = self._gone(wanted)
        if gone:
            self.layer.selected_data = set()
            self.layer.remove(gone)
            self._drop(gone)
        there = set(map(id, self._curves))
        fresh = [record for record in records if id(record.curve) not in there]
        curves = [record.curve for record in fresh]
        colours = colours_of(curves, *look)
        for done in add_shapes(
            self.layer,
            self._lines(fresh),
            ["path"] * len(fresh),
            edge_color=colours,
            face_color="transparent",
            edge_width=breadths(curves),
        ):
            self._curves = (*self._curves, *curves[done])
            self._colours = [*self._colours, *colours[done]]
            for curve in curves[done]:
                in_pixels(curve)  # a few at a time: they are asked for all at once below
            yield
        self._describe([wanted[id(curve)] for curve in self._curves], look)
        if gone:
            yield

    def follow(self, *, removed: bool) -> None:
        """Take in that the user has changed shapes: deleted some, or others, which come anew."""
        left = set(self.keys())
        if removed and len(left) < len(self._known):
            self._drop([i for i, key in enumerate(self._known) if key not in left])
        else:
            self._forget()

    def _lines(self, records: Sequence[Record]) -> Iterator[Float[np.ndarray, "P D"]]:
        """Draw curves, some at a time when they are needed."""
        for start in range(0, len(records), CHUNK):
            some = records[start : start + CHUNK]
            lines = thinned([record.curve.points for record in some])
            for record, line in zip(some, lines, strict=True):
                yield in_stack(self._image, record.frame, line)

    def _forget(self) -> None:
        self._curves, self._colours = (), []

    def _gone(self, wanted: Collection[int]) -> list[int]:
        """Positions in the layer of what does not belong there."""
        if self.layer.nshapes != len(self._curves):
            self._forget()
            return list(range(self.layer.nshapes))
        return [i for i, curve in enumerate(self._curves) if id(curve) not in wanted]

    def _drop(self, positions: Collection[int]) -> None:
        """Forget what was at some positions of the layer."""
        gone = set(positions)
        kept = [i for i in range(len(self._curves)) if i not in gone]
        self._curves = tuple(self._curves[i] for i in kept)
        self._colours = [self._colours[i] for i in kept]
        self._known = [key for i, key in enumerate(self._known) if i not in gone]
        self._records = []

    def _describe(self, records: list[Record], look: Look) -> None:
        """Let features and colours say what is known now."""
        if records != self._records or self.layer.features.empty:
            self._records = records
            self.layer.features = features(records)
            self._known = self.keys()
            self._written = frozenset(self._known)
        colours = colours_of(self._curves, *look)
        if colours and colours != self._colours:
            self._colours = colours
            self.layer.edge_color = colours


def breadths(curves: Sequence[Curve]) -> list[float]:
    """Breadth of each curve's line, px."""
    unit = breadth(curves)
    return [unit * BREADTHS[curve.status] for curve in curves]

"""The mark of the selected curves: a thin halo outside their bodies, in a layer of its own.

To change one shape, napari draws a whole layer of shapes anew.
"""

from collections.abc import Sequence

from napari_splinesketch import palette
from napari_splinesketch.plugin.adapter.light_layer import LightLayer, Pieces
from napari_splinesketch.plugin.adapter.look import breadth, halo
from napari_splinesketch.plugin.adapter.pieces import pieces
from napari_splinesketch.plugin.adapter.space import in_stack
from napari_splinesketch.plugin.records import Key, Record, key_of

THIN = 0.5
"""Breadth of the line, relative to a curve's."""
GAP = 1.2
"""Between a body's edge and its halo, relative to the breadth of a curve's line."""

Mark = tuple[Key, int]
"""What a mark shows: a curve as it is."""


class Highlight(LightLayer):
    """Draws halos."""

    _marks: tuple[Mark, ...] = ()
    _cut: Sequence[Pieces] = ()

    def show(self, records: Sequence[Record]) -> None:
        """Mark these curves, and no others."""
        marks = tuple((key_of(record), id(record.curve)) for record in records)
        unit = breadth([record.curve for record in records])
        if marks != self._marks:
            self._marks = marks
            lines = [(r.frame, halo(r.curve, GAP * unit)) for r in records]
            self._cut = pieces([in_stack(self._image, frame, line) for frame, line in lines])
        self.draw(self._cut, [palette.MOVING] * len(records), THIN * unit)

"""The mark of the selected curves: broad lines in a layer of their own.

To change one shape, napari draws a whole layer of shapes anew.
"""

from collections.abc import Sequence

from napari_splinesketch.plugin.adapter.light_layer import LightLayer, Pieces
from napari_splinesketch.plugin.adapter.pieces import pieces
from napari_splinesketch.plugin.adapter.space import in_stack
from napari_splinesketch.plugin.records import Key, Record, key_of

Mark = tuple[Key, int]
"""What a mark shows: a curve as it is."""


class Highlight(LightLayer):
    """Draws curves over their lines."""

    _marks: tuple[Mark, ...] = ()
    _cut: Sequence[Pieces] = ()

    def show(self, records: Sequence[Record], colours: Sequence[str], breadth: float) -> None:
        """Mark these curves, and no others."""
        marks = tuple((key_of(record), id(record.curve)) for record in records)
        if marks != self._marks:
            self._marks = marks
            self._cut = pieces([in_stack(self._image, r.frame, r.curve.points) for r in records])
        self.draw(self._cut, colours, breadth)

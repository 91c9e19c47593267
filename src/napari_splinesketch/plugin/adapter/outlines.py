"""The edges of the bodies, at a half-width to both sides of their curves."""

from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType

import numpy as np

from napari_splinesketch.engine.types import Curve
from napari_splinesketch.plugin.adapter.colours import colours_of
from napari_splinesketch.plugin.adapter.curve_lines import Look
from napari_splinesketch.plugin.adapter.light_layer import LightLayer, Pieces
from napari_splinesketch.plugin.adapter.look import breadth, has_outline, outline
from napari_splinesketch.plugin.adapter.space import in_stack
from napari_splinesketch.plugin.adapter.thinning import thinned
from napari_splinesketch.plugin.records import Record

FACTOR = 0.5
"""Breadth of the lines, relative to those of the curves."""
AT_ONCE = 100
"""Outlines worked out at each step."""


class Outlines(LightLayer):
    """Draws the outlines of curves."""

    _known: Mapping[Curve, Pieces] = MappingProxyType({})

    def show(self, records: Sequence[Record], look: Look) -> Iterator[None]:
        """Show the outlines of these curves, and no others; all come at the last step."""
        kept = [record for record in records if has_outline(record.curve)]
        fresh = [record for record in kept if record.curve not in self._known]
        known = {r.curve: self._known[r.curve] for r in kept if r.curve in self._known}
        for start in range(0, len(fresh), AT_ONCE):
            some = fresh[start : start + AT_ONCE]
            for record, line in zip(some, thinned([outline(r.curve) for r in some]), strict=True):
                around = in_stack(self._image, record.frame, line)
                known[record.curve] = np.stack([around[:-1], np.diff(around, axis=0)], axis=1)
            yield
        self._known = known
        curves = [record.curve for record in kept]
        self.draw([known[c] for c in curves], colours_of(curves, *look), FACTOR * breadth(curves))

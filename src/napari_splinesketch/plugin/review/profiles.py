"""What the plots show of a curve, from all that is known of its image."""

from functools import partial

import numpy as np
from jaxtyping import Float
from napari.layers import Image

from napari_splinesketch.engine.types import Curve
from napari_splinesketch.plugin.layers.pixels import Grid, Patch, block_on
from napari_splinesketch.plugin.measures import Ruler, mean_along, once
from napari_splinesketch.plugin.model import Record
from napari_splinesketch.plugin.review.along import across, mean_across
from napari_splinesketch.plugin.review.plots import Profile
from napari_splinesketch.plugin.work import Work


class Profiles:
    """Makes profiles; keeps the mean of all curves while they stay the same."""

    def __init__(self) -> None:
        self._of: tuple[Record, ...] | None = None
        self._ruler: Ruler | None = None
        self._mean: Float[np.ndarray, " P"] | None = None

    def profile(self, work: Work, record: Record, ruler: Ruler) -> Profile:
        """Say what there is to draw of a curve."""
        curve = record.curve
        return Profile(
            f"curve {record.id}",
            ruler.unit,
            ruler.along(curve.points),
            ruler.across(curve, curve.half_width),
            ruler.across(curve, curve.sd),
            self._mean_of(work.records, ruler),
            residual_along(work.image, work.patches.get(record.frame), record),
        )

    def _mean_of(self, records: tuple[Record, ...], ruler: Ruler) -> Float[np.ndarray, " P"] | None:
        if ruler != self._ruler:
            self._ruler = ruler
            self._across = once(partial(_across, ruler))
        elif self._of is records:
            return self._mean
        self._of = records
        self._mean = mean_along([self._across(record.curve) for record in records])
        return self._mean


def _across(ruler: Ruler, curve: Curve) -> Float[np.ndarray, " P"]:
    return ruler.across(curve, curve.half_width)


def residual_along(
    image: Image, patch: Patch | None, record: Record
) -> Float[np.ndarray, " P"] | None:
    """Average image minus reconstruction across a body; None where either is not there.

    Only the pixels around the body are read.
    """
    if patch is None:
        return None
    points = patch.grid.to_block(record.curve.points)
    half_width = record.curve.half_width / patch.grid.size
    places = across(points, half_width)
    low = np.clip(np.floor(places.min((0, 1))).astype(int), 0, patch.pixels.shape)
    high = np.clip(np.ceil(places.max((0, 1))).astype(int) + 1, 0, patch.pixels.shape)
    if (high <= low).any():
        return None
    grid = Grid(patch.grid.to_image(low), patch.grid.step)
    block = block_on(image, record.frame, grid, tuple(high - low))
    if block is None:
        return None
    rest = block.read() - patch.pixels[low[0] : high[0], low[1] : high[1]]
    return mean_across(rest, points - low, half_width)

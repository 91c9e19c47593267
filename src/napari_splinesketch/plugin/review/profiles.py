"""What the plots show of a curve: its width, and what the model leaves unexplained along it."""

from functools import partial

import numpy as np
from jaxtyping import Float, Real
from napari.layers import Image
from scipy.ndimage import map_coordinates

from napari_splinesketch.engine.types import Curve
from napari_splinesketch.plugin.layers.looks import normals
from napari_splinesketch.plugin.layers.pixels import Grid, Patch, block_on
from napari_splinesketch.plugin.measures import Ruler, mean_along, once
from napari_splinesketch.plugin.model import Record
from napari_splinesketch.plugin.review.plots import Profile
from napari_splinesketch.plugin.work import Work

SPACING = 0.5
"""Between the places across a body at which the picture is read, px at most."""


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


def across(
    points: Float[np.ndarray, "P 2"], half_width: Float[np.ndarray, " P"]
) -> Float[np.ndarray, "P Q 2"]:
    """Places on a body's cross-sections, from edge to edge.

    Parameters
    ----------
    points
        (P, 2) centreline, (row, col), px.
    half_width
        (P,) from the centreline to the edge, px; a section where it is not known is one point.
    """
    reach = np.nan_to_num(half_width, nan=0.0, posinf=0.0)
    count = 1 + 2 * int(np.ceil(reach.max(initial=0.0) / SPACING))
    share = np.linspace(-1, 1, count) if count > 1 else np.zeros(1)
    return points[:, None] + (reach[:, None] * share)[..., None] * normals(points)[:, None]


def mean_across(
    picture: Real[np.ndarray, "H W"],
    points: Float[np.ndarray, "P 2"],
    half_width: Float[np.ndarray, " P"],
) -> Float[np.ndarray, " P"]:
    """Average a picture over a body's cross-section at each point of its centreline.

    Pixels that are not finite are left out, as are those beyond the picture; NaN where none is
    left.

    Parameters
    ----------
    picture
        (H, W), for example image minus reconstruction.
    points, half_width
        As for `across`, in pixels of the picture.
    """
    places = across(points, half_width)
    low = np.clip(np.floor(places.min((0, 1))).astype(int), 0, picture.shape)
    high = np.ceil(places.max((0, 1))).astype(int) + 2
    picture = picture[low[0] : max(high[0], 0), low[1] : max(high[1], 0)]
    if not picture.size:
        return np.full(len(points), np.nan)
    where = np.moveaxis(places - low, -1, 0)
    known = np.isfinite(picture)
    filled = np.where(known, picture, 0.0).astype(float)
    values = map_coordinates(filled, where, order=1, cval=0.0)
    # Weights fall to zero with the pixels that are missing, as the values do.
    weights = map_coordinates(known.astype(float), where, order=1, cval=0.0)
    total = weights.sum(axis=1)
    mean = np.full(len(points), np.nan)
    return np.divide(values.sum(axis=1), total, out=mean, where=total > 1e-6)

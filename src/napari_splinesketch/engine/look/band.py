"""The pixels around a line."""

from functools import cache

import numpy as np
from jaxtyping import Bool, Float, Int

from napari_splinesketch.engine import constants as const
from napari_splinesketch.engine import spline
from napari_splinesketch.engine.types import Array


def band(
    points: Float[Array, "P 2"], radius: float, shape: tuple[int, int]
) -> tuple[slice, slice, Bool[Array, "h w"]]:
    """Pixels within about `radius` of a curve, as a mask of a window of the image."""
    reach = int(np.ceil(radius))
    low = np.maximum(np.floor(points.min(0)).astype(int) - reach, 0)
    high = np.minimum(np.ceil(points.max(0)).astype(int) + reach + 1, shape)
    high = np.maximum(high, low)
    mask, disc = np.zeros(high - low, dtype=bool), None
    if reach <= const.WHOLE_DISC:
        disc = _disc(reach)
    step = max(radius / 3, 1.0)
    count = max(2, int(np.ceil(spline.arc_length(points)[-1] / step)) + 1)
    at = np.rint(spline.resample(points, count)).astype(int) - low
    at = at[((at >= 0) & (at <= high - low + 1)).all(1)]
    first, last = np.maximum(at - reach, 0), np.minimum(at + reach + 1, high - low)
    corners = np.concatenate([first, last, first - at, last - at], axis=1)
    for top, left, bottom, right, up, before, down, after in corners.tolist():
        if disc is None:
            part = _within(reach, np.arange(up, down), np.arange(before, after))
        else:
            part = disc[up + reach : down + reach, before + reach : after + reach]
        mask[top:bottom, left:right] |= part
    return slice(int(low[0]), int(high[0])), slice(int(low[1]), int(high[1])), mask


@cache
def _disc(reach: int) -> Bool[Array, "d d"]:
    away = np.arange(-reach, reach + 1)
    return _within(reach, away, away)


def _within(reach: int, rows: Int[Array, " h"], columns: Int[Array, " w"]) -> Bool[Array, "h w"]:
    """Part of a disc, with rows and columns counted from its centre."""
    return np.add.outer(rows**2, columns**2) <= (reach + 0.5) ** 2

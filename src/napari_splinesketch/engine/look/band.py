"""The pixels around a line."""

from functools import cache

import numpy as np
from jaxtyping import Bool, Float

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
    rows, columns = (high - low).tolist()
    mask = np.zeros((rows + 2 * reach + 2, columns + 2 * reach + 2), dtype=bool)
    disc = _disc(reach)
    size = len(disc)
    step = max(radius / 3, 1.0)
    count = max(2, int(np.ceil(spline.arc_length(points)[-1] / step)) + 1)
    for r, c in (np.rint(spline.resample(points, count)).astype(int) - low).tolist():
        if 0 <= r <= mask.shape[0] - size and 0 <= c <= mask.shape[1] - size:
            mask[r : r + size, c : c + size] |= disc
    inner = mask[reach : reach + rows, reach : reach + columns]
    return slice(int(low[0]), int(high[0])), slice(int(low[1]), int(high[1])), inner


@cache
def _disc(reach: int) -> Bool[Array, "d d"]:
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    return y**2 + x**2 <= (reach + 0.5) ** 2

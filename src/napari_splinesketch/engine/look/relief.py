"""Images in relief: bodies are bright on one side and dark on the other, as if lit from there.

Differential interference contrast and oblique light show transparent bodies like that.
"""

import numpy as np
from jaxtyping import Float
from scipy import fft

from napari_splinesketch.engine import constants as const
from napari_splinesketch.engine.look.filters import median
from napari_splinesketch.engine.look.ridges import WIDTHS, Ridges, factor_of, rung_of, smoothed
from napari_splinesketch.engine.types import Array


def leaning(
    ridges: Ridges, flat: Float[Array, "H W"], half_width: float, height: float
) -> Float[Array, "3 3"]:
    """Which way it is from dark ridges to the bright ones beside them, all over an image.

    In relief one side of a body is brighter than the background, and the other as much darker.
    `flat` is the image without background; `half_width` and `height` are about those of its ridges.

    Returns
    -------
    Moments of the unit vectors that point to a bright ridge, midway between it and a dark one:
    their products, weighed by the mean height of both; in the last column their sum, weighed by the
    lower one, and the sum of the former weights.
    """
    moments = np.zeros((3, 3))
    if min(flat.shape) < 2:
        return moments
    for rung in range(len(WIDTHS))[rung_of(half_width) :][: const.RELIEF_RUNGS]:
        high, low = (ridges.heights(rung, sign) for sign in (1, -1))
        above, factor = smoothed(flat, rung), factor_of(rung)
        every = 1 + int(np.sqrt(high.size / const.RELIEF_PIXELS))
        usual = median(np.abs(high[::every, ::every]).ravel())
        usual = max(usual, const.RIDGE_FLOOR * height, 1e-30)
        towards = np.array([slope[::every, ::every] for slope in np.gradient(high - low)])
        middle = every * np.indices(towards.shape[1:]).reshape(2, -1)
        towards = towards.reshape(2, -1) / (np.linalg.norm(towards, axis=0).ravel() + 1e-30)
        away = const.RELIEF_APART_HW * WIDTHS[rung] / factor * towards
        whole, sides = 0.0, []
        for ridge, side in ((high, 1), (low, -1)):
            row, column = np.rint(middle + side * away).astype(int)
            at = row.clip(0, len(ridge) - 1) * ridge.shape[1] + column.clip(0, ridge.shape[1] - 1)
            both = np.array([ridge.take(at), side * above.take(at)]) / usual - const.RELIEF_USUAL
            whole = whole + np.maximum(both[0], 0) / 2
            sides.append(np.maximum(both.min(0), 0))
        area = (every * factor) ** 2
        moments[:2, :2] += area * (towards * whole) @ towards.T
        moments[:2, 2] += area * towards @ np.minimum(*sides)
        moments[2, 2] += area * whole.sum()
    return moments


def lights(moments: Float[Array, "3 3"]) -> list[Float[Array, "2"]]:
    """Directions that bodies may be lit from, unit vectors; none if they are not in relief.

    In relief a body's direction alone tells which of its sides is bright, and how bright. `moments`
    are those of `leaning`.
    """
    moments = moments / (moments[2, 2] + 1e-30)
    towards = np.linalg.lstsq(moments[:2, :2], moments[:2, 2])[0]
    if moments[:2, 2] @ towards < const.RELIEF_EXPLAINED:
        return []
    towards /= np.linalg.norm(towards)
    turns = np.deg2rad(const.RELIEF_TURNS)
    return [np.cos(turn) * towards + np.sin(turn) * towards[::-1] * [1, -1] for turn in turns]


def raised(image: Float[Array, "H W"], towards: Float[Array, "2"]) -> Float[Array, "H W"]:
    """The image with bodies that are bright instead of lit from a direction, a unit vector.

    Its Hilbert transform along the direction (Arnison et al. 2000), which leaves white noise white.
    The opposite direction gives bright bodies a relief.
    """
    rows, columns = image.shape
    size = fft.next_fast_len(2 * rows), fft.next_fast_len(2 * columns)
    along = fft.fftfreq(size[0])[:, None] * towards[0] + fft.rfftfreq(size[1]) * towards[1]
    # In place: images are large.
    turned = np.asarray(fft.rfft2(image - np.median(image), size))
    turned *= np.sign(along)
    turned *= 1j
    return np.asarray(fft.irfft2(turned, size, overwrite_x=True))[:rows, :columns]

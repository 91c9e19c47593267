"""How much each pixel looks like the middle of a body: bounded, two-sided, local."""

from collections.abc import Callable, Container, Sequence
from math import pi, sqrt

import numpy as np
from jaxtyping import Float
from scipy import ndimage

from napari_splinesketch.engine import constants as const
from napari_splinesketch.engine.look.background import block_medians
from napari_splinesketch.engine.look.filters import blurred
from napari_splinesketch.engine.types import Array

WIDTHS = tuple((0.8 * const.WIDTH_RATIO ** np.arange(16)).tolist())
"""Half-widths that are tried, px: 0.8 to 72."""


def rung_of(half_width: float) -> int:
    """Index in WIDTHS of the nearest half-width, by their ratio."""
    return int(np.abs(np.log(np.array(WIDTHS) / half_width)).argmin())


def factor_of(rung: int) -> int:
    """By how much images are reduced for the half-width WIDTHS[rung]."""
    return max(1, int(WIDTHS[rung] / const.RIDGE_REDUCED_PX))


def smoothed(image: Float[Array, "H W"], rung: int) -> Float[Array, "h w"]:
    """An image reduced by `factor_of`, and blurred for ridges of the half-width WIDTHS[rung]."""
    factor = factor_of(rung)
    sigma = max(const.RIDGE_BLUR_HW * WIDTHS[rung], const.RIDGE_BLUR_PX) / factor
    return blurred(_reduce(image, factor), sigma, mode="nearest", truncate=3.0)


class Ridges:
    """The ridges of an image, of any width and of both polarities, measured when asked for.

    The image is finite; `noise` is the standard deviation of its pixel noise, in its units. `tick`
    is called before each measurement, which takes long in large images; it may raise.
    """

    def __init__(
        self, image: Float[Array, "H W"], noise: float, tick: Callable[[], object] = lambda: None
    ):
        self._image, self.noise, self._tick = np.empty(image.shape, np.float32), noise, tick
        # Large values have no small differences in single precision.
        np.subtract(image, image.min(), out=self._image, casting="same_kind")
        self._heights: dict[tuple[int, int], Array] = {}
        self._evidence: dict[tuple[int, int, float], Array] = {}

    def keep(self, heights: Container[tuple[int, int]] = (), evidence: Container[int] = ()) -> None:
        """Free all but the heights of some rungs and signs, and the evidence of some rungs.

        What is asked for later is measured again.
        """
        self._heights = {asked: of for asked, of in self._heights.items() if asked in heights}
        self._evidence = {asked: of for asked, of in self._evidence.items() if asked[0] in evidence}

    def heights(self, rung: int, sign: int) -> Float[Array, "h w"]:
        """By how much pixels are above both their sides, or below for a sign of -1.

        The image is reduced by `factor_of`.
        """
        if (rung, sign) not in self._heights:
            self._tick()
            away = const.RIDGE_SIDE_HW * WIDTHS[rung] + const.RIDGE_SIDE_PX
            both = _heights(smoothed(self._image, rung), away / factor_of(rung))
            self._heights[rung, 1], self._heights[rung, -1] = both
        return self._heights[rung, sign]

    def evidence(self, rung: int, sign: int, height: float) -> Float[Array, "H W"]:
        """Evidence of a body's middle at every pixel, 0 to 1, for a half-width and a polarity.

        A ridge is higher than *both* its sides, so edges, rims and blobs are none. Its height is
        measured in units of what is usual around it and cut at RIDGE_CERTAIN of them: a ridge is a
        ridge, however strong. `height` is that of the bodies' ridges, typically: much lower ones
        are noise. The next narrower and wider ridges count too. Results are kept; do not change
        them.
        """
        asked = rung, sign, height
        if asked not in self._evidence:
            near = range(max(rung - 1, 0), min(rung + 2, len(WIDTHS)))
            around = const.USUAL_BLOCK_HW * WIDTHS[rung]
            found = self.alone(near[0], sign, height, around)
            for k in near[1:]:
                np.maximum(found, self.alone(k, sign, height, around), out=found)
            self._evidence[asked] = found
        return self._evidence[asked]

    def alone(self, rung: int, sign: int, height: float, around: float) -> Float[Array, "H W"]:
        """The same of one half-width without its neighbours; blocks have the side `around`, px."""
        mine, factor = self.heights(rung, sign), factor_of(rung)
        block = max(around, const.USUAL_BLOCK_PX)
        left = (
            const.RIDGE_NOISE
            * self.noise
            / (2 * sqrt(pi) * max(const.RIDGE_BLUR_HW * WIDTHS[rung], const.RIDGE_BLUR_PX))
        )
        usual = _usual(mine, block / factor)
        share = mine / np.maximum(usual, max(left, const.RIDGE_FLOOR * height, 1e-30))
        if factor > 1:
            share = _stretched(share, (factor, factor), self._image.shape)
        return np.clip(share / const.RIDGE_CERTAIN, 0.0, 1.0)


def _reduce(image: Float[Array, "H W"], factor: int) -> Float[Array, "h w"]:
    if factor == 1:
        return image
    pad = [(0, -size % factor) for size in image.shape]
    wide = np.pad(image, pad, mode="edge")
    h, w = (size // factor for size in wide.shape)
    return wide.reshape(h, factor, w, factor).mean((1, 3))


def _stretched(
    image: Float[Array, "h w"], factors: Sequence[int], shape: tuple[int, ...]
) -> Float[Array, "H W"]:
    """An image enlarged by whole factors, linearly between the pixels' centres, cut to a shape."""
    for axis, (factor, size) in enumerate(zip(factors, shape, strict=True)):
        at = np.clip((np.arange(size) + 0.5) / factor - 0.5, 0, image.shape[axis] - 1)
        low = at.astype(int)
        part = (at - low).astype(np.float32).reshape((-1, 1) if axis == 0 else (1, -1))
        above = image.take(np.minimum(low + 1, image.shape[axis] - 1), axis)
        above *= part
        image = image.take(low, axis)
        image *= 1 - part
        image += above
    return image


def _heights(smooth: Float[Array, "H W"], away: float) -> tuple[Array, Array]:
    """By how much pixels are above, and below, both their sides, in their best direction."""
    reach, columns = int(np.ceil(away)), smooth.shape[1]
    wide = np.pad(smooth, reach, mode="edge")
    above, below = np.empty_like(smooth), np.empty_like(smooth)
    # Some rows after the other, so that what is computed stays in the cache.
    rows = min(max(1, const.RIDGE_CHUNK // columns), len(smooth))
    angles = np.pi * np.arange(const.RIDGE_ANGLES) / const.RIDGE_ANGLES
    steps = np.rint(away * np.stack([np.sin(angles), np.cos(angles)], axis=1)).astype(int).tolist()
    room = np.empty((3, const.RIDGE_ANGLES, rows, columns), smooth.dtype)
    for first in range(0, len(smooth), rows):
        here = smooth[first : first + rows]
        most, least, slopes = room[:, :, : len(here)]
        for k, (r, c) in enumerate(steps):
            one = wide[first + reach + r :, reach + c :][: len(here), :columns]
            two = wide[first + reach - r :, reach - c :][: len(here), :columns]
            np.maximum(one, two, out=most[k])
            np.minimum(one, two, out=least[k])
            np.subtract(most[k], least[k], out=slopes[k - const.RIDGE_ANGLES // 2])  # across
        slopes *= const.RIDGE_SLOPE
        most += slopes
        least -= slopes
        np.subtract(here, most.min(0), out=above[first : first + rows])
        np.subtract(least.max(0), here, out=below[first : first + rows])
    return above, below


def _usual(height: Float[Array, "H W"], block: float) -> Float[Array, "H W"]:
    """The size that heights usually have around each pixel: medians of blocks, interpolated."""
    medians, sides = block_medians(np.abs(height), block)
    if medians.size == 1:
        return np.full(height.shape, medians[0, 0], np.float32)
    medians = ndimage.median_filter(medians.astype(np.float32), 3, mode="nearest")
    return _stretched(medians, sides, height.shape)

"""The image without bodies: as simple a background as explains it."""

from typing import Literal

import numpy as np
from jaxtyping import Float
from scipy import ndimage

from napari_splinesketch.engine import constants as const
from napari_splinesketch.engine.look.filters import median
from napari_splinesketch.engine.types import Array

Kind = Literal["constant", "linear", "textured"]


def estimate_background(
    image: Float[Array, "H W"], noise: float, kind: Kind | None = None, *, widest: float = 0.0
) -> tuple[Float[Array, "H W"], Kind]:
    """Background from medians of blocks, cleaned by their neighbours.

    A constant, a plane and the interpolated medians themselves are compared by the Bayesian
    information criterion, for the standard deviation of the pixel noise; or one `kind` is used.
    `widest` is the largest half-width of the bodies, px: a block is not to lie inside one.
    """
    block = max(const.BACKGROUND_BLOCK_PX, const.BACKGROUND_BLOCK_HW * widest)
    medians, sides = block_medians(
        image[:: const.BACKGROUND_STEP, :: const.BACKGROUND_STEP],
        block / const.BACKGROUND_STEP,
    )
    places = [np.arange(n) for n in medians.shape]
    # Where the image's pixels are, counted in blocks.
    at = [
        (np.arange(n) / const.BACKGROUND_STEP + 0.5) / side - 0.5
        for n, side in zip(image.shape, sides, strict=True)
    ]
    plane = _plane(medians, places, places)
    # What is cleaned is the difference from a plane, so that a slope survives at the border.
    medians = plane + ndimage.median_filter(medians - plane, 3, mode="nearest")
    constant, plane = np.median(medians), _plane(medians, places, places)
    error = noise * np.hypot(const.BACKGROUND_TOLERANCE, 1.25 / (block / 2))
    error += 1e-12 * np.abs(medians).max() + 1e-300
    price = np.log(max(medians.size, 3))
    costs: dict[Kind, float] = {
        "constant": (((medians - constant) / error) ** 2).sum() + price,
        "linear": (((medians - plane) / error) ** 2).sum() + 3 * price,
        "textured": max(medians.size, 4) * price,
    }
    kind = min(costs, key=lambda one: costs[one]) if kind is None else kind
    if kind == "constant":
        return np.full(image.shape, constant), kind
    if kind == "linear":
        return _plane(medians, places, at), kind
    rows, columns = (
        np.maximum(1 - np.abs(np.clip(x, 0, p[-1])[:, None] - p), 0)
        for x, p in zip(at, places, strict=True)
    )
    return rows @ medians @ columns.T, kind


def block_medians(
    image: Float[Array, "H W"], block: float
) -> tuple[Float[Array, "h w"], list[int]]:
    """Medians of equal blocks with sides of about `block` px, and these sides."""
    counts = [max(1, round(size / block)) for size in image.shape]
    sides = [-(-size // n) for size, n in zip(image.shape, counts, strict=True)]
    pad = [(0, n * side - size) for n, side, size in zip(counts, sides, image.shape, strict=True)]
    blocks = np.pad(image, pad, mode="symmetric")
    blocks = blocks.reshape(counts[0], sides[0], counts[1], sides[1]).swapaxes(1, 2)
    return median(blocks.reshape(*counts, -1)), sides


def _plane(medians: Float[Array, "h w"], places: list[Array], at: list[Array]) -> Array:
    """The least-squares plane through values at some rows and columns, at other ones."""
    found = medians.mean()
    for axis, (known, wanted) in enumerate(zip(places, at, strict=True)):
        away = known - known.mean()
        slope = away @ medians.mean(1 - axis) / max(away @ away, 1e-9)
        found = found + np.expand_dims(slope * (wanted - known.mean()), 1 - axis)
    return found

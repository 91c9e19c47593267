"""The image without bodies: as simple a background as explains it."""

from itertools import pairwise
from typing import Literal

import numpy as np
from jaxtyping import Float
from scipy import ndimage

from napari_splinesketch.engine.types import Array

Kind = Literal["constant", "linear", "textured"]
BLOCK = 32
"""Side of the blocks whose medians tell the background, px."""
TOLERANCE = 0.3
"""A background that misses the blocks' medians by this share of the noise is good enough."""

CURVED_PIXELS = 8000
"""So many pixels tell the surface that a varying background is measured from."""
CUBIC = [(i, j) for i in range(4) for j in range(4 - i)]
"""Powers of row and column in that surface."""
CURVED_ROUNDS, STANDS_OUT = 6, 2.0
"""Times that it is fitted, and standard deviations beyond which a pixel is left out."""


def estimate_background(
    image: Float[Array, "H W"], noise: float, kind: Kind | None = None
) -> tuple[Float[Array, "H W"], Kind]:
    """Background from medians of blocks.

    A constant, a plane and the interpolated medians themselves are compared by the Bayesian
    information criterion.

    Parameters
    ----------
    image
        (H, W) finite.
    noise
        Standard deviation of the pixel noise.
    kind
        Do not choose, use this kind.
    """
    medians, rows, columns = _block_medians(image)
    h, w = image.shape
    if kind is None:
        kind = _simplest(medians, rows, columns, noise)
    if kind == "constant":
        return np.full(image.shape, np.median(medians)), kind
    if kind == "linear":
        return _plane_at(_plane(medians, rows, columns), np.arange(h), np.arange(w)), kind
    curved = _curved(image)
    rest, rows, columns = _block_medians(image, curved)
    _add_interpolated(curved, rest, rows, columns)
    return curved, kind


def _curved(image: Float[Array, "H W"]) -> Float[Array, "H W"]:
    """The cubic surface that most pixels lie on: what stands out is left out of the fit."""
    h, w = image.shape
    rows, columns = (np.linspace(-1, 1, n) for n in (h, w))
    step = max(1, round(np.sqrt(h * w / CURVED_PIXELS)))
    values = image[::step, ::step].ravel()
    design = _cubic(*np.meshgrid(rows[::step], columns[::step], indexing="ij"))
    kept = np.ones(len(values), dtype=bool)
    coefficients = np.zeros(design.shape[1])
    for _ in range(CURVED_ROUNDS):
        coefficients = np.linalg.lstsq(design[kept], values[kept], rcond=None)[0]
        rest = np.abs(values - design @ coefficients)
        kept = rest <= STANDS_OUT * 1.4826 * np.median(rest)
    powers = np.zeros((4, 4))
    powers[tuple(zip(*CUBIC, strict=True))] = coefficients
    return np.vander(rows, 4, increasing=True) @ powers @ np.vander(columns, 4, increasing=True).T


def _cubic(rows: Float[Array, "h w"], columns: Float[Array, "h w"]) -> Float[Array, "P 10"]:
    r, c = rows.ravel(), columns.ravel()
    return np.stack([r**i * c**j for i, j in CUBIC], axis=1)


def _block_medians(image, less=None):
    """Median of each block, cleaned by its neighbours, and the blocks' centres.

    Where something is taken off the image, that is done block by block: images are large.

    What is cleaned is the difference from a plane, so that a slope survives at the border.
    """
    centres, edges = [], []
    for size in image.shape:
        edge = np.linspace(0, size, max(1, round(size / BLOCK)) + 1).astype(int)
        edges.append(edge)
        centres.append((edge[1:] + edge[:-1] - 1) / 2)
    medians = [
        [np.median(_less(image, less, a, b, c, d)) for c, d in pairwise(edges[1])]
        for a, b in pairwise(edges[0])
    ]
    plane = _plane_at(_plane(np.array(medians), *centres), *centres)
    rest = ndimage.median_filter(np.array(medians) - plane, 3, mode="nearest")
    return plane + rest, *centres


def _less(image, less, top, bottom, left, right):
    place = slice(top, bottom, 2), slice(left, right, 2)
    return image[place] if less is None else image[place] - less[place]


def _simplest(medians, rows, columns, noise: float) -> Kind:
    error = noise * np.hypot(TOLERANCE, 1.25 / (BLOCK / 2)) + 1e-12
    plane = _plane_at(_plane(medians, rows, columns), rows, columns)
    misfit = {
        "constant": (((medians - np.median(medians)) / error) ** 2).sum(),
        "linear": (((medians - plane) / error) ** 2).sum(),
        "textured": 0.0,
    }
    count: dict[Kind, int] = {"constant": 1, "linear": 3, "textured": max(medians.size, 4)}
    return min(count, key=lambda kind: misfit[kind] + count[kind] * np.log(max(medians.size, 3)))


def _plane(medians, rows, columns):
    """Level at the origin and slopes of the least-squares plane."""
    r, c = (a.ravel() for a in np.meshgrid(rows, columns, indexing="ij"))
    design = np.column_stack([np.ones_like(r), r, c])
    return np.linalg.lstsq(design, medians.ravel(), rcond=None)[0]


def _plane_at(plane, rows, columns):
    level, down, across = plane
    return level + down * rows[:, None] + across * columns


def _add_interpolated(picture, medians, rows, columns):
    """Add the blocks' medians, interpolated between their centres, row by row."""
    lines = np.stack([np.interp(np.arange(picture.shape[1]), columns, line) for line in medians])
    at = np.interp(np.arange(len(picture)), rows, np.arange(len(rows)))
    below = np.floor(at).astype(int).clip(0, max(len(rows) - 2, 0))
    above = np.minimum(below + 1, len(rows) - 1)
    for row, low, high, part in zip(picture, below, above, at - below, strict=True):
        row += lines[low] * (1 - part) + lines[high] * part

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
    return _interpolated(medians, rows, columns, image.shape), kind


def _block_medians(image):
    """Median of each block, cleaned by its neighbours, and the blocks' centres.

    What is cleaned is the difference from a plane, so that a slope survives at the border.
    """
    centres, edges = [], []
    for size in image.shape:
        edge = np.linspace(0, size, max(1, round(size / BLOCK)) + 1).astype(int)
        edges.append(edge)
        centres.append((edge[1:] + edge[:-1] - 1) / 2)
    medians = [
        [np.median(image[a:b:2, c:d:2]) for c, d in pairwise(edges[1])]
        for a, b in pairwise(edges[0])
    ]
    plane = _plane_at(_plane(np.array(medians), *centres), *centres)
    rest = ndimage.median_filter(np.array(medians) - plane, 3, mode="nearest")
    return plane + rest, *centres


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


def _interpolated(medians, rows, columns, shape):
    """(H, W) the blocks' medians, interpolated; row by row, since images are large."""
    across = np.stack([np.interp(np.arange(shape[1]), columns, line) for line in medians])
    at = np.interp(np.arange(shape[0]), rows, np.arange(len(rows)))
    below = at.astype(int).clip(0, max(len(rows) - 2, 0))
    above = np.minimum(below + 1, len(rows) - 1)
    picture = np.empty(shape)
    for row, (low, high, part) in enumerate(zip(below, above, at - below, strict=True)):
        picture[row] = across[low] * (1 - part) + across[high] * part
    return picture

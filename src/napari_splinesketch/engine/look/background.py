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
    fitted = _plane(medians, rows, columns)
    plane = _plane_at(fitted, np.arange(h), np.arange(w))
    if kind == "linear":
        return plane, kind
    curved = _curved(image)
    rest, rows, columns = _block_medians(image - curved)
    return curved + _interpolated(rest, rows, columns, image.shape), kind


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
    return (_cubic(*np.meshgrid(rows, columns, indexing="ij")) @ coefficients).reshape(h, w)


def _cubic(rows: Float[Array, "h w"], columns: Float[Array, "h w"]) -> Float[Array, "P 10"]:
    r, c = rows.ravel(), columns.ravel()
    return np.stack([r**i * c**j for i in range(4) for j in range(4 - i)], axis=1)


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
    lines = np.stack([np.interp(np.arange(shape[1]), columns, line) for line in medians])
    at = np.interp(np.arange(shape[0]), rows, np.arange(len(rows)))
    below = np.floor(at).astype(int).clip(0, max(len(rows) - 2, 0))
    part = (at - below)[:, None]
    return lines[below] * (1 - part) + lines[np.minimum(below + 1, len(rows) - 1)] * part

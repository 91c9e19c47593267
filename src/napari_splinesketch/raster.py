"""Which pixels bodies cover."""

from collections.abc import Callable, Sequence
from itertools import product

import numpy as np
from jaxtyping import Float, Int, Integer
from numpy.typing import DTypeLike

from napari_splinesketch.engine.types import Array

Body = tuple[int, Float[Array, "N 2"], Float[Array, " N"]]
"""What its pixels are to hold, its centreline (row, col) and its half-width, px."""
STRIP = 2**19
"""Pixels of a label image that are drawn at a time: their depth is held beside them."""
TOGETHER = 16
"""Segments of a line that are drawn at a time."""
TILE = 90
"""Side of what is drawn at a time, px; each of its pixels takes 100 bytes a segment."""


def rasterise(
    points: Float[Array, "N 2"],
    half_width: Float[Array, " N"],
    shape: tuple[int, int],
    rows: tuple[int, int] | None = None,
) -> tuple[tuple[slice, slice], Float[Array, "h w"]] | None:
    """Find the pixels of a body: round at its ends, as wide as its half-width says, px.

    Gives the part of an image of (H, W) that lies around it, and in that the half-width minus the
    distance from the centreline, px, in 4 bytes: not negative inside the body, negative infinite
    where it is not near. None where the half-width is not known or the body lies outside the image.
    `rows` are the first and last-plus-one that are drawn; None draws all.
    """
    if not np.all(np.isfinite(half_width)):
        return None
    low, high = _window(points, half_width.max(), shape)
    if rows:
        low[0], high[0] = max(low[0], rows[0]), min(high[0], rows[1])
    if np.any(high <= low):
        return None
    # A stretch of the body at a time, and of its surroundings a tile.
    depth, points = np.full(tuple(high - low), -np.inf, np.float32), points - low
    for i in range(0, len(points) - 1, TOGETHER):
        line, widths = points[i : i + TOGETHER + 1], half_width[i : i + TOGETHER + 1]
        first, last = _window(line, widths.max(), depth.shape)
        for top, left in product(*(range(a, b, TILE) for a, b in zip(first, last, strict=True))):
            end = np.minimum((top + TILE, left + TILE), last)
            tile = slice(top, end[0]), slice(left, end[1])
            down, right = np.mgrid[tile]
            np.maximum(depth[tile], _depth(down, right, line, widths), out=depth[tile])
    return (slice(low[0], high[0]), slice(low[1], high[1])), depth


def label_image(
    bodies: Sequence[Body],
    shape: tuple[int, int],
    dtype: DTypeLike = np.uint32,
    tell: Callable[[float], None] = lambda share: None,
) -> Integer[Array, "H W"]:
    """Draw bodies; 0 is background, and a pixel of two belongs to the one it lies deeper in.

    `tell` is called now and then with the share that is drawn; what it raises ends the drawing.
    """
    image = np.zeros(shape, dtype)
    height = max(1, STRIP // shape[1])
    for top in range(0, shape[0], height):
        tell(top / shape[0])
        strip = image[top : top + height]
        deepest = np.full(strip.shape, -1, np.float32)
        for value, points, half_width in bodies:
            drawn = rasterise(points, half_width, shape, (top, top + height))
            if drawn is None:
                continue
            (rows, cols), depth = drawn
            place = slice(rows.start - top, rows.stop - top), cols
            ours = (depth >= 0) & (depth > deepest[place])
            strip[place][ours] = value
            deepest[place][ours] = depth[ours]
    return image


def _window(
    points: Float[Array, "N 2"], reach: float, shape: tuple[int, ...]
) -> tuple[Int[Array, " 2"], Int[Array, " 2"]]:
    """First and last-plus-one pixel within `reach` of the points."""
    low = np.clip(np.floor(points.min(axis=0) - reach), 0, shape).astype(int)
    high = np.clip(np.ceil(points.max(axis=0) + reach) + 1, 0, shape).astype(int)
    return low, high


def _depth(
    rows: Int[Array, "h w"],
    cols: Int[Array, "h w"],
    line: Float[Array, "N 2"],
    widths: Float[Array, " N"],
) -> Float[Array, "h w"]:
    """Half-width minus distance from a polyline; the half-width changes evenly along a segment."""
    start, step = line[:-1, :, None, None], np.diff(line, axis=0)[:, :, None, None]
    square = np.maximum((step**2).sum(axis=1), 1e-30)
    away_row, away_col = rows - start[:, 0], cols - start[:, 1]
    along = np.clip((away_row * step[:, 0] + away_col * step[:, 1]) / square, 0, 1)
    distance = np.hypot(away_row - along * step[:, 0], away_col - along * step[:, 1])
    width = widths[:-1, None, None] + along * np.diff(widths)[:, None, None]
    return (width - distance).max(axis=0)

"""Which pixels bodies cover."""

from collections.abc import Callable, Iterator, Sequence
from itertools import product

import numpy as np
from jaxtyping import Float, Int, Integer
from numpy.typing import DTypeLike

from napari_splinesketch.engine.types import Array

Body = tuple[int, Float[Array, "N 2"], Float[Array, " N"]]
"""What its pixels are to hold, its centreline (row, col) and its half-width, px."""
STRIP = 2**19
"""Pixels of a label image that are drawn at a time: their depth is held beside them."""
TILE = 90
"""Side of what is drawn around a segment at a time, px, at most."""
PIECE, PIECES = 16.0, 1000
"""Length of a segment at most, px, if that takes no more of them; longer ones are cut."""
TOGETHER = 2**17
"""Pixels around segments that are drawn at a time; each takes 100 bytes."""


def rasterise(
    points: Float[Array, "N 2"], half_width: Float[Array, " N"], shape: tuple[int, int]
) -> tuple[tuple[slice, slice], Float[Array, "h w"]] | None:
    """Find the pixels of a body: round at its ends, as wide as its half-width says, px.

    Gives the part of an image of (H, W) that lies around it, and in that the half-width minus the
    distance from the centreline, px, in 4 bytes: not negative inside the body, negative infinite
    where it is not near. None where the half-width is not known or the body lies outside the image.
    """
    if not np.all(np.isfinite(half_width)):
        return None
    reach = half_width.max()
    low = np.clip(np.floor(points.min(axis=0) - reach), 0, shape).astype(int)
    high = np.clip(np.ceil(points.max(axis=0) + reach) + 1, 0, shape).astype(int)
    if np.any(high <= low):
        return None
    whole = high - low
    depth = np.full(tuple(whole), -np.inf, np.float32)
    length = np.linalg.norm(np.diff(points, axis=0), axis=1)
    pieces = np.ceil(length / max(PIECE, length.sum() / PIECES)).clip(1)
    corners = np.arange(len(points))
    at = np.interp(np.arange(pieces.sum() + 1), np.append(0, pieces.cumsum()), corners)
    points = np.column_stack([np.interp(at, corners, each) for each in (points - low).T])
    half_width = np.interp(at, corners, half_width)
    # Of many segments at a time, windows of one size, which hold the largest of them.
    reach = np.maximum(half_width[:-1], half_width[1:])[:, None]
    first = np.floor(np.minimum(points[:-1], points[1:]) - reach)
    last = np.ceil(np.maximum(points[:-1], points[1:]) + reach) + 1
    there = np.flatnonzero(((last > 0) & (first < whole)).all(axis=1))
    size = np.minimum((last - first)[there].max(axis=0, initial=1), whole).astype(int)
    corner = np.clip(first, 0, whole - size).astype(int)
    count = max(1, TOGETHER // np.minimum(size, TILE).prod())
    for tile in product(*(range(0, side, TILE) for side in size)):
        row, col = map(np.arange, tile, np.minimum(np.add(tile, TILE), size))
        for some in np.split(there, range(count, len(there), count)):
            down = corner[some, 0, None, None] + row[:, None]
            right = corner[some, 1, None, None] + col
            deep = _depth(down, right, some, points, half_width).astype(np.float32)
            np.maximum.at(depth.ravel(), (down * whole[1] + right).ravel(), deep.ravel())
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
    for share in labelling(bodies, image):
        tell(share)
    return image


def labelling(bodies: Sequence[Body], image: Integer[Array, "H W"]) -> Iterator[float]:
    """Draw bodies, as above, into an image of zeros, one at each step; give the share drawn."""
    shape = image.shape
    height = max(1, STRIP // shape[1])
    reach = [(p[:, 0].min() - w.max(), p[:, 0].max() + w.max()) for _, p, w in bodies]
    # Not known where a half-width is not, and then nothing is drawn.
    low, high = np.array(reach).reshape(-1, 2).T
    for top in range(0, shape[0], height):
        yield top / shape[0]
        strip = image[top : top + height]
        deepest = np.full(strip.shape, -1, np.float32)
        for number in np.flatnonzero((low < top + height) & (high > top - 1)).tolist():
            value, points, half_width = bodies[number]
            drawn = rasterise(points - [top, 0], half_width, (len(strip), shape[1]))
            if drawn is None:
                continue
            place, depth = drawn
            ours = (depth >= 0) & (depth > deepest[place])
            strip[place][ours] = value
            deepest[place][ours] = depth[ours]
            yield top / shape[0]


def _depth(
    rows: Int[Array, "S h 1"],
    cols: Int[Array, "S 1 w"],
    some: Int[Array, " S"],
    points: Float[Array, "N 2"],
    widths: Float[Array, " N"],
) -> Float[Array, "S h w"]:
    """Half-width minus distance from segments; the half-width changes evenly along each."""
    start, step = points[some, :, None, None], (points[some + 1] - points[some])[..., None, None]
    square = np.maximum((step**2).sum(axis=1), 1e-30)
    away_row, away_col = rows - start[:, 0], cols - start[:, 1]
    along = np.clip((away_row * step[:, 0] + away_col * step[:, 1]) / square, 0, 1)
    square = (away_row - along * step[:, 0]) ** 2 + (away_col - along * step[:, 1]) ** 2
    change = widths[some + 1] - widths[some]
    return widths[some, None, None] + along * change[:, None, None] - np.sqrt(square)

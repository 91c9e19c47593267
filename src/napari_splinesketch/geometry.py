"""Bodies as lines with a width: their sides, how scaling widens them; and fewer points of lines."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from napari_splinesketch.engine.types import Array, Line

SEEN = 0.03
"""How far a drawn line may lie from the curve, px."""


def width_growth(points: Line, scale: tuple[float, float]) -> Float[Array, " N"]:
    """Factor from a half-width in pixels to one in physical units, where pixels may be oblong.

    A strip along the unit tangent t keeps its area when the axes are stretched by s, so its width
    grows by s_y s_x / |(s_y t_row, s_x t_col)|.
    """
    tangent = np.gradient(points, axis=0)
    length = np.linalg.norm(tangent, axis=1)
    stretched = np.linalg.norm(tangent * scale, axis=1)
    square = np.full(len(length), np.sqrt(scale[0] * scale[1]))
    return np.divide(scale[0] * scale[1] * length, stretched, out=square, where=stretched > 0)


def edges(points: Line, half_width: Float[Array, " N"]) -> tuple[Line, Line]:
    """Give both sides of a body, half a width beside its centreline, px."""
    tangent = np.gradient(points, axis=0)
    length = np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-12)
    side = half_width[:, None] * np.column_stack([tangent[:, 1], -tangent[:, 0]]) / length
    return points + side, points - side


def with_width(knots: Float[Array, "K 2"], half_width: Float[Array, " N"]) -> Float[Array, "K 3"]:
    """Add half-widths to knots; both are spread evenly along the curve."""
    there, known = (np.linspace(0, 1, len(along)) for along in (knots, half_width))
    return np.column_stack([knots, np.interp(there, known, half_width)])


def area(polygon: Line) -> float:
    """Area inside a polygon that does not cross itself."""
    a, b = polygon.T
    return abs(float(a @ np.roll(b, -1) - b @ np.roll(a, -1))) / 2


def thinned(lines: Sequence[Float[Array, "_ 2"]]) -> list[Float[Array, "_ 2"]]:
    """Leave out the points that lie within `SEEN` of the line through the others.

    What Douglas and Peucker do, for all lines at once: napari's time grows with the points. The
    ends stay; closed lines end where they begin.
    """
    if not lines:
        return []
    points = np.concatenate(lines)
    last = np.cumsum([len(line) for line in lines])
    keep = np.zeros(len(points), dtype=bool)
    keep[last - 1] = keep[np.append(0, last[:-1])] = True
    while (more := _farthest(points, keep)).any():
        keep |= more
    return [line[kept] for line, kept in zip(lines, np.split(keep, last[:-1]), strict=True)]


def _farthest(points: Float[Array, "P 2"], keep: Bool[Array, " P"]) -> Bool[Array, " P"]:
    """Of each stretch between two kept points, find the farthest that may not be left out."""
    corners = np.flatnonzero(keep)
    stretch = np.cumsum(keep) - 1
    begin = points[corners]
    along = np.append(begin[1:], begin[-1:], axis=0) - begin
    length = (along**2).sum(axis=1)
    off, way = points - begin[stretch], along[stretch]
    share = (off * way).sum(axis=1) / np.where(length, length, 1.0)[stretch]
    apart = np.linalg.norm(off - np.clip(share, 0, 1)[:, None] * way, axis=1)
    # A kept point is its own stretch's first, at no distance.
    most = np.maximum.reduceat(apart, corners)
    found = np.flatnonzero((apart > SEEN) & (apart == most[stretch]))
    more = np.zeros(len(points), dtype=bool)
    more[found[np.unique(stretch[found], return_index=True)[1]]] = True
    return more

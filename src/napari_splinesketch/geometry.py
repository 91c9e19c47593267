"""Bodies as lines with a width: their sides, how scaling widens them; points and knots of lines."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from napari_splinesketch.engine import spline
from napari_splinesketch.engine.types import POINTS, Array

SEEN = 0.03
"""How far a drawn line may lie from the curve, px."""
ROUNDS = 4
"""Gauss–Newton steps towards the knots of a line."""
ALONG = 0.01
"""What a miss along a line counts beside one across it."""
LEAST = 1e-9
"""The same of the move of a knot, so that each is determined."""


def width_growth(points: Float[Array, "N 2"], scale: tuple[float, float]) -> Float[Array, " N"]:
    """Factor from a half-width in pixels to one in physical units, where pixels may be oblong.

    A strip along the unit tangent t keeps its area when the axes are stretched by s, so its width
    grows by s_y s_x / |(s_y t_row, s_x t_col)|.
    """
    tangent = np.gradient(points, axis=0)
    length = np.linalg.norm(tangent, axis=1)
    stretched = np.linalg.norm(tangent * scale, axis=1)
    square = np.full(len(length), np.sqrt(scale[0] * scale[1]))
    return np.divide(scale[0] * scale[1] * length, stretched, out=square, where=stretched > 0)


def edges(
    points: Float[Array, "N 2"], half_width: Float[Array, " N"]
) -> tuple[Float[Array, "N 2"], Float[Array, "N 2"]]:
    """Give both sides of a body, half a width beside its centreline, px."""
    tangent = np.gradient(points, axis=0)
    length = np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-12)
    side = half_width[:, None] * np.column_stack([tangent[:, 1], -tangent[:, 0]]) / length
    return points + side, points - side


def with_width(knots: Float[Array, "K 2"], half_width: Float[Array, " N"]) -> Float[Array, "K 3"]:
    """Add half-widths to knots; both are spread evenly along the curve."""
    there, known = (np.linspace(0, 1, len(along)) for along in (knots, half_width))
    return np.column_stack([knots, np.interp(there, known, half_width)])


def places(knots: Float[Array, "K _"], count: int) -> Float[Array, " N"]:
    """Where along the parameter of a spline, 0 to 1, its points are that are evenly spaced."""
    dense = 8 * max(count, POINTS)
    along = spline.arc_length(spline.even_basis(len(knots), dense) @ knots)
    return np.interp(np.linspace(0, along[-1], count), along, np.linspace(0, 1, dense))


def knots_through(points: Float[Array, "N 2"], count: int) -> tuple[Float[Array, "K 2"], float]:
    """Give the knots of the spline whose evenly spaced points are nearest to these; its miss, px.

    Those of a curve come back, and with them how it bends: unlike those of `spline.fit_knots`, they
    need not be evenly spaced. The miss is a root mean square.
    """
    # Where along the spline a point comes to lie hardly matters.
    weights = np.array([spline.normals(points), ALONG * spline.tangents(points)])
    weights[1, [0, -1]] /= ALONG
    tried, knots = list[tuple[float, Float[Array, "K 2"]]](), spline.fit_knots(points, count)
    for _ in range(ROUNDS):
        basis = spline.basis(count, places(knots, len(points)))
        off = points - basis @ knots
        tried.append((float(np.sqrt((off**2).sum(1).mean())), knots))
        rows = (weights[..., None] * basis[:, None]).reshape(-1, 2 * count)
        step = np.linalg.solve(
            rows.T @ rows + LEAST * np.eye(2 * count), rows.T @ (weights * off).sum(axis=2).ravel()
        )
        knots = knots + step.reshape(2, count).T
    miss, best = min(tried, key=lambda each: each[0])
    return best, miss


def area(polygon: Float[Array, "N 2"]) -> float:
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

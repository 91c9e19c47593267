"""Natural cubic splines with uniform knots: values and derivatives are `basis @ knots`."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache, lru_cache
from itertools import accumulate, pairwise

import numpy as np
from jaxtyping import Float
from scipy import ndimage
from scipy.interpolate import CubicSpline
from scipy.spatial import KDTree
from scipy.spatial.distance import cdist

from napari_splinesketch.engine import constants as const
from napari_splinesketch.engine.types import POINTS, Array, Curve


def basis(knots: int, u: Float[Array, " P"], derivative: int = 0) -> Float[Array, "P K"]:
    """Cardinal basis of the natural cubic spline at `u`, or its first to third derivative by `u`.

    The K ≥ 2 knots are uniform on [0, 1]; row p gives their weights in the value at u[p].
    """
    return _cardinal(knots)(np.asarray(u) * (knots - 1), derivative) * (knots - 1) ** derivative


@cache
def _cardinal(knots: int) -> CubicSpline:
    return CubicSpline(np.arange(knots), np.eye(knots), bc_type="natural")


@lru_cache(maxsize=64)
def even_basis(knots: int, count: int) -> Float[Array, "count K"]:
    """`basis` at points uniform in the parameter, from end to end; do not change it."""
    return basis(knots, np.linspace(0.0, 1.0, count))


@lru_cache(maxsize=64)
def thinner(knots: int, few: int) -> Float[Array, "few knots"]:
    """Matrix that gives the `few` knots whose spline is nearest to `knots`; do not change it."""
    return np.linalg.pinv(even_basis(few, knots))


def arc_length(points: Float[Array, "N D"]) -> Float[Array, " N"]:
    """(N,) arc length of a polyline (its first two columns) from its first point, px."""
    square = points[1:] - points[:-1]
    square *= square
    s = np.zeros(len(points))
    np.add.accumulate(np.sqrt(square[:, 0] + square[:, 1]), out=s[1:])
    return s


def apart(
    points: Float[Array, "P 2"], line: Float[Array, "N 2"], most: float = np.inf
) -> Float[Array, " P"]:
    """(P,) distance of points to the nearest point of a line, px; infinite beyond `most`."""
    if len(points) * len(line) < const.FEW_PAIRS:
        away = np.sqrt(cdist(points, line, "sqeuclidean").min(1))
        return away if most == np.inf else np.where(away < most, away, np.inf)
    return KDTree(line).query(points, distance_upper_bound=most)[0]


def around(points: Float[Array, "P 2"], line: Float[Array, "N 2"], reach: float) -> Array:
    """Numbers of the points within `reach` of the bounding box of a line; (P, 2) `all` is slow."""
    sides = zip(points.T, line.min(0) - reach, line.max(0) + reach, strict=True)
    return np.flatnonzero(np.logical_and(*((x > low) & (x < high) for x, low, high in sides)))


def neighbours(curves: Sequence[Float[Array, "P 2"]], reach: float) -> Iterator[list[int]]:
    """Say of each curve which others' bounding boxes come within `reach` of its own."""
    low = np.array([c.min(0) for c in curves]).reshape(-1, 2).T.copy()
    high = np.array([c.max(0) for c in curves]).reshape(-1, 2).T.copy()
    for i in range(len(curves)):
        meet = (low <= high[:, [i]] + reach) & (high >= low[:, [i]] - reach)
        near = np.logical_and(*meet)
        near[i] = False
        yield np.flatnonzero(near).tolist()


def doubles(curves: list[Float[Array, "P 2"]], reach: float, share: float) -> dict[int, int]:
    """Curves that run within `reach` of another for much of their length, with its number."""
    found = {}
    for i, (a, beside) in enumerate(zip(curves, neighbours(curves, reach), strict=True)):
        for j in beside:
            if (apart(a[::4], curves[j][::2]) < reach).mean() > share:
                found[i] = j
    return found


def resample(points: Float[Array, "N D"], count: int) -> Float[Array, "count D"]:
    """Points of a polyline, uniform in arc length; further columns are interpolated along.

    It has two points or more, and a length above 0.
    """
    s = arc_length(points)
    target = s[-1] * _shares(count)
    found = np.empty((count, points.shape[1]))
    for column in range(points.shape[1]):
        found[:, column] = np.interp(target, s, points[:, column])
    return found


def resample_each(
    lines: Sequence[Float[Array, "N D"]], counts: Sequence[int] | None = None
) -> tuple[list[Float[Array, "count D"]], Float[Array, " L"]]:
    """`resample` for many polylines at once, and their lengths, px.

    Without counts they have a point every px, 8 at least.
    """
    points = np.concatenate(lines)
    s, ends = arc_length(points), np.cumsum([0, *map(len, lines)])
    first = s[ends[:-1]]
    lengths = s[ends[1:] - 1] - first
    counts = [max(8, int(length) + 1) for length in lengths] if counts is None else counts
    shares = zip(first.tolist(), lengths.tolist(), counts, strict=True)
    target = np.concatenate([start + length * _shares(n) for start, length, n in shares])
    found = np.stack([np.interp(target, s, column) for column in points.T], axis=1)
    return [found[a:b] for a, b in pairwise(accumulate(counts, initial=0))], lengths


@lru_cache(maxsize=256)
def _shares(count: int) -> Float[Array, " count"]:
    return np.linspace(0.0, 1.0, count)


def tangents(points: Float[Array, "N 2"]) -> Float[Array, "N 2"]:
    """(N, 2) unit tangents of a polyline."""
    middle = (points[2:] - points[:-2]) / 2
    along = np.concatenate([points[1:2] - points[:1], middle, points[-1:] - points[-2:-1]])
    return along / (np.linalg.norm(along, axis=1, keepdims=True) + 1e-9)


def normals(points: Float[Array, "N 2"]) -> Float[Array, "N 2"]:
    """(N, 2) unit normals of a polyline: its directions, turned by a quarter."""
    return tangents(points)[:, ::-1] * [-1.0, 1.0]


def sharpest_turn(points: Float[Array, "N 2"], reach: float) -> float:
    """By how much a dense polyline turns over a length of `reach` px, at most, rad."""
    step = np.diff(points, axis=0)
    direction = np.unwrap(np.arctan2(step[:, 1], step[:, 0]))
    s = arc_length(points)
    middle = (s[1:] + s[:-1]) / 2
    return float(np.abs(np.interp(middle + reach, middle, direction) - direction).max())


def across(
    image: Float[Array, "H W"], points: Float[Array, "N 2"], offsets: Float[Array, " T"]
) -> Float[Array, "N T"]:
    """An image along the normals of a polyline, at some distances from it, px."""
    at = points[:, None] + offsets[None, :, None] * normals(points)[:, None]
    return ndimage.map_coordinates(image, at.transpose(2, 0, 1), order=1, mode="nearest")


def distinct(points: Float[Array, "N 2"]) -> Float[Array, "M 2"]:
    """A polyline without points that are the same as the one before, as a double click sets."""
    return points[np.append(True, (points[1:] != points[:-1]).any(1))]


def steadied(points: Float[Array, "N 2"], most: int) -> Float[Array, "M 2"]:
    """At most `most` points for a line of many, drawn by a hand that shakes; its ends stay."""
    if len(points) <= most:
        return points
    parts = np.array_split(points[1:-1], most - 2)
    return np.array([points[0], *(part.mean(0) for part in parts), points[-1]])


def smoothed(lines: Sequence[Float[Array, "N 2"]], sigma: float) -> list[Float[Array, "M 2"]]:
    """Polylines resampled every px and smoothed along their length; their ends stay."""
    lines, reach = resample_each(lines)[0], int(const.PATH_SMOOTH_CUT * sigma + 0.5)
    row = np.concatenate([_mirrored(line, reach) for line in lines])
    row = ndimage.gaussian_filter1d(row, sigma, axis=0, truncate=const.PATH_SMOOTH_CUT)
    first = np.cumsum([reach, *(len(line) + 2 * reach for line in lines[:-1])])
    return [row[a : a + len(line)] for a, line in zip(first, lines, strict=True)]


def _mirrored(line: Float[Array, "N 2"], reach: int) -> Float[Array, "M 2"]:
    """A line with `reach` points more at either end, mirrored through the end point."""
    if len(line) <= reach:
        return np.pad(line, ((reach, reach), (0, 0)), "reflect", reflect_type="odd")
    before, after = 2 * line[:1] - line[reach:0:-1], 2 * line[-1:] - line[-2 : -reach - 2 : -1]
    return np.concatenate([before, line, after])


def sample(knots: Float[Array, "K D"], count: int) -> Float[Array, "count D"]:
    """Points of the spline through `knots`, uniform in arc length (of row and col)."""
    return resample(even_basis(len(knots), 8 * count) @ knots, count)


def places(knots: Float[Array, "K D"], count: int = POINTS) -> Float[Array, " count"]:
    """Where along the spline's parameter its points are that are uniform in arc length."""
    dense = 8 * max(count, POINTS)
    s = arc_length(even_basis(len(knots), dense) @ knots)
    return np.interp(s[-1] * _shares(count), s, _shares(dense))


def fine(curve: Curve) -> Curve:
    """The same curve to draw, with more points where the line through them would cut its bends."""
    made, points, along = curve, curve.points, np.linspace(0, 1, len(curve.points))
    for _ in range(const.FINEST if curve.status != "failed" else 0):
        # An arc is about an eighth of the second difference away from its chord.
        if np.linalg.norm(np.diff(points, 2, axis=0), axis=1).max() < 8 * const.CUT_PX:
            break
        points = sample(curve.knots[:, :2], 2 * len(points) - 1)
        at = np.linspace(0, 1, len(points))
        width, sd = (np.interp(at, along, each) for each in (curve.half_width, curve.sd))
        made = replace(curve, points=points, half_width=width, sd=sd)
    return made


def fit_knots(points: Float[Array, "N D"], knots: int) -> Float[Array, "K D"]:
    """Knots of the spline nearest to a polyline in the least-squares sense.

    The ends of the polyline are kept; the parameter is its arc length.
    """
    dense = resample(points, 12 * knots)
    return _fitter(knots) @ dense


def knot_miss(points: Float[Array, "N 2"], knots: int) -> float:
    """Root mean square distance, px, of a polyline from the spline that is nearest to it."""
    count = max(64, int(arc_length(points)[-1] / 4))
    off = sample(fit_knots(points, knots), count) - resample(points, count)
    return float(np.sqrt((off**2).sum(1).mean()))


@cache
def _fitter(knots: int) -> Float[Array, "K N"]:
    """Least squares with the first and last point held (weight 1e3)."""
    rows = even_basis(knots, 12 * knots)
    weight = np.ones(len(rows))
    weight[[0, -1]] = 1e3
    return np.linalg.pinv(rows * weight[:, None]) * weight


@cache
def bending_matrix(knots: int) -> Float[Array, "K K"]:
    """∫ B″ᵀB″ du: knotsᵀ Q knots is the integrated squared second derivative."""
    second = basis(knots, np.linspace(0.0, 1.0, knots), 2)
    # B'' is linear between knots, so each interval integrates as (a² + ab + b²) / 3.
    a, b = second[:-1], second[1:]
    cross = a.T @ b
    return (a.T @ a + b.T @ b + (cross + cross.T) / 2) / (3 * (knots - 1))

"""How far a curve is from the truth: dynamic time warping, normal distance, end-point error."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from numbers import Integral
from numbers import Real as RealNumber

import numpy as np
from jaxtyping import Float, Int, Real
from scipy.interpolate import CubicSpline
from scipy.optimize import linear_sum_assignment
from scipy.spatial import KDTree
from skimage.graph import MCP

from napari_splinesketch.engine.checks import checked_line, checked_lines
from napari_splinesketch.engine.constants import FARTHEST_PX
from napari_splinesketch.engine.spline import arc_length, distinct, neighbours
from napari_splinesketch.engine.types import POINTS, Array, InputError, Line

_OVERSAMPLING = 8


def resample(curve: Real[np.ndarray, "N 2"], n: int = POINTS) -> Float[np.ndarray, "n 2"]:
    """Points uniform in arc length on the cubic spline through a polyline's vertices.

    Parameters
    ----------
    curve
        (N, 2): row, col, px; N at least 2. Repeated vertices are dropped.
    n
        Number of points wanted.

    Returns
    -------
    (n, 2): row, col, px; the first and last are the polyline's ends.
    """
    if not isinstance(n, Integral) or n < 1:
        raise InputError(f"n is {n!r}; give a whole number of points, from 1.")
    points = distinct(checked_line(curve, "the curve", finite=True))
    if len(points) < 2:
        raise InputError(f"A curve needs two distinct points; got {np.shape(curve)}.")
    t = arc_length(points)
    spline = CubicSpline(t, points)
    dense_t = np.interp(
        np.linspace(0, len(t) - 1, _OVERSAMPLING * max(n, len(t))), np.arange(len(t)), t
    )
    arc = arc_length(spline(dense_t))
    return spline(np.interp(np.linspace(0, arc[-1], n), arc, dense_t))


def average_dtw(a: Real[np.ndarray, "N 2"], b: Real[np.ndarray, "M 2"]) -> float:
    """Average dynamic-time-warping distance between two curves, px.

    Both are resampled to 100 points by cubic interpolation; the cost of the best warping path
    is divided by the number of its steps; the better of the two orientations counts.
    """
    p, q = resample(a), resample(b)
    cost = np.linalg.norm(p[:, None] - q[None], axis=2)
    return min(_warp(cost), _warp(cost[:, ::-1]))


def _warp(cost: Float[np.ndarray, "N M"]) -> float:
    """Mean cost along the cheapest monotone path through `cost`, corner to corner."""
    end = cost.shape[0] - 1, cost.shape[1] - 1
    paths = MCP(cost, offsets=[(1, 0), (0, 1), (1, 1)])
    total, _ = paths.find_costs([(0, 0)], [end])
    return float(total[end] / len(paths.traceback(end)))


def normal_distances(
    a: Real[np.ndarray, "N 2"], b: Real[np.ndarray, "M 2"]
) -> Float[np.ndarray, "100"]:
    """Distance of each of `a`'s 100 points from curve `b`, px; NaN where the nearest is an end."""
    distance, place = nearest(resample(a), resample(b, 4 * POINTS))
    return np.where((place > 0) & (place < 1), distance, np.nan)


def nearest(samples: Line, fine: Line) -> tuple[Float[Array, " N"], Float[Array, " N"]]:
    """Distance of each sample from a finely sampled line, and where along it (0 to 1)."""
    _, index = KDTree(fine).query(samples)
    tangent = np.gradient(fine, axis=0)
    step = np.linalg.norm(tangent, axis=1, keepdims=True)
    away = samples - fine[index]
    along = np.einsum("nd,nd->n", away, tangent[index] / step[index] ** 2)
    place = np.clip(index + along, 0, len(fine) - 1)
    foot = fine[index] + (place - index)[:, None] * tangent[index]
    return np.linalg.norm(samples - foot, axis=1), place / (len(fine) - 1)


def normal_distance(a: Real[np.ndarray, "N 2"], b: Real[np.ndarray, "M 2"]) -> float:
    """Mean distance of `a`'s points from curve `b` along the normal, px.

    Points of `a` whose nearest point on `b` is one of `b`'s ends do not count; NaN if none is
    left.
    """
    distances = normal_distances(a, b)
    return float(np.nanmean(distances)) if np.isfinite(distances).any() else float("nan")


def end_error(a: Real[np.ndarray, "N 2"], b: Real[np.ndarray, "M 2"]) -> float:
    """Mean distance between the ends of two curves in the better orientation, px."""
    ends_a, ends_b = (checked_line(line, "the curve", finite=True)[[0, -1]] for line in (a, b))
    same = np.linalg.norm(ends_a - ends_b, axis=1).mean()
    swapped = np.linalg.norm(ends_a - ends_b[::-1], axis=1).mean()
    return float(min(same, swapped))


@dataclass(frozen=True, eq=False)
class Matching:
    """Which curve is which truth."""

    pairs: Int[np.ndarray, "P 2"]
    """(P, 2): index of the curve and of the truth it was matched with, within the tolerance."""
    distances: Float[np.ndarray, " P"]
    """(P,): average DTW of each pair, px."""
    precision: float
    recall: float
    """`precision` and `recall`: share of curves, and of truths, that are in a pair; 1 where there
    are none to be in one."""


def match(
    curves: Sequence[Real[np.ndarray, "N 2"]],
    truths: Sequence[Real[np.ndarray, "M 2"]],
    *,
    tolerance: float = 2.0,
) -> Matching:
    """Match curves with truths one to one so that the sum of their distances is smallest.

    Parameters
    ----------
    curves, truths
        Polylines (N, 2), row and col, px.
    tolerance
        Largest average DTW of a pair, px.
    """
    if not isinstance(tolerance, RealNumber) or not 0 <= tolerance < FARTHEST_PX:
        raise InputError(
            f"tolerance is {tolerance!r}; give a distance from 0 to {FARTHEST_PX:g} px."
        )
    # Average DTW is at least the distance between some two points, so that bounding boxes settle
    # most pairs.
    curves = checked_lines(curves, "curves", "curve", finite=True)
    truths = checked_lines(truths, "truths", "truth", finite=True)
    cost, both = np.full((len(curves), len(truths)), 2 * tolerance + 1.0), [*curves, *truths]
    dots = {i for i, line in enumerate(both) if not np.ptp(line, axis=0).any()}  # in no pair
    for i, near in zip(range(len(curves)), neighbours(both, tolerance), strict=False):
        for j in near:
            if (k := j - len(curves)) >= 0 and not dots & {i, j}:
                cost[i, k] = min(average_dtw(curves[i], truths[k]), cost[i, k])
    rows, columns = linear_sum_assignment(cost)
    good = cost[rows, columns] <= tolerance
    pairs = np.stack([rows[good], columns[good]], axis=1)
    return Matching(
        pairs=pairs,
        distances=cost[rows, columns][good],
        precision=len(pairs) / len(curves) if len(curves) else 1.0,
        recall=len(pairs) / len(truths) if len(truths) else 1.0,
    )


@dataclass(frozen=True)
class Comparison:
    """How far curves are from the truth, over all frames together."""

    tolerance: float
    """Largest average DTW of a pair, px."""
    curves: int
    truths: int
    pairs: int
    """`curves`, `truths` and `pairs`: how many there are, and how many could be matched one to one
    within the tolerance."""
    precision: float
    recall: float
    """`precision` and `recall`: pairs over curves, pairs over truths."""
    dtw_median: float | None
    dtw_mean: float | None
    dtw_p95: float | None
    """`dtw_median`, `dtw_mean` and `dtw_p95`: average DTW over the pairs, px."""
    normal_distance: float | None
    """Mean distance along the normal over the pairs, px."""
    end_error: float | None
    """Mean distance between ends over the pairs, px."""


def compare(
    frames: Iterable[Sequence[Sequence[Real[np.ndarray, "_ 2"]]]], *, tolerance: float
) -> Comparison:
    """Match the curves of each frame one to one with its truths, as in `match`; measure the pairs.

    `frames` gives curves and truths of each.
    """
    ours = theirs = 0
    found = list[tuple[float, float, float]]()
    for curves, truths in frames:
        ours, theirs = ours + len(curves), theirs + len(truths)
        matching = match(curves, truths, tolerance=tolerance)
        for (i, j), distance in zip(matching.pairs, matching.distances, strict=True):
            pair = curves[i], truths[j]
            found.append((distance, normal_distance(*pair), end_error(*pair)))
    distances, normals, ends = np.array(found).reshape(-1, 3).T
    return Comparison(
        tolerance,
        ours,
        theirs,
        len(found),
        precision=len(found) / ours if ours else 1.0,
        recall=len(found) / theirs if theirs else 1.0,
        dtw_median=_rounded(np.median, distances),
        dtw_mean=_rounded(np.mean, distances),
        dtw_p95=_rounded(partial(np.percentile, q=95), distances),
        normal_distance=_rounded(np.mean, normals[np.isfinite(normals)]),
        end_error=_rounded(np.mean, ends),
    )


def _rounded(
    statistic: Callable[..., np.floating], values: Float[np.ndarray, " P"]
) -> float | None:
    return round(float(statistic(values)), 4) if len(values) else None

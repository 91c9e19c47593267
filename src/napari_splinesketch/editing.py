"""Curves that are changed by hand: knots moved, cut, joined, extended; the knots of a line."""

from collections.abc import Sequence
from dataclasses import replace
from numbers import Integral
from numbers import Real as RealNumber

import numpy as np
from jaxtyping import Float

from napari_splinesketch.engine import spline
from napari_splinesketch.engine.checks import checked_line
from napari_splinesketch.engine.types import POINTS, Curve, InputError, Line
from napari_splinesketch.geometry import with_width

BY_HAND = "it was changed by hand and not refined since"
SHORTEST = 4.0
"""A piece of a curve is at least this long, px."""
SOME, MOST = 6, 96
"""Knots of a curve that was cut or joined."""
ROUNDS = 4
"""Gauss–Newton steps towards the knots of a line."""
ALONG = 0.01
"""What a miss along a line counts beside one across it."""
LEAST = 1e-9
"""The same of the move of a knot, so that each is determined."""


def moved(curve: Curve, knots: Line) -> Curve:
    """Lead a curve through other knots; along it, its half-widths stay as they are."""
    knots = checked_line(knots, "knots", finite=True)
    if len(knots) < 2:
        raise InputError("knots has 1 row; a curve needs two or more, row and col in px.")
    return _by_hand(with_width(knots, curve.knots[:, 2]), curve.half_width, curve.residual)


def flipped(curve: Curve) -> Curve:
    """Let a curve begin where it ended."""
    along = ("knots", "points", "half_width", "sd")
    return replace(curve, **{name: getattr(curve, name)[::-1] for name in along})


def nearest(curve: Curve, point: Float[np.ndarray, "2"]) -> tuple[int, float]:
    """Position of the curve's point that is nearest to another, and how far the curve is, px."""
    if np.shape(point) != (2,) or np.isnan(point).any():
        raise InputError(f"point is {point!r}; give one place (2,), row and col in px.")
    apart = np.linalg.norm(curve.points - point, axis=1)
    off = apart.min()
    if off < curve.length / 50:  # it may lie between points, which are far apart on a long curve
        line = spline.resample(spline.fine(curve).points, POINTS + int(curve.length))
        off = np.linalg.norm(line - point, axis=1).min()
    return int(apart.argmin()), float(off)


def split(curve: Curve, at: int) -> tuple[Curve, Curve]:
    """Cut a curve at one of its points; InputError if a piece would be too short."""
    along = spline.arc_length(curve.points)
    if not isinstance(at, Integral) or not 0 <= at < len(along):
        raise InputError(f"at is {at!r}; give the number of a point, from 0 to {len(along) - 1}.")
    if min(along[at], along[-1] - along[at]) < SHORTEST:
        raise InputError(f"Each piece must be {SHORTEST:.0f} px long: cut farther from the end.")
    share, line = along[at] / along[-1], spline.fine(curve)
    at = at * (len(line.points) - 1) // (len(along) - 1)
    return _fitted([line], slice(at + 1), share), _fitted([line], slice(at, None), 1 - share)


def joined(curve: Curve, other: Curve) -> Curve:
    """Make one curve of two, by those of their ends that are nearest; it runs as the first."""
    ends = [curve.points[[0, -1]], other.points[[0, -1]]]
    apart = np.linalg.norm(ends[0][:, None] - ends[1][None], axis=2)
    mine, theirs = np.unravel_index(apart.argmin(), apart.shape)
    first, second = spline.fine(curve), spline.fine(other)
    first, second = first if mine else flipped(first), flipped(second) if theirs else second
    # Where one lies over the other, the second goes on from where the first ends.
    begin, off = nearest(second, first.points[-1])
    if max(off, nearest(first, second.points[0])[1]) < body_width(first) / 2:
        along = {name: getattr(second, name)[begin:] for name in ("points", "half_width")}
        second = replace(second, **along)
    made = _fitted([first, second])
    return made if mine else flipped(made)


def extended(curve: Curve, at_end: bool, by: float) -> Curve:
    """Lengthen a curve along its tangent, at its end or at its beginning, by some px."""
    if not isinstance(by, RealNumber) or not 0 < by < np.inf:
        raise InputError(f"by is {by!r}; give a length above 0, px.")
    if not at_end:
        return flipped(extended(flipped(curve), True, by))
    line = spline.fine(curve).points
    back = line[-1] - line[-4]
    along = back / max(float(np.linalg.norm(back)), 1e-9)
    steps = np.linspace(0, by, 9)[1:, None]
    points = np.concatenate([line, line[-1] + steps * along])
    # The profile stretches with the curve, so that it tapers at the new end.
    even = spline.resample(points, len(points))
    return moved(curve, knots_through(even, min(len(curve.knots) + 1, MOST))[0])


def knots_through(points: Line, count: int) -> tuple[Line, float]:
    """Give the knots of the spline whose evenly spaced points are nearest to these; its miss, px.

    Those of a curve come back, and with them how it bends: unlike those of `spline.fit_knots`, they
    need not be evenly spaced. The miss is a root mean square.
    """
    # Where along the spline a point comes to lie hardly matters.
    weights = np.array([spline.normals(points), ALONG * spline.tangents(points)])
    weights[1, [0, -1]] /= ALONG
    tried, knots = list[tuple[float, Line]](), spline.fit_knots(points, count)
    for _ in range(ROUNDS):
        basis = spline.basis(count, spline.places(knots, len(points)))
        off = points - basis @ knots
        tried.append((float(np.sqrt((off**2).sum(1).mean())), knots))
        rows = (weights[..., None] * basis[:, None]).reshape(-1, 2 * count)
        step = np.linalg.solve(
            rows.T @ rows + LEAST * np.eye(2 * count), rows.T @ (weights * off).sum(axis=2).ravel()
        )
        knots = knots + step.reshape(2, count).T
    miss, best = min(tried, key=lambda each: each[0])
    return best, miss


def body_width(curve: Curve) -> float:
    """Give the usual width of a body, px; a guess where it is not known."""
    finite = curve.half_width[np.isfinite(curve.half_width)]
    return 2 * float(np.median(finite)) if finite.size else SHORTEST


def _fitted(curves: Sequence[Curve], piece: slice = slice(None), share: float = 1.0) -> Curve:
    """Make a curve along others, or along a piece that is a share of their length."""
    points = np.concatenate([curve.points[piece] for curve in curves])
    width = np.concatenate([curve.half_width[piece] for curve in curves])
    at, known = np.arange(len(width)), np.isfinite(width)
    if known.any():  # elsewhere it is that of the nearest places
        width = np.interp(at, at[known], width[known])
    knots = sum(len(curve.knots) for curve in curves)
    count = int(np.clip(knots if share == 1 else round(share * knots) + 2, SOME, MOST))
    even = spline.resample(np.column_stack([points, width]), POINTS)
    found, _ = knots_through(spline.resample(points, max(len(points), POINTS)), count)
    residual = max(curve.residual for curve in curves)
    return _by_hand(with_width(found, even[:, 2]), even[:, 2], residual)


def _by_hand(
    knots: Float[np.ndarray, "K 3"], half_width: Float[np.ndarray, " P"], residual: float
) -> Curve:
    """Make the curve through some knots: nothing is known of how well it lies."""
    points, nothing_known = spline.sample(knots[:, :2], POINTS), np.full(POINTS, np.inf)
    return Curve(knots, points, half_width, nothing_known, "check", (BY_HAND,), residual)

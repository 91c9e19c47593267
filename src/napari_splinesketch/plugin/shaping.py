"""Changing curves by hand: plain geometry on values, free of Qt and napari."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from napari_splinesketch.engine import spline
from napari_splinesketch.engine.types import POINTS, Curve

BY_HAND = "it was changed by hand and not refined since"
FEWEST, MOST = 6, 24
"""Knots of a curve that was cut or joined."""
SHORTEST = 4.0
"""A piece of a curve is at least this long, px."""


def moved(curve: Curve, knots: Float[np.ndarray, "K 2"]) -> Curve:
    """Lead a curve through other knots; along it, its half-widths stay as they are."""
    return _by_hand(_with_width(curve, knots), curve.half_width, curve.residual)


def flipped(curve: Curve) -> Curve:
    """Let a curve begin where it ended."""
    return replace(
        curve,
        knots=curve.knots[::-1],
        points=curve.points[::-1],
        half_width=curve.half_width[::-1],
        sd=curve.sd[::-1],
    )


def nearest(curve: Curve, point: Float[np.ndarray, "2"]) -> tuple[int, float]:
    """Position of the curve's point that is nearest to another, and how far it is, px."""
    apart = np.linalg.norm(curve.points - point, axis=1)
    return int(apart.argmin()), float(apart.min())


def split(curve: Curve, at: int) -> tuple[Curve, Curve]:
    """Cut a curve at one of its points; ValueError if a piece would be too short."""
    along = spline.arc_length(curve.points)
    if min(along[at], along[-1] - along[at]) < SHORTEST:
        raise ValueError(f"Each piece must be {SHORTEST:.0f} px long: cut farther from the end.")
    first = _fitted(curve.points[: at + 1], curve.half_width[: at + 1], _share(curve, along, at))
    rest = _share(curve, along[-1] - along, at)
    return (
        replace(first, residual=curve.residual),
        replace(_fitted(curve.points[at:], curve.half_width[at:], rest), residual=curve.residual),
    )


def joined(curve: Curve, other: Curve) -> Curve:
    """Make one curve of two, by those of their ends that are nearest; it runs as the first."""
    ends = [curve.points[[0, -1]], other.points[[0, -1]]]
    apart = np.linalg.norm(ends[0][:, None] - ends[1][None], axis=2)
    mine, theirs = np.unravel_index(apart.argmin(), apart.shape)
    first = curve if mine else flipped(curve)
    second = flipped(other) if theirs else other
    points = np.concatenate([first.points, second.points])
    width = np.concatenate([first.half_width, second.half_width])
    made = _fitted(points, width, len(curve.knots) + len(other.knots))
    made = replace(made, residual=max(curve.residual, other.residual))
    return made if mine else flipped(made)


def extended(curve: Curve, at_end: bool, by: float) -> Curve:
    """Lengthen a curve along its tangent, at its end or at its beginning, by some px."""
    if not at_end:
        return flipped(extended(flipped(curve), True, by))
    back = curve.points[-1] - curve.points[-4]
    along = back / max(float(np.linalg.norm(back)), 1e-9)
    steps = np.linspace(0, by, 9)[1:, None]
    points = np.concatenate([curve.points, curve.points[-1] + steps * along])
    knots = spline.fit_knots(points, min(len(curve.knots) + 1, MOST))
    # The profile stretches with the curve, so that it tapers at the new end.
    return _by_hand(_with_width(curve, knots), curve.half_width, curve.residual)


def body_width(curve: Curve) -> float:
    """Give the usual width of a body, px; a guess where it is not known."""
    finite = curve.half_width[np.isfinite(curve.half_width)]
    return 2 * float(np.median(finite)) if finite.size else SHORTEST


def _with_width(curve: Curve, knots: Float[np.ndarray, "K 2"]) -> Float[np.ndarray, "K 3"]:
    """Give other knots the half-widths that the curve has there."""
    there = np.linspace(0, 1, len(curve.knots))
    width = np.interp(np.linspace(0, 1, len(knots)), there, curve.knots[:, 2])
    return np.column_stack([knots, width])


def _share(curve: Curve, along: Float[np.ndarray, " P"], at: int) -> int:
    """Knots for a piece of a curve."""
    return round(len(curve.knots) * float(along[at] / along.max())) + 2


def _fitted(points: Float[np.ndarray, "N 2"], width: Float[np.ndarray, " N"], knots: int) -> Curve:
    """Make a curve along a line."""
    count = int(np.clip(knots, FEWEST, MOST))
    step = np.linalg.norm(np.diff(points, axis=0), axis=1)
    apart = np.append(True, step > 0)
    even = spline.resample(np.column_stack([points, width])[apart], POINTS)
    found = spline.fit_knots(even[:, :2], count)
    at = np.linspace(0, 1, count)
    along = np.interp(at, np.linspace(0, 1, POINTS), even[:, 2])
    return _by_hand(np.column_stack([found, along]), even[:, 2], np.inf)


def _by_hand(
    knots: Float[np.ndarray, "K 3"], half_width: Float[np.ndarray, " P"], residual: float
) -> Curve:
    """Make the curve through some knots: nothing is known of how well it lies."""
    return Curve(
        knots,
        spline.sample(knots[:, :2], POINTS),
        half_width,
        np.full(POINTS, np.inf),
        "check",
        (BY_HAND,),
        residual,
    )

"""Velocity and curvature of a body over (u, t)."""

from collections.abc import Mapping
from dataclasses import dataclass
from numbers import Integral
from reprlib import repr as short

import numpy as np
from jaxtyping import Float, Int

from napari_splinesketch.engine import spline
from napari_splinesketch.engine.types import Curve, InputError, Line


@dataclass(frozen=True, eq=False)
class Kymograph:
    """One body over its length and over time."""

    frames: Int[np.ndarray, " T"]
    """(T,) from the first frame to the last; a frame without a curve has NaN."""
    curvature: Float[np.ndarray, "T P"]
    """(T, P) 1 / px, positive where the body bends from the row axis towards the column axis."""
    along: Float[np.ndarray, "T P"]
    across: Float[np.ndarray, "T P"]
    """`along` and `across`: (T, P) velocity of the points, px a frame, along the body (towards its
    end) and to its left, from the frames on either side."""

    @property
    def speed(self) -> Float[np.ndarray, " T"]:
        """(T,) mean speed of the points, px a frame."""
        return np.hypot(self.along, self.across).mean(1)


def kymograph(curves: Mapping[int, Curve], points: int = 100) -> Kymograph:
    """Velocity and curvature of one body.

    Parameters
    ----------
    curves
        By frame; all from the same end, as tracking gives them.
    points
        Along the body, at least 2.
    """
    known = isinstance(curves, Mapping) and all(isinstance(c, Curve) for c in curves.values())
    if not (known and curves and all(isinstance(frame, Integral) for frame in curves)):
        raise InputError(
            f"curves is {short(curves)}; give the curves of one body, by frame: whole numbers"
        )
    if not isinstance(points, Integral) or points < 2:
        raise InputError(f"points is {points!r}; give a whole number of points, from 2")
    frames = np.arange(min(curves), max(curves) + 1)
    lines = np.full((len(frames), points, 2), np.nan)
    curvature = np.full((len(frames), points), np.nan)
    for frame, curve in curves.items():
        at = frame - frames[0]
        lines[at] = spline.resample(curve.points, points)
        curvature[at] = curvature_of(curve, points)
    tangent = np.gradient(lines, axis=1)
    tangent /= np.linalg.norm(tangent, axis=2, keepdims=True)
    step, none = np.diff(lines, axis=0), np.full((1, points, 2), np.nan)
    both = np.stack([np.concatenate([none, step]), np.concatenate([step, none])])
    velocity = np.ma.masked_invalid(both).mean(0).filled(np.nan)  # one of the two beside a gap
    left = np.stack([-tangent[..., 1], tangent[..., 0]], 2)
    return Kymograph(frames, curvature, (velocity * tangent).sum(2), (velocity * left).sum(2))


def curvature_of(curve: Curve, points: int) -> Float[np.ndarray, " points"]:
    """Curvature of a curve's spline at points uniform in arc length, 1 / px."""
    knots = curve.knots[:, :2]
    u = spline.places(knots, points)
    first, second = (spline.basis(len(knots), u, d) @ knots for d in (1, 2))
    speed = np.maximum(np.linalg.norm(first, axis=1), 1e-9)
    return (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / speed**3


def mean_curvature(points: Line) -> float:
    """Mean size of a line's curvature, from how much it turns over its length, 1 / px."""
    step = np.diff(points, axis=0)
    length = np.linalg.norm(step, axis=1)
    turn = np.angle(np.exp(1j * np.diff(np.arctan2(step[:, 1], step[:, 0]))))
    inside = length.sum() - (length[0] + length[-1]) / 2
    return float(np.abs(turn).sum() / inside) if inside > 0 else 0.0


def mean_speed(before: Line | None, now: Line, after: Line | None) -> float:
    """Mean speed of a body's points in one of its frames, px a frame; NaN without another."""
    beside = ((before, now), (now, after))
    steps = [new - old for old, new in beside if old is not None and new is not None]
    return float(np.linalg.norm(np.mean(steps, axis=0), axis=1).mean()) if steps else float("nan")

"""How refined curves look: safe for colour-blind eyes, and never told by colour alone."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from napari_splinesketch import palette
from napari_splinesketch.engine.types import Curve, Status
from napari_splinesketch.plugin.once import once

COLOURS: dict[Status, str] = palette.STATUS  # pyright: ignore[reportAssignmentType]
MARKS: dict[Status, str] = {"good": "", "check": "?", "failed": "!"}
"""Written beside the curve's number."""
BREADTHS: dict[Status, float] = {"good": 1.0, "check": 1.6, "failed": 2.2}
"""Breadth of the line, relative."""

RIBBON_SDS = 2.0


UNKNOWN_REACH = 3.0
"""From centreline to edge where no width is known, px."""
LEAST = 12
"""Points along one side of an outline."""


def breadth(curves: Sequence[Curve]) -> float:
    """Breadth of a good curve's line, px: a third of the bodies' width."""
    widths = np.array([_half_width(curve) for curve in curves])
    finite = widths[np.isfinite(widths)]
    return float(np.clip(0.6 * np.median(finite), 0.6, 8.0)) if finite.size else 1.0


@once
def _half_width(curve: Curve) -> float:
    return float(np.median(curve.half_width))


@once
def has_outline(curve: Curve) -> bool:
    """Whether the width of a body is known."""
    return curve.status != "failed" and bool(np.isfinite(curve.half_width).all())


def outline(curve: Curve) -> Float[np.ndarray, "P 2"]:
    """Draw a closed line at a half-width to both sides of a curve, px."""
    # A body is smooth on the scale of its width: more points would only cost time.
    count = len(curve.points)
    spacing = max(curve.length / (count - 1), 1e-9)
    step = int(np.clip(_half_width(curve) / spacing, 1, count // LEAST))
    some = np.unique(np.append(np.arange(0, count, step), count - 1))
    return _around(curve.points[some], curve.half_width[some])


def reach(curve: Curve) -> float:
    """How far a body goes from its centreline, px; a guess where it is not known."""
    return float(np.max(curve.half_width)) if has_outline(curve) else UNKNOWN_REACH


def halo(curve: Curve, gap: float) -> Float[np.ndarray, "P 2"]:
    """Draw a closed line outside a body, px: all of the body and its outline can be seen in it."""
    width = curve.half_width if has_outline(curve) else np.full(len(curve.points), UNKNOWN_REACH)
    points = curve.points
    along = np.diff(points[[0, 1, -2, -1]], axis=0)[[0, 2]]
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    ends = np.stack([points[0] - gap * along[0], points[-1] + gap * along[1]])
    longer = np.concatenate([ends[:1], points, ends[1:]])
    return _around(longer, np.pad(width, 1, mode="edge") + gap)


def ribbon(curve: Curve) -> Float[np.ndarray, "P 2"] | None:
    """Draw a closed line at `RIBBON_SDS` standard errors to both sides of a curve, px.

    None where the standard errors are not known.
    """
    if curve.status == "failed" or not np.isfinite(curve.sd).all():
        return None
    return _around(curve.points, RIBBON_SDS * curve.sd)


def normals(points: Float[np.ndarray, "P 2"]) -> Float[np.ndarray, "P 2"]:
    """Unit vectors across a line."""
    along = np.gradient(points, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    return np.column_stack([-along[:, 1], along[:, 0]])


def _around(
    points: Float[np.ndarray, "P 2"], distance: Float[np.ndarray, " P"]
) -> Float[np.ndarray, "Q 2"]:
    """Draw a closed line at a distance to both sides of another."""
    across = distance[:, None] * normals(points)
    left, right = points + across, points - across
    return np.concatenate([left, right[::-1], left[:1]])

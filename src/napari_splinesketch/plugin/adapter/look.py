"""How refined curves look: safe for colour-blind eyes, and never told by colour alone."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from napari_splinesketch.engine.types import Curve, Status

COLOURS: dict[Status, str] = {"good": "#009e73", "check": "#e69f00", "failed": "#d55e00"}
"""Bluish green, orange and vermilion of Okabe and Ito."""
MARKS: dict[Status, str] = {"good": "", "check": "?", "failed": "!"}
"""Written beside the curve's number."""
BREADTHS: dict[Status, float] = {"good": 1.0, "check": 1.6, "failed": 2.2}
"""Breadth of the line, relative."""


def breadth(curves: Sequence[Curve]) -> float:
    """Breadth of a good curve's line, px: a third of the bodies' width."""
    widths = np.array([np.median(curve.half_width) for curve in curves])
    finite = widths[np.isfinite(widths)]
    return float(np.clip(0.6 * np.median(finite), 0.6, 8.0)) if finite.size else 1.0


def outline(curve: Curve) -> Float[np.ndarray, "P 2"] | None:
    """Draw a closed line at a half-width to both sides of a curve, px; None if it failed."""
    if curve.status == "failed" or not np.isfinite(curve.half_width).all():
        return None
    along = np.gradient(curve.points, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    across = curve.half_width[:, None] * np.column_stack([-along[:, 1], along[:, 0]])
    left, right = curve.points + across, curve.points - across
    return np.concatenate([left, right[::-1], left[:1]])

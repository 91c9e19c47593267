"""Noise that neighbouring frames average out: a curve moved along its normal towards them."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float
from scipy import ndimage
from scipy.spatial.distance import cdist

from napari_splinesketch.engine.spline import fit_knots
from napari_splinesketch.engine.types import Curve
from napari_splinesketch.tracking.motion import MOVERS, Known, Mover, Points, steps_to

LAGS = (1, 2, 3, 4)
"""Frames on either side that tell where a curve is."""
KNOWN = 9
"""Frames before it that tell how well they do."""
LOOK = LAGS[-1] + 1
"""Frames after one that are needed for it."""
NOISY = 0.1
"""Standard error, px, from which it is worth while to wait for those frames."""
FEWEST = 3
"""Frames on which a movement must have been tried to be believed."""
SMOOTH = 8
"""Points of a curve over which errors of foretelling are averaged (standard deviation)."""
TOGETHER = 1.3
"""Errors of what several frames foretell go together: they count for so many times less."""
HALF = 0.5
"""Foretelling is never better than so much of a curve's own variance."""
LASTING = 0.1
"""Share of a curve's own variance that is the same in the frames beside it, because bodies are not
exactly tubes: no neighbour averages that out. Measured on generated faint films."""

Along = Float[np.ndarray, "P"]


def steadied(curve: Curve, frame: int, before: Sequence[Known], after: Sequence[Known]) -> Curve:
    """The curve, moved along its normal towards where the frames around foretell it.

    How well they do is measured on the frames before: where a body moves as no frame foretells,
    the curve stays as it is.

    Parameters
    ----------
    curve, frame
        As fitted by itself, and where.
    before, after
        What is known of the body on either side, the nearest last.
    """
    variance = np.minimum(curve.sd, 1e3) ** 2
    precision, pull = np.zeros((2, len(curve.points)))
    for lag in LAGS:
        learned = _learned(before, lag)
        if learned is None:
            continue
        mover, squared = learned
        certain = 1 / (TOGETHER * np.maximum(squared - variance, HALF * variance))
        for side in (before, after):
            if len(side) > lag:
                older, newer = side[-lag - 1], side[-lag]
                line = mover(older[1], newer[1], steps_to(older, newer, frame))
                precision += certain
                pull += certain * offsets(curve.points, line)
    shift = pull * variance / (1 + precision * variance)
    points = curve.points + shift[:, None] * normals(curve.points)
    knots = np.column_stack([fit_knots(points, len(curve.knots)), curve.knots[:, 2]])
    sd = curve.sd * np.sqrt(np.minimum(1 / (1 + precision * variance) + LASTING, 1))
    return replace(curve, points=points, knots=knots, sd=sd)


def _learned(known: Sequence[Known], lag: int) -> tuple[Mover, Along] | None:
    """Which mover foretells a body best across so many frames, and its squared error along it."""
    found = []
    for i in range(lag + 1, len(known)):
        older, newer, now = known[i - lag - 1], known[i - lag], known[i]
        steps = steps_to(older, newer, now[0])
        found.append([offsets(now[1], m(older[1], newer[1], steps)) ** 2 for m in MOVERS])
    if len(found) < FEWEST:
        return None
    squared = np.mean(found, axis=0)
    best = int(np.argmin(squared.mean(1)))
    return MOVERS[best], ndimage.gaussian_filter1d(squared[best], SMOOTH, mode="nearest")


def normals(line: Points) -> Points:
    """(P, 2) unit normals."""
    tangent = np.gradient(line, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True) + 1e-9
    return np.column_stack([-tangent[:, 1], tangent[:, 0]])


def offsets(line: Points, other: Points) -> Along:
    """How far another line is from the points of one, along the normal, px."""
    nearest = cdist(line, other, "sqeuclidean").argmin(1)
    return ((other[nearest] - line) * normals(line)).sum(1)

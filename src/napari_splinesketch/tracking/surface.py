"""A body as a surface over its length and the frames, smooth in time as far as the body is.

Frames are laid on each other along the body's path, so that gliding along it is no movement; what
is left, across it, has small second differences in time. How small is learned from the body's own
frames: a worm that swims is bound loosely, a filament that glides tightly.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float
from scipy import ndimage
from scipy.spatial.distance import cdist

from napari_splinesketch.engine import spline
from napari_splinesketch.engine.types import Curve
from napari_splinesketch.tracking.motion import Points

REACH = 4
"""Frames after one that tell where its curve is ..."""
KNOWN = 8
"""... and before it."""
NOISY = 0.1
"""Standard error, px, from which it is worth while to wait for the frames after."""
FEWEST = 5
"""Frames that must be known to tell how smooth the surface is."""
LOOSENESS = (1e-3, 1e-2, 0.1, 1.0, 10.0, 100.0, 1e4)
"""Variances that second differences may have, in units of a curve's own: the one is taken by which
each frame is likeliest where the others predict it."""
SMOOTH = 8
"""Points of a curve over which likelihoods are averaged (standard deviation)."""
LASTING = 0.1
"""Share of a curve's own variance that is the same in the frames beside it, because bodies are not
exactly tubes: no neighbour averages that out. Measured on generated faint films."""

Along = Float[np.ndarray, "P"]
Seen = tuple[int, Curve]
"""A frame, and the body's curve there."""


def steadied(curve: Curve, frame: int, around: Sequence[Seen]) -> Curve:
    """The curve on the surface that the frames `around` make of it: moved along its normal.

    All are as they were fitted by themselves.
    """
    known = [(frame, curve), *around]
    if len(known) < FEWEST:
        return curve
    at = np.array([t for t, _ in known]) - frame
    rows, here = at - at.min(), -at.min()
    found, weight = np.zeros((np.ptp(at) + 1, len(curve.points))), np.zeros(np.ptp(at) + 1)
    for row, (_, other) in zip(rows, known, strict=True):
        found[row] = offsets(curve.points, other.points) if row != here else 0.0
        weight[row] = min((np.median(curve.sd) / np.median(other.sd)) ** 2, 1.0)
    bend = np.diff(np.eye(len(found)), 2, axis=0)
    variance = np.minimum(curve.sd, 1e3) ** 2
    unlikely, shifts, gains = [], [], []
    for loose in LOOSENESS:
        spread = np.linalg.inv(np.diag(weight) + bend.T @ bend / loose)
        fitted = spread @ (weight[:, None] * found)
        rest = (1 - weight * np.diag(spread))[rows, None]  # of what each frame itself tells
        missed = (found - fitted)[rows] ** 2 * weight[rows, None] / variance / rest - np.log(rest)
        unlikely.append(ndimage.gaussian_filter1d(missed.mean(0), SMOOTH, mode="nearest"))
        shifts.append(fitted[here])
        gains.append(spread[here, here])
    best = np.argmin(unlikely, axis=0)
    shift = np.take_along_axis(np.array(shifts), best[None], 0)[0]
    basis = spline.basis(len(curve.knots), spline.places(curve.knots, len(curve.points)))
    moved = np.linalg.pinv(basis) @ (shift[:, None] * spline.normals(curve.points))
    knots = curve.knots + np.pad(moved, ((0, 0), (0, 1)))
    points = curve.points + basis @ moved
    sd = curve.sd * np.sqrt(np.minimum(np.array(gains)[best] + LASTING, 1))
    return replace(curve, points=points, knots=knots, sd=sd)


def offsets(line: Points, other: Points) -> Along:
    """How far another line is from the points of one, along the normal, px."""
    nearest = cdist(line, other, "sqeuclidean").argmin(1)
    return ((other[nearest] - line) * spline.normals(line)).sum(1)

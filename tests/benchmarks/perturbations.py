"""Ways to spoil a label: displacement, scaling, straight lines; others are in `synthetic`."""

import numpy as np

from napari_splinesketch.metrics import resample
from napari_splinesketch.synthetic.bodies import Points


def displace(
    curve: Points,
    distance: float,
    direction: float | np.random.Generator = 0.0,
) -> Points:
    """Move an (N, 2) curve by `distance` px.

    Parameters
    ----------
    curve
        (N, 2): row, col, px.
    distance
        px.
    direction
        Angle in degrees from the row axis towards the col axis, or a generator to draw it with.
    """
    if isinstance(direction, np.random.Generator):
        direction = direction.uniform(0, 360)
    angle = np.deg2rad(direction)
    return curve + distance * np.array([np.cos(angle), np.sin(angle)])


def scale(curve: Points, factor: float) -> Points:
    """Shrink or stretch an (N, 2) curve about its centroid."""
    centre = curve.mean(axis=0)
    return centre + factor * (curve - centre)


def chord(curve: Points) -> Points:
    """Straight line (2, 2) between the ends of an (N, 2) curve."""
    return curve[[0, -1]].astype(float)


def axis_line(curve: Points) -> Points:
    """Straight line (2, 2) of the curve's own length along its main axis, about its centroid."""
    even = resample(curve)
    centre = even.mean(axis=0)
    axis = np.linalg.svd(even - centre, full_matrices=False)[2][0]
    axis = axis if axis @ (even[-1] - even[0]) >= 0 else -axis
    half = np.linalg.norm(np.diff(even, axis=0), axis=1).sum() / 2
    return np.stack([centre - half * axis, centre + half * axis])

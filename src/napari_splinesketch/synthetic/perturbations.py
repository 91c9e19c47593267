"""Ways to spoil a label: rotation, displacement, scaling, straight lines, PCA compression."""

from functools import cache

import numpy as np
from jaxtyping import Float

from napari_splinesketch.metrics import resample
from napari_splinesketch.synthetic.bodies import random_curve

_POPULATION = 1000
_POPULATION_SEED = 2025

Points = Float[np.ndarray, "N 2"]


def rotate(curve: Points, degrees: float) -> Points:
    """Turn an (N, 2) curve about its centroid, from the row axis towards the col axis."""
    angle = np.deg2rad(degrees)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    centre = curve.mean(axis=0)
    return (curve - centre) @ turn + centre


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


def compress(curve: Points, components: int = 2) -> Points:
    """Curve (100, 2) as the nearest one that a few principal components can describe.

    The components are those of a fixed population of generated curves, each moved to its
    centroid and divided by its length; rotation is left in, so that the first two are nearly
    straight lines along the two axes.
    """
    even = resample(curve)
    centre = even.mean(axis=0)
    length = np.linalg.norm(np.diff(even, axis=0), axis=1).sum()
    mean, basis = _basis()
    scores = basis[:components] @ ((even - centre).ravel() / length - mean)
    shape = mean + scores @ basis[:components]
    return centre + length * shape.reshape(-1, 2)


@cache
def _basis() -> tuple[Float[np.ndarray, "200"], Float[np.ndarray, "200 200"]]:
    """Mean and principal components, largest first, of the population of generated curves."""
    rng = np.random.default_rng(_POPULATION_SEED)
    shapes = np.stack([random_curve(rng, 1.0, 0.03, 1.0).ravel() for _ in range(_POPULATION)])
    mean = shapes.mean(axis=0)
    return mean, np.linalg.svd(shapes - mean, full_matrices=True)[2]

"""Random shapes of bodies, where they lie in the frame, and lines that are less exact."""

from functools import cache

import numpy as np
from jaxtyping import Float

from napari_splinesketch.engine.spline import apart, neighbours
from napari_splinesketch.engine.types import InputError
from napari_splinesketch.metrics import POINTS, resample

_BEND_SD = (1.3, 2.1, 1.9, 1.1)
_TRIES = 4000
_TRIES_PER_SHAPE = 20
_POPULATION = 1000
_POPULATION_SEED = 2025

Points = Float[np.ndarray, "N 2"]


def random_curve(rng: np.random.Generator, length: float, half_width: float, bend: float) -> Points:
    """Random smooth centreline (100, 2) about the origin that keeps clear of itself.

    Its curvature is a sum of four cosines along the arc; its radius of curvature stays above
    2.5 half-widths.
    """
    u = np.linspace(0, 1, 2 * POINTS)
    modes = np.cos(np.pi * np.arange(len(_BEND_SD))[:, None] * u)
    strength = bend * rng.lognormal(0, 0.35)
    for _ in range(_TRIES):
        turning = (strength * rng.standard_normal(len(_BEND_SD)) * _BEND_SD) @ modes
        if np.abs(turning).max() > length / (2.5 * half_width):
            continue
        angle = rng.uniform(0, 2 * np.pi) + np.cumsum(turning) / len(u)
        steps = np.stack([np.sin(angle), np.cos(angle)], axis=1)[1:] * length / (len(u) - 1)
        curve = resample(np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)]))
        if not _nears_itself(curve, length, half_width):
            return curve - curve.mean(axis=0)
    raise InputError(
        f"No body of length {length:g} px and half-width {half_width:g} px can be bent by "
        f"{bend:g}; make it longer, thinner or straighter."
    )


def _nears_itself(curve: Points, length: float, half_width: float) -> bool:
    distance = np.linalg.norm(curve[:, None] - curve[None], axis=2)
    index = np.arange(len(curve))
    apart = np.abs(index[:, None] - index) * length / (len(curve) - 1) > 8 * half_width
    return bool(np.any(distance[apart] < 2.5 * half_width))


def place(
    rng: np.random.Generator,
    length: float,
    half_width: float,
    bend: float,
    shape: tuple[int, int],
    margin: float,
    others: tuple[Points, ...],
    *,
    across: bool,
    shared: float,
) -> Points:
    """Random body inside the frame that does not lie along any of `others`.

    `across` says whether it must cross one of them; no more than `shared` of its length may lie
    within two half-widths of another. The rest is as in `random_curve`.
    """
    upper, reach = np.array(shape) - 1 - margin, 2 * half_width
    curve = random_curve(rng, length, half_width, bend)
    for attempt in range(1, _TRIES):
        if attempt % _TRIES_PER_SHAPE == 0:
            curve = random_curve(rng, length, half_width, bend)
        if across and others:
            middle = slice(POINTS // 10, -POINTS // 10)
            other = others[rng.integers(len(others))]
            moved = curve + rng.choice(other[middle]) - rng.choice(curve[middle])
        else:
            low, high = margin - curve.min(axis=0), upper - curve.max(axis=0)
            if np.any(low > high):
                continue
            moved = curve + rng.uniform(low, high)
        if np.any(moved < margin) or np.any(moved > upper):
            continue
        near = [others[i - 1] for i in next(neighbours([moved, *others], reach))]
        if across and others and not any(crosses(moved, other) for other in near):
            continue
        if all((apart(moved, other, reach) < reach).mean() <= shared for other in near):
            return moved
    raise InputError(
        f"A body of length {length:g} px does not fit into a frame of {shape} px with margin "
        f"{margin:g} px; make the frame larger or the body shorter."
    )


def crosses(a: Points, b: Points) -> bool:
    """Whether two polylines cross."""
    p, r = a[:-1, None], np.diff(a, axis=0)[:, None]
    q, s = b[None, :-1], np.diff(b, axis=0)[None]
    scale = _cross(r, s)
    with np.errstate(divide="ignore", invalid="ignore"):
        t, u = _cross(q - p, s) / scale, _cross(q - p, r) / scale
    return bool(np.any((t >= 0) & (t <= 1) & (u >= 0) & (u <= 1)))


def _cross(a: Float[np.ndarray, "*N 2"], b: Float[np.ndarray, "*N 2"]) -> Float[np.ndarray, "*N"]:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def rotate(curve: Points, degrees: float) -> Points:
    """Turn an (N, 2) curve about its centroid, from the row axis towards the col axis."""
    angle = np.deg2rad(degrees)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    centre = curve.mean(axis=0)
    return (curve - centre) @ turn + centre


def compress(curve: Points, components: int = 2) -> Points:
    """Curve (100, 2) as the nearest one that a few principal components can describe.

    The components are those of a fixed population of generated curves, each moved to its
    centroid and divided by its length; rotation is left in, so that the first two are nearly
    straight lines along the two axes. Raises InputError for a number of them from which no curve
    can be made: fewer than 0, or more than 200.
    """
    if not 0 <= components <= 2 * POINTS:
        raise InputError(f"components is {components}; give a whole number from 0 to {2 * POINTS}.")
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

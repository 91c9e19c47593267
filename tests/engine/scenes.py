"""Frames that the tests of `refine` share: small, alike in size, so that little is compiled."""

from functools import cache

import numpy as np

from napari_splinesketch import refine, synthetic
from napari_splinesketch.engine.types import Curve, Refinement
from napari_splinesketch.metrics import average_dtw

SHAPE = (104, 128)


@cache
def frame(seed: int = 0, bodies: int = 1, **look) -> synthetic.Scene:
    """A frame that is not square, with bodies about 80 px long and 6 px wide."""
    return synthetic.scene(seed, bodies=bodies, shape=SHAPE, length=80, **look)


def sketches_of(made: synthetic.Scene, degrees: float = 12.0) -> list[np.ndarray]:
    """Rough lines: every 20th point of the truth, turned."""
    return [synthetic.rotate(c, degrees)[::20] for c in made.centrelines]


@cache
def refined(seed: int = 0, bodies: int = 1) -> Refinement:
    """The frame's refinement from its sketches."""
    made = frame(seed, bodies)
    return refine(made.image, sketches_of(made))


def miss(curve: Curve, truth: np.ndarray) -> float:
    """Average DTW from the truth, px."""
    return average_dtw(curve.points, truth)

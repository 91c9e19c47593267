"""What is known of one body, and where it is expected next."""

from dataclasses import dataclass, replace
from statistics import median

import numpy as np

from napari_splinesketch.engine.spline import resample
from napari_splinesketch.engine.types import Curve
from napari_splinesketch.tracking.types import Line

MEMORY = 5
"""Frames that tell a body's usual length and width."""
VELOCITY = 0.5
"""Share of the last movement that is expected again: swimmers turn round."""
POINTS = 12
"""Of the line that is carried over."""


@dataclass(frozen=True, eq=False)
class Body:
    """One body through time.

    Attributes
    ----------
    id
        Its number.
    seen
        (frame, curve) where it could be trusted, the latest last.
    misses
        Frames since.
    """

    id: int
    seen: tuple[tuple[int, Curve], ...]
    misses: int = 0

    @property
    def length(self) -> float:
        """Usual length, px."""
        return median(curve.length for _, curve in self.seen)

    @property
    def half_width(self) -> float:
        """Usual half-width, px; not a number where nothing is known."""
        return median(float(np.median(curve.half_width)) for _, curve in self.seen)

    def expected(self, frame: int) -> Line:
        """Where it is expected in a frame, with its velocity where two frames tell it."""
        latest, curve = self.seen[-1]
        points = curve.points
        if len(self.seen) > 1:
            before, older = self.seen[-2]
            steps = (frame - latest) / (latest - before) if latest != before else 0.0
            if abs(steps) <= 1:
                points = points + VELOCITY * steps * (points - older.points)
        return resample(points, POINTS)

    def with_curve(self, frame: int, curve: Curve) -> "Body":
        """Give the body after a frame in which it can be trusted."""
        return replace(self, seen=(*self.seen, (frame, curve))[-MEMORY:], misses=0)

    def missed(self) -> "Body":
        """Give the body after a frame in which it cannot."""
        return replace(self, misses=self.misses + 1)

"""What is known of one body, and where it is expected next."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from statistics import median

import numpy as np

from napari_splinesketch.engine.types import Curve
from napari_splinesketch.tracking import motion

MEMORY = 7
"""Frames that tell a body's usual length and width."""
LENGTHS = 40
"""Frames that tell its usual length."""
EVEN = 0.01
"""Share of a body's length by which that varies at least."""
NORMAL = 1.48
"""Standard deviations of a normal distribution in its median deviation."""
LONG, LONGER = 1.0, 5.0
"""Half-widths, and standard deviations of its length, by which a curve is longer than its body."""
SHORT, SURELY = 0.5, 1.5
"""Half-widths, and standard deviations of its length, by which a curve is shorter than its body
where something may hide the rest."""


INFERRED = "inferred from the frames around it"


def curve_inferred(curve: Curve) -> bool:
    """Whether the image does not show some of a curve, or all of it."""
    return any(INFERRED in reason for reason in curve.reasons)


def lines_of(seen: Sequence[tuple[int, Curve]]) -> list[motion.Known]:
    """The points of curves, by frame."""
    return [(float(frame), curve.points) for frame, curve in seen]


@dataclass(frozen=True, eq=False)
class Body:
    """One body through time."""

    id: int
    """Its number."""
    seen: tuple[tuple[int, Curve], ...]
    """(frame, curve) of the last frames in which its curve could be trusted, the latest last."""
    misses: int = 0
    """Frames since the latest of those."""
    lengths: tuple[float, ...] = ()
    """Its lengths in those frames and in earlier ones, px."""

    @cached_property
    def length(self) -> float:
        """Usual length, px."""
        return median(self.lengths or [curve.length for _, curve in self.seen])

    @cached_property
    def length_sd(self) -> float:
        """Standard deviation of its length, px."""
        off = np.abs(np.array(self.lengths or (self.length,)) - self.length)
        return max(NORMAL * float(np.median(off)), EVEN * self.length)

    def exceeds(self, more: float) -> bool:
        """Whether its length does not usually vary by so much, px."""
        return more > max(LONG * self.half_width, LONGER * self.length_sd)

    def exceeded(self, curve: Curve) -> bool:
        """Whether a curve is longer than the body can be; False until it was seen often enough."""
        return len(self.lengths) >= MEMORY and self.exceeds(curve.length - self.length)

    def lacks(self, curve: Curve) -> bool:
        """Whether a curve is so short that something may hide the rest of the body."""
        usual = max(SHORT * self.half_width, SURELY * self.length_sd)
        return self.length - curve.length > usual

    @cached_property
    def half_width(self) -> float:
        """Usual half-width, px; not a number where nothing is known."""
        return median(curve.typical_half_width for _, curve in self.seen)

    def predicted(self, frame: int) -> motion.Predicted:
        """Where the body is expected in a frame."""
        found = motion.ahead(lines_of(self.seen))(frame)
        return found._replace(line=motion.of_length(found.line, self.length))

    def with_curve(self, frame: int, curve: Curve) -> "Body":
        """Give the body after a frame in which this curve of it can be trusted."""
        seen = (*self.seen, (frame, curve))[-MEMORY:]
        lengths = self.lengths or tuple(c.length for _, c in self.seen)
        if not curve_inferred(curve):
            lengths = (*lengths, curve.length)
        return replace(self, seen=seen, lengths=lengths[-LENGTHS:], misses=0)

    def missed(self) -> "Body":
        """Give the body after a frame in which it has no curve that can be trusted."""
        return replace(self, misses=self.misses + 1)

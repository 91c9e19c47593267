"""What tracking takes and gives, and what is known of one body: immutable values."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from statistics import median

import numpy as np
from jaxtyping import Real

from napari_splinesketch.engine.settings import MARGIN
from napari_splinesketch.engine.spline import arc_length
from napari_splinesketch.engine.types import Curve, Line, Refinement
from napari_splinesketch.grids import Grid, slices
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


WHOLE = Grid(np.zeros(2), np.ones(2))
"""The place of a frame that was read as it is."""


@dataclass(frozen=True, eq=False)
class View:
    """What was read of a frame."""

    pixels: Real[np.ndarray, "H W"]
    """(H, W), grey."""
    place: Grid = WHOLE
    """Where the pixels lie in the image."""
    whole: bool = True
    """Whether they are all of the image, so that their border is the image's."""

    def around(self, lines: Sequence[Line]) -> "View":
        """A copy of the part that the engine looks at for some lines, px of the image.

        All of it where that part has no finite pixel, as beyond the border of a frame that was
        moved to fit the others: the engine refuses it.
        """
        blocks = [self.place.to_block(line) for line in lines]
        margin = MARGIN + max(arc_length(line)[-1] for line in blocks) / 2 + 1
        points = np.concatenate(blocks)
        low = np.clip(np.floor(points.min(0) - margin), 0, np.array(self.pixels.shape) - 1)
        high = np.maximum(np.ceil(points.max(0) + margin), low + 1)
        pixels = self.pixels[slices(low.astype(int), high.astype(int))].copy()
        if not np.isfinite(pixels).any():
            return self
        return View(pixels, Grid(self.place.to_image(low), self.place.step), whole=False)


@dataclass(frozen=True, eq=False)
class Given:
    """What stays as it is in a frame."""

    curves: Mapping[int, Curve] = field(default_factory=dict)
    """Curves by number, px of the image."""
    whole: bool = False
    """Whether they are all there is: then nothing is added to the frame."""
    leads: bool = True
    """Whether tracking goes on from all of them, or only from those of bodies that it follows."""


@dataclass(frozen=True, eq=False)
class Tracked:
    """What came of one frame."""

    frame: int
    by_id: Mapping[int, Curve] = field(default_factory=dict)
    """Curves of the bodies that were placed, without the given ones, by number; "check" with the
    reason where one drifts."""
    sketches: Mapping[int, Line] = field(default_factory=dict)
    """Where each was looked for, px of the image."""
    drifting: frozenset[int] = frozenset()
    """Numbers of the bodies whose curves are not trusted: the next frame does not start there."""
    missing: Mapping[int, str] = field(default_factory=dict)
    """Why a body has no curve here, by number."""
    lost: frozenset[int] = frozenset()
    """Numbers of the missing bodies that are not looked for any more."""
    given: tuple[int, ...] = ()
    """Numbers of the curves that stay as they are."""
    refinement: Refinement | None = None
    view: View | None = None
    """`refinement` and `view`: what the engine said, of what; None where nothing was refined."""
    contrast: float | None = None
    """Usual contrast of the bodies by then; None where it is not known."""
    error: str = ""
    """Why the frame could not be read or refined; empty otherwise."""
    entered: tuple[Line, ...] = ()
    """Lines over bodies that have come into view; nobody follows them."""

    @property
    def ids(self) -> tuple[int, ...]:
        """Numbers of the bodies that were placed."""
        return tuple(self.by_id)

    @property
    def curves(self) -> tuple[Curve, ...]:
        """Curves of the bodies that were placed, in the order of `ids`."""
        return tuple(self.by_id.values())


Read = Callable[[int, Sequence[Line]], View | Real[np.ndarray, "H W"]]
"""Reads a frame, at least around some lines."""

Refine = Callable[..., Refinement]
"""`refine`, or what stands in for it: takes pixels, lines, a preset, `fixed`, `on_progress`."""

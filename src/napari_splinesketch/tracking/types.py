"""What tracking takes and gives: immutable values, free of JAX, Qt and files."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Real

from napari_splinesketch.engine.settings import MARGIN
from napari_splinesketch.engine.spline import arc_length
from napari_splinesketch.engine.types import Curve, Line, Refinement
from napari_splinesketch.grids import Grid, slices

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
        """A copy of the part that the engine looks at for some lines, px of the image."""
        blocks = [self.place.to_block(line) for line in lines]
        margin = MARGIN + max(arc_length(line)[-1] for line in blocks) / 2 + 1
        points = np.concatenate(blocks)
        low = np.clip(np.floor(points.min(0) - margin), 0, np.array(self.pixels.shape) - 1)
        high = np.maximum(np.ceil(points.max(0) + margin), low + 1)
        pixels = self.pixels[slices(low.astype(int), high.astype(int))].copy()
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

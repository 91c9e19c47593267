"""Sketches far from each other have nothing to do with each other: the image in pieces."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse.csgraph import connected_components

from napari_splinesketch.engine import spline
from napari_splinesketch.engine.look.band import band
from napari_splinesketch.engine.settings import MARGIN
from napari_splinesketch.engine.types import Array, Curve

NEAREST, FARTHEST = 20.0, 200.0
"""Bodies are expected within half of a sketch's length of it: at least, and at most, px."""

Line = Float[Array, "N 2"]


@dataclass(frozen=True, eq=False)
class Island:
    """Sketches whose surroundings overlap, and the part of the image around them.

    Attributes
    ----------
    members
        Numbers of the sketches.
    sketches
        (N, 2) polylines in the window's pixels.
    fixed
        Curves that take part but do not move, in the image's pixels.
    window
        Rows and columns of the image.
    """

    members: tuple[int, ...]
    sketches: list[Line]
    fixed: list[Curve]
    window: tuple[slice, slice]

    @property
    def corner(self) -> Int[Array, "2"]:
        """(2,) the window's first pixel in the image."""
        return np.array([s.start for s in self.window])

    def of(self, which: Sequence[int]) -> "Island":
        """The same part of the image with some of the sketches."""
        members = tuple(self.members[i] for i in which)
        return replace(self, members=members, sketches=[self.sketches[i] for i in which])

    @cached_property
    def near(self) -> Bool[Array, "h w"]:
        """(h, w) where the bodies are expected: within half of a sketch's length of it."""
        near = np.zeros([s.stop - s.start for s in self.window], dtype=bool)
        for line in self.sketches:
            radius = np.clip(spline.arc_length(line)[-1] / 2, NEAREST, FARTHEST)
            rows, columns, mask = band(line, radius, near.shape)
            near[rows, columns] |= mask
        return near


def split(
    lines: Sequence[Line], usable: Sequence[int], fixed: Sequence[Curve], shape: tuple[int, ...]
) -> list[Island]:
    """The islands of the usable sketches, the largest first; their windows do not overlap.

    Sketches of an island are in the order of `usable`.
    """
    groups, around = [[i] for i in usable], {i: _surroundings(lines[i], shape) for i in usable}
    while True:
        boxes = [np.array([around[i] for i in group]) for group in groups]
        low = np.array([box[:, 0].min(0) for box in boxes]).reshape(-1, 2)
        high = np.array([box[:, 1].max(0) for box in boxes]).reshape(-1, 2)
        below = (low[:, None] < high[None]).all(2)
        count, label = connected_components(below & below.T, directed=False)
        if count == len(groups):
            break
        together = [{i for g, k in zip(groups, label, strict=True) if k == n for i in g}
                    for n in range(count)]  # fmt: skip
        groups = [[i for i in usable if i in group] for group in together]
    found = []
    for members, top, bottom in zip(groups, low, high, strict=True):
        beside = [c for c in fixed if _within(c, top, bottom)]
        window = slice(int(top[0]), int(bottom[0])), slice(int(top[1]), int(bottom[1]))
        found.append(Island(tuple(members), [lines[i] - top for i in members], beside, window))
    return sorted(found, key=lambda island: -len(island.members))


def _surroundings(line: Line, shape: tuple[int, ...]) -> Int[Array, "2 2"]:
    margin = MARGIN + spline.arc_length(line)[-1] / 2
    low = np.clip(np.floor(line.min(0) - margin), 0, np.array(shape) - 1)
    return np.array([low, np.clip(np.ceil(line.max(0) + margin), low + 1, shape)]).astype(int)


def _within(curve: Curve, low: Int[Array, "2"], high: Int[Array, "2"]) -> bool:
    width = np.nan_to_num(curve.half_width.max())
    return bool(
        (curve.points.max(0) + width > low).all() and (curve.points.min(0) - width < high).all()
    )

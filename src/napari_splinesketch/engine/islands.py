"""Sketches far from each other have nothing to do with each other: the image in pieces."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int, Real
from scipy.sparse.csgraph import connected_components

from napari_splinesketch.engine import constants as const
from napari_splinesketch.engine.settings import MARGIN
from napari_splinesketch.engine.types import Array, Curve, Line


@dataclass(frozen=True)
class Pose:
    """How a window of the image is turned before it is fitted: one of eight ways.

    First rows and columns change places, then either is reversed. The way is chosen by what is
    there, so that a scene that is given transposed, flipped or turned by a quarter is the same to
    everything that follows, and gives the same curves.
    """

    window: tuple[slice, slice]
    swap: bool
    reverse: tuple[bool, bool]

    @property
    def _steps(self) -> tuple[slice, ...]:
        return tuple(slice(None, None, -1 if r else 1) for r in self.reverse)

    def cut(self, image: Real[Array, "H W"]) -> Real[Array, "h w"]:
        """The window of an image, turned."""
        pixels = image[self.window]
        return np.ascontiguousarray((pixels.T if self.swap else pixels)[self._steps])

    def back(self, pixels: Real[Array, "h w"]) -> Real[Array, "h w"]:
        """A picture of the window, turned back."""
        pixels = pixels[self._steps]
        return np.ascontiguousarray(pixels.T if self.swap else pixels)

    @property
    def turn(self) -> Float[Array, "2 2"]:
        """What turns a direction in the image, a column, as the window is turned."""
        return np.eye(2)[:: -1 if self.swap else 1] * np.where(self.reverse, -1, 1)[:, None]

    def inside(self, points: Float[Array, "P D"]) -> Float[Array, "P D"]:
        """Points (row, col and whatever else) of the image in the turned window."""
        low, begin = self._corners
        return np.column_stack([(points[:, :2] - low) @ self.turn.T + begin, points[:, 2:]])

    def outside(self, points: Float[Array, "P D"]) -> Float[Array, "P D"]:
        """The same back again."""
        low, begin = self._corners
        return np.column_stack([(points[:, :2] - begin) @ self.turn + low, points[:, 2:]])

    @property
    def _corners(self) -> Int[Array, "2 2"]:
        """The first pixel of the window in the image, and where it is in the turned window."""
        low, high = np.array([(s.start, s.stop) for s in self.window]).T
        size = (high - low)[:: -1 if self.swap else 1]
        return np.array([low, np.where(self.reverse, size - 1, 0)])


@dataclass(frozen=True, eq=False)
class Island:
    """Sketches whose surroundings overlap, and the part of the image around them.

    Neither the order of the sketches, nor the end they begin at, nor how the image is turned makes
    a difference to what is in here.
    """

    members: tuple[int, ...]
    """Numbers of the sketches."""
    sketches: list[Line]
    """(N, 2) polylines in pixels of the turned window."""
    backwards: list[bool]
    """Whether each of them begins at the other end."""
    fixed: list[Float[Array, "P 3"]]
    """Points and half-widths of curves that take part but do not move, in the same pixels."""
    pose: Pose
    """The window of the image, and how it is turned."""

    def of(self, which: Sequence[int]) -> "Island":
        """The same part of the image with some of the sketches."""
        lists = (self.members, self.sketches, self.backwards)
        members, sketches, backwards = ([mine[i] for i in which] for mine in lists)
        return replace(self, members=tuple(members), sketches=sketches, backwards=backwards)

    def in_image(self, curves: Sequence[Curve]) -> list[Curve]:
        """Curves of the sketches in pixels of the image, each beginning where its sketch does."""
        steps = [slice(None, None, -1 if backwards else 1) for backwards in self.backwards]
        return [
            replace(
                curve,
                knots=self.pose.outside(curve.knots)[step],
                points=self.pose.outside(curve.points)[step],
                half_width=curve.half_width[step],
                sd=curve.sd[step],
            )
            for curve, step in zip(curves, steps, strict=True)
        ]


def split(
    image: Real[Array, "H W"],
    lines: Sequence[Line],
    usable: Sequence[int],
    fixed: Sequence[Curve],
) -> list[Island]:
    """The islands of the usable sketches, the largest first; their windows do not overlap."""
    rounded = {i: np.round(lines[i] / const.GRID_PX) * const.GRID_PX for i in usable}
    shape = image.shape
    groups, around = [[i] for i in usable], {i: _surroundings(rounded[i], shape) for i in usable}
    while True:
        boxes = [np.array([around[i] for i in group]) for group in groups]
        low = np.array([box[:, 0].min(0) for box in boxes]).reshape(-1, 2)
        high = np.array([box[:, 1].max(0) for box in boxes]).reshape(-1, 2)
        below = (low[:, None] < high[None]).all(2)
        meets = below & below.T
        if meets.sum() == len(groups):
            break
        count, label = connected_components(meets, directed=False)
        together = [{i for g, k in zip(groups, label, strict=True) if k == n for i in g}
                    for n in range(count)]  # fmt: skip
        groups = [[i for i in usable if i in group] for group in together]
    found = []
    for members, top, bottom in zip(groups, low, high, strict=True):
        beside = [c for c in fixed if _within(c, top, bottom)]
        window = slice(int(top[0]), int(bottom[0])), slice(int(top[1]), int(bottom[1]))
        found.append(_posed(image, {i: rounded[i] for i in members}, beside, window))
    return sorted(found, key=lambda island: -len(island.members))


def _posed(
    image: Real[Array, "H W"],
    lines: dict[int, Line],
    fixed: Sequence[Curve],
    window: tuple[slice, slice],
) -> Island:
    """The island in the pose whose sorted sketches come first, or its pixels where these agree."""
    ends = np.concatenate([line[[0, -1]] for line in lines.values()])
    poses = [Pose(window, bool(k & 4), (bool(k & 2), bool(k & 1))) for k in range(8)]
    size = [s.stop - s.start for s in window]
    # Shape and first end tell most of them apart.
    firsts = [(size[:: -1 if p.swap else 1], min(p.inside(ends).tolist())) for p in poses]
    found = [
        _in_pose(lines, fixed, pose)
        for pose, first in zip(poses, firsts, strict=True)
        if first == min(firsts)
    ]
    if len(found) > 1:
        drawn = [[line.tolist() for line in island.sketches] for island in found]
        found = [island for island, own in zip(found, drawn, strict=True) if own == min(drawn)]
    return found[0] if len(found) < 2 else min(found, key=lambda one: one.pose.cut(image).tobytes())


def _in_pose(lines: dict[int, Line], fixed: Sequence[Curve], pose: Pose) -> Island:
    """An island in one pose, with sketches and fixed curves sorted by where they are in it."""
    found = []
    for i, line in lines.items():
        turned = pose.inside(line)
        backwards = tuple(turned[0]) > tuple(turned[-1])
        found.append((i, turned[::-1] if backwards else turned, backwards))
    members, sketches, backwards = zip(*sorted(found, key=lambda one: one[1].tolist()), strict=True)
    beside = [pose.inside(np.column_stack([c.points, c.half_width])) for c in fixed]
    beside.sort(key=lambda points: points.tolist())
    return Island(members, list(sketches), list(backwards), beside, pose)


def _surroundings(line: Line, shape: tuple[int, ...]) -> Int[Array, "2 2"]:
    steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
    margin = MARGIN + min(steps.sum() / 2, const.AROUND_PX + const.CHORD_BULGE * steps.max())
    low = np.clip(np.floor(line.min(0) - margin), 0, np.array(shape) - 1)
    return np.array([low, np.clip(np.ceil(line.max(0) + margin) + 1, low + 1, shape)]).astype(int)


def _within(curve: Curve, low: Int[Array, "2"], high: Int[Array, "2"]) -> bool:
    width = np.nan_to_num(curve.half_width.max())
    return bool(
        (curve.points.max(0) + width > low).all() and (curve.points.min(0) - width < high).all()
    )

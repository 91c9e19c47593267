"""Labels frame by frame, as many as a film has, and what a format must know of all of them."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import chain, groupby

import numpy as np
from jaxtyping import Int

from napari_splinesketch.engine.types import Array
from napari_splinesketch.labels.types import Label, Labels


@dataclass(frozen=True)
class Facts:
    """What formats ask of all labels together.

    Attributes
    ----------
    count
        How many there are.
    sizes
        The numbers of points that occur.
    highest
        The largest identity, 0 where there is none.
    reach
        (H, W) of the smallest image from (0, 0) that holds all bodies, px.
    without_width
        How many have a half-width that is not known somewhere.
    without_radius
        How many have a half-width that is 0 or not known somewhere.
    reviewed, locked
        Whether the user has said something of one, and locked one.
    """

    count: int
    sizes: frozenset[int]
    highest: int
    reach: tuple[float, float]
    without_width: int
    without_radius: int
    reviewed: bool
    locked: bool

    @classmethod
    def of(cls, labels: Iterable[Label]) -> "Facts":
        """Go through labels."""
        count = highest = without_width = without_radius = 0
        sizes: set[int] = set()
        reach, reviewed, locked = np.ones(2), False, False
        for label in labels:
            count += 1
            sizes.add(len(label.points))
            highest = max(highest, label.curve)
            far = label.points.max(axis=0) + np.nan_to_num(label.half_width).max()
            reach = np.maximum(reach, np.ceil(far) + 1)
            without_width += not np.all(np.isfinite(label.half_width))
            without_radius += not np.all(label.half_width > 0)
            reviewed = reviewed or label.review != "open"
            locked = locked or label.locked
        size, said = (float(reach[0]), float(reach[1])), (reviewed, locked)
        return cls(count, frozenset(sizes), highest, size, without_width, without_radius, *said)


@dataclass(frozen=True, eq=False)
class ByFrame:
    """Labels of which no more than a frame's are held; they are read anew each time.

    Attributes
    ----------
    frames
        (F,) the numbers of the frames that have some, rising.
    head
        What all share, without the labels themselves.
    read
        Gives the labels of each of `frames`.
    tell
        Called while they are gone through, with the share that is done where that is known; what
        it raises ends it.
    """

    frames: Int[Array, " F"]
    head: Labels
    read: Callable[[], Iterator[tuple[Label, ...]]]
    tell: Callable[[float | None], None] = lambda done: None

    @property
    def labels(self) -> Iterator[Label]:
        """Go through all labels."""
        for label in chain.from_iterable(self.read()):
            self.tell(None)
            yield label

    @cached_property
    def facts(self) -> Facts:
        """What formats ask of all labels together; goes through them once."""
        return Facts.of(self.labels)

    @property
    def scale(self) -> tuple[float, float] | None:
        """(y, x) size of a pixel, or None."""
        return self.head.scale

    @property
    def units(self) -> str | None:
        """Physical unit, or None."""
        return self.head.units

    @property
    def shape(self) -> tuple[int, int] | None:
        """(H, W) of the image, px, or None."""
        return self.head.shape

    @property
    def provenance(self) -> Mapping[str, object]:
        """How the labels came about."""
        return self.head.provenance

    @property
    def notes(self) -> tuple[str, ...]:
        """What a reader left out of the file."""
        return self.head.notes


AnyLabels = Labels | ByFrame
"""What can be written."""


def facts_of(labels: AnyLabels) -> Facts:
    """Give what formats ask of all labels together."""
    return labels.facts if isinstance(labels, ByFrame) else Facts.of(labels.labels)


def scaled(labels: AnyLabels, scale: tuple[float, float], units: str | None) -> AnyLabels:
    """Give labels with another size of a pixel."""
    if isinstance(labels, ByFrame):
        return replace(labels, head=replace(labels.head, scale=scale, units=units))
    return replace(labels, scale=scale, units=units)


def in_frames(labels: AnyLabels) -> ByFrame:
    """Give labels frame by frame; those in memory are put in order."""
    if isinstance(labels, ByFrame):
        return labels
    ordered = sorted(labels.labels, key=lambda label: label.frame)
    groups = [tuple(group) for _, group in groupby(ordered, key=lambda label: label.frame)]
    head = Labels((), labels.scale, labels.units, labels.shape, labels.provenance, labels.notes)
    frames = np.array([group[0].frame for group in groups], dtype=np.int64)
    return ByFrame(frames, head, partial(iter, groups))

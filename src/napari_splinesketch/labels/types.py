"""What the readers give and the writers take: immutable labels, all at once or frame by frame."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, partial
from itertools import chain, groupby
from operator import index
from reprlib import repr as short
from types import MappingProxyType
from typing import Any, Literal, Self, get_args

import numpy as np
from jaxtyping import Float, Int

from napari_splinesketch.engine.types import POINTS, Array, Curve, InputError
from napari_splinesketch.files import counted

LabelStatus = Literal["good", "check", "failed", "sketch"]
STATUSES: tuple[LabelStatus, ...] = get_args(LabelStatus)
Review = Literal["open", "accepted", "rejected"]
REVIEWS: tuple[Review, ...] = get_args(Review)
MAX_COORDINATE = 1e9
MAX_INTEGER = 2**63 - 1
MAX_SCALE = 1e30
MICROMETRE = {"um", "μm", *(f"micro{n}{s}" for n in ("n", "meter", "metre") for s in ("", "s"))}
MICROMETRE |= {"\\u00b5m"}  # as ImageJ may write it
NO_PIXEL_SIZE = "the file has no pixel size: 1 {} is taken as 1 pixel"


def unit_of(name: str) -> str:
    """Give the one name of a unit, of which micrometres have many (one of them with a Greek μ)."""
    return "µm" if name.lower() in MICROMETRE else name


@dataclass(frozen=True, eq=False)
class Label:
    """One body in one frame.

    Coordinates are (row, col) in pixels of the image, pixel centres at integers.
    """

    frame: int
    """Index of the image in its stack, from 0."""
    curve: int
    """Identity of the body: the same number in every frame it is seen in; from 0."""
    points: Float[Array, "N 2"] = field(repr=False)
    """(N, 2), N >= 2: the centreline, row and col, px."""
    half_width: Float[Array, " N"] = field(repr=False)
    """(N,): distance from the centreline to the body's edge, px; NaN where not known."""
    sd: Float[Array, " N"] = field(repr=False)
    """(N,): standard error of `points` along the normal, px; infinite where not known."""
    status: LabelStatus
    """Result of the refinement, or "sketch" for a line that was not refined."""
    review: Review = "open"
    """The user's decision."""
    locked: bool = False
    """Whether the user wants it to stay as it is."""

    def __post_init__(self) -> None:
        for name in ("frame", "curve"):
            number = index(getattr(self, name))
            if not 0 <= number <= MAX_INTEGER:
                raise InputError(f"{name} is {number}: expected a whole number from 0 to 2^63 - 1")
            object.__setattr__(self, name, number)
        for name, missing in (("points", np.nan), ("half_width", np.nan), ("sd", np.inf)):
            array = np.array(getattr(self, name), dtype=np.float64, subok=True)
            array = np.asarray(np.ma.filled(array, missing))
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        if problem := _problem(self):
            raise InputError(f"curve {self.curve} of frame {self.frame}: {problem}")

    @classmethod
    def from_curve(cls, curve: Curve, *, frame: int = 0, identity: int = 0, **said: Any) -> Self:
        """Label a refined curve with its frame and identity, and `review` and `locked` if given."""
        along = curve.points, curve.half_width, curve.sd
        return cls(frame, identity, *along, curve.status, **said)

    @classmethod
    def from_sketch(cls, points: Float[Array, "N 2"], *, frame: int = 0, identity: int = 0) -> Self:
        """Label a line that nobody refined: half-width and standard error are not known."""
        size = len(points)
        return cls(frame, identity, points, np.full(size, np.nan), np.full(size, np.inf), "sketch")

    def failed(self) -> "Label":
        """The line as drawn, which could not be refined."""
        drawn = self.from_sketch(self.points, frame=self.frame, identity=self.curve)
        return replace(drawn, status="failed")

    def resampled(self, count: int) -> "Label":
        """Resample to `count` points, uniform in arc length, if it has another number."""
        if len(self.points) == count:
            return self
        arc = self.arc_length
        places, columns = np.linspace(0, arc[-1], count), (*self.points.T, self.half_width, self.sd)
        row, col, width, sd = (np.interp(places, arc, column) for column in columns)
        return replace(self, points=np.column_stack([row, col]), half_width=width, sd=sd)

    @property
    def arc_length(self) -> Float[Array, " N"]:
        """Distance along the centreline from its first point, px."""
        steps = np.linalg.norm(np.diff(self.points, axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])


@dataclass(frozen=True, eq=False)
class Labels:
    """All labels of an image or a film."""

    labels: tuple[Label, ...] = ()
    """In the order in which files hold them; no body twice in a frame."""
    scale: tuple[float, float] | None = None
    """(y, x): size of a pixel in `units`, or None when the image has no scale. Physical coordinates
    are y = row * scale[0] and x = col * scale[1]."""
    units: str | None = None
    """Name of the physical unit, such as "µm", or None."""
    shape: tuple[int, int] | None = None
    """(H, W) of the image, px, or None when it is not known."""
    provenance: Mapping[str, object] = field(default_factory=dict)
    """Where the labels come from: values that JSON can hold."""
    notes: tuple[str, ...] = ()
    """What a reader left out of the file, one sentence each, for the user; not written."""
    in_units: bool = False
    """Whether coordinates are in `units`, as the file has no size of a pixel; not written."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "labels", tuple(self.labels))
        if others := [each for each in self.labels if not isinstance(each, Label)]:
            raise InputError(f"labels has {short(others[0])}; Label.from_curve labels a curve")
        object.__setattr__(self, "provenance", MappingProxyType(dict(self.provenance)))
        if self.scale is not None:
            _check_pair("scale", "(y, x) size of a pixel", self.scale, 1 / MAX_SCALE, MAX_SCALE)
            object.__setattr__(self, "scale", tuple(map(float, self.scale)))
        if self.shape is not None:
            _check_pair("shape", "(H, W) of the image", self.shape, 1, MAX_COORDINATE)
            object.__setattr__(self, "shape", tuple(map(index, self.shape)))
        if self.units is not None and self.scale is None:
            raise InputError(f"units are {self.units!r} but scale is None; give a pixel's size too")
        if self.units is not None and not (self.units.strip() and self.units.isprintable()):
            raise InputError(f"units are {self.units!r}; expected a unit's name, such as 'µm'")
        seen = set()
        for label in self.labels:
            if (label.frame, label.curve) in seen:
                raise InputError(
                    f"curve {label.curve} occurs twice in frame {label.frame}; "
                    "give every body of a frame its own identity"
                )
            seen.add((label.frame, label.curve))

    def __repr__(self) -> str:
        """Say what they are: the labels themselves would fill pages of a notebook."""
        count, frames = len(self.labels), len({label.frame for label in self.labels})
        about = f"scale={self.scale}, units={self.units!r}, shape={self.shape}"
        return f"Labels({counted(count, 'label')} in {counted(frames, 'frame')}, {about})"

    def __reduce__(self) -> tuple[Any, ...]:
        """Tell pickle how to make them anew: it cannot copy a mapping that does not change."""
        given = {one.name: getattr(self, one.name) for one in fields(self)}
        return type(self), tuple((given | {"provenance": dict(self.provenance)}).values())

    @classmethod
    def from_curves(
        cls,
        curves: Sequence[Curve],
        *,
        frame: int = 0,
        ids: Iterable[int] | None = None,
        **known: Any,
    ) -> Self:
        """Label the refined curves of one frame.

        `ids` are their identities, from 0 by default; `known` is further attributes: scale, units,
        shape, provenance.
        """
        identities = range(len(curves)) if ids is None else tuple(ids)
        if len(identities) != len(curves):
            numbers = f"{len(curves)} and {len(identities)}"
            raise InputError(f"curves and ids are not as many, but {numbers}; give one each")
        labels = tuple(
            Label.from_curve(curve, frame=frame, identity=identity)
            for curve, identity in zip(curves, identities, strict=True)
        )
        return cls(labels, **known)

    def with_pixel_size(self, scale: tuple[float, float], units: str | None) -> "Labels":
        """Give a size of a pixel, (y, x), in these units or the known ones; lines become pixels."""
        if not self.in_units:
            return replace(self, scale=scale, units=units or self.units)
        if units is not None and unit_of(units) != self.units:
            raise InputError(
                f"the lines are in {self.units}; give the size of a pixel in that unit"
            )
        labels = tuple(replace(label, points=label.points / scale) for label in self.labels)
        notes = tuple(note for note in self.notes if note != NO_PIXEL_SIZE.format(self.units))
        return replace(self, labels=labels, scale=scale, notes=notes, in_units=False)

    @property
    def head(self) -> "Labels":
        """What all labels share, as `ByFrame` has it; here it comes with them."""
        return self

    @cached_property
    def facts(self) -> "Facts":
        """What formats need to know of all labels together."""
        return Facts.of(self.labels)


@dataclass
class Facts:
    """What formats need to know of all labels together."""

    count: int = 0
    """How many there are."""
    sizes: set[int] = field(default_factory=set)
    """Every number of points that occurs."""
    highest: int = 0
    """The largest identity, 0 where there is none."""
    reach: tuple[float, ...] = (1.0, 1.0)
    """(H, W) of the smallest image from (0, 0) that holds all bodies, px."""
    without_width: int = 0
    """How many have a half-width that is not known somewhere."""
    reviewed: bool = False
    locked: bool = False
    """`reviewed` and `locked`: whether the user has accepted or rejected one, and locked one."""

    @classmethod
    def of(cls, labels: Iterable[Label]) -> "Facts":
        """Go through labels."""
        facts = cls()
        for label in labels:
            facts.count += 1
            facts.sizes.add(len(label.points))
            facts.highest = max(facts.highest, label.curve)
            far = label.points.max(axis=0) + np.nan_to_num(label.half_width).max()
            facts.reach = tuple(np.maximum(facts.reach, np.ceil(far) + 1).tolist())
            facts.without_width += not np.all(np.isfinite(label.half_width))
            facts.reviewed |= label.review != "open"
            facts.locked |= label.locked
        return facts


@dataclass(frozen=True, eq=False)
class ByFrame:
    """Labels of which only one frame's are held; they are read from the file each time."""

    frames: Int[Array, " F"]
    """The numbers of the frames that have some, in rising order."""
    head: Labels
    """What all share, without the labels themselves."""
    read: Callable[[], Iterator[tuple[Label, ...]]]
    """Gives the labels of each of `frames`."""
    tell: Callable[[float | None], None] = lambda done: None
    """Called on the way through them, with the share that is done if that is known; an exception
    that it raises ends the reading."""

    def with_pixel_size(self, scale: tuple[float, float], units: str | None) -> "ByFrame":
        """Give the (y, x) size of a pixel: what is read frame by frame is in pixels."""
        return replace(self, head=self.head.with_pixel_size(scale, units))

    @property
    def labels(self) -> Iterator[Label]:
        """Go through all labels."""
        for label in chain.from_iterable(self.read()):
            self.tell(None)
            yield label

    @cached_property
    def facts(self) -> Facts:
        """What formats need to know of all labels together; goes through them once."""
        return Facts.of(self.labels)


AnyLabels = Labels | ByFrame
"""What can be written."""


def evenly_sampled(labels: AnyLabels) -> tuple[int, Iterator[Label]]:
    """Give all labels the same number of points, and that number: `POINTS` where they differ."""
    sizes = labels.facts.sizes
    size = min(sizes) if len(sizes) == 1 else POINTS
    return size, (label.resampled(size) for label in labels.labels)


def in_frames(labels: AnyLabels) -> ByFrame:
    """Give labels frame by frame; those in memory are put in order."""
    if isinstance(labels, ByFrame):
        return labels
    ordered = sorted(labels.labels, key=lambda label: label.frame)
    groups = [tuple(group) for _, group in groupby(ordered, key=lambda label: label.frame)]
    frames = np.array([group[0].frame for group in groups], dtype=np.int64)
    return ByFrame(frames, replace(labels, labels=()), partial(iter, groups))


def _problem(label: Label) -> str | None:
    size = len(label.points)
    if label.points.shape != (size, 2) or size < 2:
        return f"points have shape {label.points.shape}; expected (N, 2) with N at least 2"
    if not np.all(np.abs(label.points) <= MAX_COORDINATE):
        return f"points must be finite and within ±{MAX_COORDINATE:g} px"
    for name in ("half_width", "sd"):
        values = getattr(label, name)
        if values.shape != (size,):
            return f"{name} has shape {values.shape}; expected ({size},), one for each point"
        if np.any(values < 0):
            return f"{name} is negative; expected 0 or more, or NaN where it is not known"
    if np.any(label.half_width > MAX_COORDINATE):
        return f"half_width is over {MAX_COORDINATE:g} px; use NaN where it is not known"
    for name, allowed in (("status", STATUSES), ("review", REVIEWS)):
        if (word := getattr(label, name)) not in allowed:
            return f"{name} is {word!r}; expected one of {', '.join(allowed)}"
    if not isinstance(label.locked, bool | np.bool_):
        return f"locked is {label.locked!r}; expected True or False"
    return None


def _check_pair(name: str, what: str, pair: Sequence[float], least: float, most: float) -> None:
    if np.shape(pair) != (2,) or not all(least <= each <= most for each in pair):
        raise InputError(f"{name} is {pair}; expected {what}, from {least:g} to {most:g}")

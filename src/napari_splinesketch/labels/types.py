"""What the readers give and the writers take: immutable labels, free of any file format."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from operator import index
from types import MappingProxyType
from typing import Literal, Self, get_args

import numpy as np
from jaxtyping import Float

from napari_splinesketch.engine.types import Array, Curve, Refinement

LabelStatus = Literal["good", "check", "failed", "sketch"]
STATUSES: tuple[LabelStatus, ...] = get_args(LabelStatus)
Review = Literal["open", "accepted", "rejected"]
REVIEWS: tuple[Review, ...] = get_args(Review)
MAX_COORDINATE = 1e9
MAX_INTEGER = 2**63 - 1
MAX_SCALE = 1e30


@dataclass(frozen=True, eq=False)
class Label:
    """One body in one frame.

    Coordinates are (row, col) in pixels of the image, pixel centres at integers.

    Attributes
    ----------
    frame
        Index of the image in its stack, from 0.
    curve
        Identity of the body: the same number in every frame it is seen in; from 0.
    points
        (N, 2), N >= 2: the centreline, row and col, px.
    half_width
        (N,): distance from the centreline to the body's edge, px; NaN where not known.
    sd
        (N,): standard error of `points` along the normal, px; infinite where not known.
    status
        What the refinement says of the curve, or "sketch" for a line that was not refined.
    review
        What the user says of it.
    locked
        Whether the user wants it to stay as it is.
    """

    frame: int
    curve: int
    points: Float[Array, "N 2"]
    half_width: Float[Array, " N"]
    sd: Float[Array, " N"]
    status: LabelStatus
    review: Review = "open"
    locked: bool = False

    def __post_init__(self) -> None:
        """Make the arrays float64 and refuse what no file could hold."""
        for name in ("frame", "curve"):
            number = index(getattr(self, name))
            if not 0 <= number <= MAX_INTEGER:
                raise ValueError(f"{name} is {number}: expected a whole number from 0 to 2^63 - 1")
            object.__setattr__(self, name, number)
        for name in ("points", "half_width", "sd"):
            array = np.array(getattr(self, name), dtype=np.float64)
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        problem = _array_problem(self) or _word_problem("status", self.status, STATUSES)
        problem = problem or _word_problem("review", self.review, REVIEWS)
        if problem:
            raise ValueError(f"curve {self.curve} of frame {self.frame}: {problem}")

    @classmethod
    def from_curve(
        cls,
        curve: Curve,
        *,
        frame: int = 0,
        identity: int = 0,
        review: Review = "open",
        locked: bool = False,
    ) -> Self:
        """Label a refined curve with its frame and identity."""
        along = curve.points, curve.half_width, curve.sd
        return cls(frame, identity, *along, curve.status, review, locked)

    @classmethod
    def from_sketch(cls, points: Float[Array, "N 2"], *, frame: int = 0, identity: int = 0) -> Self:
        """Label a line that nobody refined: half-width and standard error are not known."""
        size = len(points)
        return cls(frame, identity, points, np.full(size, np.nan), np.full(size, np.inf), "sketch")

    @property
    def arc_length(self) -> Float[Array, " N"]:
        """Distance along the centreline from its first point, px."""
        steps = np.linalg.norm(np.diff(self.points, axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])


@dataclass(frozen=True, eq=False)
class Labels:
    """All labels of an image or a film.

    Attributes
    ----------
    labels
        In the order in which files hold them; no body twice in a frame.
    scale
        (y, x): size of a pixel in `units`, or None when the image has no scale. Physical
        coordinates are y = row * scale[0] and x = col * scale[1].
    units
        Name of the physical unit, such as "µm", or None.
    shape
        (H, W) of the image, px, or None when it is not known.
    provenance
        How the labels came about: values that JSON can hold.
    notes
        What a reader left out of the file, one sentence each, for the user; not written.
    """

    labels: tuple[Label, ...] = ()
    scale: tuple[float, float] | None = None
    units: str | None = None
    shape: tuple[int, int] | None = None
    provenance: Mapping[str, object] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Freeze what was given and check that it makes sense together."""
        object.__setattr__(self, "labels", tuple(self.labels))
        object.__setattr__(self, "provenance", MappingProxyType(dict(self.provenance)))
        if self.scale is not None:
            object.__setattr__(self, "scale", _checked_scale(self.scale))
        if self.shape is not None:
            object.__setattr__(self, "shape", _checked_shape(self.shape))
        if self.units is not None:
            _check_units(self.units, self.scale)
        seen = set()
        for label in self.labels:
            if (label.frame, label.curve) in seen:
                raise ValueError(
                    f"curve {label.curve} occurs twice in frame {label.frame}; "
                    "give every body of a frame its own identity"
                )
            seen.add((label.frame, label.curve))

    @classmethod
    def from_curves(
        cls,
        curves: Sequence[Curve],
        *,
        frame: int = 0,
        ids: Iterable[int] | None = None,
        scale: tuple[float, float] | None = None,
        units: str | None = None,
        shape: tuple[int, int] | None = None,
        provenance: Mapping[str, object] | None = None,
    ) -> Self:
        """Label the curves of one frame.

        Parameters
        ----------
        curves
            Refined curves.
        frame
            Index of the image in its stack.
        ids
            Identity of each curve; None numbers them from 0.
        scale
            (y, x) size of a pixel, or None.
        units
            Physical unit of `scale`, or None.
        shape
            (H, W) of the image, px, or None.
        provenance
            How the curves came about.
        """
        identities = range(len(curves)) if ids is None else tuple(ids)
        if len(identities) != len(curves):
            raise ValueError(f"{len(curves)} curves but {len(identities)} ids; give one each")
        labels = tuple(
            Label.from_curve(curve, frame=frame, identity=identity)
            for curve, identity in zip(curves, identities, strict=True)
        )
        return cls(labels, scale, units, shape, provenance or {})

    @classmethod
    def from_refinement(
        cls,
        result: Refinement,
        *,
        frame: int = 0,
        ids: Iterable[int] | None = None,
        scale: tuple[float, float] | None = None,
        units: str | None = None,
        provenance: Mapping[str, object] | None = None,
    ) -> Self:
        """Label the curves of a refinement; options as in `from_curves`."""
        return cls.from_curves(
            result.curves,
            frame=frame,
            ids=ids,
            scale=scale,
            units=units,
            shape=result.shape,
            provenance=provenance,
        )


def _array_problem(label: Label) -> str | None:
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
    return None


def _word_problem(name: str, word: str, allowed: tuple[str, ...]) -> str | None:
    if word in allowed:
        return None
    return f"{name} is {word!r}; expected one of {', '.join(allowed)}"


def _checked_scale(scale: tuple[float, float]) -> tuple[float, float]:
    if len(scale) != 2 or not all(1 / MAX_SCALE <= size <= MAX_SCALE for size in scale):
        raise ValueError(f"scale is {scale}; expected (y, x), two numbers above 0")
    return float(scale[0]), float(scale[1])


def _checked_shape(shape: tuple[int, ...]) -> tuple[int, int]:
    if len(shape) != 2 or not all(0 < size <= MAX_COORDINATE for size in shape):
        raise ValueError(f"shape is {shape}; expected (H, W) of the image, two numbers above 0")
    return index(shape[0]), index(shape[1])


def _check_units(units: str, scale: tuple[float, float] | None) -> None:
    if scale is None:
        raise ValueError(f"units are {units!r} but scale is None; give the size of a pixel too")
    if not units.strip() or not units.isprintable():
        raise ValueError(f"units are {units!r}; expected the name of a unit, such as 'µm'")

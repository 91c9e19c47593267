"""What the engine takes and gives: immutable values, free of JAX."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

import numpy as np
from jaxtyping import Float, Real

Polarity = Literal["auto", "bright", "dark"]
Status = Literal["good", "check", "failed"]
Array = np.ndarray
AnyArray = Any
"""NumPy's or JAX's: compiled functions take either."""
Line = Float[Array, "N 2"]
"""Points one after the other, (row, col), px."""

CANCELLED = "cancelled before it was done"
POINTS = 100


class InputError(ValueError):
    """Something given that cannot be used: what it is, what is allowed, or what to do."""


@dataclass(frozen=True, eq=False)
class Curve:
    """One refined body: a natural cubic spline with its half-width and its uncertainty.

    Coordinates are (row, col) in pixels of the image, pixel centres at integers.

    Attributes
    ----------
    knots
        (K, 3): row, col and half-width at the knots, px. A natural cubic spline through them,
        uniform in the knots' index, is the centreline.
    points
        (100, 2): the centreline, uniform in arc length.
    half_width
        (100,): distance from the centreline to the body's edge at `points`, px.
    sd
        (100,): standard error of `points` along the normal, px; infinite where nothing is known.
    status
        "good"; "check" where it needs review; "failed" when the sketch could not be
        refined, in which case the curve is the sketch as drawn.
    reasons
        Why the status is not "good", one sentence each.
    residual
        Root mean square of image minus reconstruction in the body's band, divided by the body's
        contrast.
    """

    knots: Float[Array, "K 3"] = field(repr=False)
    points: Float[Array, "100 2"] = field(repr=False)
    half_width: Float[Array, "100"] = field(repr=False)
    sd: Float[Array, "100"] = field(repr=False)
    status: Status
    reasons: tuple[str, ...]
    residual: float

    @cached_property
    def length(self) -> float:
        """Arc length of the centreline, px."""
        return float(np.linalg.norm(np.diff(self.points, axis=0), axis=1).sum())

    @cached_property
    def typical_half_width(self) -> float:
        """Median half-width, px; not a number where none is known."""
        return float(np.median(self.half_width))


@dataclass(frozen=True)
class SceneModel:
    """What the scene needed: the parts of the model that were switched on, and why.

    Attributes
    ----------
    polarity
        Whether bodies are brighter or darker than the background.
    knots
        Number of knots of each curve; 0 for a curve that failed.
    half_width
        Typical half-width of the bodies, px.
    width
        "constant" (apart from the taper of the ends) or "profile".
    background
        "constant", "linear" or "textured".
    overlap
        Whether overlapping bodies add up (0 = sum) or hide each other (1 = max);
        None where no curves overlap.
    contrast
        Brightness of the bodies above the background, in the image's units.
    noise
        Standard deviation of image minus reconstruction, in the image's units.
    blur
        Softness of the bodies' edges, px.
    notes
        One sentence for each choice, for the user to read.
    """

    polarity: Literal["bright", "dark"]
    knots: tuple[int, ...]
    half_width: float
    width: Literal["constant", "profile"]
    background: Literal["constant", "linear", "textured"]
    overlap: float | None
    contrast: float
    noise: float
    blur: float
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Refinement:
    """The result of `refine`.

    The two pictures are as large as the image; `refine` leaves them to be made from it when they
    are first read.

    Attributes
    ----------
    curves
        One per sketch, in the same order. After a cancel every curve is its sketch as drawn,
        "failed", with the reason `CANCELLED`.
    reconstruction
        (H, W): the image as the model explains it, in the image's own units.
    background
        (H, W): the same without bodies.
    model
        What the scene needed.
    seconds
        Wall time of the call.
    """

    curves: tuple[Curve, ...]
    reconstruction: Float[Array, "H W"] = field(repr=False)
    background: Float[Array, "H W"] = field(repr=False)
    model: SceneModel
    seconds: float

    @classmethod
    def lazy(cls, curves: tuple[Curve, ...], pictures: Any, model: SceneModel, seconds: float):
        """A result whose pictures are attributes of `pictures`, made when they are first read."""
        found = object.__new__(cls)
        found.__dict__.update(curves=curves, _pictures=pictures, model=model, seconds=seconds)
        return found

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the image, px; no picture is made to tell."""
        pictures = self.__dict__.get("_pictures")
        return (self.reconstruction if pictures is None else pictures).shape

    def __getattr__(self, name: str) -> Any:
        """Make a picture that is read for the first time."""
        if name not in ("reconstruction", "background") or "_pictures" not in self.__dict__:
            raise AttributeError(f"{type(self).__name__} has no attribute {name!r}")
        return self.__dict__.setdefault(name, getattr(self.__dict__["_pictures"], name))


@dataclass(frozen=True, eq=False)
class Progress:
    """Where a running refinement stands.

    Attributes
    ----------
    stage
        What is being done, in words for the user: "looking at the image", "tracing", ...
    fraction
        Share of the work done, 0 to 1; never falls.
    centrelines
        The curves as they are now, one (P, 2) array per sketch, or None before there are any.
    """

    stage: str
    fraction: float
    centrelines: tuple[Float[Array, "P 2"], ...] | None = None


OnProgress = Callable[[Progress], bool | None]


def says_stop(answer: bool | None) -> bool:
    """Whether a callback returned False, Python's or NumPy's."""
    return isinstance(answer, bool | np.bool_) and not answer


Sketches = Sequence[Real[Array, "N 2"]]

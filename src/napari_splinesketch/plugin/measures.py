"""What the table says of a curve: numbers in the image's units, free of Qt and napari."""

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from typing import TypeVar
from weakref import WeakKeyDictionary

import numpy as np
from jaxtyping import Float

from napari_splinesketch.engine.types import Curve, Status
from napari_splinesketch.labels.geometry import width_growth
from napari_splinesketch.tracking.over_time import mean_curvature

V = TypeVar("V", bound=Hashable)
T = TypeVar("T")
NOTICEABLE_RESIDUAL = 0.25
NOTICEABLE_SD = 0.5
"""What weighs the same when the worst curve is looked for: share of the contrast, px."""
RANKS: dict[Status, int] = {"good": 0, "check": 1, "failed": 2}
UNKNOWN = "–"


def once(find: Callable[[V], T]) -> Callable[[V], T]:
    """Remember what a function gave for each value, while the value lives."""
    known: WeakKeyDictionary[V, T] = WeakKeyDictionary()

    def found(value: V) -> T:
        try:
            return known[value]
        except KeyError:
            return known.setdefault(value, find(value))

    return found


@dataclass(frozen=True)
class Ruler:
    """Turns pixels into the image's unit, by the (y, x) size of a pixel; "px" where it has none."""

    scale: tuple[float, float] = (1.0, 1.0)
    unit: str = "px"

    @property
    def pixel(self) -> float:
        """Size of a pixel: the mean of both directions."""
        return (self.scale[0] * self.scale[1]) ** 0.5

    def along(self, points: Float[np.ndarray, "P 2"]) -> Float[np.ndarray, " P"]:
        """Distance from the first point along a line of (row, col), px, in the unit."""
        steps = np.linalg.norm(np.diff(points * self.scale, axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])

    def across(self, curve: Curve, values: Float[np.ndarray, " P"]) -> Float[np.ndarray, " P"]:
        """Turn distances from a curve, px, into the unit, whichever way it runs."""
        if self.scale[0] == self.scale[1]:
            return values * self.scale[0]
        return values * width_growth(curve.points, self.scale)


@dataclass(frozen=True)
class Measures:
    """Numbers of a curve; lengths in the ruler's unit.

    Attributes
    ----------
    length
        Arc length.
    half_width_mean, half_width_max
        Over the curve's points.
    sd
        Median standard error along the normal.
    residual
        As a share of the body's contrast.
    curvature
        Mean of its size along the curve, 1 / unit.
    speed
        Mean over the curve's points, in units a frame; NaN without a curve in a frame beside.
    """

    length: float
    half_width_mean: float
    half_width_max: float
    sd: float
    residual: float
    curvature: float
    speed: float = float("nan")


def measure(curve: Curve, ruler: Ruler) -> Measures:
    """Measure a curve."""
    half_width = ruler.across(curve, curve.half_width)
    return Measures(
        float(ruler.along(curve.points)[-1]),
        float(np.mean(half_width)),
        float(np.max(half_width)),
        float(np.median(ruler.across(curve, curve.sd))),
        curve.residual,
        mean_curvature(curve.points * ruler.scale),
    )


@once
def typical_sd(curve: Curve) -> float:
    """Median standard error along the normal, px."""
    return float(np.median(curve.sd))


@once
def severity(curve: Curve) -> tuple[int, float]:
    """Say how much a curve needs review: by status, then by residual and sd."""
    numbers = curve.residual / NOTICEABLE_RESIDUAL, typical_sd(curve) / NOTICEABLE_SD
    return RANKS[curve.status], max(n if np.isfinite(n) else np.inf for n in numbers)


def three_digits(value: float) -> str:
    """Write a number with three digits that count, and never with an exponent."""
    if not np.isfinite(value):
        return UNKNOWN
    decimals = 2 - int(np.floor(np.log10(abs(value)))) if value else 0
    return f"{value:.{min(max(decimals, 0), 6)}f}"


def mean_along(
    values: Sequence[Float[np.ndarray, " P"]],
) -> Float[np.ndarray, " P"] | None:
    """Average what curves have at the same share of their lengths; None without any."""
    if not values:
        return None
    every = np.stack(values)
    known = every[np.isfinite(every).all(axis=1)]
    return known.mean(axis=0) if len(known) else None

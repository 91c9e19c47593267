"""Colours of curves: by status, or by a number of theirs."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Literal, get_args

import numpy as np
from jaxtyping import Float

from napari_splinesketch.engine.types import Curve
from napari_splinesketch.plugin.adapter.look import COLOURS
from napari_splinesketch.plugin.measures import Ruler, measure

ColourBy = Literal["status", "length", "half_width", "sd", "residual"]
COLOUR_BY: tuple[ColourBy, ...] = get_args(ColourBy)
COLUMN = {"half_width": "half_width_mean"}
"""The columns that are called otherwise in the settings."""
RAMP = ("#414487", "#2a788e", "#22a884", "#7ad151", "#fde725")
"""Viridis without its darkest end, which is lost on a dark image: rises in lightness, and so is
read by everybody."""
UNKNOWN = "#999999"


@dataclass(frozen=True)
class Scale:
    """The numbers that the ends of the ramp stand for, in the ruler's unit."""

    low: float
    high: float


def scale_of(curves: Sequence[Curve], by: ColourBy, ruler: Ruler) -> Scale | None:
    """Give what the ramp spans; None where there are no numbers, or the status is shown."""
    values = np.array(_numbers(curves, by, ruler))
    known = values[np.isfinite(values)]
    return Scale(float(known.min()), float(known.max())) if known.size else None


def colours_of(curves: Sequence[Curve], by: ColourBy, ruler: Ruler) -> list[str]:
    """Give each curve its colour."""
    if by == "status":
        return [COLOURS[curve.status] for curve in curves]
    scale = scale_of(curves, by, ruler)
    if scale is None:
        return [UNKNOWN] * len(curves)
    return [_on_ramp(value, scale) for value in _numbers(curves, by, ruler)]


def rgba(colours: Sequence[str]) -> Float[np.ndarray, "N 4"]:
    """Give colours as napari keeps them."""
    return np.array([_rgba(colour) for colour in colours], dtype=np.float32).reshape(-1, 4)


@cache
def _rgba(colour: str) -> tuple[float, ...]:
    return *(value / 255 for value in bytes.fromhex(colour[1:])), 1.0


def _numbers(curves: Sequence[Curve], by: ColourBy, ruler: Ruler) -> list[float]:
    if by == "status":
        return []
    return [getattr(measure(curve, ruler), COLUMN.get(by, by)) for curve in curves]


def _on_ramp(value: float, scale: Scale) -> str:
    if not np.isfinite(value):
        return UNKNOWN
    share = (value - scale.low) / (scale.high - scale.low) if scale.high > scale.low else 0.5
    stops = np.array([list(bytes.fromhex(c[1:])) for c in RAMP])
    at = share * (len(RAMP) - 1)
    mixed = [round(float(np.interp(at, range(len(RAMP)), channel))) for channel in stops.T]
    return "#{:02x}{:02x}{:02x}".format(*mixed)

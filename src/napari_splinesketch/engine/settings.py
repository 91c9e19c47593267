"""What may be asked of a refinement."""

from collections.abc import Sequence
from dataclasses import astuple, dataclass
from itertools import pairwise
from numbers import Integral, Real
from typing import Literal, get_args

import numpy as np

from napari_splinesketch.engine import constants as const
from napari_splinesketch.engine.types import InputError, Polarity

PresetName = Literal["fast", "balanced", "thorough", "paper"]
PRESETS: tuple[PresetName, ...] = get_args(PresetName)
OFFERED: tuple[PresetName, ...] = ("balanced", "paper")
"""Those that differ: "fast" and "thorough" are the same as "balanced"."""
MARGIN = 40
"""Image that is looked at around a sketch, px, beside half of the length of a short sketch."""


@dataclass(frozen=True, kw_only=True)
class Asked:
    """What users may ask of a refinement, in the words of the command line and the window."""

    polarity: Polarity = "auto"
    """Whether bodies are brighter or darker than what is around them."""
    half_width: float | None = None
    """Rough distance from a body's centreline to its edge, px; None measures it."""
    preset: PresetName = "balanced"
    """This engine, or the recipe of the paper."""


@dataclass(frozen=True)
class Hold:
    """How well it is known where a body is: standard errors, px."""

    across: float
    """Of each of its knots, along the normal."""
    along: float
    """Of the body as a whole, along its own path."""
    stretch: float
    """Of its knots along the path, against each other: how well its length is known."""

    def __post_init__(self) -> None:
        known = all(isinstance(sd, Real) and 0 <= float(sd) < np.inf for sd in astuple(self))
        if not (known and self.across and self.stretch):
            raise InputError(f"hold is {self!r}; give finite standard errors above 0, px.")


@dataclass(frozen=True)
class Settings:
    """How this engine works.

    Attributes
    ----------
    traced
        Whether paths are looked for in the graph of traces, beside those along the sketch.
    knots
        Numbers of knots that a curve may have, in rising order; the first from 2 to 24.
    hold
        How precisely each sketch is known to lie on its body; nothing is searched for, and curves
        are held to their sketches by that. None to search.

    Raises
    ------
    InputError
        Where no curve can have such numbers of knots, or be held like that.
    """

    traced: bool = True
    knots: tuple[int, ...] = (4, 8, 12, 16, 24, 48, 96)
    hold: tuple[Hold, ...] | None = None

    def __post_init__(self) -> None:
        knots, most = self.knots, const.KNOTS_MANY
        if (
            not (isinstance(knots, Sequence) and knots)
            or not all(isinstance(number, Integral) for number in knots)
            or not 2 <= knots[0] <= most
            or any(more <= number for number, more in pairwise(knots))
        ):
            raise InputError(
                f"knots is {knots!r}; give whole numbers in rising order, the first from 2 to"
                f" {most}, such as (8, 12, 16)."
            )
        held = () if self.hold is None else self.hold
        if not (isinstance(held, Sequence) and all(isinstance(one, Hold) for one in held)):
            raise InputError(f"hold is {held!r}; give one Hold for each sketch, or None to search.")

"""Presets: where on the speed-accuracy chart to work."""

from dataclasses import dataclass
from typing import Literal, get_args

PresetName = Literal["fast", "balanced", "thorough", "paper"]
PRESETS: tuple[PresetName, ...] = get_args(PresetName)


@dataclass(frozen=True)
class LevelSettings:
    """How one level is fitted.

    Attributes
    ----------
    blur
        Blur of image and model, in half-widths of the bodies.
    steps
        Evaluations a curve in each sweep.
    margin
        Background on either side of a body in its band, px.
    sparse
        Whether to use every second row and column, where the bodies are wide enough.
    """

    blur: float
    steps: tuple[int, ...]
    margin: float = 4.0
    sparse: bool = False

    def stride(self, half_width: float) -> int:
        """Use every so many rows and columns."""
        return 2 if self.sparse and self.blur * half_width >= 1.0 else 1


@dataclass(frozen=True)
class Settings:
    """What a preset stands for.

    Attributes
    ----------
    weigh
        Paths looked at for each sketch, at most.
    paths
        Candidate paths kept for each sketch.
    polish
        How paths are finished.
    knots
        Numbers of knots that a curve may have, in rising order.
    everything
        Use every part of the model, whether it pays or not.
    hold
        Standard error of the sketches, px, where it is known: nothing is searched for, and curves
        are held to their sketches by so much. None searches.
    """

    weigh: int = 3000
    paths: int = 40
    polish: LevelSettings = LevelSettings(0.0, (5, 4, 4, 4, 4, 4), 4.0)
    knots: tuple[int, ...] = (8, 12, 16, 24)
    everything: bool = False
    hold: float | None = None


SETTINGS: dict[PresetName, Settings] = {
    "fast": Settings(weigh=1000, polish=LevelSettings(0.0, (6, 4, 4), 3.0)),
    "balanced": Settings(),
    "thorough": Settings(weigh=6000, paths=80),
}

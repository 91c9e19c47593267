"""Lines that were suggested: immutable values, free of Qt and napari."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from napari_splinesketch.metrics import resample
from napari_splinesketch.plugin.records import Line

SAMPLES = 16
SAME = 0.25
"""Lines that lie so near to each other, in lengths of the shorter one, mean the same body."""


@dataclass(frozen=True, eq=False)
class Suggestion:
    """A sketch that nobody has drawn.

    Attributes
    ----------
    frame
        Index of the frame.
    line
        (N, 2) px of the image.
    """

    frame: int
    line: Line


def new_among(lines: Sequence[Line], known: Sequence[Line]) -> list[Line]:
    """Leave out lines over bodies that have one already."""
    if not (lines and known):
        return list(lines)
    others = np.array([resample(line, SAMPLES) for line in known])
    both = np.stack([others, others[:, ::-1]])
    sizes = np.array([_length(line) for line in known])
    kept = []
    for line in lines:
        apart = np.linalg.norm(both - resample(line, SAMPLES), axis=3).mean(2).min(0)
        if not (apart < SAME * np.minimum(sizes, _length(line))).any():
            kept.append(line)
    return kept


def _length(line: Float[np.ndarray, "N 2"]) -> float:
    return float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())

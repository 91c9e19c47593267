"""What is known of an image's bodies: immutable values, free of Qt and napari."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.optimize import linear_sum_assignment

from napari_splinesketch.engine.types import Curve
from napari_splinesketch.labels.types import Review

Line = Float[np.ndarray, "N 2"]
Key = tuple[int, int]
"""(frame, id) of a record."""

SAMPLES = 16
"""Points at which two sketches are compared."""


@dataclass(frozen=True, eq=False)
class Record:
    """A curve of one frame, and the sketch it was refined from.

    Attributes
    ----------
    id
        Number of the curve, from 1; the same body keeps it when it is refined again.
    frame
        Index of the frame.
    sketch
        (N, 2): the sketch as it was, px.
    curve
        The result.
    review
        What the user said of it.
    locked
        Whether it stays as it is when its frame is refined again.
    drawn
        Whether `sketch` is a line that the user drew, rather than what another curve left.
    edited
        Whether the user has changed the curve since it was refined.
    """

    id: int
    frame: int
    sketch: Line
    curve: Curve
    review: Review = "open"
    locked: bool = False
    drawn: bool = True
    edited: bool = False


def key_of(record: Record) -> Key:
    """Give what tells a record from all others."""
    return record.frame, record.id


def identify(lines: Sequence[Line], known: Sequence[Record], others: Iterable[Record]) -> list[int]:
    """Give each sketch the number it had before, or a new one.

    Parameters
    ----------
    lines
        Sketches of one frame, px.
    known
        Records of the same frame. A sketch that was moved or mended is known again while it
        lies, on average, within half of its length of where it was.
    others
        Records of the image whose numbers are taken.
    """
    ids = [0] * len(lines)
    if known and lines:
        reach = np.array([_length(line) / 2 for line in lines])[:, None]
        distance = _distances(lines, [record.sketch for record in known])
        for i, j in zip(*linear_sum_assignment(np.minimum(distance, reach)), strict=True):
            if distance[i, j] < reach[i]:
                ids[i] = known[j].id
    new = max((record.id for record in (*known, *others)), default=0)
    for i, number in enumerate(ids):
        if not number:
            ids[i] = new = new + 1
    return ids


def _distances(a: Sequence[Line], b: Sequence[Line]) -> Float[np.ndarray, "A B"]:
    """Mean distance of every line to every other, whichever way they were drawn, px."""
    others = np.array([_resample(line) for line in b])
    both = np.stack([others, others[:, ::-1]])
    rows = [np.linalg.norm(both - _resample(line), axis=3).mean(axis=2).min(axis=0) for line in a]
    return np.array(rows)


def _resample(line: Line) -> Line:
    steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    at = np.linspace(0, along[-1], SAMPLES)
    return np.column_stack([np.interp(at, along, axis) for axis in line.T])


def _length(line: Line) -> float:
    return float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())

"""What the tables and charts say about a set of rows."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from rows import Row

FAR = 2.0
"""A body further from the truth than this, px of average DTW, was not found."""


@dataclass(frozen=True)
class Summary:
    """Accuracy and time of one method in one cell, or in several together.

    Attributes
    ----------
    frames, bodies
        How many there were.
    initial_half, best_half
        Mean average DTW over the best half of the frames, px: of the sketches, and after
        refinement (each with its own best half; a frame counts with the mean of its bodies).
    median, mean, low, high
        Of average DTW over bodies, and its quartiles, px.
    far
        Share of bodies with average DTW above 2 px.
    worse
        Share of bodies that are further from the truth than their sketches.
    normal
        Median over bodies of the mean normal distance, px, of those within 2 px.
    end
        Median over bodies of the mean distance of the ends, px, of those within 2 px.
    seconds, seconds_low, seconds_high
        Median seconds a frame on one core, and its quartiles.
    """

    frames: int
    bodies: int
    initial_half: float
    best_half: float
    median: float
    mean: float
    low: float
    high: float
    far: float
    worse: float
    normal: float
    end: float
    seconds: float
    seconds_low: float
    seconds_high: float


def summary(rows: Sequence[Row]) -> Summary | None:
    """Summarise rows; None where there are none."""
    if not rows:
        return None
    dtw = np.array([row.dtw for row in rows])
    initial = np.array([row.initial for row in rows])
    found = [row for row in rows if row.dtw <= FAR]
    by_frame = {}
    for row in rows:
        by_frame.setdefault((row.cell, row.index), []).append(row)
    frames = list(by_frame.values())
    seconds = np.quantile([frame[0].cpu for frame in frames], [0.25, 0.5, 0.75])
    return Summary(
        frames=len(frames),
        bodies=len(rows),
        initial_half=_best_half([np.mean([r.initial for r in frame]) for frame in frames]),
        best_half=_best_half([np.mean([r.dtw for r in frame]) for frame in frames]),
        median=float(np.median(dtw)),
        mean=float(np.mean(dtw)),
        low=float(np.quantile(dtw, 0.25)),
        high=float(np.quantile(dtw, 0.75)),
        far=float(np.mean(dtw > FAR)),
        worse=float(np.mean(dtw > initial)),
        normal=_median([row.normal for row in found]),
        end=_median([row.end for row in found]),
        seconds=float(seconds[1]),
        seconds_low=float(seconds[0]),
        seconds_high=float(seconds[2]),
    )


def _best_half(values: Sequence[float] | Sequence[np.floating]) -> float:
    ordered = np.sort(np.asarray(values, dtype=float))
    return float(ordered[: max(1, len(ordered) // 2)].mean())


def _median(values: Sequence[float]) -> float:
    finite = [value for value in values if np.isfinite(value)]
    return float(np.median(finite)) if finite else float("nan")

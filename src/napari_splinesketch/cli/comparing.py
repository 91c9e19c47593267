"""Comparing labels with the truth."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from napari_splinesketch.images.frames import open_frames
from napari_splinesketch.images.pictures import write_overlay
from napari_splinesketch.labels import Label, Labels
from napari_splinesketch.labels.masks import image_shape
from napari_splinesketch.labels.stream import in_frames


@dataclass(frozen=True)
class Comparison:
    """How far labels are from the truth, over all frames together.

    Attributes
    ----------
    tolerance
        Largest average DTW of a pair, px.
    curves, truths, pairs
        How many there are, and how many could be matched one to one within the tolerance.
    precision, recall
        Pairs over curves, pairs over truths.
    dtw_median, dtw_mean, dtw_p95
        Average DTW over the pairs, px.
    normal_distance
        Mean distance along the normal over the pairs, px.
    end_error
        Mean distance between ends over the pairs, px.
    """

    tolerance: float
    curves: int
    truths: int
    pairs: int
    precision: float
    recall: float
    dtw_median: float | None
    dtw_mean: float | None
    dtw_p95: float | None
    normal_distance: float | None
    end_error: float | None


def compare(labels: Labels, truth: Labels, *, tolerance: float) -> Comparison:
    """Match the curves of each frame one to one and measure the pairs."""
    from napari_splinesketch import metrics

    distances: list[float] = []
    normals: list[float] = []
    ends: list[float] = []
    ours, theirs = _by_frame(labels), _by_frame(truth)
    for frame in ours.keys() | theirs.keys():
        curves = [label.points for label in ours.get(frame, ())]
        truths = [label.points for label in theirs.get(frame, ())]
        matching = metrics.match(curves, truths, tolerance=tolerance)
        distances.extend(matching.distances)
        for i, j in matching.pairs:
            normals.append(metrics.normal_distance(curves[i], truths[j]))
            ends.append(metrics.end_error(curves[i], truths[j]))
    count, all_ours, all_theirs = len(distances), len(labels.labels), len(truth.labels)
    return Comparison(
        tolerance,
        all_ours,
        all_theirs,
        count,
        precision=count / all_ours if all_ours else 1.0,
        recall=count / all_theirs if all_theirs else 1.0,
        dtw_median=_rounded(np.median, distances),
        dtw_mean=_rounded(np.mean, distances),
        dtw_p95=_rounded(lambda values: np.percentile(values, 95), distances),
        normal_distance=_rounded(np.mean, [value for value in normals if np.isfinite(value)]),
        end_error=_rounded(np.mean, ends),
    )


def as_text(result: Comparison) -> list[str]:
    """Give the comparison in words."""
    lines = [
        f"{result.curves} curves, {result.truths} truths, {result.pairs} pairs "
        f"within {result.tolerance:g} px",
        f"precision {result.precision:.3f}, recall {result.recall:.3f}",
    ]
    if result.pairs:
        lines += [
            f"average DTW: median {result.dtw_median} px, mean {result.dtw_mean} px, "
            f"95 % below {result.dtw_p95} px",
            f"normal distance {result.normal_distance} px, end error {result.end_error} px (means)",
        ]
    return lines


def draw(
    path: Path,
    labels: Labels,
    truth: Labels,
    *,
    image: str | None = None,
    overwrite: bool = False,
) -> None:
    """Draw the curves and the truth of the first frame that has either.

    Parameters
    ----------
    path
        The picture.
    labels, truth
        What was compared.
    image
        What to draw over; None draws over a blank sheet that holds all curves.
    overwrite
        Replace an existing file.
    """
    ours, theirs = _by_frame(labels), _by_frame(truth)
    frame = min(ours.keys() | theirs.keys(), default=0)
    curves, truths = ours.get(frame, ()), theirs.get(frame, ())
    if image:
        with open_frames(image) as images:
            pixels = images[frame]
    else:
        pixels = np.zeros(np.maximum(image_shape(labels), image_shape(truth)))
    write_overlay(path, pixels, curves, truth=truths, overwrite=overwrite)


def _by_frame(labels: Labels) -> dict[int, tuple[Label, ...]]:
    return {frame[0].frame: frame for frame in in_frames(labels).read()}


def _rounded(
    statistic: Callable[[Sequence[float]], np.floating], values: Sequence[float]
) -> float | None:
    return round(float(statistic(values)), 4) if values else None

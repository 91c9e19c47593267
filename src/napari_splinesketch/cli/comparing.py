"""Comparing labels with the truth."""

from pathlib import Path

import numpy as np

from napari_splinesketch import metrics
from napari_splinesketch.cli.jobs import CompareJob
from napari_splinesketch.files import atomic, counted
from napari_splinesketch.images.frames import open_frames
from napari_splinesketch.images.pictures import write_overlay
from napari_splinesketch.labels import Label, Labels
from napari_splinesketch.labels.masks import drawn_shape
from napari_splinesketch.labels.types import in_frames
from napari_splinesketch.metrics import Comparison


def compare(labels: Labels, truth: Labels, *, tolerance: float) -> Comparison:
    """Match the curves of each frame one to one and measure the pairs."""
    ours, theirs = _by_frame(labels), _by_frame(truth)
    frames = (
        [[label.points for label in side.get(frame, ())] for side in (ours, theirs)]
        for frame in ours.keys() | theirs.keys()
    )
    return metrics.compare(frames, tolerance=tolerance)


def as_text(result: Comparison) -> list[str]:
    """Give the comparison in words."""
    lines = [
        f"{counted(result.curves, 'curve')}, {counted(result.truths, 'truth')}, "
        f"{counted(result.pairs, 'pair')} within {result.tolerance:g} px",
        f"precision {result.precision:.3f}, recall {result.recall:.3f}",
    ]
    if result.pairs:
        normal = "–" if result.normal_distance is None else result.normal_distance
        lines += [
            f"average DTW: median {result.dtw_median} px, mean {result.dtw_mean} px, "
            f"95 % below {result.dtw_p95} px",
            f"normal distance {normal} px, end error {result.end_error} px (means)",
        ]
    return lines


def draw(job: CompareJob, path: Path, labels: Labels, truth: Labels) -> None:
    """Draw curves and truth of the first frame that has either, on an image or a blank sheet."""
    ours, theirs = _by_frame(labels), _by_frame(truth)
    frame = min(ours.keys() | theirs.keys(), default=0)
    if job.image is not None:
        with open_frames(job.image, channel=job.channel, z=job.z) as images:
            pixels = images[frame]
    else:
        pixels = np.zeros(np.maximum(drawn_shape(labels), drawn_shape(truth)))
    curves, truths = ours.get(frame, ()), theirs.get(frame, ())
    with atomic(path, overwrite=job.overwrite) as temporary:
        write_overlay(temporary, pixels, curves, truths)


def _by_frame(labels: Labels) -> dict[int, tuple[Label, ...]]:
    return {frame[0].frame: frame for frame in in_frames(labels).read()}

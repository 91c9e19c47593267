"""Suggesting sketches on the frames of an image or film."""

from functools import partial

import numpy as np
from jaxtyping import Real

import napari_splinesketch
from napari_splinesketch.batch.flow import Progress
from napari_splinesketch.batch.frame_task import FrameDone
from napari_splinesketch.batch.reports import CurveReport, FrameReport
from napari_splinesketch.cli.jobs import SuggestJob
from napari_splinesketch.cli.run import Outcome, open_run
from napari_splinesketch.cli.terminal import Report
from napari_splinesketch.engine.types import Polarity
from napari_splinesketch.images.frames import ImageError
from napari_splinesketch.labels import Label


def run(job: SuggestJob, report: Report) -> Outcome:
    """Suggest sketches on every frame, or on the one asked for, and write them.

    A frame that cannot be read is reported, and the others continue.
    """
    with open_run(job, report) as work:
        images = work.images
        if job.frame is not None and not 0 <= job.frame < images.count:
            count = f"{images.name} has {images.count}, counted from 0"
            raise ImageError(f"no frame {job.frame}: {count}")
        frames = range(images.count) if job.frame is None else [job.frame]
        work.count = len(frames)
        options = (job.sensitivity, job.polarity, job.half_width)
        work.shared(job, ((frame, partial(suggested, frame, options), ()) for frame in frames))
        return work.write(frames)


def suggested(
    frame: int,
    options: tuple[float, Polarity, float | None],
    image: Real[np.ndarray, "H W"],
    progress: Progress,
) -> FrameDone:
    """Suggest sketches on one frame; the options are those of `napari_splinesketch.suggest`."""
    lines = napari_splinesketch.suggest(image, *options)
    labels = tuple(Label.from_sketch(line, frame=frame, identity=i) for i, line in enumerate(lines))
    told = tuple(CurveReport.drawn(label, "sketch") for label in labels)
    return FrameDone(FrameReport(frame, told), labels)

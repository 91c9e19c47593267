"""Suggesting sketches on the frames of an image or film."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Real

import napari_splinesketch
from napari_splinesketch.batch.frame_task import Found
from napari_splinesketch.batch.reports import CurveReport
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
        work.shared(job, ((frame, Suggester(frame, options)) for frame in frames))
        return work.write(frames)


@dataclass(frozen=True)
class Suggester:
    """Suggests sketches on one frame; the options are those of `napari_splinesketch.suggest`."""

    frame: int
    options: tuple[float, Polarity, float | None]

    def find(self, image: Real[np.ndarray, "H W"], progress: Callable[[float], None]) -> Found:
        """Suggest them."""
        lines = napari_splinesketch.suggest(image, *self.options)
        labels = tuple(
            Label.from_sketch(line, frame=self.frame, identity=i) for i, line in enumerate(lines)
        )
        lengths = (round(float(label.arc_length[-1]), 3) for label in labels)
        reports = (CurveReport(i, length, None, None, "sketch") for i, length in enumerate(lengths))
        return Found(labels, tuple(reports))

    def instead(self) -> tuple[Label, ...]:
        """Suggest nothing."""
        return ()

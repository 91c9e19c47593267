"""Suggesting sketches on the frames of an image or film."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Real

import napari_splinesketch
from napari_splinesketch.cli.frame_run import Report, SharedJob, work
from napari_splinesketch.cli.frame_task import Found
from napari_splinesketch.cli.images import ImageError
from napari_splinesketch.cli.report import CurveReport
from napari_splinesketch.cli.run import Outcome, open_run
from napari_splinesketch.engine.types import Polarity
from napari_splinesketch.labels import Label


@dataclass(frozen=True, kw_only=True)
class SuggestJob(SharedJob):
    """What `suggest` was asked for."""

    sensitivity: float = 0.5
    frame: int | None = None


def suggest_job(job: SuggestJob, report: Report) -> Outcome:
    """Suggest sketches on every frame, or on the one asked for, and write them.

    A frame that cannot be read is reported, and the others go on.
    """
    job.check()
    own = {"command": "suggest", "sensitivity": job.sensitivity}
    with open_run(job, **own, frame=job.frame) as run:
        images = run.images
        if job.frame is not None and not 0 <= job.frame < images.count:
            count = f"{images.name} has {images.count}, counted from 0"
            raise ImageError(f"no frame {job.frame}: {count}")
        frames = range(images.count) if job.frame is None else [job.frame]
        finders = (
            (frame, Suggester(frame, job.sensitivity, job.polarity, job.half_width))
            for frame in frames
        )
        work(job, run, finders, len(frames), report)
        reports, _, losses = run.write(frames, **own)
    return Outcome(reports, losses)


@dataclass(frozen=True)
class Suggester:
    """Suggests sketches on one frame; the options are those of the job."""

    frame: int
    sensitivity: float
    polarity: Polarity
    half_width: float | None

    def find(self, image: Real[np.ndarray, "H W"], progress: Callable[[float], None]) -> Found:
        """Suggest them."""
        lines = napari_splinesketch.suggest(image, self.sensitivity, self.polarity, self.half_width)
        labels = tuple(
            Label.from_sketch(line, frame=self.frame, identity=i) for i, line in enumerate(lines)
        )
        reports = (
            CurveReport(
                label.curve, round(float(label.arc_length[-1]), 3), None, None, "sketch", ()
            )
            for label in labels
        )
        return Found(labels, tuple(reports))

    def instead(self) -> tuple[Label, ...]:
        """Suggest nothing."""
        return ()

"""Suggesting sketches on the frames of an image or film."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Real

import napari_splinesketch
from napari_splinesketch.cli.frame_run import FrameRun, Report
from napari_splinesketch.cli.frame_task import Found
from napari_splinesketch.cli.images import Frames, ImageError, open_frames
from napari_splinesketch.cli.outcome import Outcome, check_files, pixel_size
from napari_splinesketch.cli.partial import Partial
from napari_splinesketch.cli.report import CurveReport
from napari_splinesketch.engine.types import Polarity
from napari_splinesketch.labels import Label, Labels


@dataclass(frozen=True)
class SuggestJob:
    """What `suggest` was asked for; the attributes are the command's options."""

    image: str
    output: Path
    sensitivity: float = 0.5
    polarity: Polarity = "auto"
    half_width: float | None = None
    frame: int | None = None
    channel: int | None = None
    z: int | None = None
    scale: tuple[float, float] | None = None
    units: str | None = None
    jobs: int = 1
    scheduler: str | None = None
    resume: bool = False
    overwrite: bool = False

    def outputs(self) -> tuple[Path]:
        """Give every file that the job writes."""
        return (self.output,)


def suggest_job(job: SuggestJob, report: Report) -> Outcome:
    """Suggest sketches on every frame, or on the one asked for, and write them.

    A frame that cannot be read is reported, and the others go on.
    """
    check_files(job.output, job.outputs(), overwrite=job.overwrite)
    with open_frames(job.image, channel=job.channel, z=job.z) as images:
        if job.frame is not None and not 0 <= job.frame < images.count:
            count = f"{images.name} has {images.count}, counted from 0"
            raise ImageError(f"no frame {job.frame}: {count}")
        frames = range(images.count) if job.frame is None else [job.frame]
        head = pixel_size(job, images)
        partial = Partial(job.output, _settings(job, images, head), resume=job.resume)
        run = FrameRun(job, images, partial, head)
        finders = (
            (frame, Suggester(frame, job.sensitivity, job.polarity, job.half_width))
            for frame in frames
        )
        run.work(finders, len(frames), report)
        options = {
            "command": "suggest",
            "sensitivity": job.sensitivity,
            "polarity": job.polarity,
            "half_width": job.half_width,
        }
        reports, _, losses = run.write(frames, "", options)
    partial.remove()
    return Outcome(reports, losses)


def _settings(job: SuggestJob, images: Frames, head: Labels) -> dict[str, object]:
    return {
        "version": napari_splinesketch.__version__,
        "command": "suggest",
        "image": [images.name, images.count],
        "sensitivity": job.sensitivity,
        "polarity": job.polarity,
        "half-width": job.half_width,
        "frame": job.frame,
        "channel": job.channel,
        "z": job.z,
        "pixel size": [head.scale, head.units],
    }


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

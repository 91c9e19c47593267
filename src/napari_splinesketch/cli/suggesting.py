"""Suggesting sketches on the frames of an image or film."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import napari_splinesketch
from napari_splinesketch.cli.images import Frames, ImageError, open_frames
from napari_splinesketch.cli.outcome import Outcome, check_files, gather, words
from napari_splinesketch.cli.partial import Partial
from napari_splinesketch.cli.report import CurveReport, FrameReport
from napari_splinesketch.engine.types import Polarity
from napari_splinesketch.labels import Label, Labels, write_labels
from napari_splinesketch.labels.provenance import checksum


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
    resume: bool = False
    overwrite: bool = False

    def outputs(self) -> tuple[Path]:
        """Give every file that the job writes."""
        return (self.output,)


def suggest_job(job: SuggestJob, report: Callable[[float, int], None]) -> Outcome:
    """Suggest sketches on every frame, or on the one asked for, and write them.

    A frame that cannot be read is reported, and the others go on.
    """
    check_files(job.output, job.outputs(), overwrite=job.overwrite)
    with open_frames(job.image, channel=job.channel, z=job.z) as images:
        if job.frame is not None and not 0 <= job.frame < images.count:
            count = f"{images.name} has {images.count}, counted from 0"
            raise ImageError(f"no frame {job.frame}: {count}")
        frames = range(images.count) if job.frame is None else [job.frame]
        partial = Partial(job.output, _settings(job, images), resume=job.resume)
        reports = []
        for frame in frames:
            reports.append(partial.done(frame) or _suggest_frame(job, images, frame, partial))
            report(len(reports), len(frames))
        options = {
            "command": "suggest",
            "sensitivity": job.sensitivity,
            "polarity": job.polarity,
            "half_width": job.half_width,
        }
        labels = gather(job, images, partial, reports, preset="", options=options)
        losses = write_labels(job.output, labels, overwrite=job.overwrite)
    partial.remove()
    return Outcome(tuple(reports), losses)


def _settings(job: SuggestJob, images: Frames) -> dict[str, object]:
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
    }


def _suggest_frame(job: SuggestJob, images: Frames, frame: int, partial: Partial) -> FrameReport:
    began, labels, error, digest = time.perf_counter(), (), None, None
    try:
        image = images[frame]
        digest = checksum(image)
        lines = napari_splinesketch.suggest(image, job.sensitivity, job.polarity, job.half_width)
        labels = tuple(
            Label.from_sketch(line, frame=frame, identity=i) for i, line in enumerate(lines)
        )
    except Exception as reason:  # one bad frame must not stop the others
        error = words(reason)
    curves = tuple(
        CurveReport(label.curve, round(float(label.arc_length[-1]), 3), None, None, "sketch", ())
        for label in labels
    )
    seconds = round(time.perf_counter() - began, 3)
    finished = FrameReport(frame, curves, error, seconds, digest)
    partial.save(finished, Labels(labels), None)
    return finished

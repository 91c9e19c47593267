"""Refining the frames of an image or film, one after another, without losing any."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import napari_splinesketch
from napari_splinesketch.cli.images import Frames, open_frames
from napari_splinesketch.cli.outcome import Outcome, check_files, gather, words
from napari_splinesketch.cli.partial import Partial
from napari_splinesketch.cli.pictures import write_overlay, write_reconstruction
from napari_splinesketch.cli.report import CurveReport, FrameReport
from napari_splinesketch.engine.settings import PresetName
from napari_splinesketch.engine.types import Polarity, Progress
from napari_splinesketch.labels import Label, Labels, masks, read_labels, write_labels
from napari_splinesketch.labels.files import checksum_of_file
from napari_splinesketch.labels.provenance import checksum

Report = Callable[[float, int], None]
"""Told how many frames are done, counting part of the one being refined, and how many to do."""
TIFF = (".tif", ".tiff")
PICTURE = (".png", ".jpg", ".tif")


@dataclass(frozen=True)
class Job:
    """What `refine` was asked for; the attributes are the command's options."""

    image: str
    sketches: Path
    output: Path
    preset: PresetName = "balanced"
    polarity: Polarity = "auto"
    half_width: float | None = None
    seed: int = 0
    channel: int | None = None
    z: int | None = None
    scale: tuple[float, float] | None = None
    units: str | None = None
    reconstruction: Path | None = None
    masks: Path | None = None
    overlay: Path | None = None
    resume: bool = False
    overwrite: bool = False

    def outputs(self) -> Iterator[Path]:
        """Give every file that the job writes."""
        yield self.output
        yield from (p for p in (self.reconstruction, self.masks, self.overlay) if p)


def refine_job(job: Job, report: Report) -> Outcome:
    """Refine every frame that has sketches, and write the outputs.

    A frame that cannot be refined is reported and its sketches come back as drawn, "failed".
    Finished frames are kept beside the output until all outputs are written.
    """
    check_outputs(job)
    sketches = read_labels(job.sketches)
    by_frame: dict[int, list[Label]] = {}
    for label in sketches.labels:
        by_frame.setdefault(label.frame, []).append(label)
    with open_frames(job.image, channel=job.channel, z=job.z) as images:
        partial = Partial(job.output, _settings(job, images), resume=job.resume)
        reports = []
        for done, frame in enumerate(sorted(by_frame)):

            def progress(fraction: float, done: int = done) -> None:
                report(done + fraction, len(by_frame))

            finished = partial.done(frame)
            if finished is None:
                finished = _refine_frame(job, images, frame, by_frame[frame], partial, progress)
            reports.append(finished)
            progress(1.0)
        losses = _write(job, images, partial, reports, sketches)
    partial.remove()
    return Outcome(tuple(reports), (*sketches.notes, *losses))


def check_outputs(job: Job) -> None:
    """Refuse a job whose outputs could not be written, before it has cost any time."""
    check_files(job.output, tuple(job.outputs()), overwrite=job.overwrite)
    for path, endings in ((job.reconstruction, TIFF), (job.masks, TIFF), (job.overlay, PICTURE)):
        if path and path.suffix.lower() not in endings:
            raise ValueError(f"{path}: expected a name that ends with {' or '.join(endings)}")


def _settings(job: Job, images: Frames) -> dict[str, object]:
    """Collect what the results depend on."""
    return {
        "version": napari_splinesketch.__version__,
        "image": [images.name, images.count],
        "sketches": checksum_of_file(job.sketches),
        "preset": job.preset,
        "polarity": job.polarity,
        "half-width": job.half_width,
        "seed": job.seed,
        "channel": job.channel,
        "z": job.z,
        "reconstruction": job.reconstruction is not None,
    }


def _refine_frame(
    job: Job,
    images: Frames,
    frame: int,
    sketches: list[Label],
    partial: Partial,
    report: Callable[[float], None],
) -> FrameReport:
    began, digest = time.perf_counter(), None
    ids = [label.curve for label in sketches]

    def on_progress(progress: Progress) -> None:
        report(progress.fraction)

    try:
        image = images[frame]
        digest = checksum(image)
        result = napari_splinesketch.refine(
            image,
            [label.points for label in sketches],
            job.preset,
            polarity=job.polarity,
            half_width=job.half_width,
            on_progress=on_progress,
            seed=job.seed,
        )
    except Exception as error:  # one bad frame must not stop the others
        seconds = time.perf_counter() - began
        failed = FrameReport(frame, (), words(error), round(seconds, 3), digest)
        partial.save(failed, Labels(tuple(_failed(label) for label in sketches)), None)
        return failed
    curves = tuple(map(CurveReport.of, result.curves, ids))
    finished = FrameReport(frame, curves, None, round(result.seconds, 3), digest)
    reconstruction = result.reconstruction if job.reconstruction else None
    partial.save(finished, Labels.from_refinement(result, frame=frame, ids=ids), reconstruction)
    return finished


def _failed(sketch: Label) -> Label:
    """Give a sketch as drawn, as `refine` does with one that cannot be refined."""
    unknown = np.full(len(sketch.points), np.nan)
    certain = np.full(len(sketch.points), np.inf)
    return Label(sketch.frame, sketch.curve, sketch.points, unknown, certain, "failed")


def _write(
    job: Job, images: Frames, partial: Partial, reports: list[FrameReport], sketches: Labels
) -> tuple[str, ...]:
    """Write all outputs from the finished frames; say what the labels' format cannot hold."""
    options = {
        "polarity": job.polarity,
        "half_width": job.half_width,
        "seed": job.seed,
        "sketches": job.sketches.name,
    }
    labels = gather(
        job, images, partial, reports, preset=job.preset, options=options, sketches=sketches
    )
    losses = write_labels(job.output, labels, overwrite=job.overwrite)
    if job.masks:
        masks.write(job.masks, labels, overwrite=job.overwrite)
    done = [r.frame for r in reports if r.error is None]
    if job.reconstruction and labels.shape:
        pages = (partial.reconstruction(frame) for frame in done)
        write_reconstruction(
            job.reconstruction,
            (page for page in pages if page is not None),
            labels.shape,
            done,
            overwrite=job.overwrite,
        )
    if job.overlay and done:
        drawn = [label for label in labels.labels if label.frame == done[0]]
        write_overlay(job.overlay, images[done[0]], drawn, overwrite=job.overwrite)
    return losses

"""Refining the frames of an image or film, without losing any."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Real

import napari_splinesketch
from napari_splinesketch.cli.frame_run import FrameRun, Report
from napari_splinesketch.cli.frame_task import Found
from napari_splinesketch.cli.images import Frames, open_frames
from napari_splinesketch.cli.outcome import Outcome, check_files, pixel_size
from napari_splinesketch.cli.partial import Partial
from napari_splinesketch.cli.pictures import write_masks, write_overlay, write_reconstruction
from napari_splinesketch.cli.report import CurveReport, Reports
from napari_splinesketch.engine.settings import PresetName
from napari_splinesketch.engine.types import Polarity, Progress
from napari_splinesketch.labels import Label, Labels
from napari_splinesketch.labels.by_frame import ByFrame, by_frame
from napari_splinesketch.labels.files import checksum_of_file

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
    jobs: int = 1
    scheduler: str | None = None
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
    sketches = by_frame(job.sketches)
    with open_frames(job.image, channel=job.channel, z=job.z) as images:
        head = pixel_size(job, images, sketches.head)
        partial = Partial(job.output, _settings(job, images, head), resume=job.resume)
        run = FrameRun(job, images, partial, head)
        run.work(_finders(job, sketches), len(sketches.frames), report)
        reports, losses = _write(job, run, sketches)
    partial.remove()
    return Outcome(reports, (*sketches.head.notes, *losses))


def check_outputs(job: Job) -> None:
    """Refuse a job whose outputs could not be written, before it has cost any time."""
    check_files(job.output, tuple(job.outputs()), overwrite=job.overwrite)
    for path, endings in ((job.reconstruction, TIFF), (job.masks, TIFF), (job.overlay, PICTURE)):
        if path and path.suffix.lower() not in endings:
            raise ValueError(f"{path}: expected a name that ends with {' or '.join(endings)}")


def _settings(job: Job, images: Frames, head: Labels) -> dict[str, object]:
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
        "pixel size": [head.scale, head.units],
        "reconstruction": job.reconstruction is not None,
    }


@dataclass(frozen=True, eq=False)
class Refiner:
    """Refines the sketches of one frame; the options are those of the job."""

    frame: int
    sketches: tuple[Label, ...]
    preset: PresetName
    polarity: Polarity
    half_width: float | None
    seed: int
    reconstruction: bool

    def find(self, image: Real[np.ndarray, "H W"], progress: Callable[[float], None]) -> Found:
        """Refine them all together."""

        def on_progress(stage: Progress) -> None:
            progress(stage.fraction)

        result = napari_splinesketch.refine(
            image,
            [label.points for label in self.sketches],
            self.preset,
            polarity=self.polarity,
            half_width=self.half_width,
            on_progress=on_progress,
            seed=self.seed,
        )
        ids = [label.curve for label in self.sketches]
        return Found(
            Labels.from_curves(result.curves, frame=self.frame, ids=ids).labels,
            tuple(map(CurveReport.of, result.curves, ids)),
            result.reconstruction if self.reconstruction else None,
        )

    def instead(self) -> tuple[Label, ...]:
        """Give the sketches as drawn, as `refine` does with those that cannot be refined."""
        return tuple(map(_failed, self.sketches))


def _finders(job: Job, sketches: ByFrame) -> Iterator[tuple[int, Refiner]]:
    for labels in sketches.read():
        frame = labels[0].frame
        yield (
            frame,
            Refiner(
                frame,
                labels,
                job.preset,
                job.polarity,
                job.half_width,
                job.seed,
                job.reconstruction is not None,
            ),
        )


def _failed(sketch: Label) -> Label:
    unknown = np.full(len(sketch.points), np.nan)
    certain = np.full(len(sketch.points), np.inf)
    return Label(sketch.frame, sketch.curve, sketch.points, unknown, certain, "failed")


def _write(job: Job, run: FrameRun, sketches: ByFrame) -> tuple[Reports, tuple[str, ...]]:
    """Write all outputs from the finished frames; say what the labels' format cannot hold."""
    options = {
        "polarity": job.polarity,
        "half_width": job.half_width,
        "seed": job.seed,
        "sketches": job.sketches.name,
    }
    partial, images = run.partial, run.images
    frames = map(int, sketches.frames)
    with_masks = job.masks is not None
    reports, head, losses = run.write(frames, job.preset, options, checksums=with_masks)
    if job.masks:
        write_masks(job.masks, partial, reports, head, overwrite=job.overwrite)
    if job.reconstruction and head.shape:
        done = [report.frame for report in reports if report.error is None]
        pages = (partial.reconstruction(frame) for frame in done)
        write_reconstruction(
            job.reconstruction,
            (page for page in pages if page is not None),
            head.shape,
            done,
            overwrite=job.overwrite,
        )
    first = next((report.frame for report in reports if report.error is None), None)
    if job.overlay and first is not None:
        drawn = partial.labels(first).labels
        write_overlay(job.overlay, images[first], drawn, overwrite=job.overwrite)
    return reports, losses

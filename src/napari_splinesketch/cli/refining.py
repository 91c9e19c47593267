"""Refining the frames of an image or film, without losing any."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Real

import napari_splinesketch
from napari_splinesketch.cli.frame_run import Report, SharedJob, work
from napari_splinesketch.cli.frame_task import Found
from napari_splinesketch.cli.pictures import write_overlay, write_reconstruction
from napari_splinesketch.cli.report import CurveReport, Reports
from napari_splinesketch.cli.run import Outcome, Run, open_run
from napari_splinesketch.engine.settings import PresetName
from napari_splinesketch.engine.types import Polarity, Progress
from napari_splinesketch.labels import Label, Labels, masks
from napari_splinesketch.labels.by_frame import by_frame
from napari_splinesketch.labels.files import checksum_of_file
from napari_splinesketch.labels.stream import ByFrame

TIFF = (".tif", ".tiff")
PICTURE = (".png", ".jpg", ".tif")


@dataclass(frozen=True, kw_only=True)
class Job(SharedJob):
    """What `refine` was asked for."""

    sketches: Path
    preset: PresetName = "balanced"
    seed: int = 0
    reconstruction: Path | None = None
    masks: Path | None = None
    overlay: Path | None = None

    def inputs(self) -> tuple[Path, ...]:
        """Give every file that the job reads, beside the image."""
        return (self.sketches,)

    def outputs(self) -> tuple[Path, ...]:
        """Give every file that the job writes."""
        more = (self.reconstruction, self.masks, self.overlay)
        return (*super().outputs(), *(path for path in more if path))

    def check(self) -> None:
        """Refuse a job whose outputs could not be written, before it has cost any time."""
        super().check()
        for path, endings in (
            (self.reconstruction, TIFF),
            (self.masks, TIFF),
            (self.overlay, PICTURE),
        ):
            if path and path.suffix.lower() not in endings:
                raise ValueError(f"{path}: expected a name that ends with {' or '.join(endings)}")


def refine_job(job: Job, report: Report) -> Outcome:
    """Refine every frame that has sketches, and write the outputs.

    A frame that cannot be refined is reported and its sketches come back as drawn, "failed".
    Finished frames are kept beside the output until all outputs are written.
    """
    job.check()
    sketches = by_frame(job.sketches)
    settings = {
        "sketches": checksum_of_file(job.sketches),
        "preset": job.preset,
        "seed": job.seed,
        "reconstruction": job.reconstruction is not None,
    }
    with open_run(job, sketches.head, **settings) as run:
        work(job, run, _finders(job, sketches), len(sketches.frames), report)
        frames = map(int, sketches.frames)
        told = run.write(frames, job.preset, seed=job.seed, sketches=job.sketches.name)
        reports, labels, losses = told
        if job.masks:
            masks.write(job.masks, labels, overwrite=job.overwrite)
        _write_pictures(job, run, reports, labels.shape)
    return Outcome(reports, (*sketches.head.notes, *losses))


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


def _write_pictures(job: Job, run: Run, reports: Reports, shape: tuple[int, int] | None) -> None:
    """Write what is to be looked at, where any frame could be refined."""
    if shape is None:
        return
    done = [report.frame for report in reports if report.error is None]
    if job.reconstruction:
        pages = map(run.partial.reconstruction, done)
        write_reconstruction(
            job.reconstruction,
            (page for page in pages if page is not None),
            shape,
            done,
            overwrite=job.overwrite,
        )
    if job.overlay:
        first = done[0]
        drawn = run.partial.labels(first)
        write_overlay(job.overlay, run.images[first], drawn, overwrite=job.overwrite)

"""Refining the frames of an image or film, and suggesting sketches on them, without losing any."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Real

import napari_splinesketch
from napari_splinesketch.batch.frame_task import CurveReport, FrameDone, FrameReport, Tell
from napari_splinesketch.cli.jobs import RefineJob, SuggestJob
from napari_splinesketch.cli.run import Outcome, Todo, is_judged, judged, open_run
from napari_splinesketch.cli.terminal import Report
from napari_splinesketch.engine.types import InputError, Polarity
from napari_splinesketch.images.pictures import write_overlay, write_reconstruction
from napari_splinesketch.labels import Label, Labels, masks
from napari_splinesketch.labels.formats import open_labels
from napari_splinesketch.labels.types import in_frames

OPTIONS = ("preset", "polarity", "half_width", "seed")
"""What the user may ask of `napari_splinesketch.refine`."""


def run(job: RefineJob, report: Report) -> Outcome:
    """Refine every frame that has sketches, and write the outputs."""
    sketches = in_frames(job.sized(open_labels(job.sketches)))
    with open_run(job, report, sketches) as work:
        work.count, work.alike = len(sketches.frames), bool(job.masks or job.reconstruction)
        options = {name: getattr(job, name) for name in OPTIONS}
        kept = job.reconstruction is not None
        said = Counter[bool]()

        def todo() -> Iterator[Todo]:
            for labels in sketches.read():
                said.update(map(is_judged, labels))
                drawn = tuple(label.failed() for label in labels)
                yield labels[0].frame, partial(refined, labels, options, kept), drawn

        work.shared(job, todo())
        nothing = () if len(sketches.frames) else (f"{job.sketches} has no line to refine",)
        notes = *sketches.head.notes, *nothing, *judged(said[True])
        outcome = work.write(map(int, sketches.frames), notes)
        if job.masks:
            work.put(masks.write, job.masks, outcome.labels)
        done = [report.frame for report in outcome.frames if report.error is None]
        if job.reconstruction and (shape := outcome.labels.head.shape):
            pages = map(work.partial.reconstruction, done)
            work.put(write_reconstruction, job.reconstruction, pages, shape, done)
        if job.overlay and done:
            drawn = work.partial.labels(done[0])
            work.put(write_overlay, job.overlay, work.images[done[0]], drawn)
    return outcome


def refined(
    sketches: Sequence[Label],
    options: Mapping[str, Any],
    reconstruction: bool,
    image: Real[np.ndarray, "H W"],
    tell: Tell,
) -> FrameDone:
    """Refine the sketches of one frame together; with `reconstruction`, that is given too."""
    result = napari_splinesketch.refine(
        image,
        [label.points for label in sketches],
        on_progress=lambda stage: tell(stage.fraction),
        **options,
    )
    frame, ids = sketches[0].frame, [label.curve for label in sketches]
    return FrameDone(
        FrameReport(frame, tuple(map(CurveReport.of, result.curves, ids))),
        Labels.from_curves(result.curves, frame=frame, ids=ids).labels,
        result.reconstruction if reconstruction else None,
    )


def suggest(job: SuggestJob, report: Report) -> Outcome:
    """Suggest sketches on every frame, or on the one asked for, and write them."""
    with open_run(job, report) as work:
        images = work.images
        if job.frame is not None and not 0 <= job.frame < images.count:
            count = f"{images.name} has {images.count}, counted from 0"
            raise InputError(f"no frame {job.frame}: {count}")
        frames = range(images.count) if job.frame is None else [job.frame]
        work.count = len(frames)
        options = (job.sensitivity, job.polarity, job.half_width)
        work.shared(job, ((frame, partial(suggested, frame, options), ()) for frame in frames))
        return work.write(frames)


def suggested(
    frame: int,
    options: tuple[float, Polarity, float | None],
    image: Real[np.ndarray, "H W"],
    tell: Tell,
) -> FrameDone:
    """Suggest sketches on one frame; the options are those of `napari_splinesketch.suggest`."""
    lines = napari_splinesketch.suggest(image, *options)
    labels = tuple(Label.from_sketch(line, frame=frame, identity=i) for i, line in enumerate(lines))
    told = tuple(CurveReport.drawn(label, "sketch") for label in labels)
    return FrameDone(FrameReport(frame, told), labels)

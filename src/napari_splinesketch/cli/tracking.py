"""Tracking bodies through a film, from the frames that have sketches."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial as bind
from pathlib import Path
from typing import Literal

import numpy as np

import napari_splinesketch
from napari_splinesketch.cli.images import Frames, ImageError
from napari_splinesketch.cli.report import CurveReport, FrameReport, words
from napari_splinesketch.cli.run import FrameJob, Outcome, Run, open_run
from napari_splinesketch.cli.terminal import was_interrupted
from napari_splinesketch.engine.settings import PresetName
from napari_splinesketch.engine.types import Curve, Progress, Refinement
from napari_splinesketch.labels import Label, Labels, read_labels, table
from napari_splinesketch.labels.files import checksum_of_file
from napari_splinesketch.labels.provenance import checksum
from napari_splinesketch.tracking import Body, Given, Tracked, View, after, follow

DRIFT, MISSING, LOST = "drift", "missing", "lost"
"""What a report says of a body that tracking does not trust, or does not find."""


@dataclass(frozen=True, kw_only=True)
class TrackJob(FrameJob):
    """What `track` was asked for."""

    sketches: Path
    preset: PresetName = "balanced"
    last: int | None = None
    smooth: Literal["on", "off"] = "on"

    def inputs(self) -> tuple[Path, ...]:
        """Give every file that the job reads, beside the image."""
        return (self.sketches,)


def track_job(job: TrackJob, report: Callable[[float, int], None]) -> Outcome:
    """Refine the sketches, carry the curves to the last frame, and write them all.

    Sketches in later frames are refined there: new numbers join, known ones start anew. A frame
    that cannot be read or refined is reported, and the bodies are looked for in the next one.
    """
    job.check()
    sketches = read_labels(job.sketches)
    drawn: dict[int, list[Label]] = {}
    for label in sketches.labels:
        drawn.setdefault(label.frame, []).append(label)
    if not drawn:
        raise ValueError(f"{job.sketches} has no line; draw or suggest some in the first frame")
    settings = {
        "command": "track",
        "sketches": checksum_of_file(job.sketches),
        "preset": job.preset,
        "last": job.last,
        "smooth": job.smooth,
    }
    with open_run(job, sketches, **settings) as run:
        frames = _frames(job, run.images, min(drawn))
        bodies: dict[int, Body] = {}
        done = 0
        for frame in frames:
            finished = run.partial.done(frame)
            if finished is None:
                break
            bodies = _after(bodies, finished, run.partial.labels(frame), drawn.get(frame, []))
            done += 1
            report(done, len(frames))
        _track(job, run, frames[done:], drawn, bodies, bind(_tell, report, done, len(frames)))
        report(len(frames), len(frames))
        options = {"command": "track", "sketches": job.sketches.name}
        reports, _, losses = run.write(frames, job.preset, **options)
    return Outcome(reports, (*sketches.notes, *losses))


def _frames(job: TrackJob, images: Frames, first: int) -> range:
    last = images.count - 1 if job.last is None else job.last
    if not 0 <= first <= last < images.count:
        raise ImageError(
            f"there is no way from frame {first}, the first with sketches, to frame {last}: "
            f"{images.name} has {images.count}, counted from 0"
        )
    return range(first, last + 1)


def _tell(report: Callable[[float, int], None], done: int, count: int, progress: Progress) -> None:
    report(done + 0.99 * progress.fraction * (count - done), count)


def _track(
    job: TrackJob,
    run: Run,
    frames: Sequence[int],
    drawn: Mapping[int, list[Label]],
    bodies: Mapping[int, Body],
    report: Callable[[Progress], None],
) -> None:
    """Refine the sketches of each frame, place the bodies of the frames before; keep both."""
    reader = _Reader(job, run, drawn)
    following = follow(
        frames,
        bodies.values(),
        lambda frame, _: View(reader.image(frame)),
        refine=bind(_refine, job),
        preset=job.preset,
        given=reader.given,
        on_progress=lambda progress: report(progress),
        smooth=job.smooth == "on",
    )
    began = time.perf_counter()
    for tracked in following:
        if tracked.error and was_interrupted():
            raise KeyboardInterrupt
        seconds = round(time.perf_counter() - began, 3)
        opened = reader.opened.pop(tracked.frame)
        curves = opened.curves | dict(zip(tracked.ids, tracked.curves, strict=True))
        error = opened.error or tracked.error or None
        reports = _reports(curves, tracked)
        scale, units = run.head.scale, run.head.units
        labels = Labels.from_curves(
            tuple(curves.values()), frame=tracked.frame, ids=curves, scale=scale, units=units
        )
        finished = FrameReport(tracked.frame, reports, error, seconds, opened.digest)
        run.partial.save(finished, table.text(labels), None)
        began = time.perf_counter()


@dataclass
class _Opened:
    """A frame until it is decided: its image, its checksum, its sketches' curves, or the error."""

    image: np.ndarray | None = None
    digest: str | None = None
    curves: dict[int, Curve] = field(default_factory=dict)
    error: str = ""


class _Reader:
    """Reads frames, and refines what was drawn in them."""

    def __init__(self, job: TrackJob, run: Run, drawn: Mapping[int, list[Label]]):
        self.opened: dict[int, _Opened] = {}
        self._job, self._run, self._drawn = job, run, drawn

    def given(self, frame: int) -> Given:
        opened = self.opened[frame] = _Opened()
        drawn = self._drawn.get(frame, [])
        try:
            opened.image = self._run.images[frame]
            opened.digest = checksum(opened.image)
            if drawn:
                lines = [label.points for label in drawn]
                result = _refine(self._job, opened.image, lines, self._job.preset, fixed=())
                opened.curves = {d.curve: c for d, c in zip(drawn, result.curves, strict=True)}
        except ConnectionError:  # where the film is: other frames would fail too
            raise
        except Exception as reason:  # one bad frame must not stop the others
            if was_interrupted():
                raise KeyboardInterrupt from None
            opened.error = words(reason)
        return Given({n: c for n, c in opened.curves.items() if c.status != "failed"})

    def image(self, frame: int) -> np.ndarray:
        opened = self.opened[frame]
        if opened.image is None:
            raise ValueError(opened.error)
        image, opened.image = opened.image, None
        return image


def _refine(
    job: TrackJob,
    image: np.ndarray,
    lines: Sequence[np.ndarray],
    preset: PresetName,
    /,
    **options: object,
) -> Refinement:
    return napari_splinesketch.refine(
        image,
        lines,
        preset,
        polarity=job.polarity,
        half_width=job.half_width,
        **options,  # pyright: ignore[reportArgumentType]
    )


def _reports(curves: Mapping[int, Curve], tracked: Tracked) -> tuple[CurveReport, ...]:
    """Report every body, those without a curve too."""
    placed = [CurveReport.of(curve, number) for number, curve in curves.items()]
    here = [replace(r, status=DRIFT) if r.curve in tracked.drifting else r for r in placed]
    gone = [
        CurveReport(number, 0.0, None, None, LOST if number in tracked.lost else MISSING, (why,))
        for number, why in tracked.missing.items()
    ]
    return (*here, *gone)


def _after(
    bodies: Mapping[int, Body], done: FrameReport, labels: Sequence[Label], drawn: list[Label]
) -> dict[int, Body]:
    """Give the bodies as they are known after a frame, which may come from an earlier run."""
    curves = {label.curve: _curve(label) for label in labels if label.status != "failed"}
    status = {report.curve: report for report in done.curves}
    anew = {label.curve for label in drawn}
    given = {number: curve for number, curve in curves.items() if number in anew}
    placed = {number: curve for number, curve in curves.items() if number not in anew}
    tracked = Tracked(
        done.frame,
        ids=tuple(placed),
        sketches=tuple(curve.points for curve in placed.values()),
        curves=tuple(placed.values()),
        drifting=frozenset(n for n in placed if status[n].status == DRIFT),
        missing={n: "" for n, r in status.items() if r.status in (MISSING, LOST) and n in bodies},
        lost=frozenset(n for n, r in status.items() if r.status == LOST),
    )
    return after(bodies, tracked, Given(given))


def _curve(label: Label) -> Curve:
    """As much of a curve as its label keeps."""
    knots = np.column_stack([label.points, label.half_width])
    status = "check" if label.status == "check" else "good"
    return Curve(knots, label.points, label.half_width, label.sd, status, (), float("nan"))

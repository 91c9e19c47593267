"""Tracking bodies through a film, from the frames that have sketches."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

import napari_splinesketch
from napari_splinesketch.batch.frame_task import FrameDone
from napari_splinesketch.batch.reports import CurveReport, FrameReport, words
from napari_splinesketch.cli.jobs import TrackJob
from napari_splinesketch.cli.run import Outcome, Run, open_run
from napari_splinesketch.cli.terminal import Report
from napari_splinesketch.engine.types import Curve, Progress, Refinement
from napari_splinesketch.images.frames import Frames, ImageError, checksum
from napari_splinesketch.labels import Label, Labels, read_labels, table
from napari_splinesketch.tracking import Body, Given, Tracked, View, after, follow

ENTERED = "a body came into view at row {:.0f}, column {:.0f}; sketch it in this frame to track it"
DRIFT, MISSING, LOST = "drift", "missing", "lost"
"""Status, in a report, of a body that tracking does not trust or does not find."""


def run(job: TrackJob, report: Report) -> Outcome:
    """Refine the sketches, carry the curves to the last frame, and write them all.

    Sketches in later frames are refined there: new numbers join, known ones start again. A frame
    that cannot be read or refined is reported, and the bodies are looked for in the next one.
    """
    job.check()
    sketches = read_labels(job.sketches)
    drawn: dict[int, list[Label]] = {}
    for label in sketches.labels:
        drawn.setdefault(label.frame, []).append(label)
    if not drawn:
        raise ValueError(f"{job.sketches} has no line; draw or suggest some in the first frame")
    with open_run(job, report, sketches) as work:
        frames = _frames(job, work.images, min(drawn))
        work.tally.count = len(frames)
        bodies: dict[int, Body] = {}
        left = list(frames)
        while left and (done := work.partial.done(left[0])):  # in an earlier run
            bodies = _after(bodies, done, work.partial.labels(left[0]), drawn.get(left[0], []))
            work.tally.add()
            del left[0]
        for result in _Film(job, work, drawn).follow(left, bodies):
            work.keep(result)
        outcome, _ = work.write(frames, sketches.notes)
    return outcome


def _frames(job: TrackJob, images: Frames, first: int) -> range:
    last = images.count - 1 if job.last is None else job.last
    if not 0 <= first <= last < images.count:
        raise ImageError(
            f"cannot track from frame {first}, the first with sketches, to frame {last}:  "
            f"{images.name} has {images.count}, counted from 0"
        )
    return range(first, last + 1)


class _Film:
    """Gives tracking what it needs, and turns its answers into reports."""

    def __init__(self, job: TrackJob, run: Run, drawn: Mapping[int, list[Label]]) -> None:
        self._job, self._run, self._drawn = job, run, drawn
        self._here: dict[int, _Frame] = {}
        self._finished = 0

    def follow(self, frames: Sequence[int], bodies: Mapping[int, Body]) -> Iterator[FrameDone]:
        """Carry bodies through frames, and give each frame as it is done."""

        def on_progress(progress: Progress) -> None:
            self._run.tally.part(progress.fraction * len(frames) - self._finished)

        began = time.perf_counter()
        for tracked in follow(
            frames,
            bodies.values(),
            lambda frame, lines: View(self._frame(frame).image()),
            refine=self._refine,
            preset=self._job.preset,
            given=lambda frame: Given(self._frame(frame).good),
            on_progress=on_progress,
            smooth=self._job.smooth == "on",
            pictures=False,
        ):
            yield self._done(tracked, time.perf_counter() - began)
            self._finished += 1
            began = time.perf_counter()

    def _done(self, tracked: Tracked, seconds: float) -> FrameDone:
        here = self._here.pop(tracked.frame)
        curves = here.curves | dict(zip(tracked.ids, tracked.curves, strict=True))
        error = here.error or tracked.error or None
        told = _reports(curves, tracked)
        notes = tuple(ENTERED.format(*line.mean(0)) for line in tracked.entered)
        report = FrameReport(tracked.frame, told, error, round(seconds, 3), here.sha256, notes)
        size = {"scale": self._run.head.scale, "units": self._run.head.units}
        labels = Labels.from_curves(tuple(curves.values()), frame=tracked.frame, ids=curves, **size)
        return FrameDone(report, table.text(labels))

    def _frame(self, frame: int) -> "_Frame":
        if frame not in self._here:
            drawn = self._drawn.get(frame, [])
            self._here[frame] = _Frame(self._run.images, frame, drawn, self._refine_drawn)
        return self._here[frame]

    def _refine_drawn(self, image: np.ndarray, lines: Sequence[np.ndarray]) -> Refinement:
        def on_progress(progress: Progress) -> None:
            self._run.tally.part(progress.fraction / 2)

        return self._refine(image, lines, self._job.preset, fixed=(), on_progress=on_progress)

    def _refine(self, image: Any, lines: Any, preset: Any, /, **more: Any) -> Refinement:
        look = {"polarity": self._job.polarity, "half_width": self._job.half_width}
        return napari_splinesketch.refine(image, lines, preset, **look, **more)


class _Frame:
    """A frame's pixels, and the curves of what is drawn on it."""

    def __init__(
        self,
        images: Frames,
        frame: int,
        drawn: Sequence[Label],
        refine: Callable[[np.ndarray, Sequence[np.ndarray]], Refinement],
    ) -> None:
        self.curves: dict[int, Curve] = {}
        self.error, self.sha256, self._image = "", None, None
        try:
            self._image = images[frame]
            self.sha256 = checksum(self._image)
            if drawn:
                result = refine(self._image, [label.points for label in drawn])
                self.curves = {d.curve: c for d, c in zip(drawn, result.curves, strict=True)}
        except ConnectionError:  # where the film is: other frames would fail too
            raise
        except Exception as error:  # one bad frame must not stop the others
            self.error = words(error)

    @property
    def good(self) -> dict[int, Curve]:
        """Those that tracking continues from."""
        return {number: c for number, c in self.curves.items() if c.status != "failed"}

    def image(self) -> np.ndarray:
        """Give the pixels, once: waiting frames do without. ImageError where there are none."""
        image, self._image = self._image, None
        if image is None:
            raise ImageError(self.error)
        return image


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
    sketched = {label.curve for label in drawn}
    given = {number: curve for number, curve in curves.items() if number in sketched}
    placed = {number: curve for number, curve in curves.items() if number not in sketched}
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

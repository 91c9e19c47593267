"""Tracking bodies through a film, from the frames that have sketches."""

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

import napari_splinesketch
from napari_splinesketch.batch.frame_task import CurveReport, FrameDone, FrameReport
from napari_splinesketch.cli.jobs import TrackJob
from napari_splinesketch.cli.run import Outcome, Run, is_judged, judged, open_run
from napari_splinesketch.cli.terminal import Report
from napari_splinesketch.engine.types import Curve, InputError, Refinement
from napari_splinesketch.files import counted, reason_of
from napari_splinesketch.images.frames import checksum
from napari_splinesketch.labels import Label, Labels, read_labels
from napari_splinesketch.labels.types import in_frames
from napari_splinesketch.tracking import Body, Given, Tracked, View, after, follow
from napari_splinesketch.tracking.bodies import INFERRED

ENTERED = "a body came into view at row {:.0f}, column {:.0f}; sketch it in this frame to track it"
DRIFT, MISSING, LOST = "drift", "missing", "lost"
"""Status, in a report, of a body that tracking does not trust or does not find."""


def run(job: TrackJob, report: Report) -> Outcome:
    """Refine the sketches, carry the curves to the last frame, and write them all."""
    sketches = job.sized(read_labels(job.sketches))
    drawn = {labels[0].frame: labels for labels in in_frames(sketches).read()}
    if not drawn:
        raise InputError(f"{job.sketches} has no line; draw or suggest some in the first frame")
    with open_run(job, report, sketches) as work:
        first, count = min(drawn), work.images.count
        last = count - 1 if job.last is None else job.last
        if not 0 <= first <= last < count:
            raise InputError(
                f"cannot track from frame {first}, the first with sketches, to frame {last}: "
                f"{work.images.name} has {count}, counted from 0"
            )
        frames = range(first, last + 1)
        work.count = len(frames)
        bodies: dict[int, Body] = {}
        left, contrast = list(frames), None
        while left and (done := work.finished(left[0])):  # in an earlier run
            bodies = _after(bodies, done, work.partial.labels(left[0]), drawn.get(left[0], ()))
            contrast = done.contrast or contrast
            del left[0]
        for result in _Film(job, work, drawn).follow(left, bodies, contrast):
            work.keep(result)
        notes = [*sketches.head.notes]
        if beyond := sum(label.frame > last for label in sketches.labels):
            lines = counted(beyond, "line")
            notes.append(f"left out: {lines} in frames after {last}, the last one")
        notes += judged(sum(map(is_judged, sketches.labels)))
        return work.write(frames, notes)


@dataclass(eq=False)
class _Film:
    """Gives tracking what it needs, and turns its answers into reports."""

    job: TrackJob
    run: Run
    drawn: Mapping[int, Sequence[Label]]
    _image: np.ndarray | None = field(default=None, init=False)
    """Pixels of the frame that comes next."""
    _known: dict[int, tuple[FrameReport, dict[int, Curve]]] = field(
        default_factory=dict, init=False
    )
    """What is known of each frame before tracking, and the curves of what is drawn on it."""

    def follow(
        self, frames: Sequence[int], bodies: Mapping[int, Body], contrast: float | None
    ) -> Iterator[FrameDone]:
        """Carry bodies through frames, and give each frame as it is done."""
        began, earlier = time.perf_counter(), self.run.count - len(frames)
        for tracked in follow(
            frames,
            bodies.values(),
            self._read,
            refine=self._refine,
            preset=self.job.preset,
            given=self._open,
            on_progress=lambda told: self.run.reach(earlier + told.fraction * len(frames)),
            smooth=self.job.smooth == "on",
            pictures=False,
            contrast=contrast,
        ):
            yield self._done(tracked, time.perf_counter() - began)
            began = time.perf_counter()

    def _open(self, frame: int) -> Given:
        """Read a frame, and give the curves of its sketches that tracking continues from."""
        self._image, report, curves = None, FrameReport(frame), dict[int, Curve]()
        try:
            image = self._image = self.run.images[frame]
            report = FrameReport(frame, sha256=checksum(image), shape=image.shape)
            if drawn := self.drawn.get(frame):
                result = self._refine(
                    image,
                    [label.points for label in drawn],
                    self.job.preset,
                    fixed=(),
                    on_progress=lambda told: self.run.part(told.fraction / 2),
                )
                curves = {d.curve: c for d, c in zip(drawn, result.curves, strict=True)}
        except ConnectionError:  # where the film is: other frames would fail too
            raise
        except Exception as error:  # one bad frame must not stop the others
            report = replace(report, error=reason_of(error))
        self._known[frame] = report, curves
        return Given({i: c for i, c in curves.items() if c.status != "failed"})

    def _read(self, frame: int, lines: Sequence[np.ndarray]) -> View:
        """Give the pixels, once: waiting frames do without. InputError where there are none."""
        image, self._image = self._image, None
        if image is None:
            raise InputError(self._known[frame][0].error)
        return View(image)

    def _refine(self, image: Any, lines: Any, preset: Any, /, **more: Any) -> Refinement:
        look = {"polarity": self.job.polarity, "half_width": self.job.half_width}
        return napari_splinesketch.refine(image, lines, preset, **look, **more)

    def _done(self, tracked: Tracked, seconds: float) -> FrameDone:
        """Report every body, those without a curve too."""
        report, given = self._known.pop(tracked.frame)
        curves, error = {**given, **tracked.by_id}, report.error or tracked.error or None
        told = [CurveReport.of(curve, number) for number, curve in curves.items()]
        told = [replace(r, status=DRIFT) if r.curve in tracked.drifting else r for r in told]
        for number, why in tracked.missing.items():
            status = LOST if number in tracked.lost else MISSING
            told.append(CurveReport(number, 0.0, None, None, status, (why,)))
        left_out = [d.failed() for d in self.drawn.get(tracked.frame, ()) if d.curve not in curves]
        told += [CurveReport.drawn(label, "failed", error or "") for label in left_out]
        report = replace(
            report,
            curves=tuple(told),
            error=error,
            seconds=round(seconds, 3),
            notes=tuple(ENTERED.format(*line.mean(0)) for line in tracked.entered),
            contrast=tracked.contrast,
        )
        labels = Labels.from_curves(tuple(curves.values()), frame=tracked.frame, ids=curves)
        return FrameDone(report, (*labels.labels, *left_out))


def _after(
    bodies: Mapping[int, Body], done: FrameReport, labels: Sequence[Label], drawn: Sequence[Label]
) -> dict[int, Body]:
    """Give the bodies as they are known after a frame, which may come from an earlier run."""
    status = {report.curve: report for report in done.curves}
    refined = [label for label in labels if label.status != "failed"]
    curves = {one.curve: _curve(one, status[one.curve].reasons) for one in refined}
    sketched = {label.curve for label in drawn}
    given = {number: curve for number, curve in curves.items() if number in sketched}
    # What was inferred tells nothing of where a body goes.
    placed = {n: c for n, c in curves.items() if n not in sketched and INFERRED not in c.reasons}
    tracked = Tracked(
        done.frame,
        placed,
        drifting=frozenset(n for n in placed if status[n].status == DRIFT),
        missing={n: "" for n, r in status.items() if r.status in (MISSING, LOST) and n in bodies},
        lost=frozenset(n for n, r in status.items() if r.status == LOST),
    )
    return after(bodies, tracked, Given(given))


def _curve(label: Label, reasons: tuple[str, ...]) -> Curve:
    """As much of a curve as its label keeps."""
    knots = np.column_stack([label.points, label.half_width])
    status = "check" if label.status == "check" else "good"
    return Curve(knots, label.points, label.half_width, label.sd, status, reasons, float("nan"))

"""The state behind the dock: what would be refined, what runs, what came of it."""

import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Literal

from napari.components import ViewerModel
from napari.layers import Image, Shapes
from napari.utils.notifications import show_info
from psygnal import Signal
from qtpy.QtCore import QTimer

from napari_splinesketch.engine.settings import PresetName
from napari_splinesketch.engine.types import Curve, Progress
from napari_splinesketch.labels import write_labels
from napari_splinesketch.plugin import engine, words
from napari_splinesketch.plugin.adapter.labels import labels_of
from napari_splinesketch.plugin.adapter.pixels import block_around
from napari_splinesketch.plugin.adapter.sketches import (
    Drawn,
    drawn_in,
    new_sketch_layer,
    selected_in,
)
from napari_splinesketch.plugin.adapter.space import current_frame, plane_problem
from napari_splinesketch.plugin.choices import Choices
from napari_splinesketch.plugin.jobs import Job
from napari_splinesketch.plugin.records import Record, identify
from napari_splinesketch.plugin.work import Work, works_in

_log = logging.getLogger(__name__)

BREATH_MS = 30
"""Between two steps of drawing results: time for the window to paint and to answer."""
STEPS = "Press New sketch, then draw a line over each body."
OPEN = "Open an image: drop a file on the window, or File > Open Sample."


@dataclass(frozen=True, eq=False)
class Request:
    """What Refine would do now.

    Attributes
    ----------
    frame
        Index of the frame in view.
    drawn
        The sketches that it would refine, and what it would leave out.
    selected
        Whether these are the selected ones only.
    problem
        Why there is nothing to do, in words; empty otherwise.
    """

    frame: int = 0
    drawn: Drawn = field(default_factory=Drawn)
    selected: bool = False
    problem: str = ""


@dataclass(frozen=True)
class Notice:
    """What the last action came to, where its results do not say it."""

    kind: Literal["none", "done", "cancelled", "failed"] = "none"
    text: str = ""


class Controller:
    """Owns the state; widgets show it.

    Parameters
    ----------
    viewer
        The viewer whose layers are worked on.

    Attributes
    ----------
    choices
        The chosen image and sketches.
    preset
        How much work to do.
    progress
        Where the running refinement stands; None when none runs.
    notice
        What the last action came to.
    """

    changed = Signal()
    """Whoever shows the state should look again."""

    def __init__(self, viewer: ViewerModel):
        self.viewer = viewer
        self.choices = Choices(viewer)
        self.preset: PresetName = "balanced"
        self.progress: Progress | None = None
        self.notice = Notice()
        self._pair = self.choices.image, self.choices.sketches
        self._job: Job | None = None
        self._works = works_in(viewer)
        self._told: list[Image] = []
        for work in self._works:
            self._attend(work)
        self.choices.changed.connect(self._follow)
        self.choices.edited.connect(self.changed.emit)

    def request(self) -> Request:
        """Say what Refine would do now."""
        image, layer = self.choices.image, self.choices.sketches
        if image is None:
            return Request(problem=OPEN)
        problem = plane_problem(self.viewer, image)
        if problem:
            return Request(problem=problem)
        frame = current_frame(self.viewer, image)
        if layer is None:
            return Request(frame, problem=STEPS)
        chosen = selected_in(layer)
        drawn = drawn_in(self.viewer, layer, image, frame, chosen)
        problem = "" if drawn.lines else _nothing_drawn(image, layer, bool(chosen))
        return Request(frame, drawn, bool(chosen), problem)

    @property
    def work(self) -> Work | None:
        """What is known of the chosen image through the chosen sketches."""
        pair = self.choices.image, self.choices.sketches
        return next((work for work in self._works if (work.image, work.sketches) == pair), None)

    def records(self, frame: int | None = None) -> tuple[Record, ...]:
        """Give the curves of a frame, or of all."""
        records = self.work.records if self.work else ()
        return tuple(r for r in records if frame is None or r.frame == frame)

    def refine(self) -> None:
        """Refine what `request` says, in a thread."""
        request = self.request()
        image, layer = self.choices.image, self.choices.sketches
        if request.problem or self.progress or image is None or layer is None:
            return
        work = self.work or self._begin(image, layer)
        if image.rgb and image not in self._told:
            self._told.append(image)
            show_info(f"{image.name} is in colour: its luminance is used.")
        known = self.records(request.frame)
        lines = request.drawn.lines
        ids = identify(lines, known, self.records())
        fixed = [r.curve for r in known if r.id not in ids and r.curve.status != "failed"]
        task = engine.Task(
            block_around(image, request.frame, lines),
            lines,
            tuple(fixed) if request.selected else (),
            self.preset,
        )
        self.progress, self.notice = Progress("starting", 0.0), Notice()
        self._job = Job(partial(engine.run, task))
        self._job.progressed.connect(self._on_progress)
        self._job.done.connect(partial(self._on_done, work, request, ids))
        self._job.failed.connect(self._on_failed)
        self._job.start()
        self.changed.emit()

    def cancel(self) -> None:
        """Forget the running refinement; everything stays as it was."""
        if self._job:
            self._stop(Notice("cancelled", "Cancelled. Nothing was changed."))

    def new_sketches(self) -> None:
        """Add a layer of sketches that lies on the image, ready for drawing."""
        if self.choices.image is not None:
            new_sketch_layer(self.viewer, self.choices.image)

    def export(self, path: str | Path, *, overwrite: bool = True) -> None:
        """Write the curves of all frames to a file, as a rule in place of one that is there."""
        work = self.work
        if work is None or not work.records:
            return
        try:
            lost = write_labels(path, labels_of(work), overwrite=overwrite)
        except (OSError, ValueError) as error:
            self.notice = Notice("failed", f"Not saved: {error}")
        else:
            said = words.count(len(work.records), "curve")
            text = f"Saved {said} to {Path(path).name}. {words.together(lost)}".rstrip()
            self.notice = Notice("done", text)
        self.changed.emit()

    def abandon(self) -> None:
        """End what runs, and do not speak of it."""
        if self._job:
            self._job.cancel()
        self._job, self.progress = None, None

    def close(self) -> None:
        """End what runs; nobody is there any more to show anything."""
        self.abandon()
        self.changed.disconnect()
        self.choices.changed.disconnect()
        self.choices.edited.disconnect()

    def _stop(self, notice: Notice) -> None:
        self.abandon()
        self.notice = notice
        self.changed.emit()

    def _on_progress(self, progress: Progress) -> None:
        self.progress = progress
        self.changed.emit()

    def _on_failed(self, message: str) -> None:
        self._stop(Notice("failed", f"Refining failed, nothing was changed. {message}"))

    def _on_done(
        self, work: Work, request: Request, ids: list[int], refined: engine.Refined
    ) -> None:
        self._job = None
        if work not in self._works:
            self._stop(Notice("cancelled", "The layer is gone; its refinement was dropped."))
            return
        fresh = [
            Record(number, request.frame, line, _renumbered(curve, ids))
            for number, line, curve in zip(ids, request.drawn.lines, refined.curves, strict=True)
        ]
        work.put(request.frame, fresh, refined, whole=not request.selected)
        self._on_progress(Progress("drawing the curves", 1.0))
        self._draw(work.layers.show(), last=partial(self._stop, Notice()))

    def _begin(self, image: Image, sketches: Shapes) -> Work:
        work = Work(image, sketches, self.viewer)
        self._works.append(work)
        self._attend(work)
        return work

    def _attend(self, work: Work) -> None:
        # Later: napari is still busy with the edit that it tells of.
        work.layers.toggled.connect(self.changed.emit)
        work.layers.edited.connect(lambda: QTimer.singleShot(0, partial(self._adopt, work)))

    def _adopt(self, work: Work) -> None:
        """Take over what the user deleted among the curves; what she moved goes back."""
        if not self.progress or self._job:
            if not work.adopt_deletions():
                said = f"Curves are results: draw and move lines in {work.sketches.name!r}."
                self.notice = Notice("failed", said)
            self.changed.emit()
            self._draw(work.layers.show(), last=self.changed.emit)

    def _draw(self, steps: Iterator[None], last: Callable[[], None]) -> None:
        """Go through the steps of changing layers; the window lives in between."""
        try:
            next(steps)
        except StopIteration:
            last()
        except Exception as error:
            _log.exception("The results could not be shown")
            self._stop(Notice("failed", f"The results could not be shown. {error}"))
        else:
            QTimer.singleShot(BREATH_MS, partial(self._draw, steps, last))

    def _follow(self) -> None:
        """Forget what is known of layers that are gone, and what was said of others."""
        pair = self.choices.image, self.choices.sketches
        if pair != self._pair:
            self._pair, self.notice = pair, Notice()
        self._works = [w for w in self._works if {w.image, w.sketches} <= set(self.viewer.layers)]
        for work in self._works:
            work.forget_if_deleted()
        self.changed.emit()


def _renumbered(curve: Curve, ids: Sequence[int]) -> Curve:
    return replace(curve, reasons=tuple(words.renumbered(r, ids) for r in curve.reasons))


def _nothing_drawn(image: Image, layer: Shapes, selected: bool) -> str:
    if selected:
        return "None of the selected shapes is a line in this frame."
    where = "in this frame " if image.ndim > 2 else ""
    return f"Nothing to refine {where}yet: draw a line over each body in {layer.name!r}."

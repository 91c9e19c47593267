"""The state behind the dock: what would be refined, what runs, what came of it."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from napari.components import ViewerModel
from napari.layers import Image, Shapes
from napari.utils.notifications import show_info

from napari_splinesketch.engine.settings import PresetName
from napari_splinesketch.engine.types import Curve, Progress
from napari_splinesketch.labels import write_labels
from napari_splinesketch.plugin import engine, words
from napari_splinesketch.plugin.actions import Action, Actions
from napari_splinesketch.plugin.adapter.labels import labels_of
from napari_splinesketch.plugin.adapter.pixels import block_around
from napari_splinesketch.plugin.adapter.results import is_result
from napari_splinesketch.plugin.adapter.sketches import (
    Drawn,
    drawn_in,
    new_sketch_layer,
    selected_in,
)
from napari_splinesketch.plugin.adapter.space import current_frame, plane_problem
from napari_splinesketch.plugin.jobs import Job
from napari_splinesketch.plugin.keeper import Keeper, Notice
from napari_splinesketch.plugin.records import Record, identify
from napari_splinesketch.plugin.work import Work

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


class Controller(Keeper):
    """Owns the state; widgets show it.

    Parameters
    ----------
    viewer
        The viewer whose layers are worked on.

    Attributes
    ----------
    preset
        How much work to do.
    actions
        What can be done with a key.
    """

    def __init__(self, viewer: ViewerModel):
        super().__init__(viewer)
        self.preset: PresetName = "balanced"
        self._pair = self.choices.image, self.choices.sketches
        self._job: Job | None = None
        self._told: list[Image] = []
        self.actions = Actions(viewer, self._is_meant)
        self.actions.add(
            Action("undo", "Undo", "Ctrl+Z", self.undo, "Take back the last step"),
            Action("redo", "Redo", "Ctrl+Shift+Z", self.redo, "Do again what was taken back"),
        )
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
        self.actions.close()
        self.changed.disconnect()
        self.choices.changed.disconnect()
        self.choices.edited.disconnect()

    def _is_meant(self) -> bool:
        """Whether a key is meant for us: a layer that we have to do with is active, or none."""
        layer = self.viewer.layers.selection.active
        ours = None, self.choices.image, self.choices.sketches
        return layer in ours or (layer is not None and is_result(layer))

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
        whole = not request.selected
        what = f"Refine {words.curves([(r.frame, r.id) for r in fresh])}"
        work.history.apply(what, work.state.refined(request.frame, fresh, refined, whole=whole))
        self._on_progress(Progress("drawing the curves", 1.0))
        self._drawing.start(work, last=partial(self._on_all_shown, work))

    def _on_all_shown(self, work: Work) -> None:
        work.layers.select(self.selection)
        self._stop(Notice())

    def _begin(self, image: Image, sketches: Shapes) -> Work:
        work = Work(image, sketches, self.viewer)
        self._works.append(work)
        self._attend(work)
        return work

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

"""The state behind the dock: what would be refined, what runs, what came of it."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any

from napari.components import ViewerModel
from napari.layers import Image, Shapes
from napari.utils.notifications import show_info
from qtpy.QtCore import QTimer

from napari_splinesketch.engine.types import OnProgress, Progress
from napari_splinesketch.plugin import engine, words
from napari_splinesketch.plugin.adapter.labels import labels_of
from napari_splinesketch.plugin.adapter.pixels import block_around
from napari_splinesketch.plugin.adapter.preview import Preview
from napari_splinesketch.plugin.adapter.roles import is_result
from napari_splinesketch.plugin.adapter.sketches import (
    begin_drawing,
    drawing,
    new_sketch_layer,
    select_curves,
)
from napari_splinesketch.plugin.commands import Commands
from napari_splinesketch.plugin.corrections import Corrections
from napari_splinesketch.plugin.files import export
from napari_splinesketch.plugin.films import Films
from napari_splinesketch.plugin.gently import MANY, Soon
from napari_splinesketch.plugin.jobs import Job
from napari_splinesketch.plugin.keeper import Notice
from napari_splinesketch.plugin.knot_editing import KnotEditing
from napari_splinesketch.plugin.plan import Scope
from napari_splinesketch.plugin.records import Record, key_of
from napari_splinesketch.plugin.request import Request, Requests
from napari_splinesketch.plugin.review.reviewing import Reviewing
from napari_splinesketch.plugin.settings_keeper import SettingsKeeper
from napari_splinesketch.plugin.work import Work, remove_results

SAVING = "Saving"

KNOWN_AFTER = 2.0
"""Seconds after which the time that is left is worth a guess."""


class Controller(SettingsKeeper):
    """Owns the state; widgets show it.

    Parameters
    ----------
    viewer
        The viewer whose layers are worked on.

    Attributes
    ----------
    at_once
        Whether a line is refined as soon as it is drawn.
    actions
        What can be done with a key.
    corrections
        What can be done to the shape of a curve.
    knots
        Moving a curve by its knots.
    films, reviewing
        Suggesting and tracking; going from curve to curve.
    left
        About how long what runs still will, s; None where nobody knows.
    """

    def __init__(self, viewer: ViewerModel):
        super().__init__(viewer)
        self.at_once = False
        self._closed = False
        self._requests = Requests(self)
        self._pair = self.choices.image, self.choices.sketches
        self._job: Job | None = None
        self._preview: Preview | None = None
        self._cancelled: Callable[[], str] = lambda: ""
        self._on: Work | None = None
        self._told: list[Image] = []
        self.corrections = Corrections(self, partial(self.refine, "selected"))
        self.knots = KnotEditing(self, partial(self.refine, "selected"))
        self.films = Films(self)
        self.reviewing = Reviewing(self)
        self.left: float | None = None
        self._began = 0.0
        self.actions = Commands(viewer, self, self._is_meant)
        self.use_keys()
        self.clicked.connect(lambda shift: self.corrections.pick(add=shift))
        self.choices.changed.connect(self._follow)
        self._soon = Soon(lambda: self.changed.emit())
        self.choices.edited.connect(self._on_edited)
        # Later: napari is still busy with the line.
        self.choices.drawn.connect(lambda: QTimer.singleShot(0, self._refine_at_once))

    def request(self, scope: Scope = "new") -> Request:
        """Say what Refine would do now; selected lines go before those that are new."""
        return self._requests.request(scope)

    def refine(self, scope: Scope = "new") -> None:
        """Refine what `request` says, in a thread; the curve alone whose knots are shown."""
        if self.knots.active:
            self.knots.refine()
            return
        self._requests.forget()
        request = self.request(scope)
        image, layer = self.choices.image, self.choices.sketches
        if request.problem or self.progress or image is None or layer is None:
            return
        work = self.begin(image, layer)
        if image.rgb and image not in self._told:
            self._told.append(image)
            show_info(f"{image.name} is in colour: its luminance is used.")
        lines = tuple(target.start for target in request.plan.targets)
        block = block_around(image, request.frame, lines)
        task = engine.Task(
            block,
            lines,
            request.plan.fixed,
            self.preset,
            self.settings.polarity,
            self.half_width_in(image),
        )
        self._preview = Preview(self.viewer, image, f"{work.name} on the way")
        done = partial(self._on_done, work, request)
        see = partial(self._see, request.frame)
        self.start(partial(engine.run, task), done, "Refining", see, on=work)

    def start(
        self,
        work: Callable[[OnProgress], Any],
        done: Callable[[Any], None],
        name: str,
        see: Callable[[Progress], None] = lambda progress: None,
        cancelled: Callable[[], str] = lambda: "Nothing was changed.",
        on: Work | None = None,
    ) -> None:
        """Do something in a thread, with its progress in the dock.

        Parameters
        ----------
        work
            Called in the thread with a function to report progress to.
        done
            Called with what came of it; calls `finish` when all is shown.
        name
            What is done: "Refining".
        see
            Called whenever there is progress.
        cancelled
            Called when the user cancels; says what has become of what was done by then.
        on
            What it is about: it ends when one of its layers is removed.
        """
        self.progress, self.notice = Progress("starting", 0.0), Notice()
        self._began, self.left = perf_counter(), None
        self._cancelled, self._on = cancelled, on
        self._job = Job(work)
        self._job.progressed.connect(self._on_progress)
        self._job.progressed.connect(see)
        self._job.done.connect(partial(self._on_ended, done))
        self._job.failed.connect(partial(self._on_failed, name))
        self._job.start()
        self.changed.emit()

    @property
    def cancellable(self) -> bool:
        """Whether Cancel can still keep what runs from changing anything."""
        return self._job is not None

    def finish(self, notice: Notice) -> None:
        """Say what came of what was running: it is over."""
        self._stop(notice)

    def toggle_at_once(self) -> None:
        """Refine each line as soon as it is drawn, or no longer."""
        self.at_once = not self.at_once
        self.changed.emit()
        self._refine_at_once()

    def begin(self, image: Image, sketches: Shapes) -> Work:
        """Give what is known of an image through a layer of sketches, from now on at the latest."""
        known = self.work_on(image, sketches)
        if known:
            return known
        work = Work(image, sketches, self.viewer)
        self._works.append(work)
        self._attend(work)
        return work

    def cancel(self) -> None:
        """Forget the running refinement; everything stays as it was."""
        if self._job:
            said = self._cancelled()
            self._stop(Notice("cancelled", f"Cancelled. {said}"))

    def undo(self) -> None:
        """Take back the last step, or the last move of a knot."""
        if self.knots.active:
            self.knots.undo()
        else:
            super().undo()

    def redo(self) -> None:
        """Do again what was taken back."""
        if self.knots.active:
            self.knots.redo()
        else:
            super().redo()

    @property
    def waited(self) -> float:
        """For how long the user has waited for what she started last, s."""
        return perf_counter() - self._began

    def draw(self) -> None:
        """Draw lines into the chosen layer, or into a new one where there is none."""
        if self.choices.sketches is None:
            self.new_sketches()
        else:
            begin_drawing(self.choices.sketches, self.viewer)

    def draw_or_select(self) -> None:
        """Draw lines; or, while drawing, go back to selecting curves."""
        layer = self.choices.sketches
        curves = self.work.layers.layer("curves") if self.work else None
        if layer is not None and curves is not None and drawing(self.viewer, layer):
            select_curves(self.viewer, curves)
        else:
            self.draw()

    def new_sketches(self) -> None:
        """Add a layer of sketches that lies on the image, ready for drawing."""
        if self.choices.image is not None:
            new_sketch_layer(self.viewer, self.choices.image)

    def export(self, path: str | Path, *, overwrite: bool = True, rejected: bool = False) -> None:
        """Write the curves of all frames to a file, in a thread.

        Parameters
        ----------
        path
            The file; its ending says the format.
        overwrite
            Whether a file that is there is replaced.
        rejected
            Whether curves that the user has rejected are written too.
        """
        work = self.work
        if work is None or not work.records or self.progress:
            return
        labels = labels_of(work, rejected=rejected)
        left_out = len(work.records) - len(labels.labels)
        if not labels.labels:
            self.say(f"Nothing was saved: {words.count(left_out, 'curve')} here, all rejected.")
            return
        done = partial(self._on_exported, Path(path), len(labels.labels), left_out)
        order = partial(export, path, labels, overwrite)
        self.start(order, done, SAVING, cancelled=lambda: "Nothing was written.")

    def _on_exported(self, path: Path, count: int, left_out: int, lost: Sequence[str]) -> None:
        without = f", without {words.count(left_out, 'rejected curve')}" if left_out else ""
        text = f"Saved {words.count(count, 'curve')} to {path.name}{without}. "
        self.finish(Notice("done", f"{text}{words.together(lost)}".rstrip()))

    def abandon(self) -> None:
        """End what runs, and do not speak of it."""
        if self._job:
            self._job.cancel()
        if self._preview:
            self._preview.remove()
        self._job, self._preview, self.progress, self._on = None, None, None, None

    def close(self) -> None:
        """End what runs; nobody is there any more to show anything."""
        if self._closed:
            return
        self._closed = True
        self.knots.discard()
        self.abandon()
        self.actions.close()
        self.stop_listening()
        self._soon.stop()
        super().close()

    def _on_edited(self) -> None:
        layer = self.choices.sketches
        if layer is None or layer.nshapes < MANY:
            self.changed.emit()
        elif not self.progress:  # at the end of what runs, all is looked at anyway
            self._soon()

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
        self.left = time_left(self.waited, progress.fraction)
        self.changed.emit()

    def _see(self, frame: int, progress: Progress) -> None:
        """Show the curves on their way."""
        if self._preview and progress.centrelines:
            self._preview.show(frame, progress.centrelines)

    def _on_failed(self, name: str, message: str) -> None:
        if name == SAVING:
            self._stop(Notice("failed", f"Not saved: {message.partition(': ')[2]}"))
            return
        self._stop(Notice("failed", f"{name} failed, nothing was changed. {message}"))

    def _on_ended(self, done: Callable[[Any], None], outcome: Any) -> None:
        """What the thread was to do is done: what is left is to show it."""
        self._job = None
        self.changed.emit()
        done(outcome)

    def _on_done(self, work: Work, request: Request, refined: engine.Refined) -> None:
        targets = request.plan.targets
        ids = [target.id for target in targets]
        curves = [replace(c, reasons=words.renumbered(c.reasons, ids)) for c in refined.curves]
        fresh = [
            Record(t.id, request.frame, t.sketch, curve, drawn=t.drawn)
            for t, curve in zip(targets, curves, strict=True)
        ]
        what = f"Refine {words.curves([key_of(record) for record in fresh])}"
        state = work.state.set_aside([(request.frame, t.id) for t in targets if t.again])
        work.history.apply(what, state.refined(request.frame, fresh, refined))
        self._on_progress(Progress("drawing the curves", 1.0))
        self._drawing.start(work, last=partial(self._on_all_shown, work, len(fresh)))

    def _on_all_shown(self, work: Work, number: int) -> None:
        work.layers.select(self.selection)
        self._stop(Notice("done", words.done("Refined", number, "curve", self.waited)))
        self._refine_at_once()

    def _refine_at_once(self) -> None:
        """Refine what was drawn meanwhile, if she wants it so."""
        if self.at_once and not self.knots.active and self.request().plan.scope == "new":
            self.refine()

    def _follow(self) -> None:
        """Forget what is known of layers that are gone, and what was said of others."""
        pair = self.choices.image, self.choices.sketches
        if pair != self._pair:
            self._pair, self.notice = pair, Notice()
            self.knots.discard()
        there = set(self.viewer.layers)
        gone = [work for work in self._works if not {work.image, work.sketches} <= there]
        self._works = [work for work in self._works if work not in gone]
        for work in gone:
            self._leave(work)
        for work in self._works:
            if work.layers.deleted():
                # Later: napari is still busy with the layer that it tells of.
                QTimer.singleShot(0, partial(self._let_go, work))
        self.changed.emit()

    def _leave(self, work: Work) -> None:
        """End what runs on layers that the user has removed; what is half shown goes with them."""
        half = self._drawing.drop(work)
        if half:
            # Later: napari is still busy with the layer that it tells of.
            QTimer.singleShot(0, partial(remove_results, self.viewer, work))
        if half or (self.progress and self._on is work):
            name = (work.sketches if work.image in self.viewer.layers else work.image).name
            self._stop(Notice("cancelled", f"{name!r} was removed: what was running on it ended."))


def time_left(spent: float, done: float) -> float | None:
    """Guess from the share that is done how long the rest takes, s; None while nobody knows."""
    return spent * (1 - done) / done if spent > KNOWN_AFTER and done > 0.05 else None

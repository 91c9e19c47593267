"""What would be refined, what runs, what came of it."""

import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path
from time import perf_counter
from typing import Any
from weakref import WeakSet

import numpy as np
from napari.components import ViewerModel
from napari.layers import Image, Shapes
from napari.utils.notifications import show_info
from qtpy.QtCore import Qt, QTimer
from qtpy.QtGui import QGuiApplication
from superqt.utils import qdebounced

from napari_splinesketch.engine.types import OnProgress, Progress
from napari_splinesketch.files import counted, logged, reason_of, same_file
from napari_splinesketch.plugin import engine, files, films, knots, words
from napari_splinesketch.plugin.commands import RUNNING, Commands, pick, worst_first
from napari_splinesketch.plugin.keeper import Keeper, Kind
from napari_splinesketch.plugin.layers import drawn, pictures, results, space
from napari_splinesketch.plugin.model import Changes, History, Key, Record, Refined, key_of
from napari_splinesketch.plugin.plan import Plan, Scope, make_plan

SAVING = "Saving"
KNOWN_AFTER = 2.0  # seconds after which the time that is left is worth a guess


class Controller(Keeper):
    """Does what the user asks for; widgets show what came of it."""

    def __init__(self, viewer: ViewerModel):
        self.drawing = pictures.Drawing(self._on_not_shown)
        super().__init__(viewer)
        self.at_once = self._closed = False
        self.clicked = np.full(2, np.inf)  # where a curve was clicked last, px
        # In which curves are gone through: the worst first, or as a table shows them.
        self.order: Callable[[Sequence[Record]], Sequence[Record]] = worst_first
        self.left: float | None = None  # s until what runs is done, about; None if unknown
        self.plan = lru_cache(2)(make_plan)  # the same question has the same answer
        self.job: engine.Job | None = None  # that Cancel can still keep from changing anything
        self._turn = threading.Lock()  # of one thread at a time: what is cancelled takes a while
        self._cancelled: Callable[[], str] = lambda: ""
        self._on: results.Work | None = None
        self._frames = 0  # of that image, as it began
        self._told = WeakSet[Image]()
        self._began = 0.0
        self.suggestions = films.Suggestions(self)
        self.actions = Commands(self)
        self.say(self.actions.rebind(self.settings.keys))
        self.changes.clicked.connect(lambda shift: pick(self, add=shift))
        self.changes.layers.connect(self._follow)
        # Last: napari goes to the middle of a film when it is told of it.
        viewer.layers.events.inserted.connect(self._on_inserted, position="last")
        self._soon = qdebounced(self.changes.lines.emit, 0)
        self.changes.edited.connect(self._on_edited)
        # Later: napari is still busy with the line.
        self.changes.drawn.connect(lambda: QTimer.singleShot(0, self._on_drawn))

    def request(self, scope: Scope = "new") -> Plan:
        """Say what Refine would do now; selected lines go before those that are new."""
        layer, marked, problem = self.sketches, frozenset[int](), self.problem
        if problem or layer is None:
            return Plan(problem=problem or words.BEGIN)
        if self.unfinished and drawn.drawing(self.viewer, layer):
            return Plan(problem="Finish the line: a polyline ends with a double click or Enter.")
        frame, lines = self.frame, self.drawn
        about_curves = scope == "selected" and any(key[0] == frame for key in self.selection)
        if layer is self.viewer.layers.selection.active and not about_curves and scope != "all":
            marked = drawn.selected_in(layer)
        chosen = frozenset([i for i, number in enumerate(lines.numbers) if number in marked])
        if marked:
            scope = "selected"
            if not chosen:
                return Plan(scope, drawn=lines, problem=words.NO_LINE)
        asked = () if scope == "new" else self.selection
        plan = self.plan(self.state, frame, lines, scope, chosen, asked)
        if plan.targets:
            return plan
        return replace(plan, problem=words.nothing(plan, bool(self.records(frame)), layer.name))

    def refine(self, scope: Scope = "new") -> None:
        """Refine what `request` says, in a thread; the curve alone whose knots are shown."""
        if self.knots:
            self.knots.refine()
            return
        self.forget()
        wanted, work = self.request(scope), self.work
        if wanted.problem or self.progress or work is None:
            if scope != "new":
                self.say(wanted.problem or RUNNING)
            return
        image = work.image
        if image.rgb and image not in self._told:
            self._told.add(image)
            show_info(f"{image.name} is in colour: its luminance is used.")
        lines = tuple(target.start for target in wanted.targets)
        block = space.block_around(image, wanted.frame, lines)
        run = partial(engine.run, block, lines, wanted.fixed, self.how(image))

        def see(now: Progress) -> object:
            return now.centrelines and work.move(wanted.frame, now.centrelines)

        done = partial(self._on_refined, work, wanted, work.state.by_key)
        # Not that nothing was changed: an end that was extended stays longer.
        self.start(run, done, "Refining", see, lambda: "No curve was refined.", on=work)

    def start(
        self,
        work: Callable[[OnProgress], Any],
        done: Callable[[Any], None],
        name: str,
        see: Callable[[Progress], object] = lambda progress: None,
        cancelled: Callable[[], str] = lambda: "Nothing was changed.",
        on: results.Work | None = None,
    ) -> None:
        """Do something in a thread, called "Refining" or the like, with its progress in the dock.

        `work` reports progress, which `see` is given; `done` is given what came of it, and calls
        `finish` when all is shown; `cancelled` says what has become of what was done by then. What
        runs ends when a layer is removed that it is `on`.
        """
        if self.progress:
            return
        if self.knots:
            self.knots.close()

        def in_turn(on_progress: OnProgress) -> Any:
            if self._turn.locked():
                on_progress(Progress("waiting for what was cancelled", 0.0))
            with self._turn:
                return work(on_progress) if on_progress(Progress("starting", 0.0)) else None

        def show(outcome: Any) -> None:
            self.job = None  # it can no longer be cancelled
            self.changes.busy.emit()
            try:
                done(outcome)
            except Exception as error:
                self._on_not_shown(error)

        def failed(message: str) -> None:
            said = f"{name} failed. {cancelled()} {message[:1].upper()}{message[1:]}"
            self.finish(f"Not saved: {message}" if name == SAVING else said, "failed")

        self.progress = Progress("starting", 0.0)
        self._began, self.left = perf_counter(), None
        self._cancelled, self._on = cancelled, on
        self._frames = space.frame_count(on.image) if on else 0
        self.job = engine.Job(in_turn)
        self.job.progressed.connect(self._on_progress)
        self.job.progressed.connect(see)
        self.job.done.connect(show)
        self.job.failed.connect(failed)
        self.job.start()
        self.tell()
        self.changes.busy.emit()

    def finish(self, text: str = "", kind: Kind = "done") -> None:
        """End what runs, and say what came of it."""
        if self.job:
            self.job.cancel()
        if self._on:
            self._on.move()
        self.job = self.progress = self._on = None
        self.tell(text, kind)
        self.changes.busy.emit()

    def cancel(self) -> None:
        """Stop what runs; everything stays as it was."""
        if self.job:
            self.finish(f"Cancelled. {self._cancelled()}", "cancelled")

    @property
    def steps(self) -> History[Any]:
        """What can be undone."""
        return self.work.history if self.work else History(None)

    def toggle_at_once(self) -> None:
        """Refine each line as soon as it is drawn, or no longer."""
        self.at_once = not self.at_once
        self.changes.mode.emit()
        self._refine_at_once()

    def toggle_knots(self) -> None:
        """Show the knots of the selected curve, or keep the curve as they are."""
        work, chosen = self.work, self.selected_records()
        if self.knots:
            self.knots.close()
        elif locked := [record for record in chosen if record.locked]:
            self.say(words.locked(locked))
        elif work:
            self.knots = knots.KnotEditing(self, work, *chosen)
            self.changes.mode.emit()

    def draw(self, *, or_select: bool = False) -> None:
        """Draw lines into the chosen layer, or a new one; or, while drawing, select curves."""
        image, layer, curves = self.image, self.sketches, self.work and self.work.layer("curves")
        if or_select and curves is not None and layer and drawn.drawing(self.viewer, layer):
            self.viewer.layers.selection.active = curves
        elif image is not None and layer is not None:
            drawn.begin_drawing(layer, self.viewer, image)
        elif image is not None:
            drawn.new_sketch_layer(self.viewer, image)

    def export(self, path: str | Path) -> None:
        """Write the curves of all frames to a file, whose ending says the format, in a thread."""
        work, name = self.work, Path(path).name
        if work is None or not work.records or self.progress:
            return
        images = [layer for layer in self.viewer.layers if isinstance(layer, Image)]
        if any(same_file(path, i.source.path) for i in images if i.source.path):
            self.say(f"Not saved: {name} is an image that is open; choose another name.")
            return
        labels = files.labels_of(work, rejected=False)
        written, left_out = len(labels.labels), len(work.records) - len(labels.labels)
        if not written:
            self.say(f"Nothing was saved: {counted(left_out, 'curve')} here, all rejected.")
            return
        times, frame = space.times_of(work.image), max(each.frame for each in labels.labels)

        def done(lost: Sequence[str]) -> None:
            without = f", without {counted(left_out, 'rejected curve')}" if left_out else ""
            text = f"Saved {counted(written, 'curve')} to {name}{without}. "
            if times.others:
                text += f"It counts frames over all planes: frame {times.place(frame)} is {frame}. "
            self.finish(f"{text}{words.together(lost)}".rstrip())

        order = partial(files.export, path, labels)
        self.start(order, done, SAVING, cancelled=lambda: "Nothing was written.")

    def close(self) -> None:
        """End what runs; nobody is there any more to show anything."""
        if self._closed:
            return
        self._closed = True
        if self.knots:
            self.knots.close()
        self.viewer.layers.events.inserted.disconnect(self._on_inserted)
        self._soon.cancel()
        super().close()
        self.finish()
        self.actions.close()

    def _on_inserted(self, event: Any) -> None:
        image, layer = self.image, self.sketches
        if image is None or self.records() or space.frame_count(image) < 2:
            return
        if event.value is image and len(self.viewer.layers) == 1:
            space.go_to_frame(self.viewer, image, 0)
        elif event.value is layer and layer is not None and layer.nshapes:
            frames = [frame for frame, _ in drawn.shapes_in(self.viewer, layer, image)]
            space.go_to_frame(self.viewer, image, min(frames))

    def _on_edited(self) -> None:
        if self._on and space.frame_count(self._on.image) != self._frames:
            name = self._on.image.name
            self.finish(f"{name!r} has other frames: what was running on it ended.", "cancelled")
        if self.work and any(slot.unfit for slot in self.work.slots.values()):
            self.show(self.work)
        for work in self.works if self.viewer.dims.ndisplay == 2 else ():
            if work.behind:
                self.show(work)
        layer = self.sketches
        if layer and len(layer.edge_color) > layer.nshapes:  # later: napari is still busy
            QTimer.singleShot(0, partial(drawn.forget_given_up, layer))
        if layer is None or layer.nshapes < drawn.MANY:
            self.changes.lines.emit()
        else:
            self._soon()

    def is_meant(self) -> bool:
        """Whether a key is meant for us: an image, lines or results are active, or no layer."""
        layer = self.viewer.layers.selection.active
        return layer is None or isinstance(layer, Image | Shapes) or pictures.is_result(layer)

    def _on_progress(self, progress: Progress) -> None:
        self.progress = progress
        share, spent = progress.fraction, perf_counter() - self._began
        known = spent > KNOWN_AFTER and share > 0.05
        self.left = spent * (1 - share) / share if known else None
        self.changes.progress.emit()

    def _on_not_shown(self, error: Exception) -> None:
        ends = logged("The results could not be shown", error) or not self.job
        said = f"The results could not be shown. {reason_of(error)}"
        (self.finish if ends else self.tell)(said, "failed")

    def _on_refined(
        self, work: results.Work, plan: Plan, known: Mapping[Key, Record], refined: Refined
    ) -> None:
        """Take over the curves that nobody has reviewed or deleted meanwhile: `known` before."""
        ids, now = [target.id for target in plan.targets], work.state.by_key
        curves = [replace(c, reasons=words.renumbered(c.reasons, ids)) for c in refined.curves]
        fresh = [
            t.refined(plan.frame, curve)
            for t, curve in zip(plan.targets, curves, strict=True)
            if now.get((plan.frame, t.id)) is known.get((plan.frame, t.id))
        ]
        keys, left = list(map(key_of, fresh)), len(ids) - len(fresh)
        without = f", without {counted(left, 'curve')} that you decided on" if left else ""
        what = f"Refine {words.curves(keys)}" if keys else ""
        aside = [t.again for t in plan.targets if t.again and (plan.frame, t.id) in keys]
        state = work.state.refined(plan.frame, fresh, refined).set_aside(aside)
        self._on_progress(Progress("drawing the curves", 1.0))

        def over() -> None:
            waited = perf_counter() - self._began
            self.finish(f"Refined {counted(len(fresh), 'curve')} in {waited:.1f} s{without}.")
            self._refine_at_once()

        self.apply(what, state, over, work)

    def _on_drawn(self) -> None:
        """Refine what was drawn, if the user wants that; a mere click selects a curve."""
        image, layer, work = self.image, self.sketches, self.work
        if layer:
            drawn.put_into_frame(layer)
        if image and layer and drawn.clicked(self.viewer, layer):
            layer.remove([layer.nshapes - 1])
            shift = Qt.KeyboardModifier.ShiftModifier in QGuiApplication.keyboardModifiers()
            pick(self, add=shift)
        elif work and work.sketches.nshapes - 1 not in work.positions(work.suggested):
            self._refine_at_once()

    def _refine_at_once(self) -> None:
        if self.at_once and not self.knots and self.request().scope == "new":
            self.refine()

    def _follow(self) -> None:
        """Forget what is known of layers that are gone."""
        there = set(self.viewer.layers)
        for work in [work for work in self.works if not {work.image, work.sketches} <= there]:
            self.works.remove(work)
            work.changes = Changes()  # a key in a layer that stays means no other curves
            vars(work.sketches)[results.WORKS].remove(work)
            half = self.drawing.runs.pop(work, None)  # what is half shown goes with it
            if half or work.image not in there:
                # Later: napari is still busy with the layer that it tells of.
                QTimer.singleShot(0, work.remove)
            if self.progress and self._on is work:
                name = (work.sketches if work.image in there else work.image).name
                self.finish(f"{name!r} was removed: what was running on it ended.", "cancelled")
        for work in self.works:
            if work.deleted():
                if self._on is work:
                    self.cancel()
                QTimer.singleShot(0, partial(self._let_go, work))
        self.changes.curves.emit()

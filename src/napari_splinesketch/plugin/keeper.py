"""What is known and selected, what the user chose, and the one door through which it changes."""

from __future__ import annotations

import gc
from collections.abc import Callable, Collection, Iterable
from dataclasses import replace
from functools import cached_property, partial, partialmethod
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeVar

from napari.components import ViewerModel
from napari.layers import Image, Layer, Shapes
from napari.layers.base import ActionType

from napari_splinesketch.engine.settings import Asked
from napari_splinesketch.engine.types import Progress
from napari_splinesketch.plugin import choices, files, words
from napari_splinesketch.plugin.layers import space
from napari_splinesketch.plugin.layers.drawn import Drawn, drawing, drawn_in
from napari_splinesketch.plugin.layers.pictures import Drawing, is_result
from napari_splinesketch.plugin.layers.results import ORIGIN, WORKS, Work, origin_of
from napari_splinesketch.plugin.model import Changes, History, Key, Record, Review, State, key_of

if TYPE_CHECKING:
    from napari_splinesketch.plugin.commands import Commands
    from napari_splinesketch.plugin.knots import KnotEditing

NOTHING = State()
LOOKED = ("point", "order", "ndisplay")  # of the sliders: something else is in view
L = TypeVar("L", bound=Layer)
Kind = Literal["none", "done", "cancelled", "failed"]
Last = Callable[[], None] | None


class Notice(NamedTuple):
    """What the last action came to, where its results do not say it."""

    kind: Kind = "none"
    text: str = ""


def _choice(kind: type[Layer]) -> Any:
    return property(lambda self: self.chosen(kind), lambda self, new: self.choose_layer(kind, new))


class Keeper:
    """Keeps the curves of each image, as the user corrects and judges them.

    Image and sketches are the layers added last, or the topmost of those left; never results.
    napari's own choice of layers would list these as well, and keep the first one where work goes
    on in the latest.
    """

    image: Image | None = _choice(Image)
    sketches: Shapes | None = _choice(Shapes)
    actions: Commands
    drawing: Drawing
    knots: KnotEditing | None = None
    unfinished = False  # the last of the sketches is still being drawn

    def __init__(self, viewer: ViewerModel):
        self.viewer = viewer
        self.changes = Changes(instance=self)
        self.notice = Notice()
        self._chosen: dict[type[Layer], Layer | None] = {Image: None, Shapes: None}
        self._ends: dict[type[Layer], Callable[[], None]] = {}
        for layer in filter(None, (*viewer.layers, viewer.layers.selection.active)):
            self._take_up(layer)
        self.settings = choices.load()
        self.progress: Progress | None = None  # of what runs
        for signal in (self.changes.layers, self.changes.edited):
            signal.connect(self.forget)
        self.changes.erased.connect(lambda: self.delete())
        # What an earlier dock knew of the layers that are still there.
        known: Any = (work for layer in viewer.layers for work in vars(layer).get(WORKS, ()))
        self.works: list[Work] = [work for work in known if work.image in viewer.layers]
        for work in self.works:
            self.attend(work)
            if not work.deleted():  # that dock may have been closed while it drew the curves
                self.show(work)
        layers, groups = viewer.layers.events, choices.groups().values()
        self._end = choices.listen(
            (layers.inserted, lambda event: self._take_up(event.value)),
            (layers.removed, self._on_removed),
            (layers.reordered, lambda event: self.changes.layers.emit()),
            (layers.renamed, lambda event: self.changes.layers.emit()),
            (viewer.layers.selection.events.active, lambda event: self.changes.mode.emit()),
            *[(getattr(viewer.dims.events, name), self._on_seen) for name in LOOKED],
            *[(group.events, lambda event: self._take(choices.load())) for group in groups],
        )

    def chosen(self, kind: type[L]) -> L | None:
        """Give the chosen layer of a kind."""
        layer: Any = self._chosen[kind]  # napari tells late that one is gone
        return layer if layer in self.viewer.layers else None

    def layers(self, kind: type[L]) -> list[L]:
        """Give the layers of a kind to choose from, topmost first."""
        return [x for x in reversed(self.viewer.layers) if isinstance(x, kind) and not is_result(x)]

    def choose_layer(self, kind: type[Layer], new: Layer | None) -> None:
        """Choose a layer of a kind, or none; with an image from another file, lines of its own."""
        self._ends.pop(kind, lambda: None)()
        other = new is not self._chosen[kind]
        if other:
            self.tell()  # nothing: what was said is of other layers
            if self.knots:
                self.knots.close()
        self._chosen[kind], self.unfinished = new, False
        if new is not None:
            events = [getattr(new.events, name) for name in choices.PLACED]
            if isinstance(new, Shapes):
                events += [new.events.mode, new.selected_data.events.items_changed]
            self._ends[kind] = choices.listen(*[(event, self._on_seen) for event in events])
        layer, origin = self.sketches, origin_of(new) if isinstance(new, Image) else None
        if origin and not (layer and self._fits(layer)):
            own = (each for each in self.layers(Shapes) if vars(each).get(ORIGIN) == origin)
            self.choose_layer(Shapes, next(own, None))
        elif other and self.image and layer:
            if not any(work.records for work in vars(layer).get(WORKS, ())):
                files.lay(layer, self.image)
        self.changes.layers.emit()

    @property
    def work(self) -> Work | None:
        """What is known of the chosen image through the chosen sketches; None without both."""
        return self.work_on(self.image, self.sketches) if self.image and self.sketches else None

    def work_on(self, image: Image, sketches: Shapes) -> Work:
        """Give what is known of an image through a layer of sketches."""
        for work in self.works:
            if work.image is image and work.sketches is sketches:
                return work
        self.works.append(Work(image, sketches, self.viewer))
        self.attend(self.works[-1])
        return self.works[-1]

    @cached_property
    def frame(self) -> int:
        """Index of the frame in view."""
        return space.current_frame(self.viewer, self.image) if self.image else 0

    @cached_property
    def drawn(self) -> Drawn:
        """The lines of the frame in view."""
        image, layer = self.image, self.sketches
        return drawn_in(self.viewer, layer, image, self.frame) if image and layer else Drawn()

    def forget(self) -> None:
        """Look again at what is in view."""
        for name in ("frame", "drawn"):
            vars(self).pop(name, None)

    @property
    def state(self) -> State:
        """What is known now."""
        return self.work.state if self.work else NOTHING

    def records(self, frame: int | None = None) -> tuple[Record, ...]:
        """Give the curves of a frame, or of all."""
        records = self.work.records if self.work else ()
        return records if frame is None else tuple([r for r in records if r.frame == frame])

    @property
    def selection(self) -> tuple[Key, ...]:
        """(frame, id) of the selected curves."""
        return tuple(map(key_of, self.selected_records()))

    def selected_records(self) -> tuple[Record, ...]:
        """Give the selected curves."""
        return self.work.selected if self.work else ()

    def select(self, keys: Iterable[Key]) -> None:
        """Select curves, here and in their layer."""
        if work := self.work:
            work.select(tuple(keys))
            if self.selection and not self.unfinished and drawing(self.viewer, work.sketches):
                # The line drawn last, unseen: Delete would take it where a curve is meant.
                work.sketches.selected_data = set()

    @property
    def unseen(self) -> str:
        """Say which frame to go to, where no selected curve is in the one in view."""
        chosen = self.selected_records()
        seen = self.viewer.dims.ndisplay > 2 or any(r.frame == self.frame for r in chosen)
        if seen or not chosen:
            return ""
        frame = space.times_of(self.image).place(chosen[0].frame)
        return f"Curve {chosen[0].id} is in frame {frame}: go there first."

    def say(self, text: str) -> None:
        """Tell the user why something was not done."""
        self.tell(text, "failed")

    def tell(self, text: str = "", kind: Kind = "done") -> None:
        """Tell the user what came of something."""
        notice = Notice(kind, text) if text else Notice()
        if notice != self.notice:
            self.notice = notice
            self.changes.said.emit()

    def apply(self, what: str, state: State, last: Last = None, work: Work | None = None) -> None:
        """Put a state in the place of the present one: the one way to change what is known.

        `what` is done, for the tooltip of Undo: "Accept curve 3"; without it, it is part of the
        last step. `last` is called when it is shown.
        """
        if work := work or self.work:
            if what:
                self.tell()
                work.history.apply(what, state)
            else:
                work.history.amend(state)
            self.show(work, last)

    def show(self, work: Work, last: Last = None) -> None:
        """Let the layers show what is known, and then call something."""
        self.changes.curves.emit()
        self.drawing.start(work, work.show(), last, self.changes.shown.emit)

    def _travel(self, said: str, way: Callable[[History[Any]], str]) -> None:
        """Go to another step, if there is one."""
        if self.work and not self.progress and (what := way(self.work.history)):
            self.show(self.work)  # and put away its knots, which says nothing
            self.tell(f"{said}: {what[0].lower()}{what[1:]}.")

    undo = partialmethod(_travel, "Undone", History.undo)
    redo = partialmethod(_travel, "Redone", History.redo)

    def _change(
        self, verb: str, change: Callable[[State, Collection[Key]], State], *keys: Key
    ) -> None:
        """Change some curves as a step, those selected if none are named."""
        chosen = keys or self.selection
        if self.work and chosen and (state := change(self.state, chosen)) is not self.state:
            self.apply(f"{verb} {words.curves(chosen)}", state)

    def delete(self, *keys: Key) -> None:
        """Delete curves, those selected if none are named; not if one of them is locked."""
        chosen = keys or self.selection
        if not keys and self.unseen:
            self.say(self.unseen)
        elif locked := [r for r in self.records() if r.locked and key_of(r) in chosen]:
            self.say(words.locked(locked))
        else:
            self._change("Delete", State.without, *keys)

    def review(self, review: Review, *keys: Key) -> None:
        """Accept, reject or reopen curves, those selected if none are named."""
        verb = {"accepted": "Accept", "rejected": "Reject", "open": "Reopen"}[review]
        self._change(verb, partial(State.marked, review=review), *keys)

    def lock(self, locked: bool, *keys: Key) -> None:
        """Lock or unlock curves, those selected if none are named."""
        self._change("Lock" if locked else "Unlock", partial(State.marked, locked=locked), *keys)

    def restore(self, *keys: Key) -> None:
        """Bring deleted curves back, the latest if none are named."""
        if chosen := keys or tuple(map(key_of, self.state.deleted[-1:])):
            self._change("Restore", State.restored, *chosen)
            self.select(chosen)

    @property
    def problem(self) -> str:
        """Why nothing can be refined or looked for in the chosen image now, or nothing."""
        image, problem = self.image, space.plane_problem(self.viewer, self.image)
        if problem or image is None:
            return problem
        ruler = space.ruler_of(image)
        return words.half_width(self.settings.half_width_in(ruler), ruler, space.size_of(image))

    def how(self, image: Image) -> Asked:
        """Say how the user wants the bodies of an image to be found; its half-width in px."""
        return replace(self.settings, half_width=self.settings.half_width_in(space.ruler_of(image)))

    def choose(self, **chosen: object) -> None:
        """Take settings that the user chose, and keep them for other sessions.

        InputError where napari knows of no such choice.
        """
        wanted = replace(self.settings, **chosen)
        try:
            choices.save(wanted)
        except OSError as error:
            why = f"napari could not write its settings ({error.strerror or error})"
            self.say(f"Chosen, but not for next time: {why}. Make room there, and choose again.")
        self._take(wanted)

    def close(self) -> None:
        """Hear of nothing any more; what is known stays with its layers."""
        self._end()
        self.drawing.runs.clear()
        for work in self.works:
            work.changes = Changes()
        self.works.clear()
        self.changes.disconnect()
        for kind in self._chosen:
            self.choose_layer(kind, None)

    def _take_up(self, layer: Layer) -> None:
        for kind in self._chosen:
            if isinstance(layer, kind) and not is_result(layer):
                self.choose_layer(kind, layer)

    def _on_removed(self, event: Any) -> None:
        if not is_result(event.value):
            gc.unfreeze()  # its pixels may be garbage among what the dock leaves out of the search
        for kind in self._chosen:
            if event.value is self._chosen[kind]:
                left = (x for x in self.layers(kind) if self._fits(x, strictly=True))
                self.choose_layer(kind, next(left, None))
        self.changes.layers.emit()

    def _fits(self, layer: Layer, *, strictly: bool = False) -> bool:
        """Whether a layer is not of another file's image; `strictly`, nor of another in memory."""
        origin, works = vars(layer).get(ORIGIN), vars(layer).get(WORKS)
        if strictly and works and not origin:
            return works[0].image is self.image
        return not (origin and self.image) or origin == origin_of(self.image)

    def _on_seen(self, event: Any) -> None:
        action, added = getattr(event, "action", None), ActionType.ADDED  # of the chosen sketches
        self.unfinished = action == ActionType.ADDING or self.unfinished & (action != added)
        self.changes.edited.emit()
        if action == added:
            self.changes.drawn.emit()

    def _take(self, chosen: choices.Settings) -> None:
        before, self.settings = self.settings, chosen
        if chosen.keys != before.keys:
            self.say(self.actions.rebind(chosen.keys))
        for work in self.works:
            self.attend(work)
        self.changes.settings.emit()

    def attend(self, work: Work) -> None:
        """Hear of what happens to a work, and let its colours follow the settings."""
        work.changes = self.changes
        before, work.look = work.look, (self.settings.colour_by, space.ruler_of(work.image))
        if work.look != before and work.slots["curves"].made is not None:
            self.show(work)

    def _let_go(self, work: Work) -> None:
        """Take the removal of the layer of curves for a step: the curves go, until undone."""
        if work in self.works and work.deleted():  # not one whose other layers went, too
            known, nothing = work.state.records, State(suggestions=work.state.suggestions)
            if known:  # first: with each layer that goes, all that is known is looked through
                work.history.apply("Remove the curves", nothing)
            work.remove()
            if known:
                self.show(work)
                self.tell("The curves are gone with their layer. Undo brings them back.")

"""What is known, what is selected, and the one door through which it changes."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from typing import Literal

from napari.components import ViewerModel
from napari.layers import Image, Shapes
from psygnal import Signal, SignalInstance
from qtpy.QtCore import QTimer

from napari_splinesketch.engine.types import Progress
from napari_splinesketch.plugin import words
from napari_splinesketch.plugin.adapter.space import current_frame
from napari_splinesketch.plugin.choices import Choices
from napari_splinesketch.plugin.drawing import Drawing
from napari_splinesketch.plugin.gently import BREATH_MS, MANY, Soon
from napari_splinesketch.plugin.records import Key, Record, Review, key_of
from napari_splinesketch.plugin.state import State
from napari_splinesketch.plugin.work import Work, works_in


@dataclass(frozen=True)
class Notice:
    """What the last action came to, where its results do not say it."""

    kind: Literal["none", "done", "cancelled", "failed"] = "none"
    text: str = ""


BACK = "Undo brings them back."


class Keeper:
    """Keeps the curves of each image, as the user corrects and judges them.

    Parameters
    ----------
    viewer
        The viewer whose layers are worked on.

    Attributes
    ----------
    choices
        The chosen image and sketches.
    progress
        Where what runs stands; None when nothing runs.
    notice
        What the last action came to.
    """

    changed = Signal()
    """Whoever shows the state should look again."""
    selected_changed = Signal()
    """Other curves are selected."""
    clicked = Signal(bool)
    """The user has clicked into the layer of curves; with Shift, or without."""

    def __init__(self, viewer: ViewerModel):
        self.viewer = viewer
        self.choices = Choices(viewer)
        self.progress: Progress | None = None
        self.notice = Notice()
        self._selection: tuple[Key, ...] = ()
        self._drawing = Drawing(self._on_not_shown)
        self._soon_marked = Soon(self._mark_selected, after=BREATH_MS)
        self.selected_changed.connect(self._look_at_selected)
        self._works = works_in(viewer)
        for work in self._works:
            self._attend(work)

    @property
    def work(self) -> Work | None:
        """What is known of the chosen image through the chosen sketches."""
        return self.work_on(self.choices.image, self.choices.sketches)

    @property
    def works(self) -> tuple[Work, ...]:
        """All that is known, of every image through every layer of sketches."""
        return tuple(self._works)

    def work_on(self, image: Image | None, sketches: Shapes | None) -> Work | None:
        """Give what is known of an image through a layer of sketches."""
        pair = image, sketches
        return next((work for work in self._works if (work.image, work.sketches) == pair), None)

    @property
    def frame(self) -> int:
        """Index of the frame in view."""
        image = self.choices.image
        return current_frame(self.viewer, image) if image else 0

    def records(self, frame: int | None = None) -> tuple[Record, ...]:
        """Give the curves of a frame, or of all."""
        records = self.work.records if self.work else ()
        return tuple(r for r in records if frame is None or r.frame == frame)

    @property
    def selection(self) -> tuple[Key, ...]:
        """(frame, id) of the selected curves."""
        known = self.work.state.by_key if self.work else {}
        return tuple(key for key in self._selection if key in known)

    @property
    def selected(self) -> Key | None:
        """(frame, id) of the selected curve; None without one, or with several."""
        return self.selection[0] if len(self.selection) == 1 else None

    @selected.setter
    def selected(self, key: Key | None) -> None:
        self.select(() if key is None else (key,))

    def say(self, text: str) -> None:
        """Tell the user why something was not done."""
        self.tell(Notice("failed", text))

    def tell(self, notice: Notice) -> None:
        """Tell the user what came of something."""
        self.notice = notice
        self.changed.emit()

    def select(self, keys: Iterable[Key]) -> None:
        """Select curves, here and in their layer."""
        chosen = tuple(keys)
        if self.work and len(self.work.records) < MANY:
            self.work.layers.select(chosen)
        else:
            self._soon_marked()
        if chosen != self._selection:
            self._selection = chosen
            self.selected_changed.emit()
            self.changed.emit()

    def apply(self, what: str, state: State, last: Callable[[], None] = lambda: None) -> None:
        """Put a state in the place of the present one, as a step that can be taken back.

        Every change of what is known goes through here.

        Parameters
        ----------
        what
            What is done, for the tooltip of Undo: "Accept curve 3".
        state
            What is known then.
        last
            Called when it is shown.
        """
        if self.work:
            self.notice = Notice()
            self.work.history.apply(what, state)
            self._show(self.work, last)

    def amend(self, state: State) -> None:
        """Put a state in the place of the present one, as part of the last step."""
        if self.work:
            self.work.history.amend(state)
            self._show(self.work)

    def when_shown(self, call: Callable[[], None]) -> None:
        """Call something when the layers show what is known."""
        if self.work:
            self._show(self.work, call)

    def undo(self) -> None:
        """Take back the last step."""
        self._travel("Undone", "undo")

    def redo(self) -> None:
        """Do again what was taken back."""
        self._travel("Done again", "redo")

    def review(self, review: Review, *keys: Key) -> None:
        """Accept, reject or reopen curves, those selected if none are named."""
        verb = {"accepted": "Accept", "rejected": "Reject", "open": "Reopen"}[review]
        chosen = keys or self.selection
        if self.work and chosen:
            self.apply(f"{verb} {words.curves(chosen)}", self.work.state.reviewed(chosen, review))

    def lock(self, locked: bool, *keys: Key) -> None:
        """Lock or unlock curves, those selected if none are named."""
        chosen = keys or self.selection
        if self.work and chosen:
            what = f"{'Lock' if locked else 'Unlock'} {words.curves(chosen)}"
            self.apply(what, self.work.state.locked(chosen, locked))

    def toggle_lock(self) -> None:
        """Lock the selected curves, or unlock them if all are locked."""
        chosen = [self.work.state.record(key) for key in self.selection] if self.work else []
        self.lock(not all(record is not None and record.locked for record in chosen))

    def delete(self, *keys: Key) -> None:
        """Delete curves, those selected if none are named."""
        chosen = keys or self.selection
        if self.work and chosen:
            self.apply(f"Delete {words.curves(chosen)}", self.work.state.without(chosen))

    def restore(self, *keys: Key) -> None:
        """Bring deleted curves back, the latest if none are named."""
        deleted = self.work.state.deleted if self.work else ()
        chosen = keys or tuple(map(key_of, deleted[-1:]))
        if self.work and chosen:
            state = self.work.state
            for key in chosen:
                state = state.restored(key)
            self.apply(f"Restore {words.curves(chosen)}", state)
            self.select(chosen)

    def close(self) -> None:
        """Hear of nothing any more; what is known stays with its layers."""
        self._soon_marked.stop()
        self._drawing.stop()
        for work in self._works:
            for signal in _signals(work):
                signal.disconnect()
        self._works.clear()
        self.choices.close()
        for signal in (self.changed, self.selected_changed, self.clicked):
            signal.disconnect()

    def _attend(self, work: Work) -> None:
        for signal in _signals(work):
            signal.disconnect()
        # Later: napari is still busy with the edit that it tells of.
        work.layers.toggled.connect(lambda: self.changed.emit())
        work.proofs.toggled.connect(lambda: self.changed.emit())
        work.layers.edited.connect(lambda: QTimer.singleShot(0, partial(self._adopt, work)))
        work.layers.selected.connect(partial(self._on_selected, work))
        work.layers.clicked.connect(lambda shift: self.clicked.emit(shift))

    def _adopt(self, work: Work) -> None:
        """Take over what the user deleted among the curves; what she moved goes back."""
        gone = work.layers.missing() & set(map(key_of, work.records))
        if gone:
            work.history.apply(f"Delete {words.curves(sorted(gone))}", work.state.without(gone))
        elif not self.progress:
            said = f"Curves are results: draw and move lines in {work.sketches.name!r}."
            self.notice = Notice("failed", said)
        self._show(work)

    def _let_go(self, work: Work) -> None:
        """Take the removal of the layer of curves for a step: the curves go, until undone."""
        if work.layers.deleted():
            work.layers.forget()
            if work.records:
                left = State(suggestions=work.state.suggestions)
                work.history.apply("Remove the curves", left)
                self.notice = Notice("done", "The curves are gone with their layer. " + BACK)
                self._show(work)

    def _on_selected(self, work: Work) -> None:
        if work is self.work and work.layers.selection() != self._selection:
            self._selection = work.layers.selection()
            # Later: napari is still busy with the click, and with its own mark of the curve.
            QTimer.singleShot(BREATH_MS, work.layers.emphasise)
            self.selected_changed.emit()
            self.changed.emit()

    def _mark_selected(self) -> None:
        if self.work:
            self.work.layers.select(self.selection)

    def _look_at_selected(self) -> None:
        if self.work:
            self.work.looked_at = self.selected
            self.work.proofs.update()

    def _travel(self, said: str, way: Literal["undo", "redo"]) -> None:
        if self.work and not self.progress:
            what = getattr(self.work.history, way)()
            if what:
                self.notice = Notice("done", f"{said}: {what[0].lower()}{what[1:]}.")
                self._show(self.work)

    def _show(self, work: Work, last: Callable[[], None] = lambda: None) -> None:
        self.changed.emit()
        self._drawing.start(work, last=partial(self._on_shown, work, last))

    def _on_shown(self, work: Work, last: Callable[[], None]) -> None:
        if work is self.work:
            self._mark_selected()
        last()
        self.changed.emit()

    def _on_not_shown(self, error: Exception) -> None:
        self.progress = None
        self.notice = Notice("failed", f"The results could not be shown. {error}")
        self.changed.emit()


def _signals(work: Work) -> tuple[SignalInstance, ...]:
    """What tells of the user's doings in layers of results: one keeper listens."""
    layers = work.layers
    return layers.toggled, work.proofs.toggled, layers.edited, layers.selected, layers.clicked

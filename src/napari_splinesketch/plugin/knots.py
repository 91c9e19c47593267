"""Moving a curve by its knots: points that can be dragged."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from jaxtyping import Float
from napari.layers import Points
from napari.layers.base import ActionType
from qtpy.QtCore import QTimer

from napari_splinesketch import palette
from napari_splinesketch.engine.types import Curve
from napari_splinesketch.plugin import shaping
from napari_splinesketch.plugin.keeper import Keeper, Notice
from napari_splinesketch.plugin.layers.slot import Preview, Slot
from napari_splinesketch.plugin.layers.space import in_stack
from napari_splinesketch.plugin.model import History, Record, key_of

FEWEST = 3
HELP = "Drag the knots. Enter refines from there, Done keeps the curve as it is, Esc undoes it all."
COLOUR, HEAD = palette.MOVING, palette.TRUTH
"""The first knot is the head: it stands out."""
LOOK = {"size": 3, "canvas_size_limits": (9, 14), "border_width": 0.1, "border_color": "black"}
DONE = (ActionType.ADDED, ActionType.CHANGED, ActionType.REMOVED)

Knots = Float[np.ndarray, "K 2"]


class KnotEditing:
    """Shows the knots of the selected curve, and the curve as they are dragged.

    `steps` are the knots, and where they were; `refine` is called to refine the selected curves.
    """

    def __init__(self, keeper: Keeper, refine: Callable[[], None]):
        self._keeper = keeper
        self._refine = refine
        self._record: Record | None = None
        self._slot: Slot | None = None
        self._preview: Preview | None = None
        self.steps: History[Knots] = History(np.zeros((0, 2)))

    @property
    def active(self) -> bool:
        """Whether knots are shown."""
        return self._slot is not None

    def toggle(self) -> None:
        """Show the knots of the selected curve, or keep the curve as it is now."""
        if self.active:
            self.keep()
        else:
            self.begin()

    def begin(self) -> None:
        """Show the knots of the selected curve."""
        keeper, work, key = self._keeper, self._keeper.work, self._keeper.selected
        record = work.state.record(key) if work and key else None
        if work is None or record is None or record.locked or keeper.progress:
            locked = record is not None and record.locked
            keeper.say("The curve is locked." if locked else "Select one curve to edit its knots.")
            return
        self._record, self.steps = record, History(record.curve.knots[:, :2])
        there, layers = (keeper.viewer, work.image), keeper.viewer.layers
        self._slot = Slot(*there, "knots", f"{work.name} knots of curve {record.id}")
        self._preview = Preview(*there, "preview", f"{work.name} edited")
        self._before = layers.selection.active
        knots = in_stack(work.image, record.frame, self.steps.value)
        layer = self._slot.make(knots, kind=Points, **LOOK)
        for key, run in (("Enter", self.refine), ("Escape", self.discard)):
            layer.bind_key(key, lambda _, run=run: run(), overwrite=True)
        self._paint()
        layers.selection.active = layer
        layer.mode = "select"
        layer.mouse_drag_callbacks.append(self._follow)
        layer.events.data.connect(self._on_data)
        layers.events.removed.connect(self._on_removed)
        self._show()
        keeper.tell(Notice("none", HELP))
        keeper.changes.mode.emit()

    def keep(self) -> None:
        """Put the curve where its knots are, if they were moved."""
        work, record, curve = self._keeper.work, self._record, self._curve()
        moved = bool(self.steps.done)
        known = work.state.record(key_of(record)) if work and record else None
        self.discard()
        if work and record and curve and moved and known is record:
            changed = replace(record, curve=curve, edited=True, review="open")
            state = work.state.with_records(changed)
            self._keeper.apply(f"Move knots of curve {record.id}", state)
            self._keeper.selected = key_of(record)

    def refine(self) -> None:
        """Refine the curve from where its knots are, and no other."""
        record = self._record
        self.keep()
        if record is not None:
            self._keeper.selected = key_of(record)
            self._refine()

    def discard(self) -> None:
        """Leave the curve as it was."""
        slot, preview = self._slot, self._preview
        self._slot = self._preview = self._record = None
        if slot is not None and preview is not None:
            layers = self._keeper.viewer.layers
            layers.events.removed.disconnect(self._on_removed)
            preview.remove()
            if slot.layer is not None:
                slot.layer.events.data.disconnect(self._on_data)
            slot.remove()
            if self._before in layers:
                layers.selection.active = self._before
            self._keeper.tell(Notice())
            self._keeper.changes.mode.emit()

    def undo(self) -> None:
        """Put the knots back to where they were before the last move."""
        self.steps.undo()
        self._put()

    def redo(self) -> None:
        """Move the knots again."""
        self.steps.redo()
        self._put()

    def _put(self) -> None:
        """Show the knots where they are by now."""
        layer = self._slot.layer if self._slot else None
        if self._slot and layer is not None and self._record is not None:
            with layer.events.data.blocker():
                layer.selected_data = set()
                layer.data = in_stack(self._slot.image, self._record.frame, self.steps.value)
                self._paint()
            self._show()
            self._keeper.changes.mode.emit()

    def _paint(self) -> None:
        layer = self._slot.layer if self._slot else None
        if layer is not None:
            layer.face_color = [HEAD, *[COLOUR] * max(len(layer.data) - 1, 0)]

    def _value(self) -> Knots:
        """(K, 2) the knots in their layer, px."""
        layer = self._slot.layer if self._slot else None
        return self.steps.value if layer is None else np.array(layer.data[:, -2:], dtype=float)

    def _curve(self) -> Curve | None:
        return shaping.moved(self._record.curve, self._value()) if self._record else None

    def _show(self) -> None:
        curve = self._curve()
        if curve is not None and self._preview is not None and self._record is not None:
            self._preview.show(self._record.frame, [curve.points])

    def _follow(self, layer: Points, event: Any) -> Iterator[None]:
        """Draw the curve at every move: napari's own event comes when the button is released."""
        yield
        while event.type == "mouse_move":
            self._show()
            yield

    def _on_data(self, event: Any) -> None:
        if event.action in DONE:
            # Later: napari is still busy with the edit that it tells of.
            QTimer.singleShot(0, self._on_moved)

    def _on_moved(self) -> None:
        if not self.active:
            return
        knots = _in_order(self.steps.value, self._value())
        if len(knots) < FEWEST:
            self._keeper.say(f"A curve has at least {FEWEST} knots.")
        else:
            self.steps.apply("move knots", knots)
        self._put()

    def _on_removed(self) -> None:
        if self._slot is not None and self._slot.layer is None:
            self.discard()


def _in_order(before: Knots, now: Knots) -> Knots:
    """Put a knot that was added, and so comes last, where it lies among the others."""
    if len(now) != len(before) + 1:
        return now
    rest, new = now[:-1], now[-1]
    detours = [
        np.linalg.norm(a - new) + np.linalg.norm(b - new) - np.linalg.norm(a - b)
        for a, b in pairwise(rest)
    ]
    detours = [2 * np.linalg.norm(rest[0] - new), *detours, 2 * np.linalg.norm(rest[-1] - new)]
    return np.insert(rest, int(np.argmin(detours)), new, axis=0)

"""Knots of a curve, to be dragged by hand."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float
from napari.layers import Points
from napari.layers.base import ActionType
from qtpy.QtCore import QTimer

from napari_splinesketch import palette
from napari_splinesketch.editing import moved
from napari_splinesketch.engine.types import Curve
from napari_splinesketch.plugin.choices import listen
from napari_splinesketch.plugin.keeper import Notice
from napari_splinesketch.plugin.layers.results import Work
from napari_splinesketch.plugin.layers.slot import Slot
from napari_splinesketch.plugin.layers.space import in_stack, look_at, screen_pixel
from napari_splinesketch.plugin.model import History, Record, key_of

if TYPE_CHECKING:
    from napari_splinesketch.plugin.controller import Controller

FEWEST = 3
"""Knots of any curve."""
HELP = "Drag the knots. Enter refines from there, Done keeps the curve as it is, Esc undoes it all."
COLOUR, HEAD = palette.MOVING, palette.TRUTH
"""The first knot is the head: it stands out."""
LOOK = {"border_width": 0.15, "border_color": "black"}
SIZE = 11.0
"""Of a knot, px of the screen: napari's own limits would draw nothing but its border."""
DONE = (ActionType.ADDED, ActionType.CHANGED, ActionType.REMOVED)

Knots = Float[np.ndarray, "K 2"]


class KnotEditing:
    """Shows the knots of a curve, and the curve as they are dragged, until they are kept or not.

    `steps` are the knots, and where they were; `number` is that of the curve.
    """

    def __init__(self, controller: Controller, work: Work, record: Record):
        viewer, layers = controller.viewer, controller.viewer.layers
        self.steps: History[Knots] = History(record.curve.knots[:, :2])
        self.number = record.id
        self._controller, self._work, self._record = controller, work, record
        name = f"{work.name} knots of curve {record.id}"
        self._slot = Slot(viewer, work.image, "knots", name, Points)
        self._before = layers.selection.active
        knots = in_stack(work.image, record.frame, self.steps.value)
        layer = self._slot.make(knots, **LOOK)
        steps = np.linalg.norm(np.diff(self.steps.value, axis=0), axis=1)
        apart = float(np.median(steps) / screen_pixel(viewer, work.image)[-1])
        if apart < SIZE:  # nobody could take hold of one
            viewer.scene.camera.zoom *= 2 * SIZE / apart
            look_at(viewer, work.image, record.frame, record.curve.points)
        for key, run in (("Enter", self.refine), ("Escape", self.discard)):
            layer.bind_key(key, lambda _, run=run: run(), overwrite=True)
        self._paint()
        layers.selection.active = layer
        layer.mode = "select"
        layer.mouse_drag_callbacks.append(self._follow)
        self._end = listen(
            (viewer.scene.camera.events.zoom, self._paint),
            (layer.events.data, self._on_data),
            (layers.events.removed, self._on_removed),
        )
        self._show()
        controller.tell(Notice("none", HELP))

    def keep(self) -> None:
        """Put the curve where its knots are, if they were moved."""
        work, record, curve = self._work, self._record, self._curve()
        self.discard()
        if self.steps.done and work.state.by_key.get(key_of(record)) is record:
            changed = replace(record, curve=curve, edited=True, review="open")
            state = work.state.with_records(changed)
            self._controller.apply(f"Move knots of curve {record.id}", state)
            self._controller.selected = key_of(record)

    def refine(self) -> None:
        """Refine the curve from where its knots are, and no other."""
        self.keep()
        self._controller.selected = key_of(self._record)
        self._controller.refine("selected")

    def discard(self) -> None:
        """Leave the curve as it was."""
        controller, layers = self._controller, self._controller.viewer.layers
        if controller.knots is not self:
            return
        controller.knots = None
        self._end()
        self._work.move()
        self._slot.remove()
        if self._before in layers:
            layers.selection.active = self._before
        controller.tell(Notice())
        controller.changes.mode.emit()

    def travel(self, way: Callable[[History[Knots]], object]) -> None:
        """Go back or on through the moves of the knots."""
        way(self.steps)
        self._put()

    def _put(self) -> None:
        """Show the knots where they are by now."""
        layer = self._slot.layer
        if layer is not None:
            with layer.events.data.blocker():
                layer.selected_data = set()
                layer.data = in_stack(self._work.image, self._record.frame, self.steps.value)
                self._paint()
            self._show()
            self._controller.changes.mode.emit()

    def _paint(self) -> None:
        layer = self._slot.layer
        if layer is not None:
            layer.face_color = [HEAD, *[COLOUR] * max(len(layer.data) - 1, 0)]
            layer.size = SIZE * screen_pixel(self._controller.viewer, self._work.image)[-1]

    def _value(self) -> Knots:
        """(K, 2) the knots in their layer, px."""
        layer = self._slot.layer
        return self.steps.value if layer is None else np.array(layer.data[:, -2:], dtype=float)

    def _curve(self) -> Curve:
        return moved(self._record.curve, self._value())

    def _show(self) -> None:
        self._work.move(self._record.frame, [self._curve().points])

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
        if self._controller.knots is not self:
            return
        knots = _in_order(self.steps.value, self._value())
        if len(knots) < FEWEST:
            self._controller.say(f"A curve has at least {FEWEST} knots.")
        else:
            self.steps.apply("move knots", knots)
        self._put()

    def _on_removed(self) -> None:
        if self._slot.layer is None:
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

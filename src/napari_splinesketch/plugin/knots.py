"""Knots of a curve, to be dragged by hand."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from napari.layers import Points
from napari.layers.base import ActionType
from superqt.utils import qdebounced

from napari_splinesketch import palette
from napari_splinesketch.editing import moved
from napari_splinesketch.plugin import choices, commands
from napari_splinesketch.plugin.layers import space
from napari_splinesketch.plugin.layers.pictures import Made, Maker, Slot
from napari_splinesketch.plugin.layers.results import Work
from napari_splinesketch.plugin.model import Record, State, key_of

if TYPE_CHECKING:
    from napari_splinesketch.plugin.controller import Controller

FEWEST = 3  # knots of any curve
HELP = "Drag the knots. Enter refines from there, Done keeps the curve as it is, Esc undoes it all."
COLOUR, HEAD = palette.MOVING, palette.TRUTH  # the first knot is the head: it stands out
LOOK = {"border_width": 0.15, "border_color": "black", "visible": True}
SIZE = 11.0  # of a knot, px of the screen: napari's own limits would draw nothing but its border
DONE = (ActionType.ADDED, ActionType.CHANGED, ActionType.REMOVED)


class KnotEditing:
    """Shows the knots of a curve until the user is done; every drag is a step that she can undo."""

    def __init__(self, controller: Controller, work: Work, record: Record):
        viewer, layers = controller.viewer, controller.viewer.layers
        self.number, self._key, self._begun = record.id, key_of(record), record
        self._step = f"Move knots of curve {record.id}"
        self._moves = set[State]()  # what each drag led to
        self._controller, self._work = controller, work
        self._active = layers.selection.active
        # Later: napari is still busy with the edit that it tells of.
        self._soon = qdebounced(self._take, 0)
        maker = Maker(Points, f"knots of curve {record.id}", lambda work: [object()], self._made)
        self._slot = Slot("knots", maker, work)
        next(self._slot.update())
        layer = self._slot.layer
        steps = np.linalg.norm(np.diff(record.curve.knots[:, :2], axis=0), axis=1)
        apart = float(np.median(steps) / space.screen_pixel(viewer, work.image)[-1])
        if apart < SIZE:  # nobody could take hold of one
            viewer.scene.camera.zoom *= 2 * SIZE / apart
            space.look_at(viewer, work.image, record.frame, record.curve.points)
        none = "Control-V", lambda: None  # no more knots are taken, and in films napari fails
        for key, run in (("Enter", self.refine), ("Escape", self.discard), none):
            layer.bind_key(key, lambda _, run=run: run(), overwrite=True)
        layers.selection.active = layer
        layer.mode = "select"
        layer.mouse_drag_callbacks.append(self._follow)
        self._end = choices.listen(
            (viewer.scene.camera.events.zoom, self._show),
            (layer.events.data, lambda event: self._soon() if event.action in DONE else None),
            (layers.events.removed, self._show),
            (controller.changes.curves, self._show),
        )
        self._show()
        controller.tell(HELP, "none")

    def close(self) -> None:
        """Show the knots no longer; the curve stays as they are."""
        controller, layers = self._controller, self._controller.viewer.layers
        self._soon.flush(restart_timer=False)
        if controller.knots is not self:
            return
        controller.knots = None
        self._end()
        self._work.move()
        self._slot.remove()
        if self._active in layers:
            layers.selection.active = self._active
        controller.tell()
        controller.changes.mode.emit()

    def refine(self) -> None:
        """Refine the curve from where its knots are, and no other."""
        self.close()
        space.go_to_frame(self._controller.viewer, self._work.image, self._key[0])
        self._controller.select((self._key,))
        self._controller.refine("selected")

    def discard(self) -> None:
        """Leave the curve as it was; what was done with its knots cannot be redone either."""
        history = self._work.history
        self._soon.cancel()
        while history.value in self._moves:
            history.undo()
        if self._moves and history.undone == self._step:
            history.amend(history.value)  # lets nothing be done again
        self.close()
        self._controller.show(self._work)

    @property
    def _record(self) -> Record | None:
        return self._work.state.by_key.get(self._key)

    def _made(self, work: Work, _: object) -> Made | None:
        record = self._record
        if record is None or self._slot.unfit or record.frame >= space.frame_count(work.image):
            return None
        if record is not self._begun and (record.locked or record.review != "open"):
            return None  # decided on meanwhile
        places = space.in_stack(work.image, record.frame, record.curve.knots[:, :2])
        size = SIZE * space.screen_pixel(work.viewer, work.image)[-1]
        colours = [HEAD, *[COLOUR] * (len(places) - 1)]
        return Made(places, {"face_color": colours, "size": float(size)}, LOOK)

    def _show(self, event: object = None) -> None:
        """Show the knots where they are by now; none where the curve is gone, or their layer."""
        if self._slot.layer is not None:
            with self._slot.layer.events.data.blocker():
                next(self._slot.update())
                self._slot.place()  # the image may lie elsewhere by now
        if self._slot.layer is None or self._record is None:
            self.close()
        else:
            self._work.move(self._key[0], [self._record.curve.points])

    def _follow(self, layer: Points, event: Any) -> Iterator[None]:
        """Draw the curve at every move: napari's own event comes when the button is released."""
        curve = self._work.state.by_key[self._key].curve
        yield
        while event.type == "mouse_move":
            self._work.move(self._key[0], [moved(curve, layer.data[:, -2:]).points])
            yield

    def _take(self) -> None:
        c, layer, record = self._controller, self._slot.layer, self._record
        if c.knots is not self or layer is None or record is None:
            return
        knots = np.array(layer.data[:, -2:], dtype=float)
        before = len(record.curve.knots)
        if min(FEWEST, before) <= len(knots) <= before:
            fresh = commands.edited(record, moved(record.curve, knots))
            state = self._work.state.with_records(fresh)
            self._moves.add(state)
            c.apply(self._step, state, work=self._work)
            c.tell(HELP, "none")
        else:
            c.say(f"Move or delete knots; at least {min(FEWEST, before)} must stay.")
            self._show()

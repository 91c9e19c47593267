"""The curves of an image, and the layers that show them."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from time import perf_counter
from typing import Any

import numpy as np
from napari.components import ViewerModel
from napari.layers import Image, Shapes
from napari.layers.base import ActionType
from superqt.utils import qdebounced, qthrottled

from napari_splinesketch.geometry import thinned
from napari_splinesketch.plugin import columns, model
from napari_splinesketch.plugin.layers import drawn, looks
from napari_splinesketch.plugin.layers.pictures import MAKERS
from napari_splinesketch.plugin.layers.slot import Following, Slot, undisturbed
from napari_splinesketch.plugin.layers.space import (
    Ruler,
    in_stack,
    screen_pixel,
    size_of,
    to_pixels,
)
from napari_splinesketch.plugin.model import (
    Changes,
    History,
    Key,
    Record,
    State,
    bytes_beside,
    key_of,
)

OVER = ("outlines", "curves", "selected", "marks")
"""The layers over all others, from below to above. The halos of those selected have one of their
own: to change one shape, napari draws a whole layer of shapes anew."""
EDITS = (ActionType.ADDED, ActionType.CHANGED, ActionType.REMOVED)
AT_ONCE = 0.02
"""Spent on outlines at each step, s."""
AFTER_MS = 120
"""Marks and halos follow the camera when it has stood still for so long."""


class CurveLines(Slot):
    """A line for each curve, brought in step with what is known: some go, some come."""

    _shown: Sequence[Record] = ()
    """In the order of the layer."""
    _stale = False
    """Whether the user has changed them: all come anew."""

    def make(self, *data: Any, **how: Any) -> Any:
        """Add the layer, with nothing in it."""
        self._shown, self._stale = (), False
        return super().make(*data, **how)

    def keys(self) -> list[Key]:
        """(frame, id) of the curves that are there."""
        return [] if self.layer is None else list(map(key_of, self._shown))

    def selection(self) -> tuple[Key, ...]:
        """(frame, id) of the curves that are selected."""
        keys = self.keys()
        chosen = sorted(self.layer.selected_data) if keys else ()
        return tuple(keys[i] for i in chosen if i < len(keys))

    def show(self, records: Sequence[Record], look: columns.Look) -> Iterator[None]:
        """Show these curves, and no others; some come at each step."""
        layer = self.layer
        wanted = {id(record.curve): record for record in records}
        if self._stale or layer.nshapes != len(self._shown):
            gone, self._shown, self._stale = list(range(layer.nshapes)), (), False
        else:
            gone = [i for i, r in enumerate(self._shown) if id(r.curve) not in wanted]
        if gone:
            layer.selected_data = set()
            layer.remove(gone)
            self._shown = [r for r in self._shown if id(r.curve) in wanted]
        there = {id(record.curve) for record in self._shown}
        fresh = [record for record in records if id(record.curve) not in there]
        curves = [record.curve for record in fresh]
        unit = looks.breadth(curves)
        for done in drawn.add_shapes(
            layer,
            self._lines(fresh),
            ["path"] * len(fresh),
            edge_color=columns.colours_of(fresh, look),
            face_color="transparent",
            edge_width=[unit * looks.BREADTHS[curve.status] for curve in curves],
        ):
            self._shown = [*self._shown, *fresh[done]]
            columns.features(fresh[done])  # a few are measured at a time: below, all are asked for
            yield
        self._describe([wanted[id(r.curve)] for r in self._shown], look, bool(gone or fresh))
        if gone:
            yield

    def follow(self, event: Any) -> set[Key]:
        """Take in that the user has changed shapes; give (frame, id) of those that she deleted."""
        before = self.keys()
        if event.action != ActionType.REMOVED or len(before) <= self.layer.nshapes:
            self._stale = True
            return set()
        gone = set(event.data_indices)
        self._shown = [r for i, r in enumerate(self._shown) if i not in gone]
        return set(before).difference(self.keys())

    def _lines(self, records: Sequence[Record]) -> Iterator[np.ndarray]:
        """Draw curves, some at a time when they are needed."""
        for start in range(0, len(records), drawn.CHUNK):
            some = records[start : start + drawn.CHUNK]
            lines = thinned([record.curve.points for record in some])
            for record, line in zip(some, lines, strict=True):
                yield in_stack(self.image, record.frame, line)

    def _describe(self, records: list[Record], look: columns.Look, changed: bool) -> None:
        """Let features and colours say what is known now."""
        layer: Any = self._layer
        if changed or records != self._shown or layer.features.empty:
            layer.features = columns.features(records)
            self._shown = records
        colours = looks.rgba(columns.colours_of(records, look))
        if not np.allclose(layer.edge_color, colours):
            layer.edge_color = colours


class Work:
    """The curves of an image, how they came about, and the layers that show them.

    The layers of results come with the first of them; the suggested lines are among the sketches.
    `selection` are (frame, id) of curves that are selected; some may be gone. `look` is what the
    colours of curves say, `made` are the layers that are made of what is known. What the user does
    in the layers is told to whoever listens to `changes`: one dock.
    """

    def __init__(self, image: Image, sketches: Shapes, viewer: ViewerModel):
        self.image, self.sketches, self.viewer = image, sketches, viewer
        self.changes = Changes()
        self.selection: tuple[Key, ...] = ()
        self.history: History[State] = History(State(), bytes_beside)
        self.look: columns.Look = ("status", Ruler())
        self.moving: list[tuple[int, model.Line]] = []
        self._suggested: dict[model.Suggestion, np.ndarray] = {}
        self.made = {role: Following(viewer, role, maker, self) for role, maker in MAKERS.items()}
        self.curves = CurveLines(viewer, image, "curves", f"{self.name} curves", Shapes, self)
        self._slots: dict[str, Slot] = {**self.made, "curves": self.curves}
        self._busy = False
        self._soon_marked = qdebounced(self.mark, drawn.BREATH_MS)
        self._soon_seen = qthrottled(self._update, AFTER_MS, leading=False)
        for moved in (viewer.scene.camera.events, viewer.dims.events.current_step):
            moved.connect(self._on_move)

    @property
    def name(self) -> str:
        """What names of layers begin with."""
        return self.sketches.name.removesuffix(drawn.SUFFIX)

    @property
    def screen(self) -> float:
        """What a pixel of the screen covers, px of the image, in steps."""
        return looks.stepped(float(screen_pixel(self.viewer, self.image).mean()))

    @property
    def state(self) -> State:
        """What is known now."""
        return self.history.value

    @property
    def records(self) -> tuple[Record, ...]:
        """The curves of all frames."""
        return self.state.records

    @property
    def selected(self) -> tuple[Record, ...]:
        """The curves that are selected."""
        known = self.state.by_key
        return tuple(known[key] for key in self.selection if key in known)

    def layer(self, role: str) -> Any:
        """Give the layer of a role, or None where there is none or the user removed it."""
        return self.sketches if role == "sketches" else self._slots[role].layer

    def remove(self) -> None:
        """Remove the layers of results; they are made anew when there is something to show."""
        with self._by_us():
            for slot in self._slots.values():
                slot.remove()

    def ask(self, role: str, on: bool) -> bool:
        """Show or hide a layer, made now where it has to be; False if there is nothing to show."""
        if self.layer(role) is None and on and self.image in self.viewer.layers:
            self.made[role].update()
        elif (layer := self.layer(role)) is not None:
            layer.visible = on
        self.changes.shown.emit()
        return self.layer(role) is not None or not on

    def show(self) -> Iterator[None]:
        """Bring the layers in step with what is known by then, a little at each step.

        napari takes about 0.1 s to add a layer and as long to draw it first, and longer beside
        full ones: the window may live in between, and layers are added before any is filled.
        """
        yield from self._suggest()
        for step in (self._prepare(), self._add(), self._follow(), self._fill()):
            while self.image in self.viewer.layers:
                with self._by_us():
                    if next(step, step) is step:
                        break
                yield
            yield
        self._fade()

    def _follow(self, *roles: str) -> Iterator[None]:
        """Let what is made of the work follow it; where roles are named, those that are in view."""
        for role in roles or self.made:
            slot = self.made[role]
            always = not (roles or slot.maker.title) and (slot.layer or role not in OVER)
            there = (slot.shown or always) and self.image in self.viewer.layers
            if there and slot.update():
                yield

    def _update(self, *roles: str) -> None:
        with self._by_us():
            for _ in self._follow(*roles):
                pass

    def move(self, frame: int = 0, lines: Sequence[model.Line] = ()) -> None:
        """Show lines of a frame that are on their way, px; none once they have arrived."""
        slot = self.made["preview"]
        if not lines or slot.layer is not None or not slot.made:  # the user has not removed it
            self.moving = [(frame, line) for line in looks.coarse(lines)]
            with self._by_us():
                slot.update()

    def colour(self, look: columns.Look) -> bool:
        """Choose what the colour of a curve says; say whether `show` has to be called for it."""
        before, self.look = self.look, look
        return self.curves.made and before != look

    def deleted(self) -> bool:
        """Whether the user has removed the layer of curves, and so the results."""
        return self.curves.made and self.curves.layer is None

    def select(self, keys: tuple[Key, ...]) -> None:
        """Select curves, here and, soon where there are many, in their layer."""
        if keys != self.selection:
            self.selection = keys
            self._update("selected", "body")
            self.changes.selection.emit()
        if len(self.records) < drawn.MANY:
            self.mark()
        else:
            self._soon_marked()

    def mark(self) -> None:
        """Select in the layer of curves those that are selected."""
        layer, chosen = self.curves.layer, set(self.selection)
        if layer is not None and chosen != set(self.curves.selection()):
            # napari takes a selection for an edit of its look and writes all text anew: 0.2 s
            # with 1,000 curves.
            with self._by_us(), layer.events.edge_width.blocker():
                there = self.curves.keys()
                layer.selected_data = {i for i, key in enumerate(there) if key in chosen}
            layer.events.highlight()

    def _add(self) -> Iterator[None]:
        """Add the layers that are not there, hidden; each is drawn once while it is empty."""
        for role in OVER if self.records else ():
            slot = self._slots[role]
            if slot.layer is None:
                layer = slot.make(visible=False)
                if slot is self.curves:
                    layer.events.data.connect(self._on_data)
                    layer.selected_data.events.items_changed.connect(self._on_selected)
                    layer.mouse_drag_callbacks.append(self._on_press)
                yield
                if role == "marks":
                    self.made[role].update()  # to write text and to draw it first takes 0.1 s each
                    yield
                if slot.layer is layer:
                    layer.visible = True
                    yield

    def positions(self, suggestions: Collection[model.Suggestion]) -> list[int]:
        """Say where among the sketches lines are that were suggested, and are as they were.

        A line that the user has moved, changed or deleted is hers: it is not touched again.
        """
        prints = {self._suggested[one].tobytes() for one in suggestions if one in self._suggested}
        data = self.sketches.data if prints else ()
        return [i for i, shape in enumerate(data) if np.float32(shape).tobytes() in prints]

    def _suggest(self) -> Iterator[None]:
        """Add and remove suggested lines, some at each step."""
        layer, wanted = self.sketches, self.state.suggestions
        if not {self.image, layer} <= set(self.viewer.layers):
            return
        gone = set(self._suggested).difference(wanted)
        old = self.positions(gone)
        for one in gone:
            del self._suggested[one]
        if old:
            layer.selected_data = set()
            layer.remove(old)
            yield
        if fresh := [one for one in wanted if one not in self._suggested]:
            points = np.concatenate([in_stack(self.image, one.frame, one.line) for one in fresh])
            vertices = to_pixels(self.viewer, self.image, layer, points).astype(np.float32)
            shapes = np.split(vertices, np.cumsum([len(one.line) for one in fresh])[:-1])
            self._suggested |= dict(zip(fresh, shapes, strict=True))
            style = drawn.line_style(size_of(self.image))
            for _ in drawn.add_shapes(layer, shapes, ["path"] * len(shapes), **style):
                yield

    def _fade(self) -> None:
        """Let the lines that have become curves step back behind them, and no others."""
        layer = self.sketches
        if not {self.image, layer} <= set(self.viewer.layers) or not layer.nshapes:
            return
        refined = {(r.frame, model.print_of_sketch(r)) for r in self.records if r.drawn}
        frames, lines = zip(*drawn.shapes_in(self.viewer, layer, self.image), strict=True)
        back = [pair in refined for pair in zip(frames, model.prints_of(lines), strict=True)]
        colours = np.array(layer.edge_color)
        before = np.round(colours[:, 3], 3)
        # A transparency that the user has chosen stays.
        ours = np.isin(before, (1.0, drawn.FADED))
        wanted = np.where(ours, np.where(back, drawn.FADED, 1.0), before)
        if (wanted != before).any():
            colours[:, 3] = wanted
            layer.edge_color = colours

    def _prepare(self) -> Iterator[None]:
        """Work out, once, what takes long for many curves."""
        began = perf_counter()
        for record in self.records:
            if looks.has_outline(record.curve):
                looks.outline(record.curve)
            if perf_counter() - began > AT_ONCE:
                yield
                began = perf_counter()

    def _fill(self) -> Iterator[None]:
        if self.curves.layer is not None:
            yield from self.curves.show(self.records, self.look)

    @contextmanager
    def _by_us(self) -> Iterator[None]:
        """Change layers without taking our own edits for the user's."""
        before, self._busy = self._busy, True
        try:
            with undisturbed(self.viewer):
                yield
        finally:
            self._busy = before

    def _on_move(self, event: object) -> None:
        if self.records:
            self._soon_seen("marks", "selected")  # what depends on the camera

    def on_visible(self, event: Any) -> None:
        """Follow the eye of a layer: halos and marks go with their curves."""
        if self._busy:
            return
        with self._by_us():
            for mark in (self.layer("selected"), self.layer("marks")):
                if event.source is self.curves.layer and mark is not None:
                    mark.visible = event.source.visible
            self._update()
        self.changes.shown.emit()

    def _on_data(self, event: Any) -> None:
        if not self._busy and event.action in EDITS:
            self.changes.touched.emit(self, self.curves.follow(event))

    def _on_press(self, layer: Shapes, event: Any) -> Iterator[None]:
        """Tell a click from a drag, where napari itself only moves the camera."""
        begin, shift = np.array(event.pos), "Shift" in event.modifiers
        far = 0.0
        yield
        while event.type == "mouse_move":
            far = max(far, float(np.linalg.norm(np.array(event.pos) - begin)))
            yield
        if layer.mode == "pan_zoom" and far < drawn.CLICK:
            self.changes.clicked.emit(shift)

    def _on_selected(self) -> None:
        if not self._busy:
            self.select(self.curves.selection())

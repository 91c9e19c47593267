"""The layers that show curves: their lines, outlines, marks and the halo of those selected."""

from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from napari.components import ViewerModel
from napari.layers import Layer, Shapes
from napari.layers.base import ActionType
from psygnal import Signal
from qtpy.QtCore import QTimer

from napari_splinesketch import palette
from napari_splinesketch.engine.types import Curve
from napari_splinesketch.plugin.columns import Look, colours_of, features, in_pixels
from napari_splinesketch.plugin.layers.drawn import BREATH_MS, CHUNK, add_shapes
from napari_splinesketch.plugin.layers.looks import (
    BREADTHS,
    Pieces,
    breadth,
    halo,
    has_outline,
    outline,
    pieces,
    thinned,
    vectors,
)
from napari_splinesketch.plugin.layers.marks import Marks
from napari_splinesketch.plugin.layers.slot import Known, Lines, Role, Slot, undisturbed
from napari_splinesketch.plugin.layers.space import Ruler, in_stack
from napari_splinesketch.plugin.model import Key, Record, key_of

EDITS = (ActionType.ADDED, ActionType.CHANGED, ActionType.REMOVED)
CLICK = 4.0
"""A mouse that moves less between press and release has clicked, px of the screen."""
AT_ONCE = 100
"""Outlines worked out at each step."""
THIN, GAP = 0.5, 1.2
"""Breadth of outlines and halos, and from a body's edge to its halo, relative to a curve's line."""


class CurveLines(Slot):
    """A line for each curve, brought in step with what is known: some go, some come."""

    _shown: Sequence[Record] = ()
    """In the order of the layer."""
    _described: Sequence[Record] = ()
    """Those that its features speak of."""
    _colours: Sequence[str] = ()
    _written: frozenset[Key] = frozenset()

    def make(self, kind: type[Layer] = Shapes, *data: Any, **how: Any) -> Any:
        """Add the layer, with nothing in it."""
        self._shown, self._written = (), frozenset()
        return super().make(kind, *data, **how)

    def keys(self) -> list[Key]:
        """(frame, id) of the curves that are there."""
        known = {} if self.layer is None else self.layer.features
        return list(zip(known["frame"], known["id"], strict=True)) if "id" in known else []

    def missing(self) -> set[Key]:
        """(frame, id) of the curves that the user has deleted."""
        return set(self._written.difference(self.keys())) if self.layer is not None else set()

    def records(self, keys: Collection[Key]) -> list[Record]:
        """Give some of the curves that are there."""
        return [record for record in self._shown if key_of(record) in keys]

    def show(self, records: Sequence[Record], look: Look) -> Iterator[None]:
        """Show these curves, and no others; some come at each step."""
        layer = self.layer
        if layer.nshapes != len(self._shown):
            self._shown = self._colours = self._described = ()
            gone = list(range(layer.nshapes))
        else:
            wanted = {id(record.curve) for record in records}
            gone = [i for i, r in enumerate(self._shown) if id(r.curve) not in wanted]
        if gone:
            layer.selected_data = set()
            layer.remove(gone)
            self._drop(gone)
        there = {id(record.curve) for record in self._shown}
        fresh = [record for record in records if id(record.curve) not in there]
        curves = [record.curve for record in fresh]
        colours, unit = colours_of(fresh, look), breadth(curves)
        for done in add_shapes(
            layer,
            self._drawn(fresh),
            ["path"] * len(fresh),
            edge_color=colours,
            face_color="transparent",
            edge_width=[unit * BREADTHS[curve.status] for curve in curves],
        ):
            self._shown = [*self._shown, *fresh[done]]
            self._colours = [*self._colours, *colours[done]]
            for record in fresh[done]:
                in_pixels(record)  # a few at a time: they are asked for all at once below
            yield
        now = {id(record.curve): record for record in records}
        self._describe([now[id(record.curve)] for record in self._shown], look)
        if gone:
            yield

    def follow(self, *, removed: bool) -> None:
        """Take in that the user has changed shapes: deleted some, or others, which come anew."""
        left = set(self.keys())
        if removed and len(left) < len(self._shown):
            self._drop([i for i, r in enumerate(self._shown) if key_of(r) not in left])
        else:
            self._shown = ()

    def _drawn(self, records: Sequence[Record]) -> Iterator[np.ndarray]:
        """Draw curves, some at a time when they are needed."""
        for start in range(0, len(records), CHUNK):
            some = records[start : start + CHUNK]
            for record, line in zip(some, thinned([r.curve.points for r in some]), strict=True):
                yield in_stack(self.image, record.frame, line)

    def _drop(self, positions: Collection[int]) -> None:
        """Forget what was at some positions of the layer."""
        kept = [i for i in range(len(self._shown)) if i not in set(positions)]
        self._shown = [self._shown[i] for i in kept]
        self._colours = [self._colours[i] for i in kept]
        self._described = ()

    def _describe(self, records: list[Record], look: Look) -> None:
        """Let features and colours say what is known now."""
        layer: Any = self._layer
        if records != self._described or layer.features.empty:
            layer.features = features(records)
            self._shown = self._described = records
            self._written = frozenset(map(key_of, records))
        colours = colours_of(records, look)
        if colours and colours != self._colours:
            self._colours = layer.edge_color = colours


class Outlines(Lines):
    """The edges of the bodies, at a half-width to both sides of their curves."""

    def __init__(self, *arguments: Any):
        super().__init__(*arguments)
        self._known: WeakKeyDictionary[Curve, Pieces] = WeakKeyDictionary()

    def show(self, records: Sequence[Record], look: Look) -> Iterator[None]:
        """Show the outlines of these curves, and no others; all come at the last step."""
        kept = [record for record in records if has_outline(record.curve)]
        fresh = [record for record in kept if record.curve not in self._known]
        for start in range(0, len(fresh), AT_ONCE):
            some = fresh[start : start + AT_ONCE]
            for record, line in zip(some, thinned([outline(r.curve) for r in some]), strict=True):
                self._known[record.curve] = vectors(in_stack(self.image, record.frame, line))
            yield
        curves = [record.curve for record in kept]
        lines = [self._known[curve] for curve in curves]
        self.draw(lines, colours_of(kept, look), THIN * breadth(curves))


class Highlight(Lines):
    """A thin halo outside each selected body, in a layer of its own.

    To change one shape, napari draws a whole layer of shapes anew.
    """

    _cut: tuple[tuple[int, ...], Sequence[Pieces]] = (), ()

    def show(self, records: Sequence[Record]) -> None:
        """Mark these curves, and no others."""
        marked, unit = tuple(id(r.curve) for r in records), breadth([r.curve for r in records])
        if marked != self._cut[0]:
            lines = [in_stack(self.image, r.frame, halo(r.curve, GAP * unit)) for r in records]
            self._cut = marked, pieces(lines)
        self.draw(self._cut[1], [palette.MOVING] * len(records), THIN * unit)


class ResultLayers:
    """Shows the curves of an `owner` in layers, whose names begin with its name."""

    edited = Signal()
    """The user has changed the layer of curves."""
    toggled = Signal()
    """A layer was shown or hidden."""
    selected = Signal()
    """The user has selected other curves in their layer."""
    clicked = Signal(bool)
    """The user has clicked into the layer of curves while moving the camera; with Shift, or not."""

    def __init__(self, viewer: ViewerModel, owner: Known):
        self._viewer, self._image, self._owner = viewer, owner.image, owner
        self._look: Look = ("status", Ruler())
        self._veiled = self._busy = False

        def slot(kind: Any, role: Role) -> Any:
            return kind(viewer, owner.image, role, f"{owner.name} {role}", owner)

        self._curves: CurveLines = slot(CurveLines, "curves")
        self._outlines: Outlines = slot(Outlines, "outlines")
        self._highlight: Highlight = slot(Highlight, "selected")
        self._marks: Marks = slot(Marks, "marks")
        self.slots: dict[Role, Slot] = {
            "curves": self._curves,
            "outlines": self._outlines,
            "selected": self._highlight,
            "marks": self._marks,
        }

    def colour(self, look: Look) -> bool:
        """Choose what the colour of a curve says; say whether `show` has to be called for it."""
        before, self._look = self._look, look
        return self._curves.made and before != look

    def show(self) -> Iterator[None]:
        """Show what is known by then, in the layers that exist or in new ones, layer by layer.

        napari takes about 0.1 s to add a layer and as long to draw it first, and longer beside
        full ones: the window may live in between, and layers are added before any is filled.
        """
        for step in (self._add(), self._fill_outlines(), self._fill_curves()):
            while self._image in self._viewer.layers:
                with self._by_us():
                    if next(step, step) is step:
                        break
                yield
            yield

    def deleted(self) -> bool:
        """Whether the user has removed the layer of curves, and so the results."""
        return self._curves.made and self._curves.layer is None

    def forget(self) -> None:
        """Make all lines anew when there is something to show again."""
        with self._by_us():
            for slot in self.slots.values():
                slot.remove()

    def missing(self) -> set[Key]:
        """(frame, id) of the curves that the user has deleted from their layer."""
        return self._curves.missing()

    def selection(self) -> tuple[Key, ...]:
        """(frame, id) of the curves that are selected in their layer."""
        keys, layer = self._curves.keys(), self._curves.layer
        return tuple(keys[i] for i in sorted(layer.selected_data) if i < len(keys)) if keys else ()

    def select(self, keys: Collection[Key]) -> None:
        """Select curves in their layer."""
        layer, chosen = self._curves.layer, set(keys)
        if layer is not None and chosen != set(self.selection()):
            # napari takes a selection for an edit of its look and writes all text anew: 0.2 s
            # with 1,000 curves.
            with self._by_us(), layer.events.edge_width.blocker():
                there = self._curves.keys()
                layer.selected_data = {i for i, key in enumerate(there) if key in chosen}
            layer.events.highlight()
        self.emphasise()

    def emphasise(self) -> None:
        """Mark the selected curves: napari does so in some of its tools only."""
        if self._curves.layer is None:
            return
        records = self._curves.records(self.selection())
        if records and self._highlight.layer is None:
            # A layer takes napari about 0.1 s: the window lives before it is filled.
            with self._by_us():
                self._highlight.make()
            QTimer.singleShot(BREATH_MS, self.emphasise)
            return
        self._highlight.show(records)

    def _add(self) -> Iterator[None]:
        """Add the layers that are not there, hidden while they are empty."""
        if not self._owner.records:
            return
        if self._outlines.layer is None:
            layer, self._veiled = self._outlines.make(visible=False), True
            layer.events.visible.connect(self._on_visible)
            yield
        if self._curves.layer is None:
            layer = self._curves.make(visible=False)
            layer.events.visible.connect(self._on_visible)
            layer.events.data.connect(self._on_data)
            layer.selected_data.events.items_changed.connect(self._on_selected)
            layer.mouse_drag_callbacks.append(self._on_press)
            try:
                yield
            finally:
                layer.visible = True
            yield
        for slot in (self._highlight, self._marks):
            if slot.layer is None:
                slot.make()
                yield

    def _fill_outlines(self) -> Iterator[None]:
        if self._outlines.layer is not None:
            yield from self._outlines.show(self._owner.records, self._look)
        if self._veiled and self._outlines.layer is not None:
            self._veiled, self._outlines.layer.visible = False, True

    def _fill_curves(self) -> Iterator[None]:
        if self._curves.layer is not None:
            yield from self._curves.show(self._owner.records, self._look)
            self.emphasise()
            yield
            self._marks.show(self._owner.records)

    @contextmanager
    def _by_us(self) -> Iterator[None]:
        """Change layers without taking our own edits for the user's."""
        self._busy = True
        try:
            with undisturbed(self._viewer):
                yield
        finally:
            self._busy = False

    def _on_visible(self, event: Any) -> None:
        if self._busy:
            return
        for mark in (self._highlight.layer, self._marks.layer):
            if event.source is self._curves.layer and mark is not None:
                mark.visible = event.source.visible
        self.toggled.emit()

    def _on_data(self, event: Any) -> None:
        if not self._busy and event.action in EDITS:
            self._curves.follow(removed=event.action == ActionType.REMOVED)
            self.edited.emit()

    def _on_press(self, layer: Shapes, event: Any) -> Iterator[None]:
        """Tell a click from a drag, where napari itself only moves the camera."""
        begin, shift = np.array(event.pos), "Shift" in event.modifiers
        far = 0.0
        yield
        while event.type == "mouse_move":
            far = max(far, float(np.linalg.norm(np.array(event.pos) - begin)))
            yield
        if layer.mode == "pan_zoom" and far < CLICK:
            self.clicked.emit(shift)

    def _on_selected(self) -> None:
        if not self._busy:
            self.selected.emit()

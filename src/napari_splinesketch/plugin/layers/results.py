"""The layers that show curves: their lines, outlines, marks and the halo of those selected."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from time import perf_counter
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from jaxtyping import Float
from napari.components import ViewerModel
from napari.layers import Points, Shapes
from napari.layers.base import ActionType
from psygnal import Signal, SignalInstance
from qtpy.QtCore import QTimer
from superqt.utils import qthrottled

from napari_splinesketch import palette
from napari_splinesketch.engine.types import Curve
from napari_splinesketch.plugin.columns import Look, colours_of, severity
from napari_splinesketch.plugin.layers import looks
from napari_splinesketch.plugin.layers.drawn import BREATH_MS, CLICK
from napari_splinesketch.plugin.layers.looks import COLOURS, MARKS, Line
from napari_splinesketch.plugin.layers.pictures import MAKERS, Proof, ProofRole
from napari_splinesketch.plugin.layers.slot import CurveLines, Lines, Role, Slot, undisturbed
from napari_splinesketch.plugin.layers.space import Ruler, View, in_stack, view_of
from napari_splinesketch.plugin.model import Key, Record

if TYPE_CHECKING:
    from napari_splinesketch.plugin.keeper import Work

EDITS = (ActionType.ADDED, ActionType.CHANGED, ActionType.REMOVED)
AT_ONCE = 0.02
"""Spent on outlines at each step, s."""
THIN, GAP = 0.5, 1.2
"""Breadth of outlines and halos, and from a body's edge to its halo, relative to a curve's line."""
LETTER, LINE_HEIGHT, BESIDE = 9.0, 16.0, 2.0
"""Width and height of a letter, and how far a mark is from its body, px of the screen."""
MOST = 60
"""Marks at once: more are not read, and napari's time for text grows with their number."""
PLACES = (0.5, 0.02, 0.98, 0.25, 0.75)
"""Where along a curve a mark may stand, the best first."""
AFTER_MS = 120
"""Marks follow the camera when it has stood still for so long."""


def readable(
    records: Sequence[Record], view: View
) -> Iterator[tuple[Record, Float[np.ndarray, 2]]]:
    """Choose the curves whose marks can be read, the worst first, and where each mark stands."""
    here = [r for r in records if r.frame == view.frame and MARKS[r.curve.status]]
    if not here:
        return
    ends = np.stack([_stands(r.curve)[0] for r in here])
    near = ((ends > view.low) & (ends < view.high)).all(axis=2).any(axis=-1)
    here = [here[i] for i in np.flatnonzero(near).tolist()]
    taken, sizes, count = np.zeros((MOST, 2)), np.zeros((MOST, 2)), 0
    for record in sorted(here, key=lambda r: severity(r.curve), reverse=True):
        size = np.array([LINE_HEIGHT, LETTER * len(_text(record))]) * view.pixel / 2
        places = _places(record.curve, size, view)
        free = ((places - size > view.low) & (places + size < view.high)).all(axis=1)
        over = np.abs(places[:, None] - taken[:count]) < size + sizes[:count]
        free &= ~over.all(axis=2).any(axis=-1)
        if free.any():
            own = np.abs(places[:, None] - record.curve.points) < size
            clear = free & ~own.all(axis=2).any(axis=-1)  # of its own body, where that is bent
            best = places[(clear if clear.any() else free).argmax()]
            taken[count], sizes[count] = best, size
            yield record, best
            count += 1
        if count == MOST:
            return


def _text(record: Record) -> str:
    return f"{record.id} {MARKS[record.curve.status]}"


@looks.once
def _stands(curve: Curve) -> tuple[Float[np.ndarray, "S 2"], Float[np.ndarray, "S 2"]]:
    """Points of a curve beside which its mark may stand, and the way there: above it first."""
    at = np.round(np.array(PLACES) * (len(curve.points) - 1)).astype(int)
    across = looks.normals(curve.points)[at]
    return curve.points[at], np.where(across[:, :1] > 0, -across, across)


def _places(curve: Curve, size: Float[np.ndarray, 2], view: View) -> Float[np.ndarray, "_ 2"]:
    """Where the middle of its mark, of half a size of (row, col), may stand; the best one first."""
    points, up = _stands(curve)
    half = (np.abs(up) * size).sum(axis=1, keepdims=True)  # of the mark's box, on the way there
    away = (looks.reach(curve) + BESIDE * float(view.pixel.mean()) + half) * up
    return np.stack([points + away, points - away], axis=1).reshape(-1, 2)


class Marks(Slot):
    """Numbers and signs beside the curves that need review, as many as can be read.

    They follow camera and frame.
    """

    kind = Points
    style: ClassVar = {"size": 1, "face_color": "transparent", "border_color": "transparent"}
    _records: Sequence[Record] = ()
    _shown: tuple[Any, ...] = ()

    def __init__(self, *arguments: Any):
        super().__init__(*arguments)
        self._soon = qthrottled(self._write, AFTER_MS, leading=False)

    def make(self, *data: Any, **how: Any) -> Any:
        """Add the layer, with nothing in it, and follow what is in view."""
        self._shown = ()
        self.viewer.scene.camera.events.connect(self._on_move)
        self.viewer.dims.events.current_step.connect(self._on_move)
        made = super().make(*data, **how)
        made.events.visible.connect(self._on_move)
        return made

    def show(self, records: Sequence[Record]) -> None:
        """Mark these curves, and no others."""
        self._records = records
        self._write()

    def _on_move(self, event: object) -> None:
        if self._records:
            self._soon()

    def _write(self) -> None:
        layer = self.layer
        if layer is None or not layer.visible or self.image not in self.viewer.layers:
            return
        view = view_of(self.viewer, self.image)
        found = list(readable(self._records, view))
        shown = tuple((id(record), *place) for record, place in found)
        if shown == self._shown:
            return
        self._shown = shown
        places = np.array([place for _, place in found]).reshape(-1, 2)
        with undisturbed(self.viewer):
            layer.selected_data = set()
            layer.text = {"string": {"constant": ""}}
            layer.data = in_stack(self.image, view.frame, places)
            layer.text = {
                "string": [_text(record) for record, _ in found],
                "color": [COLOURS[record.curve.status] for record, _ in found],
                "size": 10,
                "anchor": "center",
            }


KINDS: dict[Role, type[Slot]] = {
    "outlines": Lines,
    "curves": CurveLines,
    "selected": Lines,
    "marks": Marks,
}
"""From below to above. The halos have a layer of their own: to change one shape, napari draws a
whole layer of shapes anew."""


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

    def __init__(self, viewer: ViewerModel, owner: Work):
        self._viewer, self._image, self._owner = viewer, owner.image, owner
        self._look: Look = ("status", Ruler())
        self._busy = False
        self.slots: dict[Role, Any] = {
            role: kind(viewer, owner.image, role, f"{owner.name} {role}", owner)
            for role, kind in KINDS.items()
        }
        self._curves: CurveLines = self.slots["curves"]
        self.proofs = {role: Proof(viewer, role, owner) for role in MAKERS}
        self.missing, self.selection = self._curves.missing, self._curves.selection

    @property
    def signals(self) -> tuple[SignalInstance, ...]:
        """What tells of the user's doings: one keeper listens."""
        return self.toggled, self.edited, self.selected, self.clicked

    def layer(self, role: Any) -> Any:
        """Give the layer of a role, or None where there is none or the user removed it."""
        return (self.slots | self.proofs)[role].layer

    def ask(self, role: ProofRole, on: bool) -> bool:
        """Show or hide what the model says; False if there is nothing to show."""
        proof = self.proofs[role]
        if proof.layer is not None:
            proof.layer.visible = on
        elif on:
            self._update(proof)
        self.toggled.emit()
        return proof.layer is not None or not on

    def prove(self) -> Iterator[None]:
        """Let what the model says follow what is known, where it is in view."""
        for proof in self.proofs.values():
            if proof.wanted:
                self._update(proof)
                yield

    def colour(self, look: Look) -> bool:
        """Choose what the colour of a curve says; say whether `show` has to be called for it."""
        before, self._look = self._look, look
        return self._curves.made and before != look

    def show(self) -> Iterator[None]:
        """Show what is known by then, in the layers that exist or in new ones, layer by layer.

        napari takes about 0.1 s to add a layer and as long to draw it first, and longer beside
        full ones: the window may live in between, and layers are added before any is filled.
        """
        for step in (self.prove(), self._add(), self._fill_outlines(), self._fill_curves()):
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
        """Draw a halo outside each selected body: napari marks them in some of its tools only."""
        if self._curves.layer is None:
            return
        records, halos = self._curves.records(self.selection()), self.slots["selected"]
        if records and halos.layer is None:
            # A layer takes napari about 0.1 s: the window lives before it is filled.
            with self._by_us():
                halos.make()
            QTimer.singleShot(BREATH_MS, self.emphasise)
            return
        curves = [record.curve for record in records]
        unit = looks.breadth(curves)

        def lines() -> Iterator[tuple[int, Line]]:
            around = looks.coarse([looks.halo(curve, GAP * unit) for curve in curves])
            return zip([record.frame for record in records], around, strict=True)

        halos.draw(curves, lines, [palette.MOVING] * len(curves), THIN * unit)

    def _update(self, proof: Proof) -> None:
        before = proof.layer
        if self._image in self._viewer.layers:
            proof.update()
        if proof.layer is not None and proof.layer is not before:
            proof.layer.events.visible.connect(self._on_visible)

    def _add(self) -> Iterator[None]:
        """Add the layers that are not there, hidden; each is drawn once while it is empty."""
        for role, slot in self.slots.items() if self._owner.records else ():
            if slot.layer is None:
                layer = slot.make(visible=False)
                if role in ("outlines", "curves"):
                    layer.events.visible.connect(self._on_visible)
                if role == "curves":
                    layer.events.data.connect(self._on_data)
                    layer.selected_data.events.items_changed.connect(self._on_selected)
                    layer.mouse_drag_callbacks.append(self._on_press)
                yield
                if slot.layer is layer:
                    layer.visible = True
                    yield

    def _fill_outlines(self) -> Iterator[None]:
        kept = [record for record in self._owner.records if looks.has_outline(record.curve)]
        began = perf_counter()
        for record in kept:
            looks.outline(record.curve)  # worked out once
            if perf_counter() - began > AT_ONCE:
                yield
                began = perf_counter()
        curves = [record.curve for record in kept]
        self.slots["outlines"].draw(
            curves,
            lambda: [(record.frame, looks.outline(record.curve)) for record in kept],
            colours_of(kept, self._look),
            THIN * looks.breadth(curves),
        )

    def _fill_curves(self) -> Iterator[None]:
        if self._curves.layer is not None:
            yield from self._curves.show(self._owner.records, self._look)
            self.emphasise()
            yield
            self.slots["marks"].show(self._owner.records)

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
        for mark in (self.slots["selected"].layer, self.slots["marks"].layer):
            if event.source is self._curves.layer and mark is not None:
                mark.visible = event.source.visible
        for _ in self.prove():
            pass
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

"""The layers that show curves: their lines, outlines, marks and the halo of those selected."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from time import perf_counter
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from jaxtyping import Float, Integer
from napari.components import ViewerModel
from napari.layers import Points, Shapes
from napari.layers.base import ActionType
from psygnal import Signal, SignalInstance
from superqt.utils import qthrottled

from napari_splinesketch.engine.types import Curve
from napari_splinesketch.geometry import edges
from napari_splinesketch.plugin import columns
from napari_splinesketch.plugin.layers import looks
from napari_splinesketch.plugin.layers.drawn import CLICK
from napari_splinesketch.plugin.layers.pictures import MAKERS
from napari_splinesketch.plugin.layers.slot import CurveLines, Following, Slot, undisturbed
from napari_splinesketch.plugin.layers.space import Ruler, View, in_stack, view_of
from napari_splinesketch.plugin.model import Key, Record

if TYPE_CHECKING:
    from napari_splinesketch.plugin.keeper import Work

OVER = ("outlines", "curves", "selected", "marks")
"""The layers over all others, from below to above. The halos of those selected have one of their
own: to change one shape, napari draws a whole layer of shapes anew."""
EDITS = (ActionType.ADDED, ActionType.CHANGED, ActionType.REMOVED)
AT_ONCE = 0.02
"""Spent on outlines at each step, s."""
LETTER, LINE_HEIGHT, BESIDE = 9.0, 16.0, 2.0
"""Width and height of a letter, and how far a mark is from its body, px of the screen."""
CELL = 2
"""Size of the cells in which points of curves are counted, px of the screen."""
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
    here = [r for r in records if r.frame == view.frame and looks.MARKS[r.curve.status]]
    if not here:
        return
    ends = np.stack([_stands(r.curve)[0] for r in here])
    near = ((ends > view.low) & (ends < view.high)).all(axis=2).any(axis=-1)
    here = [here[i] for i in np.flatnonzero(near).tolist()]
    taken, sizes, count = np.zeros((MOST, 2)), np.zeros((MOST, 2)), 0
    crowd = _crowd(records, view)
    for record in sorted(here, key=lambda r: columns.severity(r.curve), reverse=True):
        size = np.array([LINE_HEIGHT, LETTER * len(_text(record))]) * view.pixel / 2
        places = _places(record.curve, size, view)
        free = ((places - size > view.low) & (places + size < view.high)).all(axis=1)
        over = np.abs(places[:, None] - taken[:count]) < size + sizes[:count]
        free &= ~over.all(axis=2).any(axis=-1)
        if free.any():
            best = places[np.where(free, crowd(places, size), np.inf).argmin()]
            taken[count], sizes[count] = best, size
            yield record, best
            count += 1
        if count == MOST:
            return


def _crowd(records: Sequence[Record], view: View) -> Callable[..., Integer[np.ndarray, " N"]]:
    """Make what counts the points of curves in boxes around places: marks lie over few of them.

    What lies above and to the left of each cell is added up once, for thousands of boxes.
    """
    cell = CELL * view.pixel
    shape = np.ceil((view.high - view.low) / cell).astype(int)
    points = np.concatenate([r.curve.points for r in records if r.frame == view.frame])
    at = np.floor((points - view.low) / cell).astype(int)
    at = at[((at >= 0) & (at < shape)).all(axis=1)]
    sums = np.zeros(shape + 1, dtype=int)
    np.add.at(sums, tuple(at.T + 1), 1)
    sums = sums.cumsum(axis=0).cumsum(axis=1)

    def count(places: Float[np.ndarray, "N 2"], half: Float[np.ndarray, 2]) -> Any:
        low = np.clip(np.floor((places - half - view.low) / cell).astype(int), 0, shape).T
        high = np.clip(np.ceil((places + half - view.low) / cell).astype(int), 0, shape).T
        return sums[*high] - sums[low[0], high[1]] - sums[high[0], low[1]] + sums[*low]

    return count


def _text(record: Record) -> str:
    return f"{record.id} {looks.MARKS[record.curve.status]}"


@looks.once
def _stands(curve: Curve) -> tuple[Float[np.ndarray, "S 2"], Float[np.ndarray, "S 2"]]:
    """Points of a curve beside which its mark may stand, and the way there: above it first."""
    at = np.round(np.array(PLACES) * (len(curve.points) - 1)).astype(int)
    across = (edges(curve.points, np.ones(len(curve.points)))[0] - curve.points)[at]
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
    _shown: tuple[Any, ...] = ()

    def __init__(self, viewer: ViewerModel, work: Work):
        super().__init__(viewer, work.image, "marks", f"{work.name} marks", work)
        self._work = work
        self._soon = qthrottled(self.update, AFTER_MS, leading=False)

    def make(self, *data: Any, **how: Any) -> Any:
        """Add the layer, with nothing in it, and follow what is in view."""
        self._shown = ()
        made = super().make(*data, **how)
        moves = self.viewer.scene.camera.events, self.viewer.dims.events.current_step
        for moved in (*moves, made.events.visible):
            moved.connect(self._on_move)
        return made

    def _on_move(self, event: object) -> None:
        if self._work.records:
            self._soon()

    def update(self) -> None:
        """Mark the curves in view, and no others."""
        layer = self.layer
        if layer is None or not layer.visible or self.image not in self.viewer.layers:
            return
        view = view_of(self.viewer, self.image)
        found = list(readable(self._work.records, view))
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
                "color": [looks.COLOURS[record.curve.status] for record, _ in found],
                "size": 10,
                "anchor": "center",
            }


class ResultLayers:
    """Shows the curves of a work in layers, whose names begin with its name."""

    edited = Signal()
    """The user has changed the layer of curves."""
    toggled = Signal()
    """A layer was shown or hidden."""
    selected = Signal()
    """The user has selected other curves in their layer."""
    clicked = Signal(bool)
    """The user has clicked into the layer of curves while moving the camera; with Shift, or not."""

    def __init__(self, viewer: ViewerModel, work: Work):
        self._viewer, self._image, self._work = viewer, work.image, work
        self.look: columns.Look = ("status", Ruler())
        self._busy = False
        self.made = {role: Following(viewer, role, work, MAKERS) for role in MAKERS}
        self._curves = CurveLines(viewer, work.image, "curves", f"{work.name} curves", work)
        self._marks = Marks(viewer, work)
        over = self.made["outlines"], self._curves, self.made["selected"], self._marks
        self._over: dict[str, Any] = dict(zip(OVER, over, strict=True))
        self.missing, self.selection = self._curves.missing, self._curves.selection

    @property
    def signals(self) -> tuple[SignalInstance, ...]:
        """What tells of the user's doings: one keeper listens."""
        return self.toggled, self.edited, self.selected, self.clicked

    def layer(self, role: str) -> Any:
        """Give the layer of a role, or None where there is none or the user removed it."""
        return {**self.made, **self._over}[role].layer

    def ask(self, role: str, on: bool) -> bool:
        """Show or hide what the model says; False if there is nothing to show."""
        picture = self.made[role]
        if picture.layer is not None:
            picture.layer.visible = on
        elif on:
            self._update(picture)
        self.toggled.emit()
        return picture.layer is not None or not on

    def follow(self) -> Iterator[None]:
        """Let what is made of the work follow it, where it is in view or always there."""
        for role, picture in self.made.items():
            there = picture.layer is not None or role not in OVER
            if picture.shown or (there and not picture.maker.title):
                self._update(picture)
                yield

    def colour(self, look: columns.Look) -> bool:
        """Choose what the colour of a curve says; say whether `show` has to be called for it."""
        before, self.look = self.look, look
        return self._curves.made and before != look

    def show(self) -> Iterator[None]:
        """Show what is known by then, in the layers that exist or in new ones, layer by layer.

        napari takes about 0.1 s to add a layer and as long to draw it first, and longer beside
        full ones: the window may live in between, and layers are added before any is filled.
        """
        for step in (self._prepare(), self._add(), self.follow(), self._fill()):
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
            for slot in self._over.values():
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

    def _update(self, picture: Following) -> None:
        before = picture.layer
        if self._image in self._viewer.layers:
            picture.update()
        if picture.layer is not None and picture.layer is not before:
            picture.layer.events.visible.connect(self._on_visible)

    def _add(self) -> Iterator[None]:
        """Add the layers that are not there, hidden; each is drawn once while it is empty."""
        for role, slot in self._over.items() if self._work.records else ():
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

    def _prepare(self) -> Iterator[None]:
        """Work out, once, what takes long for many curves."""
        began = perf_counter()
        for record in self._work.records:
            if looks.has_outline(record.curve):
                looks.outline(record.curve)
            if perf_counter() - began > AT_ONCE:
                yield
                began = perf_counter()

    def _fill(self) -> Iterator[None]:
        if self._curves.layer is not None:
            yield from self._curves.show(self._work.records, self.look)
            self._marks.update()

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
        for mark in (self.layer("selected"), self.layer("marks")):
            if event.source is self._curves.layer and mark is not None:
                mark.visible = event.source.visible
        for _ in self.follow():
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

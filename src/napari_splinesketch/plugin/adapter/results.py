"""The layers that show a refinement, updated in place."""

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from napari.components import ViewerModel
from napari.layers import Layer, Shapes
from napari.layers.base import ActionType
from psygnal import Signal
from qtpy.QtCore import QTimer

from napari_splinesketch.plugin.adapter.colours import ColourBy
from napari_splinesketch.plugin.adapter.curve_lines import CurveLines, Look
from napari_splinesketch.plugin.adapter.highlight import Highlight
from napari_splinesketch.plugin.adapter.marks import Marks
from napari_splinesketch.plugin.adapter.model_picture import ModelPicture
from napari_splinesketch.plugin.adapter.outlines import Outlines
from napari_splinesketch.plugin.adapter.roles import OWNER, ROLE, Known, Role, put, undisturbed
from napari_splinesketch.plugin.adapter.space import placement
from napari_splinesketch.plugin.gently import BREATH_MS
from napari_splinesketch.plugin.measures import Ruler
from napari_splinesketch.plugin.records import Key, key_of

EDITS = (ActionType.ADDED, ActionType.CHANGED, ActionType.REMOVED)
CLICK = 4.0
"""A mouse that moves less between press and release has clicked, px of the screen."""


class ResultLayers:
    """Curves, outlines and reconstruction of one image and one layer of sketches.

    Parameters
    ----------
    viewer
        Where the layers are added.
    name
        What their names begin with.
    owner
        What they show; kept in their metadata, so that it lives as long as they do.
    """

    edited = Signal()
    """The user has changed the layer of curves."""
    toggled = Signal()
    """A layer was shown or hidden."""
    selected = Signal()
    """The user has selected other curves in their layer."""
    clicked = Signal(bool)
    """The user has clicked into the layer of curves while moving the camera; with Shift, or not."""

    def __init__(self, viewer: ViewerModel, name: str, owner: Known):
        self._look: Look = ("status", Ruler())
        self._viewer, self._image, self._owner = viewer, owner.image, owner
        self._name = name
        self._model = ModelPicture(viewer, owner.image, self._keywords("reconstruction"))
        self._highlight = Highlight(viewer, owner.image, self._keywords("selected"))
        self._outlines = Outlines(viewer, owner.image, self._keywords("outlines"))
        self._marks = Marks(viewer, owner.image, self._keywords("marks"))
        self._veiled = False
        self._curves: CurveLines | None = None
        self._busy = False

    def layer(self, role: Role) -> Layer | None:
        """Give the layer of a role, or None where there is none or the user removed it."""
        if role == "curves":
            lines = self._curves
            return lines.layer if lines and lines.layer in self._viewer.layers else None
        others = {
            "outlines": self._outlines,
            "reconstruction": self._model,
            "selected": self._highlight,
            "marks": self._marks,
        }
        return others[role].layer

    def colour(self, by: ColourBy, ruler: Ruler) -> bool:
        """Choose what the colour of a curve says; say whether `show` has to be called for it."""
        before = self._look
        self._look = (by, ruler)
        return self._curves is not None and before != self._look

    def show(self) -> Iterator[None]:
        """Show what is known by then, in the layers that exist or in new ones, layer by layer.

        napari takes about 0.1 s to add a layer and as long to draw it first, and longer beside
        full ones: the window may live in between, and layers are added before any is filled.
        """
        steps = (self._show_model, self._add_outlines, self._add_curves, self._add_highlight)
        for step in (*steps, self._fill_outlines, self._fill_curves):
            yield from self._quietly(step())
            yield

    def _quietly(self, steps: Iterator[None]) -> Iterator[None]:
        """Take steps without taking our own edits for the user's, while there is an image."""
        while self._image in self._viewer.layers:
            with self._by_us():
                if next(steps, steps) is steps:
                    return
            yield

    def deleted(self) -> bool:
        """Whether the user has removed the layer of curves, and so the results."""
        return self._curves is not None and self._curves.layer not in self._viewer.layers

    def forget(self) -> None:
        """Make all lines anew when there is something to show again."""
        with self._by_us():
            for layer in map(self.layer, ("outlines", "selected", "marks")):
                if layer is not None:
                    self._viewer.layers.remove(layer)
        self._curves = None

    def missing(self) -> set[Key]:
        """(frame, id) of the curves that the user has deleted from their layer."""
        return set() if self._curves is None or self.deleted() else self._curves.missing()

    def selection(self) -> tuple[Key, ...]:
        """(frame, id) of the curves that are selected in their layer."""
        if self._curves is None:
            return ()
        keys = self._curves.keys()
        return tuple(keys[i] for i in sorted(self._curves.layer.selected_data) if i < len(keys))

    def select(self, keys: Collection[Key]) -> None:
        """Select curves in their layer."""
        layer, chosen = self.layer("curves"), set(keys)
        if isinstance(layer, Shapes) and self._curves and chosen != set(self.selection()):
            # napari takes a selection for an edit of its look and writes all text anew: 0.2 s
            # with 1,000 curves.
            with self._by_us(), layer.events.edge_width.blocker():
                there = self._curves.keys()
                layer.selected_data = {i for i, key in enumerate(there) if key in chosen}
            layer.events.highlight()
        self.emphasise()

    def emphasise(self) -> None:
        """Mark the selected curves: napari does so in some of its tools only."""
        lines = self._curves
        if lines is None or self.deleted():
            return
        chosen, there = set(self.selection()), lines.colours()
        records = [r for r in self._owner.records if key_of(r) in chosen and r.curve in there]
        if records and self._highlight.layer is None:
            # A layer takes napari about 0.1 s: the window lives before it is filled.
            with self._by_us():
                self._highlight.make()
            QTimer.singleShot(BREATH_MS, self.emphasise)
            return
        self._highlight.show(records)

    def _show_model(self) -> Iterator[None]:
        for layer in self._model.show(self._owner.patches):
            layer.events.visible.connect(self._on_visible)
            yield

    def _add_outlines(self) -> Iterator[None]:
        if self._outlines.layer is None and self._owner.records:
            layer = self._outlines.make(visible=False)
            layer.events.visible.connect(self._on_visible)
            self._veiled = True
            yield

    def _fill_outlines(self) -> Iterator[None]:
        if self._outlines.layer is not None:
            yield from self._outlines.show(self._owner.records, self._look)
        if self._veiled and self._outlines.layer is not None:
            self._veiled, self._outlines.layer.visible = False, True

    def _add_curves(self) -> Iterator[None]:
        if self.layer("curves") is None and self._owner.records:
            layer = Shapes(
                ndim=self._image.ndim,
                visible=False,
                **self._keywords("curves"),
                **placement(self._image),
            )
            put(self._viewer, layer)
            self._curves = CurveLines(layer, self._image)
            layer.events.visible.connect(self._on_visible)
            layer.events.data.connect(self._on_data)
            layer.selected_data.events.items_changed.connect(self._on_selected)
            layer.mouse_drag_callbacks.append(self._on_press)
            yield from _unveiled(layer)

    def _add_highlight(self) -> Iterator[None]:
        if self._highlight.layer is None and self._owner.records:
            self._highlight.make()
            yield
        if self._marks.layer is None and self._owner.records:
            self._marks.make()
            yield

    def _fill_curves(self) -> Iterator[None]:
        if self._curves and self.layer("curves"):
            yield from self._curves.show(self._owner.records, self._look)
            self.emphasise()
            yield
            self._marks.show(self._owner.records)

    def _keywords(self, role: Role) -> dict[str, Any]:
        return {"name": f"{self._name} {role}", "metadata": {ROLE: role, OWNER: self._owner}}

    @contextmanager
    def _by_us(self) -> Iterator[None]:
        self._busy = True
        try:
            with undisturbed(self._viewer):
                yield
        finally:
            self._busy = False

    def _on_visible(self, event: Any) -> None:
        if self._busy:
            return
        curves = self.layer("curves")
        for mark in map(self.layer, ("selected", "marks")):
            if event.source is curves and curves is not None and mark is not None:
                mark.visible = curves.visible
        self.toggled.emit()

    def _on_data(self, event: Any) -> None:
        lines = self._curves
        if lines is not None and not self._busy and event.action in EDITS:
            lines.follow(removed=event.action == ActionType.REMOVED)
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


def _unveiled(layer: Shapes) -> Iterator[None]:
    """Show a layer that was added hidden: napari takes as long to draw it first as to add it."""
    try:
        yield
    finally:
        layer.visible = True
    yield

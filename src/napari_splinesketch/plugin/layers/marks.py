"""Numbers and signs beside the curves that need review, as many as can be read."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from jaxtyping import Float
from napari.components import ViewerModel
from napari.layers import Points
from scipy.spatial import KDTree
from superqt.utils import qthrottled

from napari_splinesketch.engine.types import Curve
from napari_splinesketch.geometry import edges
from napari_splinesketch.plugin import columns
from napari_splinesketch.plugin.layers import looks
from napari_splinesketch.plugin.layers.slot import Slot, undisturbed
from napari_splinesketch.plugin.layers.space import View, in_stack, view_of
from napari_splinesketch.plugin.model import Record, once

if TYPE_CHECKING:
    from napari_splinesketch.plugin.layers.results import Work

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
    frame = [record for record in records if record.frame == view.frame]
    here = [record for record in frame if looks.MARKS[record.curve.status]]
    if not here:
        return
    ends = np.stack([_stands(r.curve)[0] for r in here])
    near = ((ends > view.low) & (ends < view.high)).all(axis=2).any(axis=-1)
    here = [here[i] for i in np.flatnonzero(near).tolist()]
    box = np.array([LINE_HEIGHT, 3 * LETTER]) * view.pixel / 2
    bodies = KDTree(np.concatenate([r.curve.points[::2] for r in frame]) / box)
    taken, sizes, count = np.zeros((MOST, 2)), np.zeros((MOST, 2)), 0
    for record in sorted(here, key=lambda r: columns.severity(r.curve), reverse=True):
        size = np.array([LINE_HEIGHT, LETTER * len(_text(record))]) * view.pixel / 2
        places = _places(record.curve, size, view)
        free = ((places - size > view.low) & (places + size < view.high)).all(axis=1)
        over = np.abs(places[:, None] - taken[:count]) < size + sizes[:count]
        places = places[free & ~over.all(axis=2).any(axis=-1)]
        if len(places):
            crowd = bodies.query_ball_point(places / box, 1.0, p=np.inf, return_length=True)
            taken[count], sizes[count] = places[np.argmin(crowd)], size
            yield record, taken[count].copy()
            count += 1
        if count == MOST:
            return


def _text(record: Record) -> str:
    return f"{record.id} {looks.MARKS[record.curve.status]}"


@once
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
    """The layer of marks; it follows camera and frame."""

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

"""Numbers and signs beside the curves that need review, as many as can be read."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float
from napari.components import ViewerModel
from napari.layers import Image, Layer, Points
from superqt.utils import qthrottled

from napari_splinesketch.engine.types import Curve
from napari_splinesketch.plugin.columns import severity
from napari_splinesketch.plugin.layers.looks import COLOURS, MARKS, normals, once, reach
from napari_splinesketch.plugin.layers.slot import Slot, undisturbed
from napari_splinesketch.plugin.layers.space import (
    current_frame,
    from_world,
    in_stack,
    unit_factors,
)
from napari_splinesketch.plugin.model import Record

LETTER, LINE, GAP = 9.0, 16.0, 10.0
"""Width and height of a letter, and how far a mark is from its body, px of the screen."""
MOST = 60
"""Marks at once: more are not read, and napari's time for text grows with their number."""
AFTER_MS = 120
"""Marks follow the camera when it has stood still for so long."""
PLACES = (0.5, 0.02, 0.98, 0.25, 0.75)
"""Where along a curve a mark may stand, the best first."""


@dataclass(frozen=True, eq=False)
class View:
    """What the canvas shows of an image: part of a frame, px, and a screen pixel's (row, col)."""

    frame: int
    low: Float[np.ndarray, "2"]
    high: Float[np.ndarray, "2"]
    pixel: Float[np.ndarray, "2"]


def in_view(viewer: ViewerModel, image: Image) -> View:
    """Say what the canvas shows of an image."""
    camera = viewer.scene.camera
    half = np.array(viewer.canvas.size) / 2 / camera.zoom
    centre = np.array(camera.center)[-2:]
    world = np.zeros((4, image.ndim))
    world[:, -2:] = centre + half * [(-1, -1), (-1, 1), (1, -1), (1, 1)]
    corners = from_world(viewer, image, world)[:, -2:]
    size = np.abs(image.scale[-2:] * unit_factors(viewer, image)[-2:]) * camera.zoom
    return View(current_frame(viewer, image), corners.min(0), corners.max(0), 1 / size)


def readable(
    records: Sequence[Record], view: View
) -> Iterator[tuple[Record, Float[np.ndarray, "2"]]]:
    """Choose the curves whose marks can be read, the worst first, and where each mark stands."""
    here = [r for r in records if r.frame == view.frame and MARKS[r.curve.status]]
    if not here:
        return
    ends = np.stack([_stands(r.curve)[0] for r in here])
    near = ((ends > view.low) & (ends < view.high)).all(axis=2).any(axis=-1)
    here = [here[i] for i in np.flatnonzero(near).tolist()]
    taken, sizes = np.zeros((MOST, 2)), np.zeros((MOST, 2))
    count = 0
    for record in sorted(here, key=lambda r: severity(r.curve), reverse=True):
        size = np.array([LINE, LETTER * len(text_of(record))]) * view.pixel / 2
        places = _places(record.curve, view)
        free = ((places - size > view.low) & (places + size < view.high)).all(axis=1)
        over = np.abs(places[:, None] - taken[:count]) < size + sizes[:count]
        free &= ~over.all(axis=2).any(axis=-1)
        if free.any():
            taken[count], sizes[count] = places[free.argmax()], size
            yield record, places[free.argmax()]
            count += 1
        if count == MOST:
            return


def text_of(record: Record) -> str:
    """Write a mark."""
    return f"{record.id} {MARKS[record.curve.status]}"


@once
def _stands(curve: Curve) -> tuple[Float[np.ndarray, "S 2"], Float[np.ndarray, "S 2"]]:
    """Points of a curve beside which its mark may stand, and the way there: above it first."""
    at = np.round(np.array(PLACES) * (len(curve.points) - 1)).astype(int)
    across = normals(curve.points)[at]
    return curve.points[at], np.where(across[:, :1] > 0, -across, across)


def _places(curve: Curve, view: View) -> Float[np.ndarray, "_ 2"]:
    """Where its mark may stand, the best place first."""
    points, up = _stands(curve)
    away = (reach(curve) + GAP * float(view.pixel.mean())) * up
    return np.stack([points + away, points - away], axis=1).reshape(-1, 2)


class Marks(Slot):
    """The marks that can be read; they follow camera and frame."""

    _records: Sequence[Record] = ()
    _shown: tuple[Any, ...] = ()

    def __init__(self, *arguments: Any):
        super().__init__(*arguments)
        self._soon = qthrottled(self._write, AFTER_MS, leading=False)

    def make(self, kind: type[Layer] = Points, *data: Any, **how: Any) -> Any:
        """Add the layer, with nothing in it."""
        how = {"size": 1, "face_color": "transparent", "border_color": "transparent"} | how
        self._shown = ()
        self.viewer.scene.camera.events.connect(self._on_move)
        self.viewer.dims.events.current_step.connect(self._on_move)
        made = super().make(kind, *data, **how)
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
        view = in_view(self.viewer, self.image)
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
                "string": [text_of(record) for record, _ in found],
                "color": [COLOURS[record.curve.status] for record, _ in found],
                "size": 10,
                "anchor": "center",
            }

"""The knots of one curve as points that can be dragged."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from jaxtyping import Float
from napari.components import ViewerModel
from napari.layers import Image, Points
from napari.layers.base import ActionType
from psygnal import Signal

from napari_splinesketch import palette
from napari_splinesketch.plugin.adapter.roles import ROLE
from napari_splinesketch.plugin.adapter.space import in_stack, placement

COLOUR, HEAD = palette.MOVING, palette.TRUTH
"""The first knot is the head: it stands out."""
ON_SCREEN = (9, 14)
"""Smallest and largest size of a knot, px of the screen."""
DONE = (ActionType.ADDED, ActionType.CHANGED, ActionType.REMOVED)


class KnotLayer:
    """A layer of knots; it is there from the beginning and until `close`.

    Parameters
    ----------
    viewer
        Where the layer is added.
    image
        What the knots lie on.
    name
        What the layer is called.
    frame
        The frame that the knots belong to.
    knots
        (K, 2) px.
    keys
        What keys do while the layer is active.
    """

    moving = Signal()
    """Knots are being dragged."""
    moved = Signal()
    """Knots were moved, added or deleted."""

    def __init__(
        self,
        viewer: ViewerModel,
        image: Image,
        name: str,
        frame: int,
        knots: Float[np.ndarray, "K 2"],
        keys: dict[str, Callable[[], None]],
    ):
        self._viewer, self._image, self._frame = viewer, image, frame
        self._active = viewer.layers.selection.active
        self._layer = Points(
            in_stack(image, frame, knots),
            name=name,
            size=3,
            canvas_size_limits=ON_SCREEN,
            border_width=0.2,
            border_color="black",
            metadata={ROLE: "knots"},
            **placement(image),
        )
        self._paint()
        for key, run in keys.items():
            self._layer.bind_key(key, _pressed(run), overwrite=True)
        viewer.layers.append(self._layer)
        viewer.layers.selection.active = self._layer
        self._layer.mode = "select"
        self._layer.mouse_drag_callbacks.append(self._follow)
        self._layer.events.data.connect(self._on_data)

    @property
    def there(self) -> bool:
        """Whether the user has not removed the layer."""
        return self._layer in self._viewer.layers

    def value(self) -> Float[np.ndarray, "K 2"]:
        """(K, 2) the knots as they are now, px."""
        return np.array(self._layer.data[:, -2:], dtype=float)

    def set_value(self, knots: Float[np.ndarray, "K 2"]) -> None:
        """Put the knots elsewhere."""
        with self._layer.events.data.blocker():
            self._layer.selected_data = set()
            self._layer.data = in_stack(self._image, self._frame, knots)
            self._paint()

    def close(self) -> None:
        """Take the layer away, and give the one that was active back."""
        self._layer.events.data.disconnect(self._on_data)
        if self.there:
            self._viewer.layers.remove(self._layer)
        if self._active in self._viewer.layers:
            self._viewer.layers.selection.active = self._active

    def _paint(self) -> None:
        rest = max(len(self._layer.data) - 1, 0)
        self._layer.face_color = [HEAD, *[COLOUR] * rest]

    def _follow(self, layer: Points, event: Any) -> Iterator[None]:
        """Tell of every move: napari's own event comes when the button is released."""
        yield
        while event.type == "mouse_move":
            self.moving.emit()
            yield

    def _on_data(self, event: Any) -> None:
        if event.action in DONE:
            self.moved.emit()


def _pressed(run: Callable[[], None]) -> Callable[[Points], None]:
    def press(layer: Points) -> None:
        run()

    return press

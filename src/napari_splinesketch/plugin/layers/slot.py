"""One way to put a layer of ours into the window, whatever its kind."""

import gc
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from operator import is_
from typing import Any, Literal, Protocol

import numpy as np
from jaxtyping import Float
from napari.components import ViewerModel
from napari.layers import Image, Layer, Vectors

from napari_splinesketch import palette
from napari_splinesketch.plugin.layers.looks import Pieces, line_width, pieces, rgba
from napari_splinesketch.plugin.layers.pixels import Patch
from napari_splinesketch.plugin.layers.space import in_stack, placement, size_of
from napari_splinesketch.plugin.model import Record

ROLE, OWNER = "napari-splinesketch", "napari-splinesketch work"
"""Keys of a layer's metadata: what it shows, and the work that it shows."""
Role = Literal["curves", "outlines", "selected", "marks"]
SAME_BREADTH = 0.1
"""Lines are not drawn anew for a breadth that differs less, relative."""


class Known(Protocol):
    """What is known of an image: its curves, and the reconstructions by frame, the latest last."""

    image: Image

    @property
    def name(self) -> str: ...  # noqa: D102
    @property
    def records(self) -> tuple[Record, ...]: ...  # noqa: D102
    @property
    def patches(self) -> Mapping[int, Patch]: ...  # noqa: D102
    @property
    def chosen(self) -> Record | None: ...  # noqa: D102


def is_result(layer: Layer) -> bool:
    """Whether a layer shows results, and so is neither image nor sketches."""
    return ROLE in layer.metadata


@contextmanager
def undisturbed(viewer: ViewerModel) -> Iterator[None]:
    """Change layers without taking the active one from the user."""
    active = viewer.layers.selection.active
    try:
        yield
    finally:
        if active in viewer.layers and active is not viewer.layers.selection.active:
            viewer.layers.selection.active = active


class Slot:
    """The place of a layer that lies on an image; empty until it is made, or where it was removed.

    Parameters
    ----------
    viewer, image
        The window, and what the layer lies on.
    role, name
        What it shows, and what it is called.
    owner
        Kept in its metadata, so that it lives as long as the layer does.
    """

    def __init__(
        self, viewer: ViewerModel, image: Image, role: str, name: str, owner: Known | None = None
    ):
        self.viewer, self.image = viewer, image
        marks: dict[str, Any] = {ROLE: role} if owner is None else {ROLE: role, OWNER: owner}
        self._keywords = {"name": name, "metadata": marks}
        self._layer: Layer | None = None

    @property
    def layer(self) -> Any:
        """The layer, or None where there is none or the user has removed it."""
        return self._layer if self._layer in self.viewer.layers else None

    @property
    def made(self) -> bool:
        """Whether we have made the layer, and not taken it away."""
        return self._layer is not None

    def make(self, kind: type[Layer], *data: Any, at: int | None = None, **how: Any) -> Any:
        """Make a layer, without data an empty one, and put it on top or elsewhere.

        napari selects what is added. Nobody is told, as it is undone at once: being told and told
        again is half of what an added layer takes.
        """
        size = {} if data else {"ndim": self.image.ndim}
        layer = kind(*data, **size, **placement(self.image) | self._keywords | how)
        layers, selection = self.viewer.layers, self.viewer.layers.selection
        chosen, active = set(selection), selection.active
        with selection.events.blocker_all():
            layers.insert(len(layers) if at is None else at, layer)
            if active is None:
                selection.clear()
                selection.update(chosen)
            else:
                selection.active = active
        self._layer = layer
        return layer

    def remove(self) -> None:
        """Take the layer away, if it is there."""
        layer = self.layer
        if layer is not None:
            gc.freeze()  # napari collects all garbage whenever a layer goes: 0.13 s
            try:
                with undisturbed(self.viewer):
                    self.viewer.layers.remove(layer)
            finally:
                gc.unfreeze()
        self._layer = None


class Lines(Slot):
    """Lines that are only looked at, as vectors: napari draws thousands in a shape's time."""

    _lines: tuple[Pieces, ...] = ()
    _colours: tuple[str, ...] = ()

    def make(self, kind: type[Layer] = Vectors, *data: Any, at: int | None = None, **how: Any):
        """Add the layer, with nothing in it."""
        self._lines, self._colours = (), ()
        return super().make(kind, *data, at=at, vector_style="line", **how)

    def draw(self, lines: Sequence[Pieces], colours: Sequence[str], breadth: float) -> None:
        """Draw these lines, and no others, as far as they are not there already.

        The same arrays stand for the same lines.
        """
        layer, here, wanted = self.layer, tuple(lines), tuple(colours)
        same = len(here) == len(self._lines) and all(map(is_, here, self._lines))
        if layer is None or (same and wanted == self._colours):
            return
        if not same:
            layer.data = np.concatenate(here) if here else np.zeros((0, 2, self.image.ndim))
        if here:
            if abs(layer.edge_width - breadth) > SAME_BREADTH * breadth:
                layer.edge_width = breadth
            layer.edge_color = np.repeat(rgba(colours), [len(line) for line in lines], axis=0)
        self._lines, self._colours = here, wanted


class Preview(Lines):
    """Lines of one frame that are still on their way."""

    def show(self, frame: int, lines: Sequence[Float[np.ndarray, "N 2"]]) -> None:
        """Show lines, px; nothing if the user has removed the layer.

        The first time the layer is only made, hidden: that alone takes napari up to 0.1 s.
        """
        if self._layer is None:
            self.make(visible=False)
        elif self.layer is not None:
            cut = pieces([in_stack(self.image, frame, line) for line in lines])
            first = not self._lines
            self.draw(cut, [palette.MOVING] * len(cut), line_width(size_of(self.image)))
            if first:
                self.layer.visible = True

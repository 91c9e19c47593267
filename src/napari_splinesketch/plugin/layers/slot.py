"""Layers of ours that lie on an image: how each is put there, and follows what is known."""

from __future__ import annotations

import logging
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from napari.components import ViewerModel
from napari.layers import Image, Labels, Layer, Points, Shapes, Vectors
from qtpy.QtCore import QTimer

from napari_splinesketch.plugin.layers.space import placement

if TYPE_CHECKING:
    from napari_splinesketch.plugin.layers.results import Work

ROLE, OWNER = "napari-splinesketch", "napari-splinesketch work"  # keys of a layer's metadata
STEP_MS = 30  # between two steps of drawing results: time for the window to paint and to answer
FIRST_MS = 100  # before the first one: the change is seen in the dock, table and plots meanwhile
STYLES: dict[type[Layer], dict[str, Any]] = {
    Vectors: {"vector_style": "line"},
    Points: {"size": 1, "face_color": "transparent", "border_color": "transparent"},
}
"""How layers of a kind look unless something else is said: points are there for their text."""
_log = logging.getLogger(__name__)


def is_result(layer: Layer) -> bool:
    """Whether a layer shows results, and so is neither image nor sketches."""
    return ROLE in layer.metadata


@contextmanager
def undisturbed(viewer: ViewerModel) -> Iterator[None]:
    """Change layers without taking the active one from the user."""
    selection = viewer.layers.selection
    active, chosen = selection.active, set(selection)
    try:
        yield
    finally:
        if active is None and selection.active is not None:
            selection.clear()
            selection.update(chosen.intersection(viewer.layers))
        elif active in viewer.layers and active is not selection.active:
            selection.active = active


class Made(NamedTuple):
    """What a layer shows, what goes with that and is set each time, and how it looks at first."""

    data: Any
    always: Mapping[str, Any] = {}
    look: Mapping[str, Any] = {}


@dataclass(frozen=True)
class Maker:
    """What a layer is made of; it stays as it is while its source does."""

    kind: type[Layer]
    name: str
    source: Callable[[Work], Sequence[Any]]
    make: Callable[[Work, Any], Made | None]
    title: str = ""  # in the menu, and then it is there only when asked for
    tip: str = ""
    nothing: str = "There is nothing to show yet: refine first."  # where None is made


class Slot:
    """The place of a layer that shows what its maker makes of a work; empty until it is made."""

    def __init__(self, role: str, maker: Maker, work: Work):
        self.maker, self.work = maker, work
        named = {"name": f"{work.name} {maker.name}", "metadata": {ROLE: role, OWNER: work}}
        self._named = named | STYLES.get(maker.kind, {})
        self._layer: Layer | None = None
        self._source: Sequence[Any] | None = None

    @property
    def layer(self) -> Any:
        """The layer, or None where there is none or the user has removed it."""
        return self._layer if self._layer in self.work.viewer.layers else None

    @property
    def shown(self) -> bool:
        """Whether the layer is there and in view."""
        return self.layer is not None and self.layer.visible

    @property
    def made(self) -> bool:
        """Whether we have made the layer, and not taken it away."""
        return self._layer is not None

    def make(self, *data: Any, **how: Any) -> Any:
        """Make the layer; without data, an empty one to be filled by `update`."""
        image, layers, kind = self.work.image, self.work.viewer.layers, self.maker.kind
        size = {} if data else {"ndim": image.ndim}
        layer = kind(*data, **size, **placement(image) | self._named | how)
        # Pictures over the image, all else over everything.
        at = layers.index(image) + 1 if kind in (Image, Labels) else len(layers)
        # napari selects what is added: undone silently, as to tell of it twice takes as long again.
        with layers.selection.events.blocker_all(), undisturbed(self.work.viewer):
            layers.insert(at, layer)
        layer.editable = kind not in (Shapes, Labels)  # results are not drawn into
        layer.events.visible.connect(self.work.on_visible)
        self._layer, self._source = layer, None
        return layer

    def update(self) -> Iterator[None]:
        """Bring it in step with what is known; takes a step where that is not what it shows."""
        layer, source, kind = self.layer, self.maker.source(self.work), self.maker.kind
        if source == self._source and (layer is not None or not self.maker.title):
            return
        made = self.maker.make(self.work, source)
        if made is None:
            self.remove()
        elif layer is None:
            how = {**made.always, "visible": self.maker.title > "", **made.look}
            how |= {"multiscale": False} if kind in (Image, Labels) else {}
            self.make(made.data, **how)
        else:
            if kind is Points:  # text of other points does not fit these
                layer.selected_data = set()
                layer.text = {"string": {"constant": ""}}
            layer.data = made.data
            for name, value in made.always.items():
                # napari draws everything again for a breadth, even for the same.
                if not (isinstance(value, float) and np.all(getattr(layer, name) == value)):
                    setattr(layer, name, value)
        self._source = source
        yield

    def remove(self) -> None:
        """Take the layer away, if it is there."""
        if self.layer is not None:
            with undisturbed(self.work.viewer):
                self.work.viewer.layers.remove(self.layer)
        self._layer = None


class Drawing:
    """Changes layers in many short steps, its `runs`; the window lives in between."""

    def __init__(self, failed: Callable[[Exception], None]):
        self._failed = failed
        self.runs: dict[Hashable, tuple[Iterator[object], list[Callable[[], None]]]] = {}

    def start(self, key: Hashable, steps: Iterator[object], last: Callable[[], None]) -> None:
        """Take steps, in the place of others of the same key; then call `last`, also of those."""
        before = self.runs.get(key)
        self.runs[key] = steps, [*(before[1] if before else ()), last]
        if not before:
            QTimer.singleShot(FIRST_MS, partial(self._go_on, key))

    def _go_on(self, key: Hashable) -> None:
        if key not in self.runs:
            return
        try:
            next(self.runs[key][0])
        except StopIteration:
            for last in self.runs.pop(key)[1]:
                last()
        except Exception as error:
            _log.exception("The results could not be shown")
            self.runs.pop(key, None)
            self._failed(error)
        else:
            QTimer.singleShot(STEP_MS, partial(self._go_on, key))

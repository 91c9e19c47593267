"""Layers of ours that lie on an image: how each is put there, and follows what is known."""

from __future__ import annotations

import gc
import logging
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np
from jaxtyping import Float
from napari.components import ViewerModel
from napari.layers import Image, Labels, Layer, Shapes, Vectors
from qtpy.QtCore import QTimer

from napari_splinesketch import palette
from napari_splinesketch.plugin import columns
from napari_splinesketch.plugin.layers import looks
from napari_splinesketch.plugin.layers.drawn import CHUNK, add_shapes
from napari_splinesketch.plugin.layers.space import in_stack, placement, size_of
from napari_splinesketch.plugin.model import Key, Record, key_of

if TYPE_CHECKING:
    from napari_splinesketch.plugin.keeper import Work

ROLE, OWNER = "napari-splinesketch", "napari-splinesketch work"
"""Keys of a layer's metadata: what it shows, and the work that it shows."""
STEP_MS = 30
"""Between two steps of drawing results: time for the window to paint and to answer."""
FIRST_MS = 5
"""Before the first one: what has changed the state is still to be seen in the dock."""
_log = logging.getLogger(__name__)


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


def in_vectors(
    image: Image, lines: Sequence[tuple[int, looks.Line]]
) -> tuple[Float[np.ndarray, "P 2 D"], list[int]]:
    """Take lines, each with its frame, px, for vectors; and say how many each of them has.

    napari draws thousands of vectors in the time of a shape.
    """
    if not lines:
        return np.zeros((0, 2, image.ndim)), []
    counts = [len(line) for _, line in lines]
    frames = np.repeat([frame for frame, _ in lines], counts).tolist()
    points = in_stack(image, frames, np.concatenate([line for _, line in lines]))
    along = np.stack([points[:-1], np.diff(points, axis=0)], axis=1)
    pieces = np.delete(along, np.cumsum(counts)[:-1] - 1, axis=0)  # from one line to the next
    return pieces, [count - 1 for count in counts]


class Slot:
    """The place of a layer that lies on an image; empty until it is made, or where it was removed.

    Its metadata name its `role` and, so that it lives as long as the layer does, its `owner`.
    """

    kind: type[Layer] = Vectors
    style: ClassVar[dict[str, Any]] = {}

    def __init__(
        self, viewer: ViewerModel, image: Image, role: str, name: str, owner: Work | None = None
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
    def shown(self) -> bool:
        """Whether the layer is there and in view."""
        return self.layer is not None and self.layer.visible

    @property
    def made(self) -> bool:
        """Whether we have made the layer, and not taken it away."""
        return self._layer is not None

    def make(self, *data: Any, at: int | None = None, **how: Any) -> Any:
        """Make a layer, without data an empty one, and put it on top or elsewhere.

        napari selects what is added. Nobody is told, as it is undone at once: being told and told
        again is half of what an added layer takes.
        """
        size = {} if data else {"ndim": self.image.ndim}
        style = {"vector_style": "line"} if self.kind is Vectors else self.style
        layer = self.kind(*data, **size, **placement(self.image) | self._keywords | style | how)
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


class Made(NamedTuple):
    """What a layer shows, what goes with that and is set each time, and how it looks at first."""

    data: Any
    always: Mapping[str, Any] = {}
    look: Mapping[str, Any] = {}


@dataclass(frozen=True)
class Maker:
    """A layer: its kind, what it is called, the values that it depends on, what makes it of them.

    It stays as it is while they do; where nothing is made, there is nothing to show, and `nothing`
    says why. With a `title` and a `tip` it is in the menu, and there only when asked for.
    """

    kind: type[Layer]
    name: str
    source: Callable[[Work], list[Any]]
    make: Callable[[Work], Made | None]
    title: str = ""
    tip: str = ""
    nothing: str = "There is nothing to show yet: refine first."


class Following(Slot):
    """A layer that shows of a work what its maker makes."""

    def __init__(self, viewer: ViewerModel, role: str, work: Work, makers: Mapping[Any, Maker]):
        self._role, self._work, self._makers = role, work, makers
        self._source: list[Any] | None = None
        self.kind = self.maker.kind
        super().__init__(viewer, work.image, role, f"{work.name} {self.maker.name}", work)

    @property
    def maker(self) -> Maker:
        """What makes it."""
        return self._makers[self._role]

    def update(self) -> None:
        """Bring it in step with what is known, if that is not what it shows."""
        layer, source = self.layer, self.maker.source(self._work)
        if source == self._source and (layer is not None or not self.maker.title):
            return
        made = self.maker.make(self._work)
        if made is None:
            self.remove()
        elif layer is None or (self.kind is not Vectors and layer.data.shape != made.data.shape):
            self._add(made, layer)
        else:
            layer.data = made.data
            for name, value in made.always.items():
                # napari draws all anew for a breadth, even for the same.
                if not (isinstance(value, float) and getattr(layer, name) == value):
                    setattr(layer, name, value)
        self._source = source

    def make(self, *data: Any, **how: Any) -> Any:
        """Make the layer; without data, an empty one to be filled by `update`."""
        self._source = None
        return super().make(*data, **how)

    def _add(self, made: Made, old: Layer | None) -> None:
        """Put the layer over the image, lines over all, or in the place of an old one."""
        layers = self.viewer.layers
        at = layers.index(old or self.image) + (old is None)
        visible = old.visible if old else bool(self.maker.title)
        self.remove()
        how: dict[str, Any] = {**made.always, **made.look, "visible": visible}
        if self.kind is Vectors:
            at = at if old else None
        else:
            how["multiscale"] = False
        layer = self.make(made.data, at=at, **how)
        layer.editable = self.kind is not Labels


class Preview(Slot):
    """Lines of one frame that are still on their way."""

    _filled = False

    def show(self, frame: int, lines: Sequence[looks.Line]) -> None:
        """Show lines, px; nothing if the user has removed the layer.

        The first time the layer is only made, hidden: that alone takes napari up to 0.1 s.
        """
        if not self.made:
            width = looks.line_width(size_of(self.image))
            self.make(visible=False, edge_width=width, edge_color=palette.MOVING)
        elif (layer := self.layer) is not None:
            some = [(frame, line) for line in looks.coarse(lines)]
            layer.data, _ = in_vectors(self.image, some)
            if not self._filled:
                self._filled = layer.visible = True


class CurveLines(Slot):
    """A line for each curve, brought in step with what is known: some go, some come."""

    kind = Shapes
    _shown: Sequence[Record] = ()
    """In the order of the layer."""
    _described: Sequence[Record] = ()
    """Those that its features speak of."""
    _colours: Mapping[int, str] = {}
    """By the identity of the curve."""

    def make(self, *data: Any, **how: Any) -> Any:
        """Add the layer, with nothing in it."""
        self._shown, self._described, self._colours = (), (), {}
        return super().make(*data, **how)

    def keys(self) -> list[Key]:
        """(frame, id) of the curves that are there."""
        known = {} if self.layer is None else self.layer.features
        return list(zip(known["frame"], known["id"], strict=True)) if "id" in known else []

    def missing(self) -> set[Key]:
        """(frame, id) of the curves that the user has deleted."""
        written = map(key_of, self._described)
        return set(written).difference(self.keys()) if self.layer is not None else set()

    def selection(self) -> tuple[Key, ...]:
        """(frame, id) of the curves that are selected."""
        keys, layer = self.keys(), self.layer
        return tuple(keys[i] for i in sorted(layer.selected_data) if i < len(keys)) if keys else ()

    def show(self, records: Sequence[Record], look: columns.Look) -> Iterator[None]:
        """Show these curves, and no others; some come at each step."""
        layer = self.layer
        wanted = {id(record.curve): record for record in records}
        if layer.nshapes != len(self._shown):
            gone, self._shown = list(range(layer.nshapes)), ()
        else:
            gone = [i for i, r in enumerate(self._shown) if id(r.curve) not in wanted]
        if gone:
            layer.selected_data = set()
            layer.remove(gone)
            self._shown = [r for r in self._shown if id(r.curve) in wanted]
        there = {id(record.curve) for record in self._shown}
        fresh = [record for record in records if id(record.curve) not in there]
        curves = [record.curve for record in fresh]
        colours, unit = columns.colours_of(fresh, look), looks.breadth(curves)
        self._colours = {**self._colours, **dict(zip(map(id, curves), colours, strict=True))}
        for done in add_shapes(
            layer,
            self._lines(fresh),
            ["path"] * len(fresh),
            edge_color=colours,
            face_color="transparent",
            edge_width=[unit * looks.BREADTHS[curve.status] for curve in curves],
        ):
            self._shown = [*self._shown, *fresh[done]]
            for record in fresh[done]:
                columns.in_pixels(record)  # a few at a time: all are asked for at once below
            yield
        self._describe([wanted[id(r.curve)] for r in self._shown], look, bool(gone or fresh))
        if gone:
            yield

    def follow(self, *, removed: bool) -> None:
        """Take in that the user has changed shapes: deleted some, or others, which come anew."""
        left = set(self.keys())
        less = removed and len(left) < len(self._shown)
        self._shown = [r for r in self._shown if key_of(r) in left] if less else ()

    def _lines(self, records: Sequence[Record]) -> Iterator[np.ndarray]:
        """Draw curves, some at a time when they are needed."""
        for start in range(0, len(records), CHUNK):
            some = records[start : start + CHUNK]
            lines = looks.thinned([record.curve.points for record in some])
            for record, line in zip(some, lines, strict=True):
                yield in_stack(self.image, record.frame, line)

    def _describe(self, records: list[Record], look: columns.Look, changed: bool) -> None:
        """Let features and colours say what is known now."""
        layer: Any = self._layer
        if changed or records != self._described or layer.features.empty:
            layer.features = columns.features(records)
            self._shown = self._described = records
        colours = columns.colours_of(records, look)
        painted = {id(r.curve): colour for r, colour in zip(records, colours, strict=True)}
        if any(self._colours.get(curve) != colour for curve, colour in painted.items()):
            layer.edge_color = colours
        self._colours = painted


class Drawing:
    """Changes layers in many short steps; the window lives in between.

    `failed` is called with the exception if a step fails.
    """

    def __init__(self, failed: Callable[[Exception], None]):
        self._failed = failed
        self._steps: dict[Hashable, Iterator[object]] = {}
        self._last: dict[Hashable, list[Callable[[], None]]] = {}

    def start(self, key: Hashable, steps: Iterator[object], last: Callable[[], None]) -> None:
        """Take steps, in the place of others of the same key; then call `last`, also of those."""
        running = key in self._steps
        self._steps[key] = steps
        self._last.setdefault(key, []).append(last)
        if not running:
            QTimer.singleShot(FIRST_MS, partial(self._go_on, key))

    @property
    def busy(self) -> bool:
        """Whether anything is still to be shown."""
        return bool(self._steps)

    def drop(self, key: Hashable) -> bool:
        """Take no more steps; say whether there were some left."""
        self._last.pop(key, None)
        return self._steps.pop(key, None) is not None

    def stop(self) -> None:
        """Show nothing more."""
        self._steps.clear()
        self._last.clear()

    def _go_on(self, key: Hashable) -> None:
        if key not in self._steps:
            return
        try:
            next(self._steps[key])
        except StopIteration:
            del self._steps[key]
            for last in self._last.pop(key):
                last()
        except Exception as error:
            _log.exception("The results could not be shown")
            self.drop(key)
            self._failed(error)
        else:
            QTimer.singleShot(STEP_MS, partial(self._go_on, key))

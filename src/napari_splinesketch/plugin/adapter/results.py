"""The layers that show a refinement, updated in place."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Any, Literal, Protocol, cast

import numpy as np
from jaxtyping import Float
from napari.components import ViewerModel
from napari.layers import Image, Layer, Shapes
from napari.layers.base import ActionType
from psygnal import Signal

from napari_splinesketch.engine.types import Curve
from napari_splinesketch.plugin.adapter.colours import ColourBy, colours_of
from napari_splinesketch.plugin.adapter.features import features
from napari_splinesketch.plugin.adapter.film import Film, Patch
from napari_splinesketch.plugin.adapter.look import BREADTHS, COLOURS, MARKS, breadth, outline
from napari_splinesketch.plugin.adapter.space import (
    frame_shape,
    in_stack,
    placement,
    placement_on,
)
from napari_splinesketch.plugin.gently import add_shapes
from napari_splinesketch.plugin.measures import Ruler
from napari_splinesketch.plugin.records import Key, Record

ROLE, OWNER = "napari-splinesketch", "napari-splinesketch work"
"""Keys of a layer's metadata: what it shows, and the work that it shows."""
EDITS = (ActionType.ADDED, ActionType.CHANGED, ActionType.REMOVED)
SELECTED = 2.5
"""Breadth of a selected curve's line, relative."""
MARKED = 200
"""With more curves than this, numbers are in the table alone: there is no room for them."""
CLICK = 4.0
"""A mouse that moves less between press and release has clicked, px of the screen."""
Role = Literal["curves", "outlines", "reconstruction"]


class Known(Protocol):
    """What is known of an image.

    Attributes
    ----------
    image
        The user's layer.
    """

    image: Image

    @property
    def records(self) -> tuple[Record, ...]:
        """The curves of all frames."""
        ...

    @property
    def patches(self) -> Mapping[int, Patch]:
        """Reconstructions by frame, the latest last."""
        ...


def is_result(layer: Layer) -> bool:
    """Whether a layer shows results, and so is neither image nor sketches."""
    return ROLE in layer.metadata


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
        self._look: tuple[ColourBy, Ruler] = ("status", Ruler())
        self._viewer = viewer
        self._image = owner.image
        self._name = name
        self._owner = owner
        self._layers: dict[Role, Layer] = {}
        self._shown: dict[Role, tuple[Curve, ...]] = {}
        self._colours: dict[Role, list[str]] = {}
        self._written: frozenset[Key] = frozenset()
        self._rows: list[Key] = []
        self._broad: set[int] = set()
        self._pictured: Mapping[int, Patch] | None = None
        self._busy = False

    def layer(self, role: Role) -> Layer | None:
        """Give the layer of a role, or None where there is none or the user removed it."""
        layer = self._layers.get(role)
        return layer if layer in self._viewer.layers else None

    def colour(self, by: ColourBy, ruler: Ruler) -> bool:
        """Choose what the colour of a curve says; say whether `show` has to be called for it."""
        before = self._look
        self._look = (by, ruler)
        return bool(self._shown) and before != self._look

    def show(self) -> Iterator[None]:
        """Show what is known by then, in the layers that exist or in new ones, layer by layer.

        napari takes about 0.1 s to add a layer and as long to draw it first: the window may live
        in between.
        """
        steps = (
            self._show_reconstruction,
            partial(self._ensure, "outlines"),
            self._show_outlines,
            partial(self._ensure, "curves"),
            self._show_curves,
        )
        for step in steps:
            yield from self._quietly(step())

    def _quietly(self, steps: Iterator[None]) -> Iterator[None]:
        """Take steps undisturbed, while there is an image to show them on."""
        while self._image in self._viewer.layers:
            with self._undisturbed():
                if next(steps, steps) is steps:
                    return
            yield

    @contextmanager
    def _undisturbed(self) -> Iterator[None]:
        """Change layers without taking our own edits for the user's, or the layer from her."""
        self._busy = True
        active = self._viewer.layers.selection.active
        try:
            yield
        finally:
            if active in self._viewer.layers:
                self._viewer.layers.selection.active = active
            self._busy = False

    def deleted(self) -> bool:
        """Whether the user has removed the layer of curves, and so the results."""
        return "curves" in self._layers and self.layer("curves") is None

    def missing(self) -> set[Key]:
        """(frame, id) of the curves that the user has deleted from their layer."""
        return set() if self.deleted() else set(self._written - set(self._keys()))

    def selection(self) -> tuple[Key, ...]:
        """(frame, id) of the curves that are selected in their layer."""
        layer = self.layer("curves")
        chosen = layer.selected_data if isinstance(layer, Shapes) else ()
        keys = self._keys()
        return tuple(keys[i] for i in sorted(chosen) if i < len(keys))

    def select(self, keys: Collection[Key]) -> None:
        """Select curves in their layer."""
        layer = self.layer("curves")
        if isinstance(layer, Shapes) and set(keys) != set(self.selection()):
            # napari takes a selection for an edit of its look and writes all text anew: 0.2 s
            # with 1,000 curves.
            with self._undisturbed(), layer.events.edge_width.blocker():
                layer.selected_data = {i for i, key in enumerate(self._keys()) if key in keys}
            layer.events.highlight()
        self.emphasise()

    def emphasise(self) -> None:
        """Draw the selected curves broader: napari marks them in some of its tools only."""
        layer = self.layer("curves")
        curves = self._shown.get("curves", ())
        if not isinstance(layer, Shapes) or layer.nshapes != len(curves):
            return
        chosen = set(layer.selected_data)
        changed, self._broad = chosen ^ self._broad, chosen
        if not changed:
            return
        breadths = _breadths(curves, 1.0)
        with self._undisturbed(), layer.events.edge_width.blocker():
            for i in changed:
                layer.selected_data = {i}
                layer.current_edge_width = breadths[i] * (SELECTED if i in chosen else 1.0)
            layer.selected_data = chosen
        layer.refresh(thumbnail=False, extent=False)

    def _keys(self) -> list[Key]:
        layer = self.layer("curves")
        if not isinstance(layer, Shapes) or "id" not in layer.features:
            return []
        return list(zip(layer.features["frame"], layer.features["id"], strict=True))

    def _ensure(self, role: Role) -> Iterator[None]:
        """Make a layer if there is none."""
        if self.layer(role) is None and self._owner.records:
            self._shown.pop(role, None)
            place = placement(self._image)
            self._add(role, Shapes(ndim=self._image.ndim, **self._keywords(role), **place))
            yield

    def _show_outlines(self) -> Iterator[None]:
        lines = {id(r.curve): outline(r.curve) for r in self._fresh("outlines")}
        kept = [r for r in self._owner.records if lines.get(id(r.curve), ()) is not None]
        return self._show_shapes("outlines", kept, lines)

    def _show_curves(self) -> Iterator[None]:
        lines = {id(r.curve): r.curve.points for r in self._fresh("curves")}
        return self._show_shapes("curves", self._owner.records, lines)

    def _fresh(self, role: Role) -> list[Record]:
        """Records whose curves are not in their layer yet."""
        there = {id(curve) for curve in self._shown.get(role, ())}
        return [record for record in self._owner.records if id(record.curve) not in there]

    def _show_shapes(
        self,
        role: Role,
        records: Sequence[Record],
        lines: Mapping[int, Float[np.ndarray, "N 2"] | None],
    ) -> Iterator[None]:
        """Take out the curves that are gone and add those that are new, some at each step."""
        layer = self.layer(role)
        if not isinstance(layer, Shapes):
            return
        by_curve = {id(record.curve): record for record in records}
        gone = self._gone(role, layer, by_curve)
        if gone:
            layer.selected_data = set()
            layer.remove(gone)
            self._drop(role, set(gone))
        there = {id(curve) for curve in self._shown.get(role, ())}
        fresh = [record for record in records if id(record.curve) not in there]
        curves = [record.curve for record in fresh]
        colours = colours_of(curves, *self._look)
        shapes = [in_stack(self._image, r.frame, _line(lines[id(r.curve)])) for r in fresh]
        for done in add_shapes(
            layer,
            shapes,
            # Outlines too: napari takes 50 ms to fill a polygon that nobody sees filled.
            ["path"] * len(fresh),
            edge_color=colours,
            face_color="transparent",
            edge_width=_breadths(curves, 0.5 if role == "outlines" else 1.0),
        ):
            self._shown[role] = (*self._shown.get(role, ()), *curves[done])
            self._colours[role] = [*self._colours.get(role, ()), *colours[done]]
            yield
        self._describe(role, layer, by_curve)
        if gone:
            yield

    def _gone(self, role: Role, layer: Shapes, by_curve: Mapping[int, Record]) -> list[int]:
        """Positions in a layer of what does not belong there."""
        shown = self._shown.get(role, ())
        if layer.nshapes != len(shown):
            self._shown[role], self._colours[role] = (), []
            self._broad = set() if role == "curves" else self._broad
            return list(range(layer.nshapes))
        return [i for i, curve in enumerate(shown) if id(curve) not in by_curve]

    def _drop(self, role: Role, positions: Collection[int]) -> None:
        """Forget what was at some positions of a layer."""
        kept = [i for i in range(len(self._shown.get(role, ()))) if i not in positions]
        self._shown[role] = tuple(self._shown[role][i] for i in kept) if kept else ()
        self._colours[role] = [self._colours[role][i] for i in kept]
        if role == "curves":
            self._broad = {new for new, old in enumerate(kept) if old in self._broad}

    def _describe(self, role: Role, layer: Shapes, by_curve: Mapping[int, Record]) -> None:
        """Let features, colours and marks of a layer say what is known now."""
        shown = self._shown.get(role, ())
        layer.features = features([by_curve[id(curve)] for curve in shown])
        colours = colours_of(shown, *self._look)
        if colours and colours != self._colours.get(role):
            self._colours[role] = colours
            layer.edge_color = colours
        if role == "curves":
            self._rows = self._keys()
            self._written = frozenset(self._rows)
            _write_marks(layer, shown)

    def _show_reconstruction(self) -> Iterator[None]:
        layer = self.layer("reconstruction")
        patches = self._owner.patches
        if (layer or not patches) and patches is self._pictured:
            return
        self._pictured = patches
        if not patches:
            if layer:
                self._viewer.layers.remove(layer)
            yield
            return
        film = Film(self._owner.patches, frame_shape(self._image))
        where = placement_on(self._image, film.grid.origin, film.grid.step)
        if isinstance(layer, Image) and layer.data.shape == film.shape:
            layer.data = cast(Any, film)
            for name, value in where.items():
                setattr(layer, name, value)
            yield
            return
        visible = layer.visible if layer else False
        if layer:
            self._viewer.layers.remove(layer)
        layer = Image(
            cast(Any, film),
            multiscale=False,
            **look_of(self._image),
            **self._keywords("reconstruction"),
            **where,
        )
        layer.visible = visible
        self._add("reconstruction", layer)
        yield

    def _keywords(self, role: Role) -> dict[str, Any]:
        return {"name": f"{self._name} {role}", "metadata": {ROLE: role, OWNER: self._owner}}

    def _add(self, role: Role, layer: Layer) -> None:
        """Put a new layer in its place: pictures above the image, lines on top of all."""
        layers = self._viewer.layers
        place = layers.index(self._image) + 1 if role == "reconstruction" else len(layers)
        self._layers[role] = layer
        layers.insert(place, layer)
        layer.events.visible.connect(self._on_visible)
        if isinstance(layer, Shapes) and role == "curves":
            layer.events.data.connect(self._on_data)
            layer.selected_data.events.items_changed.connect(self._on_selected)
            layer.mouse_drag_callbacks.append(self._on_press)

    def _on_visible(self, event: Any) -> None:
        self.toggled.emit()

    def _on_data(self, event: Any) -> None:
        if not self._busy and event.action in EDITS:
            left = set(self._keys())
            if event.action == ActionType.REMOVED and len(left) < len(self._rows):
                self._drop("curves", {i for i, key in enumerate(self._rows) if key not in left})
                self._rows = [key for key in self._rows if key in left]
            else:
                self._shown.pop("curves", None)
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


def look_of(image: Image) -> dict[str, Any]:
    """Give the keywords that make pictures in an image's own units look like it."""
    low, high = image.contrast_limits
    look = {} if image.rgb else {"colormap": image.colormap.name, "gamma": image.gamma}
    return look | {"contrast_limits": (float(low or 0), float(high or 0))}


def _breadths(curves: Sequence[Curve], factor: float) -> list[float]:
    unit = factor * breadth(curves)
    return [unit * BREADTHS[curve.status] for curve in curves]


def _line(line: Float[np.ndarray, "N 2"] | None) -> Float[np.ndarray, "N 2"]:
    assert line is not None
    return line


def _write_marks(layer: Shapes, curves: Sequence[Curve]) -> None:
    """Write number and mark beside the curves that ask for a look, unless there are too many.

    napari's time for text grows with the square of the number of shapes.
    """
    if len(curves) > MARKED:
        if layer.text.values.size > 1:
            layer.text = {"string": {"constant": ""}}
        return
    numbers = layer.features["id"]
    layer.text = {
        "string": [
            f"{number} {MARKS[curve.status]}" if MARKS[curve.status] else ""
            for number, curve in zip(numbers, curves, strict=True)
        ],
        "color": [COLOURS[curve.status] for curve in curves],
        "size": 10,
        "anchor": "upper_left",
    }

"""What the user drew: the lines of a Shapes layer, in pixels of an image."""

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float
from napari.components import ViewerModel
from napari.layers import Image, Layer, Shapes

from napari_splinesketch import palette
from napari_splinesketch.plugin.adapter.space import (
    frame_numbers,
    from_world,
    placement,
    to_pixels,
)

LINES = ("line", "path")
SHORTEST = 2.0
"""Anything shorter is a stray click, px."""
SELECTING = ("select", "direct", "vertex_insert", "vertex_remove")
"""Modes in which napari shows what is selected; while drawing, the last line always is."""
COLOUR = palette.SKETCH
SUFFIX = " sketches"
"""What the name of a new layer ends with; layers of results drop it."""


@dataclass(frozen=True, eq=False)
class Drawn:
    """The sketches of one frame.

    Attributes
    ----------
    lines
        (N, 2) polylines, (row, col) in pixels of the image.
    numbers
        Position of each in its layer.
    strays
        How many lines were too short to mean anything.
    unusable
        How many shapes of other kinds there are: {"rectangle": 2}.
    """

    lines: tuple[Float[np.ndarray, "N 2"], ...] = ()
    numbers: tuple[int, ...] = ()
    strays: int = 0
    unusable: Mapping[str, int] = field(default_factory=dict)


def drawn_in(
    viewer: ViewerModel,
    layer: Shapes,
    image: Image,
    frame: int,
    among: Collection[int] = (),
) -> Drawn:
    """Read the sketches of one frame, all or those at some positions of the layer.

    A layer without an axis for frames belongs to all of them.
    """
    shapes = layer.data
    if not shapes:
        return Drawn()
    vertices = np.concatenate(shapes)
    first = np.cumsum([0] + [len(shape) for shape in shapes[:-1]])
    pixels = to_pixels(viewer, layer, image, vertices)
    frames = frame_numbers(image, pixels[first])
    seen = _in_view(viewer, layer, image, vertices[first])
    kinds = layer.shape_type
    lines, numbers, strays, unusable = [], [], 0, Counter[str]()
    plane = pixels[:, -2:]
    steps = np.linalg.norm(np.diff(plane, axis=0, append=plane[-1:]), axis=1)
    steps[first[1:] - 1] = 0.0  # from one shape to the next
    lengths = np.add.reduceat(steps, first)
    for i, line in enumerate(np.split(plane, first[1:])):
        if frames[i] != frame or not seen[i] or (among and i not in among):
            continue
        if kinds[i] not in LINES:
            unusable[kinds[i]] += 1
        elif not lengths[i] >= SHORTEST:
            strays += 1
        else:
            lines.append(line)
            numbers.append(i)
    return Drawn(tuple(lines), tuple(numbers), strays, unusable)


def _in_view(
    viewer: ViewerModel, layer: Shapes, image: Image, points: Float[np.ndarray, "N D"]
) -> list[bool]:
    """Whether shapes are in view as to the axes that the image does not have."""
    extra = max(layer.ndim - image.ndim, 0)
    point = from_world(viewer, layer, np.array(viewer.dims.point)[None, -layer.ndim :])
    same = np.round(points[:, :extra]) == np.round(point[:, :extra])
    return same.all(axis=1).tolist()


def selected_in(layer: Shapes) -> frozenset[int]:
    """Positions of the shapes that the user has selected; none while drawing."""
    return frozenset(layer.selected_data) if layer.mode in SELECTING else frozenset()


def new_sketch_layer(viewer: ViewerModel, image: Image, *, visible: bool = True) -> Shapes:
    """Add an empty layer that lies on the image, ready for drawing lines in the frame in view.

    A layer that is not to be visible yet gets ready by `begin_drawing`.
    """
    style = line_style(image.level_shapes[0][image.ndim - 2 : image.ndim])
    layer = Shapes(
        ndim=image.ndim, name=image.name + SUFFIX, visible=visible, **style, **placement(image)
    )
    viewer.layers.append(layer)
    layer.current_edge_color = style["edge_color"]
    layer.current_edge_width = style["edge_width"]
    if visible:
        begin_drawing(layer)
    return layer


def begin_drawing(layer: Shapes, viewer: ViewerModel | None = None) -> None:
    """Let the user draw lines into a layer, with the tool that she has used there."""
    if viewer is not None:
        viewer.layers.selection.active = layer
    if not layer.visible:
        layer.visible = True
    if not layer.mode.startswith("add"):
        layer.mode = "add_line"


def drawing(viewer: ViewerModel, layer: Shapes) -> bool:
    """Whether the user is drawing into a layer."""
    return viewer.layers.selection.active is layer and layer.mode.startswith("add")


def select_curves(viewer: ViewerModel, curves: Layer) -> None:
    """Let the user select curves by clicking them."""
    viewer.layers.selection.active = curves
    if isinstance(curves, Shapes):
        curves.mode = "pan_zoom"


def line_style(shape: Sequence[int]) -> dict[str, Any]:
    """Look of sketches on an image of (H, W) px."""
    width = max(1.0, float(max(shape)) / 512)
    return {"edge_color": COLOUR, "edge_width": width, "face_color": "transparent"}

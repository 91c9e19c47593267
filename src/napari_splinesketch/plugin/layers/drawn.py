"""What the user draws: the lines of a Shapes layer, in pixels of an image."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import islice
from typing import Any

import numpy as np
import pandas as pd
from napari.components import ViewerModel
from napari.layers import Image, Shapes

from napari_splinesketch import palette
from napari_splinesketch.plugin import model
from napari_splinesketch.plugin.layers import space

LINES = ("line", "path")
SHORTEST = 2.0  # anything shorter is a stray click, px
SELECTING = ("select", "direct", "vertex_insert", "vertex_remove")  # modes that show a selection
MANY = 200  # with so many sketches, what follows from several edits in a row is worked out once
CHUNK = 50  # shapes added at once: napari takes about as long for one of them as for so many
CLICK = 4.0  # px of the screen: a mouse that moves less while it is pressed has clicked
FADED = 0.3  # how opaque a line is that has become a curve
SUFFIX = " sketches"  # what the name of a new layer ends with; layers of results drop it


@dataclass(frozen=True, eq=False)
class Drawn:
    """The sketches of one frame, px, and the position of each in its layer."""

    lines: tuple[model.Line, ...] = ()
    numbers: tuple[int, ...] = ()
    strays: int = 0  # left out, as too short to mean anything
    unusable: Mapping[str, int] = field(default_factory=dict)  # of other kinds: {"rectangle": 2}


def drawn_in(viewer: ViewerModel, layer: Shapes, image: Image, frame: int) -> Drawn:
    """Read the sketches of one frame. A layer without an axis for frames belongs to all of them."""
    read = shapes_in(viewer, layer, image)
    if not read:
        return Drawn()
    # Sliders of axes that the image does not have.
    first, extra = np.array([shape[0] for shape in layer.data]), max(layer.ndim - image.ndim, 0)
    here = space.from_world(viewer, layer, np.array(viewer.dims.point)[None, -layer.ndim :])
    seen = (np.round(first[:, :extra]) == np.round(here[:, :extra])).all(axis=1)
    kinds, lengths = layer.shape_type, model.lengths_of([line for _, line in read])
    there = [i for i, (at, _) in enumerate(read) if at == frame and seen[i]]
    usable = [i for i in there if kinds[i] in LINES]
    numbers = tuple([i for i in usable if lengths[i] >= SHORTEST])
    unusable = Counter([kinds[i] for i in there if kinds[i] not in LINES])
    lines = tuple([read[i][1] for i in numbers])
    return Drawn(lines, numbers, len(usable) - len(numbers), unusable)


def shapes_in(viewer: ViewerModel, layer: Shapes, image: Image) -> list[tuple[int, model.Line]]:
    """Read all shapes of a layer: the frame of each, and its vertices in pixels of the image."""
    lines = model.changed(layer.data, partial(space.to_pixels, viewer, layer, image))
    frames = space.frame_numbers(image, np.array([line[0] for line in lines])) if lines else []
    return [(frame, line[:, -2:]) for frame, line in zip(frames, lines, strict=True)]


def selected_in(layer: Shapes) -> frozenset[int]:
    """Positions of the shapes that the user has selected; none while drawing."""
    return frozenset(layer.selected_data) if layer.mode in SELECTING else frozenset()


def new_sketch_layer(viewer: ViewerModel, image: Image) -> Shapes:
    """Add an empty layer that lies on the image, ready for drawing."""
    layer = empty_layer(image, image.name + SUFFIX)
    viewer.layers.append(layer)
    begin_drawing(layer, viewer, image)
    return layer


def empty_layer(image: Image, name: str, *, flat: bool = False) -> Shapes:
    """Make an empty layer of sketches that lies on the image; a flat one is in all frames."""
    style, axes = line_style(space.size_of(image)), 2 if flat else image.ndim
    layer = Shapes(ndim=axes, name=name, **style, **space.placement(image, axes))
    layer.current_edge_color = style["edge_color"]
    layer.current_edge_width = style["edge_width"]
    return layer


def bring_into_view(layer: Shapes, viewer: ViewerModel, image: Image) -> None:
    """Let the user see lines: not hidden, nor under an image that was opened later."""
    if not layer.visible:
        layer.visible = True
    layers = viewer.layers
    if (at := layers.index(layer)) < layers.index(image):
        layers.move(at, 1 + max(i for i, each in enumerate(layers) if isinstance(each, Image)))


def begin_drawing(layer: Shapes, viewer: ViewerModel, image: Image) -> None:
    """Let the user draw lines over an image, with the tool that was used in their layer last."""
    viewer.layers.selection.active = layer
    bring_into_view(layer, viewer, image)
    if not layer.mode.startswith("add"):
        layer.mode = "add_line"


def drawing(viewer: ViewerModel, layer: Shapes) -> bool:
    """Whether the user is drawing into a layer."""
    return viewer.layers.selection.active is layer and layer.mode.startswith("add")


def clicked(viewer: ViewerModel, layer: Shapes) -> bool:
    """Whether the user draws, and the last shape is but a click: a short line at 45 degrees."""
    if not drawing(viewer, layer) or not layer.nshapes or layer.shape_type[-1] != "line":
        return False
    down, right = np.diff(layer.data[-1], axis=0)[0, -2:]
    # napari makes it as long along both axes, and measures that along the last one.
    short = abs(right) < CLICK * space.screen_pixel(viewer, layer)[-1]
    return bool(short and np.isclose(down, right, rtol=1e-3))


def forget_given_up(layer: Shapes) -> None:
    """Drop what napari keeps of lines that were given up, or lost their last vertices.

    A view in 3-D would lose all shapes.
    """
    count, view = layer.nshapes, layer._data_view  # nothing public can shorten its colours
    if len(layer.features) > count:
        layer.features = pd.DataFrame(layer.features).head(count)
    view._edge_color, view._face_color = view._edge_color[:count], view._face_color[:count]


def put_into_frame(layer: Shapes) -> None:
    """Put the line drawn last into the frame where it ends: napari shows none that is in two."""
    for line in layer.data[-1:]:
        there = line.copy()
        there[:, :-2] = line[-1, :-2]
        if (there != line).any():
            layer.data = [*layer.data[:-1], there]


def line_style(size: tuple[int, int]) -> dict[str, Any]:
    """Look of sketches on an image of (H, W) px."""
    width = max(1.0, max(size) / 512)
    return {"edge_color": palette.SKETCH, "edge_width": width, "face_color": "transparent"}


def add_shapes(
    layer: Shapes, shapes: Iterable[np.ndarray], kinds: Sequence[str], **look: Any
) -> Iterator[slice]:
    """Add shapes to a layer, some at each step; gives which. Vertices are made when needed.

    An empty layer is hidden meanwhile: to draw it again and again takes napari longer than to fill
    it. Colours and widths are as `Shapes.add` takes them, for all or in a list.
    """
    made = iter(shapes)
    veiled = layer.visible and layer.nshapes == 0 and len(kinds) > CHUNK
    if veiled:
        layer.visible = False
    try:
        for start in range(0, len(kinds), CHUNK):
            part = slice(start, start + CHUNK)
            some: dict[str, Any] = {"shape_type": list(kinds[part])}
            some |= {k: v[part] if isinstance(v, list | np.ndarray) else v for k, v in look.items()}
            if not layer.visible:  # napari has not turned it to 3-D or back with the view
                layer.set_view_slice()
            layer.add(list(islice(made, CHUNK)), **some)
            yield part
    finally:
        if veiled:
            layer.visible = True

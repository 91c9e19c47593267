"""Between what the window holds and what is written down."""

from collections import defaultdict
from collections.abc import Iterable, Mapping

import numpy as np
from napari.components import ViewerModel
from napari.layers import Image, Shapes

from napari_splinesketch.plugin.adapter.sketches import line_style
from napari_splinesketch.plugin.adapter.space import (
    frame_numbers,
    in_stack,
    placement,
    to_pixels,
)
from napari_splinesketch.plugin.autosave.session import EVERY, Page, Shape
from napari_splinesketch.plugin.state import State

Drawn = dict[int, list[Shape]]


def shapes_in(viewer: ViewerModel, layer: Shapes, image: Image) -> Drawn:
    """Read what is drawn in a layer, by frame, px of the image."""
    shapes = layer.data
    if not shapes:
        return {}
    first = np.cumsum([0] + [len(shape) for shape in shapes[:-1]])
    pixels = to_pixels(viewer, layer, image, np.concatenate(shapes))
    flat = layer.ndim < image.ndim
    frames = [EVERY] * len(shapes) if flat else frame_numbers(image, pixels[first])
    found: Drawn = defaultdict(list)
    lines = np.split(pixels[:, -2:], first[1:])
    for frame, kind, line in zip(frames, layer.shape_type, lines, strict=True):
        found[frame].append(Shape(kind, line))
    return dict(found)


def pages_of(drawn: Mapping[int, Iterable[Shape]], state: State) -> dict[int, Page]:
    """Put what is drawn and what is known together, frame by frame."""
    records, deleted = defaultdict(list), defaultdict(list)
    for record in state.records:
        records[record.frame].append(record)
    for record in state.deleted:
        deleted[record.frame].append(record)
    return {
        frame: Page(
            tuple(drawn.get(frame, ())),
            tuple(records[frame]),
            tuple(deleted[frame]),
            state.seconds.get(frame),
            tuple(state.notes.get(frame, ())),
            state.patches.get(frame),
        )
        for frame in sorted({*drawn, *records, *deleted})
    }


def state_of(pages: Mapping[int, Page]) -> State:
    """What was known."""
    known = {frame: page for frame, page in pages.items() if frame != EVERY}
    return State(
        records=tuple(record for page in known.values() for record in page.records),
        deleted=tuple(record for page in known.values() for record in page.deleted),
        patches={f: page.patch for f, page in known.items() if page.patch is not None},
        seconds={f: page.seconds for f, page in known.items() if page.seconds is not None},
        notes={f: page.notes for f, page in known.items() if page.notes},
    )


def layer_for(image: Image, name: str, flat: bool) -> Shapes:
    """Make an empty layer of sketches that lies on the image; a flat one is in all frames."""
    style = line_style(image.level_shapes[0][image.ndim - 2 : image.ndim])
    place = placement(image)
    if flat and image.ndim > 2:
        place = {"scale": image.scale[-2:], "translate": image.translate[-2:]}
        place |= {"units": image.units[-2:], "axis_labels": image.axis_labels[-2:]}
    layer = Shapes(ndim=2 if flat else image.ndim, name=name, **style, **place)
    layer.current_edge_color = style["edge_color"]
    layer.current_edge_width = style["edge_width"]
    return layer


def vertices(image: Image, frame: int, shape: Shape) -> np.ndarray:
    """Give a shape's vertices in the data of a layer made by `layer_for`."""
    return shape.points if frame == EVERY else in_stack(image, frame, shape.points)

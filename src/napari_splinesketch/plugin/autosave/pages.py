"""Between what the window holds and what is written down."""

from collections import defaultdict
from collections.abc import Iterable, Mapping

from napari.components import ViewerModel
from napari.layers import Image, Shapes

from napari_splinesketch.plugin.autosave.session import EVERY, Page, Shape
from napari_splinesketch.plugin.layers import drawn as sketches
from napari_splinesketch.plugin.model import State

Drawn = dict[int, list[Shape]]


def shapes_in(viewer: ViewerModel, layer: Shapes, image: Image) -> Drawn:
    """Read what is drawn in a layer, by frame, px of the image."""
    flat = layer.ndim < image.ndim
    found: Drawn = defaultdict(list)
    read = sketches.shapes_in(viewer, layer, image)
    for kind, (frame, line) in zip(layer.shape_type, read, strict=True):
        found[EVERY if flat else frame].append(Shape(kind, line))
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

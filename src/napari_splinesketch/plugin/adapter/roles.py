"""Which layers show results, and of what."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Literal, Protocol

from napari.components import ViewerModel
from napari.layers import Image, Layer

from napari_splinesketch.plugin.adapter.film import Patch
from napari_splinesketch.plugin.records import Record

ROLE, OWNER = "napari-splinesketch", "napari-splinesketch work"
"""Keys of a layer's metadata: what it shows, and the work that it shows."""
Role = Literal["curves", "outlines", "reconstruction", "selected", "marks"]


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


def look_of(image: Image) -> dict[str, Any]:
    """Give the keywords that make pictures in an image's own units look like it."""
    low, high = image.contrast_limits
    look = {} if image.rgb else {"colormap": image.colormap.name, "gamma": image.gamma}
    return look | {"contrast_limits": (float(low or 0), float(high or 0))}


def put(viewer: ViewerModel, layer: Layer, place: int | None = None) -> None:
    """Add a layer, on top if no place is named, without taking the active one from the user.

    napari selects what is added. Nobody is told, as it is undone at once: being told and told again
    is half of what an added layer takes.
    """
    layers = viewer.layers
    selection, chosen = layers.selection, set(layers.selection)
    active = selection.active
    with selection.events.blocker_all():
        layers.insert(len(layers) if place is None else place, layer)
        if active is None:
            selection.clear()
            selection.update(chosen)
        else:
            selection.active = active


@contextmanager
def undisturbed(viewer: ViewerModel) -> Iterator[None]:
    """Change layers without taking the active one from the user."""
    active = viewer.layers.selection.active
    try:
        yield
    finally:
        if active in viewer.layers and active is not viewer.layers.selection.active:
            viewer.layers.selection.active = active

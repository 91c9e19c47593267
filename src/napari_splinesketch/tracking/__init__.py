"""Bodies through time: carried from frame to frame, each under its own number."""

from napari_splinesketch.tracking.around import around
from napari_splinesketch.tracking.bodies import Body
from napari_splinesketch.tracking.follow import after, follow
from napari_splinesketch.tracking.over_time import Kymograph, kymograph
from napari_splinesketch.tracking.types import Given, Tracked, View

__all__ = [
    "Body",
    "Given",
    "Kymograph",
    "Tracked",
    "View",
    "after",
    "around",
    "follow",
    "kymograph",
]

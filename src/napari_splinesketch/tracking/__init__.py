"""Bodies through time: carried from frame to frame, each under its own number."""

from napari_splinesketch.tracking.bodies import Body, Given, Tracked, View
from napari_splinesketch.tracking.follow import after, around, follow
from napari_splinesketch.tracking.over_time import Kymograph, kymograph

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

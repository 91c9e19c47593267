"""Pointing the window at a curve."""

import numpy as np
from jaxtyping import Float
from napari.components import ViewerModel
from napari.layers import Image

from napari_splinesketch.plugin.adapter.space import go_to_frame, in_stack, unit_factors


def look_at(
    viewer: ViewerModel, image: Image, frame: int, points: Float[np.ndarray, "N 2"]
) -> None:
    """Go to a frame and bring the middle of some points, px of the image, to the canvas's."""
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    (place,) = in_stack(image, frame, middle[None])
    world = np.array(image.data_to_world(place)) * unit_factors(viewer, image)
    go_to_frame(viewer, image, frame)
    viewer.scene.camera.center = (0.0, float(world[-2]), float(world[-1]))

"""One body alone, as the reconstruction of all of them has it."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from napari_splinesketch.engine.types import Curve
from napari_splinesketch.labels import Label
from napari_splinesketch.labels.raster import Patch as Touched
from napari_splinesketch.labels.raster import rasterise
from napari_splinesketch.plugin.adapter.film import Patch

SOFT = 3.0
"""How far beyond its edge a body may be seen, px of the picture."""
BIN = 0.5
"""Width of the rings in which a body is taken to be equally bright, px."""


def alone(patch: Patch, curve: Curve, others: Sequence[Curve]) -> Float[np.ndarray, "H W"]:
    """Draw one body on the background.

    Where it touches no other, it is what the reconstruction has. Where it does, it is as bright as
    elsewhere at the same depth below its edge.

    Parameters
    ----------
    patch
        The reconstruction, with its background.
    curve
        The body, px of the image.
    others
        All other curves of the frame, px of the image.
    """
    background = np.zeros(patch.shape) if patch.background is None else patch.background
    picture = np.array(background, dtype=float)
    touched = _touched(patch, curve)
    if touched is None:
        return picture
    elsewhere = np.zeros(patch.shape, dtype=bool)
    for other in others:
        beside = _touched(patch, other)
        if beside is not None:
            elsewhere[beside.place] |= beside.inside
    shared = elsewhere[touched.place]
    own = (patch.pixels - background)[touched.place]
    drawn = np.where(touched.inside, own, 0.0)
    both, only = touched.inside & shared, touched.inside & ~shared
    if both.any() and only.any():
        drawn[both] = _profile(touched.depth[only], own[only], touched.depth[both])
    picture[touched.place] += drawn
    return picture


def _touched(patch: Patch, curve: Curve) -> Touched | None:
    """The pixels that a body may be seen in."""
    if curve.status == "failed" or not np.isfinite(curve.half_width).all():
        return None
    reach = curve.half_width / patch.grid.size + SOFT
    label = Label.from_curve(curve)
    points = patch.grid.to_block(curve.points)
    height, width = patch.shape
    return rasterise(
        Label(label.frame, label.curve, points, reach, label.sd, label.status), (height, width)
    )


def _profile(
    depth: Float[np.ndarray, " A"], values: Float[np.ndarray, " A"], at: Float[np.ndarray, " B"]
) -> Float[np.ndarray, " B"]:
    """Look up what is usual at some depths."""
    ring = np.floor(depth / BIN).astype(int)
    count = np.bincount(ring)
    mean = np.bincount(ring, values) / np.maximum(count, 1)
    known = count > 0
    return np.interp(at, (np.arange(len(count))[known] + 0.5) * BIN, mean[known])

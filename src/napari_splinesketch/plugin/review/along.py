"""Along a body: what the model leaves unexplained at each of a curve's points."""

import numpy as np
from jaxtyping import Float, Real
from scipy.ndimage import map_coordinates

from napari_splinesketch.plugin.layers.looks import normals

SPACING = 0.5
"""Between the places across a body at which the picture is read, px at most."""


def across(
    points: Float[np.ndarray, "P 2"], half_width: Float[np.ndarray, " P"]
) -> Float[np.ndarray, "P Q 2"]:
    """Places on a body's cross-sections, from edge to edge.

    Parameters
    ----------
    points
        (P, 2) centreline, (row, col), px.
    half_width
        (P,) from the centreline to the edge, px; a section where it is not known is one point.
    """
    reach = np.nan_to_num(half_width, nan=0.0, posinf=0.0)
    count = 1 + 2 * int(np.ceil(reach.max(initial=0.0) / SPACING))
    share = np.linspace(-1, 1, count) if count > 1 else np.zeros(1)
    return points[:, None] + (reach[:, None] * share)[..., None] * normals(points)[:, None]


def mean_across(
    picture: Real[np.ndarray, "H W"],
    points: Float[np.ndarray, "P 2"],
    half_width: Float[np.ndarray, " P"],
) -> Float[np.ndarray, " P"]:
    """Average a picture over a body's cross-section at each point of its centreline.

    Pixels that are not finite are left out, as are those beyond the picture; NaN where none is
    left.

    Parameters
    ----------
    picture
        (H, W), for example image minus reconstruction.
    points, half_width
        As for `across`, in pixels of the picture.
    """
    places = across(points, half_width)
    low = np.clip(np.floor(places.min((0, 1))).astype(int), 0, picture.shape)
    high = np.ceil(places.max((0, 1))).astype(int) + 2
    picture = picture[low[0] : max(high[0], 0), low[1] : max(high[1], 0)]
    if not picture.size:
        return np.full(len(points), np.nan)
    where = np.moveaxis(places - low, -1, 0)
    known = np.isfinite(picture)
    filled = np.where(known, picture, 0.0).astype(float)
    values = map_coordinates(filled, where, order=1, cval=0.0)
    # Weights fall to zero with the pixels that are missing, as the values do.
    weights = map_coordinates(known.astype(float), where, order=1, cval=0.0)
    total = weights.sum(axis=1)
    mean = np.full(len(points), np.nan)
    return np.divide(values.sum(axis=1), total, out=mean, where=total > 1e-6)

"""Medians and blurs of whole images, faster than NumPy's and SciPy's own."""

import numpy as np
from jaxtyping import Float
from scipy import ndimage

from napari_splinesketch.engine import constants as const
from napari_splinesketch.engine.types import Array


def blurred(image: Float[Array, "H W"], sigma: float, **how) -> Float[Array, "H W"]:
    """The same as `scipy.ndimage.gaussian_filter`; `how` is passed on to it."""
    rows, columns = image.shape
    found = np.empty((rows, columns + const.ROW_APART), image.dtype)[:, :columns]
    found[:] = image
    return ndimage.gaussian_filter(found, sigma, output=found, **how)


def median(values: Float[Array, "*B N"]) -> Float[Array, "*B"]:
    """Medians along the last axis; all values are finite, and their order is changed.

    NumPy finds one rank several times as fast as the two that its own median asks for.
    """
    half = values.shape[-1] // 2
    values.partition(half, axis=-1)
    if values.shape[-1] % 2:
        return values[..., half]
    return (values[..., :half].max(-1) + values[..., half]) / 2

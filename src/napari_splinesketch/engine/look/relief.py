"""Images in relief: bodies are bright on one side and dark on the other, as if lit from there.

Differential interference contrast and oblique light show transparent bodies like that.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy import fft

from napari_splinesketch.engine import constants as const
from napari_splinesketch.engine import spline
from napari_splinesketch.engine.look.ridges import Ridges
from napari_splinesketch.engine.look.sketched import ridges_beside
from napari_splinesketch.engine.types import Array, Line


@dataclass(frozen=True, eq=False)
class Sides:
    """What is beside the sketch of one body, at P points of it."""

    normals: Float[Array, "P 2"]
    lifted: Float[Array, " P"]
    """By how much the side that the normal points to is brighter: bright ridges less dark ones."""
    whole: Float[Array, " P"]
    """The heights of all these ridges together."""
    off: float
    """How far the sketch is from the middle between the highest bright ridge and the highest dark
    one, as a share of their distance."""


def sides(ridges: Ridges, line: Line) -> Sides:
    """The ridges on both sides of a sketch."""
    points, offsets, heights = ridges_beside(ridges, line)
    (bright, dark), (other, shade) = (
        heights[:, :, there].max(2) for there in (offsets > 0, offsets < 0)
    )
    lifted, whole = bright - dark - other + shade, bright + dark + other + shade
    usual = np.median(whole) + 1e-30
    high, low = offsets[heights.argmax(2)]
    middle = np.median((high + low) / 2 * np.sign(lifted))
    off = abs(middle) / (np.median(np.abs(high - low)) + 1e-30)
    return Sides(spline.normals(points), lifted / usual, whole / usual, float(off))


def lit_from(bodies: Sequence[Sides]) -> Float[Array, "2"] | None:
    """The direction that bodies are lit from, a unit vector; None if they are not in relief.

    In relief a bright ridge is on one side of each sketch and a dark one on the other, both as far
    away. Which side is bright, and how bright, follows from the sketch's direction alone.
    """
    if not bodies:
        return None
    normals = np.concatenate([body.normals for body in bodies])
    lifted = np.concatenate([body.lifted for body in bodies])
    whole = np.concatenate([body.whole for body in bodies])
    towards = np.linalg.lstsq(normals, lifted)[0]
    explained = (normals @ towards) @ lifted / (whole @ whole + 1e-30)
    off = np.median([body.off for body in bodies])
    if explained < const.RELIEF_EXPLAINED + const.RELIEF_ALONE / len(bodies):
        return None
    if off > const.RELIEF_MIDDLE * np.sqrt(len(bodies)):
        return None
    return towards / np.linalg.norm(towards)


def raised(image: Float[Array, "H W"], towards: Float[Array, "2"]) -> Float[Array, "H W"]:
    """The image with bodies that are bright instead of lit from a direction, a unit vector.

    Its Hilbert transform along the direction (Arnison et al. 2000), which leaves white noise white.
    The opposite direction gives bright bodies a relief.
    """
    rows, columns = image.shape
    size = fft.next_fast_len(2 * rows), fft.next_fast_len(2 * columns)
    along = fft.fftfreq(size[0])[:, None] * towards[0] + fft.rfftfreq(size[1]) * towards[1]
    turned = fft.rfft2(image - np.median(image), size) * (1j * np.sign(along))
    return np.asarray(fft.irfft2(turned, size))[:rows, :columns]

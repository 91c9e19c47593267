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
    """The bright side and the dark side of the body of one sketch, if it has any."""

    normals: Float[Array, "P 2"]
    """Of P points on the sketch."""
    lifted: Float[Array, " P"]
    """How much brighter than the other side the one is that the normal points to."""
    off: float
    """How far the sketch is from the middle between them, as a share of their distance."""


def sides(ridges: Ridges, line: Line) -> Sides:
    """The sides of a body: the highest bright ridge and the highest dark one beside its sketch."""
    points, (bright, dark), heights = ridges_beside(ridges, line)
    side, size = np.sign(bright - dark), np.maximum(heights, 0).sum(0)
    middle = np.median((bright + dark) / 2 * side)
    return Sides(
        spline.normals(points),
        side * size / (np.median(size) + 1e-30),
        float(abs(middle) / (np.median(np.abs(bright - dark)) + 1e-30)),
    )


def lit_from(bodies: Sequence[Sides]) -> Float[Array, "2"] | None:
    """The direction that bodies are lit from, a unit vector; None if they are not in relief.

    In relief the two sides are as far from the sketch, and which is bright, and how bright, follows
    from the sketch's direction alone.
    """
    if not bodies:
        return None
    normals = np.concatenate([body.normals for body in bodies])
    lifted = np.concatenate([body.lifted for body in bodies])
    towards = np.linalg.lstsq(normals, lifted)[0]
    explained = (normals @ towards) @ lifted / (lifted @ lifted + 1e-30)
    alone = 1 / np.sqrt(len(bodies))
    if explained < const.RELIEF_EXPLAINED + const.RELIEF_ALONE * alone:
        return None
    if np.median([body.off for body in bodies]) > const.RELIEF_MIDDLE / alone:
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

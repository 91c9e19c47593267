"""First lines for free: sketches over the bodies of an image that nobody has drawn yet."""

from typing import get_args

import numpy as np
from jaxtyping import Bool, Float, Real
from scipy import ndimage

from napari_splinesketch.engine.find.cover import BODY, explain
from napari_splinesketch.engine.find.tracing import TraceGraph, trace
from napari_splinesketch.engine.look.scene import body_mask

THRESHOLD = 0.45
from napari_splinesketch.engine.look.background import estimate_background
from napari_splinesketch.engine.look.scene import pixel_noise, read_scene
from napari_splinesketch.engine.spline import arc_length, fit_knots
from napari_splinesketch.engine.types import Array, Polarity

THRESHOLDS = (0.65, 0.25)
"""Of the contrast, at sensitivity 0 and 1."""
CAUTION = (2.0, 0.5)
"""Factor on what a body costs, at sensitivity 0 and 1."""
STANDS_OUT = 6.0
"""What may be a body differs from the background by so many times the noise, smoothed."""
SURROUNDINGS = 12
"""Of such pixels, px."""
SPACING = 4.0
"""Of the points of a sketch, half-widths."""
BEYOND = 1.0
"""How far a sketch goes on beyond its skeleton, half-widths."""
POINTS = (4, 16)
"""Fewest and most points of a sketch."""

Line = Float[Array, "N 2"]


def suggest(
    image: Real[Array, "H W"],
    sensitivity: float = 0.5,
    polarity: Polarity = "auto",
    half_width: float | None = None,
) -> tuple[Line, ...]:
    """Sketch the bodies of an image: the fewest, smoothest lines that explain its skeleton.

    Parameters
    ----------
    image
        (H, W) any real dtype, any range; pixels that are not finite are left out.
    sensitivity
        0 gives only what stands out, 1 also what is faint or short.
    polarity
        Whether bodies are "bright" or "dark" against the background; "auto" looks.
    half_width
        Rough distance from centreline to edge, px; None measures it.

    Returns
    -------
    (N, 2) polylines, row and col in px, from top to bottom; none where nothing stands out.

    Raises
    ------
    ValueError
        Where the call makes no sense: no image, no finite pixel, a sensitivity outside 0 to 1,
        an unknown polarity, a half-width that is not positive.
    """
    image = _checked(image, sensitivity, polarity, half_width)
    near = _standing_out(image)
    if not near.any():
        return ()
    seen = read_scene(image, near, polarity, half_width)
    w = seen.half_width
    threshold = float(np.interp(sensitivity, (0, 1), THRESHOLDS))
    mask = body_mask(seen.normal * (THRESHOLD / threshold), w, seen.smoothing)
    graph = trace(mask & near & seen.valid, w)
    body = BODY * float(np.interp(sensitivity, (0, 0.5, 1), (CAUTION[0], 1, CAUTION[1])))
    lines = explain(graph, _brightness(graph, seen.normal, w), w, body)
    sketches = [_sketch(line, w) for line in lines]
    return tuple(sorted(sketches, key=lambda line: tuple(line.mean(0))))


def _checked(
    image: Real[Array, "H W"], sensitivity: float, polarity: Polarity, half_width: float | None
) -> Float[Array, "H W"]:
    image = np.asarray(image)
    if image.ndim != 2 or not image.size:
        raise ValueError(f"image has shape {image.shape}; give one 2-D grey image (H, W).")
    if image.dtype.kind not in "biuf":
        raise ValueError(f"image has dtype {image.dtype}; give real numbers.")
    if not np.isfinite(image).any():
        raise ValueError("image has no finite pixel; give an image with data in it.")
    if not 0 <= sensitivity <= 1:
        raise ValueError(f"sensitivity is {sensitivity}; give a number from 0 to 1.")
    if polarity not in get_args(Polarity):
        raise ValueError(f"polarity is {polarity!r}; choose one of {get_args(Polarity)}.")
    if half_width is not None and not 0 < half_width < np.inf:
        raise ValueError(f"half_width is {half_width}; give a positive number of px, or None.")
    return image.astype(np.float64)


def _standing_out(image: Float[Array, "H W"]) -> Bool[Array, "H W"]:
    """Where the image differs from its background by more than noise, and around there."""
    valid = np.isfinite(image)
    filled = np.where(valid, image, np.median(image[valid]))
    noise = pixel_noise(filled)
    flat = ndimage.gaussian_filter(filled - estimate_background(filled, noise)[0], 1.0)
    # Rounding to whole grey values may leave no noise at all to be measured.
    spread = max(noise * 0.28, 1e-6 * float(np.ptp(filled)))
    out = (np.abs(flat) > STANDS_OUT * spread) & valid
    return np.asarray(ndimage.distance_transform_edt(~out)) <= SURROUNDINGS if out.any() else out


def _brightness(
    graph: TraceGraph, normal: Float[Array, "H W"], half_width: float
) -> Float[Array, " E"]:
    """How bright each piece is against the usual body, at most 1."""
    smooth = ndimage.gaussian_filter(normal, max(0.35 * half_width, 0.5))
    means = [smooth[tuple(piece.astype(int).T)].mean() for piece in graph.pieces]
    return np.clip(np.array(means), 0.0, 1.0)


def _sketch(line: Line, half_width: float) -> Line:
    """A smooth line of few points, which a hand can mend; a skeleton ends short of its body."""
    count = round(arc_length(line)[-1] / (SPACING * half_width)) + 1
    points = fit_knots(line, int(np.clip(count, *POINTS)))
    first, last = points[0] - points[1], points[-1] - points[-2]
    points[0] += BEYOND * half_width * first / max(np.linalg.norm(first), 1e-9)
    points[-1] += BEYOND * half_width * last / max(np.linalg.norm(last), 1e-9)
    return points

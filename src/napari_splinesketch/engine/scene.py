"""What an image is made of before any curve is fitted: background, contrast, noise, width."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Real
from scipy import ndimage

from napari_splinesketch.engine.background import Kind, estimate_background
from napari_splinesketch.engine.tracing import body_mask
from napari_splinesketch.engine.types import Array, Polarity

MISSING = 1.5
"""Missing pixels are guessed from those nearby, with Gaussian weights of this width, px."""


@dataclass(frozen=True, eq=False)
class Scene:
    """An image in units of its bodies' contrast.

    Attributes
    ----------
    normal
        (H, W) float32: background about 0, bodies about 1; guessed where the image is not finite.
    valid
        (H, W) where the image is finite.
    background
        (H, W) smooth background in the image's units.
    background_kind
        How simple a background explains the image.
    contrast
        Bodies minus background in the image's units; negative for dark bodies.
    noise
        Standard deviation of the pixel noise, as a share of the contrast.
    half_width
        Typical half-width of the bodies, px.
    """

    normal: Float[Array, "H W"]
    valid: Bool[Array, "H W"]
    background: Float[Array, "H W"]
    background_kind: Kind
    contrast: float
    noise: float
    half_width: float

    @property
    def polarity(self) -> Literal["bright", "dark"]:
        """Whether bodies are brighter or darker than the background."""
        return "bright" if self.contrast > 0 else "dark"


def read_scene(
    image: Real[Array, "H W"],
    near: Bool[Array, "H W"],
    polarity: Polarity,
    half_width: float | None,
) -> Scene:
    """Estimate background, polarity, contrast, noise and half-width.

    Parameters
    ----------
    image
        (H, W) any real dtype; not finite pixels are masked.
    near
        (H, W) where the bodies are expected: the surroundings of the sketches.
    polarity, half_width
        As given to `refine`.
    """
    image = np.asarray(image, dtype=np.float64)
    valid = np.isfinite(image)
    whole = image if valid.all() else filled(image, valid)
    noise = pixel_noise(whole)
    background, kind = estimate_background(whole, noise)
    flat = whole - background
    smooth = ndimage.gaussian_filter(flat, 1.0)[near & valid]
    low, centre, high = np.quantile(smooth, [0.01, 0.5, 0.99])
    bright = high - centre >= centre - low if polarity == "auto" else polarity == "bright"
    sign = 1.0 if bright else -1.0
    rounding = 1e-9 * float(np.abs(image[valid]).max()) + 1e-30
    contrast = max(_contrast(sign * smooth, noise), rounding)
    normal = (sign * flat / contrast).astype(np.float32)
    if half_width is None:
        half_width = measured_half_width(normal, near)
    return Scene(
        normal, valid, background, kind, sign * contrast, max(noise / contrast, 0.01), half_width
    )


def filled(image: Float[Array, "H W"], valid: Bool[Array, "H W"]) -> Float[Array, "H W"]:
    """The image with missing pixels like those around them, or like the median far inside."""
    known, weight = (
        ndimage.gaussian_filter(a, MISSING) for a in (np.where(valid, image, 0.0), valid * 1.0)
    )
    nearby = np.where(weight > 0.05, known / np.maximum(weight, 0.05), np.median(image[valid]))
    return np.where(valid, image, nearby)


def pixel_noise(image: Float[Array, "H W"]) -> float:
    """Standard deviation of white noise, from the median of diagonal second differences."""
    if min(image.shape) < 2:
        return float(np.std(np.diff(image.ravel())) / np.sqrt(2)) if image.size > 1 else 0.0
    difference = image[1:, 1:] - image[1:, :-1] - image[:-1, 1:] + image[:-1, :-1]
    return float(1.4826 * np.median(np.abs(difference)) / 2)


def _contrast(smooth: Float[Array, " P"], noise: float) -> float:
    """Typical brightness of the brightest few percent that stand out."""
    peak = np.quantile(smooth, 0.995)
    bodies = smooth[smooth > 0.5 * peak]
    return max(float(np.median(bodies)) if len(bodies) else 0.0, 2 * noise)


def measured_half_width(normal: Float[Array, "H W"], near: Bool[Array, "H W"]) -> float:
    """Half-width of the bodies of a normalised image: area over length of their mask.

    The ridge of the distance to the mask's edge is about one pixel wide, and its height is the
    half-width.
    """
    mask = body_mask(normal, 1.5) & near
    if not mask.any():
        return 2.0
    depth = np.asarray(ndimage.distance_transform_edt(np.pad(mask, 1)))[1:-1, 1:-1]
    ridge = mask & (depth >= ndimage.maximum_filter(depth, 3) - 1e-6)
    return float(np.clip(np.median(depth[ridge]), 0.7, 50.0))

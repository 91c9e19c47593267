"""What an image is made of before any curve is fitted: background, contrast, noise, width."""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Real
from scipy import ndimage

from napari_splinesketch.engine.find.tracing import body_mask
from napari_splinesketch.engine.look.background import Kind, estimate_background
from napari_splinesketch.engine.types import Array, Polarity

MISSING = 1.5
"""Missing pixels are guessed from those nearby, with Gaussian weights of this width, px."""


SMOOTHINGS = (1.0, 1.6, 2.5)
"""Smoothings of the image that tells the contrast, px: as little as makes it clear."""
CLEAR, FAINTEST = 8.0, 3.0
"""A clear contrast, and the smallest there can be, times the noise that the smoothing leaves."""
GAINED = 1.15
"""More smoothing makes a contrast so much clearer, or the bodies are too thin for it."""
BELIEVED = 1.6
"""A half-width that was told is believed within this factor of those in the image."""


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
    smoothing
        Smoothing without which the bodies do not stand out from the noise, px; usually none.
    contradicted
        The half-width that was told, if no body in the image is like that.
    """

    normal: Float[Array, "H W"]
    valid: Bool[Array, "H W"]
    background: Float[Array, "H W"]
    background_kind: Kind
    contrast: float
    noise: float
    half_width: float
    smoothing: float = 0.0
    contradicted: float | None = None

    @cached_property
    def mask(self) -> Bool[Array, "H W"]:
        """(H, W) pixels that are body."""
        return body_mask(self.normal, self.half_width, self.smoothing)

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
    contrast, smoothing = _signed_contrast(flat, near & valid, noise, polarity)
    rounding = 1e-9 * float(np.abs(image[valid]).max()) + 1e-30
    contrast = float(np.copysign(max(abs(contrast), rounding), contrast))
    normal = (flat / contrast).astype(np.float32)
    noise = max(noise / abs(contrast), 0.01)
    width, contradicted = _half_width(ridge_depths(normal, near, smoothing), half_width)
    return Scene(normal, valid, background, kind, contrast, noise, width, smoothing, contradicted)


def _signed_contrast(
    flat: Float[Array, "H W"], near: Bool[Array, "H W"], noise: float, polarity: Polarity
) -> tuple[float, float]:
    """Bodies minus background, and the smoothing that makes them stand out from the noise."""
    contrast, clear, smoothing = 0.0, 0.0, 0.0
    for sigma in SMOOTHINGS:
        smooth = ndimage.gaussian_filter(flat, sigma)[near]
        low, centre, high = np.quantile(smooth, [0.01, 0.5, 0.99])
        bright = high - centre >= centre - low if polarity == "auto" else polarity == "bright"
        sign = 1.0 if bright else -1.0
        left = noise / (2 * np.sqrt(np.pi) * sigma)
        height = max(_contrast(sign * smooth), FAINTEST * left)
        if height < GAINED * clear * left:
            break
        smoothing = sigma if clear else 0.0
        contrast, clear = sign * height, height / max(left, 1e-30)
        if clear > CLEAR:
            break
    return contrast, smoothing


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


def _contrast(smooth: Float[Array, " P"]) -> float:
    """Typical brightness of the brightest few percent that stand out."""
    peak = np.quantile(smooth, 0.995)
    bodies = smooth[smooth > 0.5 * peak]
    return float(np.median(bodies)) if len(bodies) else 0.0


def ridge_depths(
    normal: Float[Array, "H W"], near: Bool[Array, "H W"], smoothing: float
) -> Float[Array, " R"]:
    """Half-widths of the bodies of a normalised image, px, all along their middles.

    The ridge of the distance to the mask's edge is about one pixel wide, and its height is the
    half-width.
    """
    mask = body_mask(normal, 1.5, smoothing) & near
    depth = np.asarray(ndimage.distance_transform_edt(np.pad(mask, 1)))[1:-1, 1:-1]
    return depth[mask & (depth >= ndimage.maximum_filter(depth, 3) - 1e-6)]


def _half_width(depths: Float[Array, " R"], told: float | None) -> tuple[float, float | None]:
    """Typical half-width, and what was told if the image has no body like that."""
    if not len(depths):
        return told or 2.0, None
    seen = float(np.clip(np.median(depths), 0.7, 50.0))
    if told is None:
        return seen, None
    low, high = np.quantile(depths, [0.1, 0.9])
    if low / BELIEVED < told < high * BELIEVED:
        return told, None
    return seen, told

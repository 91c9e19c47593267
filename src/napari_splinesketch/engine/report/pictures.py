"""The two pictures of a result, made when they are first read: they are as large as the image."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Real

from napari_splinesketch.engine.look.background import Kind, estimate_background
from napari_splinesketch.engine.look.scene import pixel_noise
from napari_splinesketch.engine.types import Array

Drawn = Sequence[tuple[tuple[slice, slice], Float[Array, "h w"]]]
"""Bodies in windows of the image, in its units."""


@dataclass(frozen=True, eq=False)
class Background:
    """The image without bodies.

    Attributes
    ----------
    image
        (H, W) as given to `refine`.
    drawn
        The bodies.
    kind
        How simple a background explains the image; None to find out.
    """

    image: Real[Array, "H W"]
    drawn: Drawn
    kind: Kind | None

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width, px."""
        return self.image.shape

    @cached_property
    def _picture(self) -> Float[Array, "H W"]:
        bare = _filled(self.image)
        for window, bodies in self.drawn:
            bare[window] -= bodies
        noise = pixel_noise(bare) if self.kind is None else 0.0
        return estimate_background(bare, noise, self.kind)[0]

    def __call__(self) -> Float[Array, "H W"]:
        """(H, W) in the image's units."""
        return self._picture


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """Background and bodies."""

    background: Background

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width, px."""
        return self.background.shape

    def __call__(self) -> Float[Array, "H W"]:
        """(H, W) in the image's units."""
        whole = self.background().copy()
        for window, bodies in self.background.drawn:
            whole[window] += bodies
        return whole


def _filled(image: Real[Array, "H W"]) -> Float[Array, "H W"]:
    if image.dtype.kind != "f":
        return image.astype(np.float64)
    finite = np.isfinite(image)
    if finite.all():
        return image.astype(np.float64)
    return np.where(finite, image, np.median(image[finite])).astype(np.float64)

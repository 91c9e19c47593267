"""The two pictures of a result, made when they are first read: they are as large as the image."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Real

from napari_splinesketch.engine.look.background import Kind, estimate_background
from napari_splinesketch.engine.look.scene import pixel_noise
from napari_splinesketch.engine.types import Array


@dataclass(frozen=True, eq=False)
class Pictures:
    """What the pictures are made of."""

    image: Real[Array, "H W"]
    """As given to `refine`."""
    drawn: Sequence[tuple[tuple[slice, slice], Float[Array, "h w"]]]
    """Bodies in windows of the image, in its units."""
    kind: Kind | None
    """How simple a background explains the image; None to find out."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Of the image."""
        return self.image.shape

    @cached_property
    def background(self) -> Float[Array, "H W"]:
        """(H, W) the image without bodies, in its units."""
        bare = self.image.astype(np.float64)
        finite = np.isfinite(bare)
        if not finite.all():
            bare[~finite] = np.median(bare[finite])
        for window, bodies in self.drawn:
            bare[window] -= bodies
        noise = pixel_noise(bare) if self.kind is None else 0.0
        return estimate_background(bare, noise, self.kind)[0]

    @cached_property
    def reconstruction(self) -> Float[Array, "H W"]:
        """(H, W) background and bodies."""
        whole = self.background.copy()
        for window, bodies in self.drawn:
            whole[window] += bodies
        return whole

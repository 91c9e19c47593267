"""What a generated scene looks like."""

from dataclasses import dataclass
from typing import Literal

import numpy as np


@dataclass(frozen=True)
class Look:
    """How a generated scene looks; `Look.draw` makes one at random."""

    polarity: Literal["bright", "dark"] = "bright"
    """Bodies brighter or darker than the background."""
    level: float = 0.35
    contrast: float = 0.4
    """`level` and `contrast`: intensity of the background and of a body above (or below) it; images
    lie about in 0-1."""
    snr: float = 12.0
    """Contrast divided by the noise's standard deviation on a body."""
    photon_share: float = 0.5
    """Share of the noise's variance, on a body, that grows with the intensity."""
    gradient: tuple[float, float] = (0.0, 0.0)
    """(2,): change of the background along rows and along columns over the frame, contrasts."""
    blur: float = 0.75
    """Standard deviation of the point-spread function, px."""
    flatness: float = 0.5
    """Cross-section of a body: 1 flat, 0 elliptic."""
    overlap: float = 0.7
    """How overlapping bodies combine: 1 maximum, 0 sum."""
    taper_power: float = 0.45
    taper_length: float = 0.28
    taper_floor: float = 0.25
    """`taper_power`, `taper_length` and `taper_floor`: half-width over its largest value:
    max(floor, min(1, x / (length * L)) ** power) at distance x from the nearer end of a body of
    length L."""
    brightness_sd: float = 0.04
    """Spread of brightness between bodies, relative."""
    shading: float = 0.06
    """Amplitude of slow shading along a body, relative."""
    texture: float = 0.04
    """Standard deviation of the bodies' texture, relative."""
    debris: int = 0
    """Number of specks beside the bodies."""

    @classmethod
    def draw(cls, rng: np.random.Generator) -> "Look":
        """Draw a look at random, always without debris."""
        polarity = rng.choice(["bright", "dark"])
        return cls(
            polarity="bright" if polarity == "bright" else "dark",
            level=rng.uniform(0.25, 0.4) if polarity == "bright" else rng.uniform(0.6, 0.75),
            contrast=rng.uniform(0.3, 0.5),
            snr=rng.uniform(10, 15),
            photon_share=rng.uniform(0.2, 0.8),
            gradient=(rng.uniform(-0.25, 0.25), rng.uniform(-0.25, 0.25)),
            blur=rng.uniform(0.5, 1.0),
            flatness=rng.uniform(0.3, 0.9),
            overlap=rng.uniform(0.4, 1.0),
            taper_power=rng.uniform(0.35, 0.6),
            taper_length=rng.uniform(0.15, 0.35),
            taper_floor=rng.uniform(0.08, 0.45),
            shading=rng.uniform(0.0, 0.1),
            texture=rng.uniform(0.0, 0.06),
        )

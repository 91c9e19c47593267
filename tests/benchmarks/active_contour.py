"""scikit-image's active contour, with open and free ends."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter
from skimage.segmentation import active_contour

from napari_splinesketch.metrics import resample

PERCENTILES = (1.0, 99.5)


@dataclass(frozen=True)
class Settings:
    """What the active contour is given.

    Attributes
    ----------
    blurs
        Standard deviations of the smoothing of one pass after the other, px.
    alpha, beta
        Weights of its length and its bending.
    line
        Attraction to brightness.
    gamma
        Step size.
    points
        Vertices of the contour.
    iterations
        At most so many in each pass.
    """

    blurs: tuple[float, ...] = (1.0,)
    alpha: float = 0.0
    beta: float = 3.0
    line: float = 0.3
    gamma: float = 0.003
    points: int = 100
    iterations: int = 1000


TUNED = Settings()


def prepare(image: np.ndarray, settings: Settings, *, bright: bool) -> list[np.ndarray]:
    """Stretch to 0-1, bodies bright, and smooth: one image for each pass."""
    signed = image if bright else -image
    low, high = np.percentile(signed, PERCENTILES)
    unit = np.clip((signed - low) / (high - low), 0, 1).astype(float)
    return [gaussian_filter(unit, blur) for blur in settings.blurs]


def fit(images: list[np.ndarray], sketch: np.ndarray, settings: Settings) -> np.ndarray:
    """Refine one sketch on prepared images; returns (100, 2).

    It is kept inside the frame; one that collapsed in a corner is given back as drawn.
    """
    curve = resample(sketch, settings.points)
    for image in images:
        curve = active_contour(
            image,
            curve,
            alpha=settings.alpha,
            beta=settings.beta,
            w_line=settings.line,
            w_edge=0,
            gamma=settings.gamma,
            max_num_iter=settings.iterations,
            boundary_condition="free",
        )
        curve = np.clip(curve, 0, np.array(image.shape) - 1)
    return resample(curve if np.ptp(curve, axis=0).any() else sketch)

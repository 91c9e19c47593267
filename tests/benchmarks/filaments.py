"""napari-filaments: Gaussians fitted across the line, then extended and clipped at the ends."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np

from napari_splinesketch.metrics import resample

RUNAWAY = 2.0
"""Frame diagonals; a spline longer than that would take all memory in the next step."""


@dataclass(frozen=True)
class Settings:
    """What napari-filaments is given.

    Attributes
    ----------
    width
        Width of the strip in which the body is looked for, px.
    fine_width
        Width of the strip of the second fit, px.
    passes
        How often the first fit is repeated.
    interval
        Distance of the first fit's cross-sections, px.
    error
        Smoothing of the spline, px.
    extend
        Length by which both ends are extended and fitted, px, before the spline is clipped where
        the brightness along it falls; 0 leaves the ends alone.
    """

    width: int = 41
    fine_width: int = 15
    passes: int = 1
    interval: float = 8.0
    error: float = 0.03
    extend: float = 20.0


TUNED = Settings()


def fit(image: np.ndarray, sketch: np.ndarray, settings: Settings) -> np.ndarray | None:
    """Refine one sketch on an image with bright bodies.

    Returns (100, 2): what the last step that worked left; None if the first already failed.
    """
    spline = import_module("napari_filaments").Spline.fit(resample(sketch), degree=1, err=0.0)
    curve = None
    for step in _steps(image, settings):
        try:
            spline = step(spline)
            if spline.length() > RUNAWAY * np.hypot(*image.shape):
                break
            curve = resample(spline.sample(npoints=400))
        except (RuntimeError, ValueError, TypeError, np.linalg.LinAlgError):
            break
    return curve


def _steps(image: np.ndarray, settings: Settings) -> Iterator[Callable[[Any], Any]]:
    """List the buttons pressed one after the other."""

    def rough(spline: Any) -> Any:
        interval = min(settings.interval, spline.length() / 4)
        return spline.fit_filament(image, width=settings.width, interval=interval)

    fine = {"width": settings.fine_width, "spline_error": settings.error}
    for _ in range(settings.passes):
        yield rough
    yield lambda spline: spline.fit_filament(image, **fine)
    if settings.extend > 0:
        yield lambda spline: spline.extend_filament_left(image, settings.extend, **fine)
        yield lambda spline: spline.extend_filament_right(image, settings.extend, **fine)
        yield lambda spline: spline.clip_at_inflections(image)

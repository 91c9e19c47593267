"""The public call: sketches in, curves out."""

import time
from collections.abc import Sequence
from typing import get_args

import numpy as np
from jaxtyping import Bool, Float, Real

from napari_splinesketch.engine import spline
from napari_splinesketch.engine.fit import bands, fitting
from napari_splinesketch.engine.fit.fit_scene import Centrelines, fit_scene
from napari_splinesketch.engine.look import scene
from napari_splinesketch.engine.report.assemble import assemble, nothing
from napari_splinesketch.engine.settings import PRESETS, SETTINGS, PresetName, Settings
from napari_splinesketch.engine.types import (
    CANCELLED,
    Array,
    Curve,
    OnProgress,
    Polarity,
    Progress,
    Refinement,
    Sketches,
)

MARGIN = 40
"""Image kept around the sketches, px, beside half of the longest sketch."""
FARTHEST = 200.0
"""Bodies are expected within half of a sketch's length of it, but no farther, px."""


def refine(
    image: Real[Array, "H W"],
    sketches: Sketches,
    preset: PresetName | Settings = "balanced",
    *,
    polarity: Polarity = "auto",
    half_width: float | None = None,
    fixed: Sequence[Curve] = (),
    on_progress: OnProgress | None = None,
    seed: int = 0,
) -> Refinement:
    """Fit all sketched bodies of one image together.

    Parameters
    ----------
    image
        (H, W) any real dtype, any range; pixels that are not finite are left out.
    sketches
        (N, 2) polylines, N ≥ 2, (row, col) in pixels, pixel centres at integers.
    preset
        "fast", "balanced", "thorough" or "paper"; or settings of your own.
    polarity
        Whether bodies are "bright" or "dark" against the background; "auto" looks.
    half_width
        Rough distance from centreline to edge, px; None measures it.
    fixed
        Curves that take part in the rendering but do not move; failed ones do not take part.
    on_progress
        Called with a `Progress` now and then; returning False cancels.
    seed
        Of the random numbers, where a preset uses any.

    Returns
    -------
    One curve per sketch, in the same order, with reconstruction and diagnostics. A sketch that
    cannot be refined comes back as drawn, with status "failed" and the reason.

    Raises
    ------
    ValueError
        Where the call makes no sense at all: no image, no finite pixel, a sketch that is not
        (N, 2), an unknown preset or polarity, a half-width that is not positive.
    """
    began = time.perf_counter()
    image, lines = _checked(image, sketches, preset, polarity, half_width)
    reporter = _Reporter(on_progress)
    faults = [_fault(line, image.shape) for line in lines]
    usable = [line for line, fault in zip(lines, faults, strict=True) if not fault]
    try:
        reporter("looking at the image", 0.0)
        if not usable:
            return nothing(image, lines, faults, began)
        fixed = [c for c in fixed if c.status != "failed"]
        window = _window(usable, fixed, image.shape)
        corner = np.array([s.start for s in window])
        near = _near(usable, image[window].shape, corner)
        blank = _blank(image[window][near])
        if blank:
            return nothing(image, lines, [fault or blank for fault in faults], began)
        seen = scene.read_scene(image[window], near, polarity, half_width)
        usable = [u - corner for u in usable]
        if preset == "paper":
            from napari_splinesketch.paper.result import assemble_paper, fit_paper

            paper = fit_paper(seen, usable, fixed, corner, seed, reporter)
            return assemble_paper(image, lines, faults, window, seen, paper, began)
        settings = SETTINGS[preset] if isinstance(preset, str) else preset
        fit = fit_scene(seen, usable, fixed, corner, settings, reporter)
    except fitting.Stopped:
        return nothing(image, lines, [CANCELLED] * len(lines), began)
    return assemble(image, lines, faults, window, seen, fit, began)


def _checked(image, sketches, preset, polarity, half_width):
    """The image as an array and the sketches as float arrays."""
    image = np.asarray(image)
    if image.ndim != 2 or not image.size:
        raise ValueError(f"image has shape {image.shape}; give one 2-D grey image (H, W).")
    if image.dtype.kind not in "biuf":
        raise ValueError(f"image has dtype {image.dtype}; give real numbers.")
    if not np.isfinite(image).any():
        raise ValueError("image has no finite pixel; give an image with data in it.")
    if isinstance(preset, str) and preset not in PRESETS:
        raise ValueError(f"preset is {preset!r}; choose one of {', '.join(PRESETS)}.")
    if polarity not in get_args(Polarity):
        raise ValueError(f"polarity is {polarity!r}; choose one of {get_args(Polarity)}.")
    if half_width is not None and not 0 < half_width < np.inf:
        raise ValueError(f"half_width is {half_width}; give a positive number of px, or None.")
    lines = [np.asarray(s, dtype=np.float64) for s in sketches]
    for i, line in enumerate(lines):
        if line.ndim != 2 or line.shape[1] != 2 or len(line) < 2:
            raise ValueError(
                f"sketch {i} has shape {line.shape}; give (N, 2) row, col with N ≥ 2 points."
            )
    return image, lines


def _fault(line: Float[Array, "N 2"], shape: tuple[int, ...]) -> str:
    """Why a sketch cannot be refined, or nothing."""
    if not np.isfinite(line).all():
        return "the sketch has points that are not finite"
    if (np.abs(line) > 10 * max(*shape, 100)).any():
        return "the sketch reaches far beyond the image"
    if spline.arc_length(line)[-1] < 2:
        return "the sketch is shorter than 2 px"
    if not ((line > -1) & (line < np.array(shape))).all(axis=1).any():
        return "the sketch lies outside the image"
    return ""


def _blank(pixels: Real[Array, " P"]) -> str:
    """Why nothing can be seen around the sketches, or nothing."""
    there = pixels[np.isfinite(pixels)]
    if not len(there):
        return "no pixel around the sketch is finite"
    if there.min() == there.max():
        return "the image has one and the same value around the sketch"
    return ""


class _Reporter:
    """Passes progress on; never falls; raises `Stopped` when told to stop."""

    def __init__(self, on_progress: OnProgress | None):
        self._call, self._fraction = on_progress, 0.0

    def __call__(self, stage: str, fraction: float, centrelines: Centrelines | None = None):
        if self._call is None:
            return
        self._fraction = max(self._fraction, min(fraction, 1.0))
        lines = tuple(centrelines()) if centrelines else None
        if self._call(Progress(stage, self._fraction, lines)) is False:
            raise fitting.Stopped


def _window(usable, fixed, shape) -> tuple[slice, slice]:
    """The part of the image that matters."""
    margin = MARGIN + max(spline.arc_length(u)[-1] for u in usable) / 2
    points = np.concatenate(usable)
    low = np.maximum(np.floor(points.min(0) - margin), 0).astype(int)
    high = np.minimum(np.ceil(points.max(0) + margin), shape).astype(int)
    return slice(low[0], high[0]), slice(low[1], high[1])


def _near(usable, shape, corner) -> Bool[Array, "H W"]:
    """Where the bodies are expected: within half of a sketch's length of it."""
    near = np.zeros(shape, dtype=bool)
    for line in usable:
        radius = np.clip(spline.arc_length(line)[-1] / 2, 20.0, FARTHEST)
        rows, columns, mask = bands.band(line - corner, radius, shape)
        near[rows, columns] |= mask
    return near

"""What a user could press instead of Refine, on one case: ours and the usual alternatives."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from pathlib import Path

import active_contour
import methods
import numpy as np
from real_cases import Case, Line
from scipy.ndimage import gaussian_filter1d
from skimage.filters import sato
from skimage.graph import route_through_array

import napari_splinesketch
from napari_splinesketch.engine.settings import OFFERED

FLOOR = 0.05
"""What a pixel without any ridge costs less than infinity by; sato's strongest response is 1."""
STRONG = 99.5
"""Percentile of sato's response that counts as 1."""
SMOOTHING = 2.0
"""Standard deviation of the smoothing of a minimal path along itself, px."""


@dataclass(frozen=True)
class Found:
    """What a method makes of one sketch."""

    curve: Line
    half_width: float
    status: str = "good"
    reasons: str = ""


Run = Callable[[Case, Sequence[Line]], list[Found]]


def _ours(preset: str) -> Run:
    def run(case: Case, sketches: Sequence[Line]) -> list[Found]:
        result = napari_splinesketch.refine(case.image, sketches, preset=preset)  # pyright: ignore[reportArgumentType]
        return [
            Found(c.points, float(np.median(c.half_width)), c.status, "; ".join(c.reasons))
            for c in result.curves
        ]

    return run


def _as_drawn(case: Case, sketches: Sequence[Line]) -> list[Found]:
    return [Found(sketch, case.half_width) for sketch in sketches]


def _minimal_path(case: Case, sketches: Sequence[Line]) -> list[Found]:
    """The cheapest path between the sketch's ends; its polarity is given."""
    image = case.image.astype(float)
    corner = np.array(image.shape) - 1

    @cache
    def cost(bright: bool) -> np.ndarray:
        ridge = sato(image, black_ridges=not bright)
        return 1 / (FLOOR + np.minimum(ridge / (np.percentile(ridge, STRONG) + 1e-12), 1))

    found = []
    for body, sketch in enumerate(sketches):
        start, end = np.clip(np.rint(sketch[[0, -1]]), 0, corner).astype(int)
        path = route_through_array(cost(case.bright(body)), start, end)[0]
        line = np.array(path, dtype=float)
        if len(line) < 2:
            line = np.asarray(sketch, dtype=float)
        smooth = gaussian_filter1d(line, SMOOTHING, axis=0, mode="nearest")
        found.append(Found(smooth, case.half_width))
    return found


def _active_contour(case: Case, sketches: Sequence[Line]) -> list[Found]:
    settings = active_contour.TUNED

    @cache
    def images(bright: bool) -> list[np.ndarray]:
        return active_contour.prepare(case.image.astype(float), settings, bright=bright)

    return [
        Found(active_contour.fit(images(case.bright(body)), sketch, settings), case.half_width)
        for body, sketch in enumerate(sketches)
    ]


RUNS: dict[str, Run] = {
    "as_drawn": _as_drawn,
    "minimal_path": _minimal_path,
    "active_contour": _active_contour,
    **{preset: _ours(preset) for preset in OFFERED},
}
LABELS = {
    "as_drawn": "the sketch itself",
    "minimal_path": "minimal path",
    "active_contour": "active contour",
    "balanced": "ours, balanced",
    "paper": "the paper's method",
}


def version(name: str) -> str:
    """Digest of whatever decides a method's results."""
    if name in OFFERED:
        return methods.make(name).version
    here = Path(__file__).read_text(encoding="utf-8")
    also = Path(active_contour.__file__).read_text(encoding="utf-8")
    return sha256((here + also).encode()).hexdigest()[:8]

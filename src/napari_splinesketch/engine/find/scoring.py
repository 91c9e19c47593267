"""What each path costs a sketch: one bounded score, for every use."""

from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

from napari_splinesketch.engine import spline
from napari_splinesketch.engine.types import Array

SAMPLES, FEW = 48, 16
"""Points at which a path is compared with its sketch; fewer tell as well which of the many routes
through the graph are worth a closer look."""
SEEN = 0.8
"""Evidence from here on is a body for sure."""
FARTHEST = 3.0
"""No sketch means a path that is on average farther from it, in its tolerances."""
DRAWN, STROKE = 1.0, 0.05
"""A line that is drawn in one stroke misses its body by so many px, and so much of its length."""
BULGE = 0.25
"""Of a body between two vertices of its sketch, px for each px from the nearer one."""
BENT = 0.05
"""Bodies bend by so much of the inverse of their half-width anyway."""
SMOOTH, WIDEST = 3.0, 8.0
"""Paths are smoothed over so many half-widths before their bends are measured, and over so many of
their SAMPLES at most."""
AHEAD = (1.5, 3.0)
"""Where a body is looked for beyond the end of a path, half-widths."""
HIT, HIT_PX, HIT_LONG = 0.5, 1.5, 0.004
"""A path that misses the vertices of its sketch by so many half-widths and px has hit them; clicked
ones by this share of the sketch's length more, because long bodies are seen from farther away."""
VERTICES = 12
"""Of a sketch, looked at."""
SHAPE, LIKE = 1.5, 0.5
"""What another shape than the path's costs a line that was not clicked, and by how many half-widths
its vertices then miss the path, once it is moved and turned as a whole: lines that were moved keep
their shape, and how a hand changes it is not known."""
CLICKED, SPACED = range(3, 61), 4.0
"""So many vertices, so many px apart on average, were put on the body one by one, the first and the
last on its ends: two tell little of what is between, and more or closer ones are a line that was
drawn in one stroke or moved as a whole."""
CAREFUL = 6.0, 24.0
"""Weight of clicked vertices: their number, but no less and no more than this."""
ENDS = 0.06
"""Of the length of a sketch: by so much more its clicked ends may miss the tips of the body."""
ON, ON_CLICKED = 0.5, 0.7
"""What each end of a path beyond which a body goes on costs a sketch, and a clicked one: bodies are
labelled whole, unless the next tip is far."""
FEATURES = ("unseen", "apart", "missed", "kink", "short", "long")
WEIGHTS = np.array([27.0, 1.7, 2.0, 11.0, 10.5, 1.5])
"""Fitted by tests/benchmarks/path_weights.py and rounded, but for "unseen": 19 was raised when
clicked sketches ceased to earn by what they explain (`choice.Candidates.explains`)."""
TOO_FAR = 1000.0
"""Cost of a path that its sketch cannot mean."""

Line = Float[Array, "N 2"]


def clicked(sketch: Line) -> bool:
    """Whether the vertices of a sketch were put on its body one by one."""
    spaced = spline.arc_length(sketch)[-1] >= SPACED * (len(sketch) - 1)
    return len(sketch) in CLICKED and bool(spaced)


def hit(half_width: float, clicked_length: float = 0.0) -> float:
    """How far from a vertex a path has hit it, px, for the length of a sketch that was clicked."""
    return HIT * half_width + HIT_PX + HIT_LONG * clicked_length


def tolerance(sketch: Line, half_width: float, samples: int = SAMPLES) -> Float[Array, " S"]:
    """How far a sketch usually is from its body at S points, px: least at its vertices."""
    s = spline.arc_length(sketch)
    at = np.linspace(0, s[-1], samples)
    bulge = np.abs(at[:, None] - s[None]).min(1)
    return half_width + DRAWN + STROKE * float(s[-1]) + BULGE * bulge


def cost(known: Float[Array, "C F"]) -> Float[Array, " C"]:
    """(C,) what paths cost their sketch, from their features."""
    too_far = known[:, FEATURES.index("apart")] > np.log1p(FARTHEST)
    return known @ WEIGHTS + TOO_FAR * too_far


def features(
    lines: Float[Array, "C S 2"],
    total: Float[Array, " C"],
    sketch: Line,
    half_width: float,
    evidence: Float[Array, "H W"],
) -> Float[Array, "C F"]:
    """(C, F) what is known of paths for one sketch, in the order of FEATURES."""
    length = float(spline.arc_length(sketch)[-1])
    samples = lines.shape[1]
    at = np.ascontiguousarray(lines.transpose(2, 1, 0))
    drawn, usual = spline.resample(sketch, samples), tolerance(sketch, half_width, samples)
    apart = _distance(at - drawn.T[:, :, None]) / usual[:, None]
    sharpest = _kinks(at, total, half_width)
    return np.column_stack(
        [
            1 - np.minimum(_sampled(evidence, at) / SEEN, 1).mean(0),
            np.log1p(apart.mean(0)),
            _missed(at, sketch, half_width, ~goes_on(evidence, at, half_width)),
            np.clip(sharpest - BENT, 0, 1),
            np.maximum(1 - total / length, 0),
            np.minimum(np.maximum(total / length - 1, 0), 2),
        ]
    )


def _distance(apart: Float[Array, "2 ..."]) -> Float[Array, "..."]:
    """Length of (row, col)."""
    return np.sqrt(apart[0] ** 2 + apart[1] ** 2)


def _kinks(
    at: Float[Array, "2 S C"], total: Float[Array, " C"], half_width: float
) -> Float[Array, " C"]:
    """(C,) largest curvature of paths, in units of the half-width.

    They are smoothed first: skeletons zigzag where bodies cross, and bodies do not.
    """
    samples, count = at.shape[1:]
    spacing = total / (samples - 1)
    smooth = np.clip(np.rint(2 * SMOOTH * half_width / spacing) / 2, 0.5, WIDEST)
    sharpest = np.zeros(count)
    for sigma in np.unique(smooth):
        of = smooth == sigma
        down, across = np.diff(_smoothing(samples, sigma) @ at[:, :, of], axis=1)
        straight = down[1:] * down[:-1] + across[1:] * across[:-1]
        aside = np.abs(down[1:] * across[:-1] - across[1:] * down[:-1])
        # Falls as the angle rises, and costs less.
        most = (straight / (np.abs(straight) + aside + 1e-30)).argmin(0), np.arange(of.sum())
        sharpest[of] = np.arctan2(aside[most], straight[most])
    return sharpest * half_width / spacing


def _missed(
    at: Float[Array, "2 S C"], sketch: Line, half_width: float, tips: Bool[Array, "2 C"]
) -> Float[Array, " C"]:
    """(C,) by how much paths miss the vertices of a sketch; `tips` are ends of bodies.

    The logarithm of their root mean square distance: how carefully a sketch was drawn is not
    known, so that each factor counts the same.
    """
    few = sketch[np.linspace(0, len(sketch) - 1, min(len(sketch), VERTICES)).astype(int)]
    down, across = np.diff(at, axis=1)
    inverse = 1 / (down**2 + across**2 + 1e-9)
    least = np.empty((len(few), at.shape[2]))
    # One vertex after the other, so that what is computed stays in the cache.
    for k, vertex in enumerate(few):
        below, aside = vertex[:, None, None] - at[:, :-1]
        part = np.clip((below * down + aside * across) * inverse, 0, 1)
        least[k] = ((below - part * down) ** 2 + (aside - part * across) ** 2).min(0)
    inside = (~tips).sum(0)
    if not clicked(sketch):
        unlike = 1 - np.exp(-0.5 * _reshaped(at, sketch) / (LIKE * half_width) ** 2)
        close = 0.5 * np.log1p(least.mean(0) / hit(half_width) ** 2)
        return ON * inside + close + SHAPE * unlike
    length = spline.arc_length(sketch)[-1]
    near = hit(half_width, length)
    share = near / (near + ENDS * tips * length)
    ends = (share * _distance(at[:, [0, -1]] - sketch[[0, -1]].T[:, :, None])) ** 2
    off = np.concatenate([least, ends])
    careful = float(np.clip(len(sketch), *CAREFUL))
    return ON_CLICKED * inside + careful * 0.5 * np.log1p(off.mean(0) / near**2)


def _reshaped(at: Float[Array, "2 S C"], sketch: Line) -> Float[Array, " C"]:
    """(C,) mean square by which vertices of a sketch miss paths, if it is moved as a whole, px².

    It is moved and turned. A vertex lies as far along the path as along the sketch; two vertices
    have no shape.
    """
    if len(sketch) < 3:
        return np.zeros(at.shape[2])
    few = np.linspace(0, len(sketch) - 1, min(len(sketch), VERTICES)).astype(int)
    along = spline.arc_length(sketch)
    share = along[few] / along[-1] * (at.shape[1] - 1)
    left = np.minimum(share.astype(int), at.shape[1] - 2)
    part = (share - left)[:, None]
    path = at[:, left] * (1 - part) + at[:, left + 1] * part
    path = path[0] + 1j * path[1]
    drawn = sketch[few] @ [1, 1j]
    path, drawn = path - path.mean(0), drawn - drawn.mean()
    turn = drawn.conj() @ path
    turn /= np.abs(turn) + 1e-9
    return (np.abs(path - drawn[:, None] * turn) ** 2).mean(0)


def _sampled(evidence: Float[Array, "H W"], at: Float[Array, "2 ..."]) -> Float[Array, "..."]:
    return ndimage.map_coordinates(evidence, at, order=1, cval=0.0)


def goes_on(
    evidence: Float[Array, "H W"], at: Float[Array, "2 S C"], half_width: float
) -> Bool[Array, "2 C"]:
    """Whether there is a body beyond the first and the last points of paths."""
    tip, inner = at[:, [0, -1]], at[:, [3, -4]]
    out = (tip - inner) / (_distance(tip - inner) + 1e-9)
    away = half_width * np.linspace(*AHEAD, 4)[:, None, None]
    return _sampled(evidence, tip[:, None] + away * out[:, None]).mean(0) > 0.5


@lru_cache(maxsize=64)
def _smoothing(count: int, sigma: float) -> Float[Array, "S S"]:
    """(S, S) smooths a row of points by a Gaussian of so many of them; its ends stay."""
    points = np.eye(count)
    before, after = 2 * points[:1] - points[:0:-1], 2 * points[-1:] - points[-2::-1]
    extended = np.concatenate([before, points, after])
    return ndimage.gaussian_filter1d(extended, sigma, axis=0)[count - 1 : 2 * count - 1]

"""What each path costs a sketch: one bounded score, for every use."""

from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import ndimage
from scipy.spatial.distance import cdist

from napari_splinesketch.engine import constants as const
from napari_splinesketch.engine import spline
from napari_splinesketch.engine.types import Array, Line

FEATURES = ("unseen", "apart", "missed", "kink", "short", "long")


def clicked(sketch: Line) -> bool:
    """Whether the vertices of a sketch were put on its body one by one."""
    least = const.CLICKED_APART_PX * (len(sketch) - 1)
    return len(sketch) in const.CLICKED and bool(spline.arc_length(sketch)[-1] >= least)


def hit(half_width: float, clicked_length: float = 0.0) -> float:
    """How near a vertex a path must be to hit it, px; farther for a long clicked sketch."""
    return const.HIT_HW * half_width + const.HIT_PX + const.HIT_SHARE * clicked_length


def close(half_width: float) -> float:
    """How near to the line of a clicked sketch a path along it is looked for, px."""
    return const.NARROW_HW * half_width + const.NARROW_PX


def moved(sketch: Line, path: Line, half_width: float) -> bool:
    """Whether a sketch has the shape of a path: it may have been moved off it as a whole."""
    at = spline.resample(path, const.SCORE_SAMPLES).T[:, :, None]
    near = hit(half_width, float(spline.arc_length(sketch)[-1]))
    return bool(_reshaped(at, sketch)[0] < (const.MOVED_HITS * near) ** 2)


def tolerance(
    sketch: Line, half_width: float, samples: int = const.SCORE_SAMPLES
) -> Float[Array, " S"]:
    """How far a sketch usually is from its body at S points, px: least at its vertices."""
    s = spline.arc_length(sketch)
    at = np.linspace(0, s[-1], samples)
    bulge = np.abs(at[:, None] - s[None]).min(1)
    return (
        half_width
        + const.STROKE_PX
        + const.STROKE_SHARE * float(s[-1])
        + const.VERTEX_BULGE * bulge
    )


def cost(known: Float[Array, "C F"]) -> Float[Array, " C"]:
    """(C,) cost of paths for their sketch, from their features."""
    too_far = known[:, FEATURES.index("apart")] > np.log1p(const.FARTHEST)
    return known @ const.PATH_WEIGHTS + const.IMPOSSIBLE * too_far


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
    seen, sharpest = seen_at(evidence, at), _kinks(at, total, half_width)
    tips = ~goes_on(evidence, at, half_width)
    missed = _missed(at, sketch, half_width, tips)
    if len(sketch) == 2:
        missed += const.ENDS_COST * _ends_missed(at, seen, sketch, half_width)
    return np.column_stack(
        [
            unseen(seen),
            np.log1p(apart.mean(0)),
            missed,
            (sharpest - const.USUAL_BEND).clip(0, 1),
            np.maximum(1 - total / length, 0),
            np.minimum(np.maximum(total / length - 1, 0), 2),
        ]
    )


def unseen(seen: Float[Array, "S ..."]) -> Float[Array, "..."]:
    """Share without evidence, of what is seen at S points."""
    return 1 - np.minimum(seen / const.SURE_EVIDENCE, 1).mean(0)


def _distance(apart: Float[Array, "2 ..."]) -> Float[Array, "..."]:
    """Length of (row, col)."""
    return np.sqrt(apart[0] ** 2 + apart[1] ** 2)


def _kinks(
    at: Float[Array, "2 S C"], total: Float[Array, " C"], half_width: float
) -> Float[Array, " C"]:
    """(C,) largest curvature of paths, in units of the half-width.

    They are smoothed first: skeletons zigzag where bodies cross, and bodies do not.
    """
    samples = at.shape[1]
    spacing = total / (samples - 1)
    smooth = np.clip(
        np.rint(2 * const.BEND_SMOOTH_HW * half_width / spacing) / 2, 0.5, const.BEND_SMOOTH_MOST
    )
    soft = np.empty_like(at)
    for sigma in set(smooth.tolist()):
        of = np.flatnonzero(smooth == sigma)
        soft[:, :, of] = _smoothing(samples, sigma) @ at.take(of, axis=2)
    down, across = soft[:, 1:] - soft[:, :-1]
    straight = down[1:] * down[:-1] + across[1:] * across[:-1]
    aside = np.abs(down[1:] * across[:-1] - across[1:] * down[:-1])
    return np.arctan2(aside, straight).max(0) * half_width / spacing


def _missed(
    at: Float[Array, "2 S C"], sketch: Line, half_width: float, tips: Bool[Array, "2 C"]
) -> Float[Array, " C"]:
    """(C,) by how much paths miss the vertices of a sketch; `tips` are ends of bodies.

    The logarithm of their root mean square distance: how carefully a sketch was drawn is not
    known, so that each factor counts the same.
    """
    least = _nearest(at, sketch[_few(sketch)])
    inside = (~tips).sum(0)
    if not clicked(sketch):
        off = _reshaped(at, sketch, const.SHAPE_SIZE)
        unlike = 1 - np.exp(-0.5 * off / (const.SHAPE_HW * half_width) ** 2)
        close = 0.5 * np.log1p(least.mean(0) / hit(half_width) ** 2)
        return const.GOES_ON * inside + close + const.SHAPE_COST * unlike
    length = spline.arc_length(sketch)[-1]
    near = hit(half_width, length)
    share = near / (near + const.CLICKED_END * tips * length)
    ends = (share * _distance(at[:, [0, -1]] - sketch[[0, -1]].T[:, :, None])) ** 2
    off = np.concatenate([least, ends])
    careful = float(np.clip(len(sketch), *const.CLICKED_WEIGHT))
    return const.GOES_ON_CLICKED * inside + careful * 0.5 * np.log1p(off.mean(0) / near**2)


def _nearest(at: Float[Array, "2 S C"], points: Float[Array, "V 2"]) -> Float[Array, "V C"]:
    """(V, C) square of the distance of points to the nearest point of lines, px²."""
    step = at[:, 1:] - at[:, :-1]
    square = step[0] ** 2 + step[1] ** 2
    inverse, samples, found = 0.5 / (square + 1e-9), np.ascontiguousarray(at.reshape(2, -1).T), []
    # Some points after the other, so that what is computed stays in the cache.
    many = 1 + const.SCORE_CHUNK // square.size
    for first in range(0, len(points), many):
        away = cdist(points[first : first + many], samples, "sqeuclidean")
        away = away.reshape(-1, *at.shape[1:])
        ahead = away[:, :-1] - away[:, 1:] + square
        part = (ahead * inverse).clip(0, 1)
        found.append((away[:, :-1] - part * (ahead - part * square)).min(1))
    return np.concatenate(found)


def _ends_missed(
    at: Float[Array, "2 S C"], seen: Float[Array, "S C"], sketch: Line, half_width: float
) -> Float[Array, " C"]:
    """(C,) from 0 to 1, by how much paths miss the ends of a sketch, or no body is seen there.

    Bounded: a line that was turned misses all ends, and then they say nothing.
    """
    away = _distance(at[:, [0, -1]] - sketch[[0, -1]].T[:, :, None])
    few = const.ENDS_SAMPLES
    there = np.stack([seen[:few].mean(0), seen[-few:].mean(0)]) > const.BODY_EVIDENCE
    return (1 - there * np.exp(-0.5 * (away / hit(half_width)) ** 2)).mean(0)


def _reshaped(at: Float[Array, "2 S C"], sketch: Line, resized: float = 1.0) -> Float[Array, " C"]:
    """(C,) mean square by which vertices of a sketch miss paths, if it is moved as a whole, px².

    It is moved, turned, and scaled by up to the factor `resized`. A vertex lies as far along the
    path as along the sketch; two vertices have no shape.
    """
    if len(sketch) < 3:
        return np.zeros(at.shape[2])
    few, along = _few(sketch), spline.arc_length(sketch)
    share = along[few] / along[-1] * (at.shape[1] - 1)
    weights = np.maximum(1 - np.abs(share[:, None] - np.arange(at.shape[1])), 0)
    path, drawn = (weights - weights.mean(0)) @ at, sketch[few] - sketch[few].mean(0)
    turn = np.abs(drawn @ [1, -1j] @ (path[0] + 1j * path[1]))
    square = (drawn**2).sum()
    size = np.clip(turn / (square + 1e-9), 1 / resized, resized)
    return ((path**2).sum((0, 1)) - 2 * size * turn + size**2 * square) / len(few)


def _few(sketch: Line) -> Int[Array, " V"]:
    """Numbers of the vertices of a sketch that are compared."""
    count = min(len(sketch), const.VERTICES_MOST)
    return np.arange(count) * (len(sketch) - 1) // (count - 1)


def seen_at(evidence: Float[Array, "H W"], at: Float[Array, "2 ..."]) -> Float[Array, "..."]:
    """Evidence at some points, 0 outside of the image."""
    return ndimage.map_coordinates(evidence, at, order=1, cval=0.0)


def goes_on(
    evidence: Float[Array, "H W"], at: Float[Array, "2 S C"], half_width: float
) -> Bool[Array, "2 C"]:
    """Whether there is a body beyond the first and the last points of paths."""
    tip, inner = at[:, [0, -1]], at[:, [3, -4]]
    out = (tip - inner) / (_distance(tip - inner) + 1e-9)
    away = half_width * np.linspace(*const.BEYOND_HW, 4)[:, None, None]
    return seen_at(evidence, tip[:, None] + away * out[:, None]).mean(0) > 0.5


@lru_cache(maxsize=64)
def _smoothing(count: int, sigma: float) -> Float[Array, "S S"]:
    """(S, S) matrix that smooths a row of points by a Gaussian of `sigma` of them; ends stay."""
    beyond = ((count - 1, count - 1), (0, 0))
    extended = np.pad(np.eye(count), beyond, "reflect", reflect_type="odd")
    return ndimage.gaussian_filter1d(extended, sigma, axis=0)[count - 1 : 2 * count - 1]

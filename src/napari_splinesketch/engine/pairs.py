"""Two bodies side by side that look like one thick one: their traces are one line."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

from napari_splinesketch.engine import assess, fitting, spline
from napari_splinesketch.engine.fitting import Body
from napari_splinesketch.engine.scene import Scene
from napari_splinesketch.engine.types import Array

UNEXPLAINED = 1.4
"""Squared residual, noise² = 1, from which a second look is worth its time."""
CLEARLY = 0.85
"""Two thin bodies take the place of a thick one where they leave less than this share of its
squared residual ..."""
ASIDE = 0.85
"""... and lie further apart than this share of what their half-widths come to."""
SHARED = 0.3
"""Curves this much of which runs along one another may be such a pair."""

Line = Float[Array, "N 2"]
Polish = Callable[[list[Line], list[float], list[Body]], list[Body]]
"""Fits lines with half-widths to start from, beside bodies that stay."""


def split_pairs(
    seen: Scene, sketches: list[Line], bodies: list[Body], others: list[Body], polish: Polish
) -> list[Body]:
    """Lay the two curves of a pair side by side where the image is explained better so.

    Parameters
    ----------
    seen
        The image.
    sketches, bodies
        What was drawn, and what was fitted.
    others
        Bodies without a sketch of this call.
    polish
        How to fit.
    """
    twins = assess.doubles([b.points(100) for b in bodies], seen.half_width, SHARED)
    pairs = sorted({(min(i, j), max(i, j)) for i, j in twins.items()})
    if not pairs:
        return bodies
    found = list(bodies)
    depth = _depth(seen.mask)
    for i, j in pairs:
        one = [found[i], found[j]]
        rest = [b for k, b in enumerate(found) if k not in (i, j)] + others
        rest = [b for b in rest if _meet(b, *one, reach=4 * seen.half_width)]
        if _misfit(seen, one, one, rest) < UNEXPLAINED:
            continue
        lines, width = _beside(found[i], depth, (sketches[i], sketches[j]))
        pair = polish(lines, [width, width], rest)
        better = _misfit(seen, pair, one, rest) < CLEARLY * _misfit(seen, one, pair, rest)
        if better and _aside(*pair) > ASIDE:
            found[i], found[j] = pair
    return found


def _meet(body: Body, *pair: Body, reach: float) -> bool:
    """Whether the surroundings of a body overlap with those of a pair."""
    a, b = body.knots, np.concatenate([one.knots for one in pair])
    return bool((a.max(0) > b.min(0) - reach).all() and (a.min(0) < b.max(0) + reach).all())


def _depth(mask: Bool[Array, "H W"]) -> Float[Array, "H W"]:
    return np.asarray(ndimage.distance_transform_edt(np.pad(mask, 1)))[1:-1, 1:-1]


def _beside(
    body: Body, depth: Float[Array, "H W"], sketches: tuple[Line, Line]
) -> tuple[list[Line], float]:
    """Two lines on either side of a curve, each on its sketch's side, and their half-width."""
    middle = body.points(64)
    at = np.rint(middle).astype(int).clip(0, np.array(depth.shape) - 1)
    width = max(float(np.median(depth[tuple(at.T)])) / 2, 0.5)
    along = np.gradient(middle, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True) + 1e-9
    across = np.column_stack([-along[:, 1], along[:, 0]])
    drawn = [_oriented(spline.resample(s, 64), middle) for s in sketches]
    sides = [float(((line - middle) * across).sum(1).mean()) for line in drawn]
    sign = 1.0 if sides[0] >= sides[1] else -1.0
    return [middle + sign * width * across, middle - sign * width * across], width


def _oriented(line: Line, other: Line) -> Line:
    same, reverse = (np.linalg.norm(other - x, axis=1).sum() for x in (line, line[::-1]))
    return line if same <= reverse else line[::-1]


def _aside(a: Body, b: Body) -> float:
    """Distance between two curves as a share of the sum of their half-widths."""
    apart = np.linalg.norm(a.points(64)[8:-8, None] - b.points(64)[None], axis=2).min(1)
    widths = np.exp(a["log_width_0"]) + np.exp(b["log_width_0"])
    return float(np.median(apart) / widths)


def _misfit(seen: Scene, bodies: list[Body], rivals: list[Body], rest: list[Body]) -> float:
    """Mean squared residual in the bands of the bodies and of their rivals, noise² = 1."""
    near = np.unique(np.concatenate([b.pixels for b in (*bodies, *rivals)]))
    pixels = np.unique(np.concatenate([near, *(b.pixels for b in rest)]))
    drawn = fitting.render_at(pixels, [*bodies, *rest])[np.searchsorted(pixels, near)]
    return float(np.mean(((seen.normal.ravel()[near] - drawn) / seen.noise) ** 2))

"""Two bodies side by side that look like one thick one: their traces run into each other."""

import numpy as np
from scipy import ndimage

from napari_splinesketch.engine import constants as const
from napari_splinesketch.engine import spline
from napari_splinesketch.engine.find import finding
from napari_splinesketch.engine.find.finding import Start
from napari_splinesketch.engine.fit import bands, fitting
from napari_splinesketch.engine.fit.fitting import Body
from napari_splinesketch.engine.look.scene import Scene
from napari_splinesketch.engine.types import Line


def settle_pairs(
    seen: Scene,
    starts: list[Start],
    bodies: list[Body],
    free: list[bool],
    others: list[Body],
) -> list[Body]:
    """Lay the two curves of a pair side by side where that is likelier, each on its own side.

    Only those that are `free` may move; `others` are bodies without a sketch of this call.
    """
    lines = [b.points(100) for b in bodies]
    next_to = spline.doubles(lines, const.PAIR_HW * seen.half_width, const.PAIR_SHARE)
    pairs = sorted({(min(i, j), max(i, j)) for i, j in next_to.items() if free[i] and free[j]})
    found = [*bodies, *others]
    meets = bands.touching([b.pixels for b in found]) if pairs else np.zeros((0, 0))
    for i, j in pairs:
        one, drawn = [found[i], found[j]], [starts[i], starts[j]]
        near = set(np.flatnonzero(meets[[i, j]].any(0)).tolist()) - {i, j}
        rest = [found[k] for k in sorted(near)]
        pair = _fit_beside(seen, one, rest)
        found[i], found[j] = _each_its_side(
            pair if _likelier(seen, pair, one, rest, drawn) else one, drawn
        )
    return found[: len(bodies)]


def _fit_beside(seen: Scene, one: list[Body], rest: list[Body]) -> list[Body]:
    """Two bodies side by side where a pair is, fitted beside bodies that stay."""
    lines, width = _beside(seen, one)
    contrast = float(np.mean([b["contrast"] for b in one]))
    knots = max(len(b.knots) for b in one)
    theta, priors = bands.begin([(x, width, contrast) for x in lines], knots, seen)
    return fitting.fit_curves(seen, theta, priors, beside=rest)


def _likelier(
    seen: Scene, pair: list[Body], one: list[Body], rest: list[Body], starts: list[Start]
) -> bool:
    """Whether two bodies side by side explain more than what was found, and may be meant."""
    near = np.unique(np.concatenate([b.pixels for b in (*pair, *one)]))
    pixels = sum(len(b.pixels) for b in one)

    def more(bodies: list[Body]) -> list[float]:
        mine = zip(_each_its_side(bodies, starts), starts, strict=True)
        return [sum(finding.extra_costs(seen, x, body.points()).values()) for body, x in mine]

    def misfit(bodies: list[Body]) -> float:
        left = seen.normal.ravel()[near] - fitting.drawn([*bodies, *rest], near)
        return float(np.mean(left**2)) * pixels

    costs = more(pair)
    if _aside(*pair) < const.PAIR_APART or max(costs) >= const.PLAUSIBLE:
        return False
    return misfit(pair) - misfit(one) < const.PAIR_PIXELS * (sum(more(one)) - sum(costs))


def _matched(a: Line, b: Line) -> tuple[Line, Line]:
    """Two lines at as many points each, running the same way."""
    a, b = spline.resample(a, 64), spline.resample(b, 64)
    same, reverse = (np.linalg.norm(a - x, axis=1).sum() for x in (b, b[::-1]))
    return a, b if same <= reverse else b[::-1]


def _beside(seen: Scene, pair: list[Body]) -> tuple[list[Line], float]:
    """Two lines that share what is bright around a pair between them, and their half-width."""
    first, second = _matched(*(b.points(64) for b in pair))
    middle = (first + second) / 2
    offsets = np.arange(
        -const.PAIR_REACH_HW * seen.half_width, const.PAIR_REACH_HW * seen.half_width + 0.5, 0.5
    )
    bright = spline.across(seen.normal, middle, offsets)
    inside = ndimage.gaussian_filter(bright, (4, 1)) > 0.5
    inside = ndimage.binary_closing(inside, np.ones((1, 5)))
    centre = len(offsets) // 2
    after = np.where(inside[:, centre:], 1, 0).cumprod(1).sum(1)
    before = np.where(inside[:, centre::-1], 1, 0).cumprod(1).sum(1)
    width = max(float(np.median(after + before)) / 8, 0.5)
    shift = ndimage.gaussian_filter1d((after - before) / 4, 4, mode="nearest")
    normals = spline.normals(middle)
    middle = middle + np.clip(shift, -width, width)[:, None] * normals
    return [middle + width * normals, middle - width * normals], width


def _each_its_side(pair: list[Body], starts: list[Start]) -> list[Body]:
    """The two bodies in the order in which their sketches lie beside each other."""
    a, b = _matched(*(start.sketch for start in starts))
    c, d = _matched(pair[0].points(64), pair[1].points(64))
    if ((b[-1] - a[0]) * (d[-1] - c[0])).sum() < 0:
        c, d = c[::-1], d[::-1]
    swapped = ((b - a) * (d - c)).sum() < 0
    return pair[::-1] if swapped else pair


def _aside(a: Body, b: Body) -> float:
    """Distance between two curves as a share of the sum of their half-widths."""
    apart = spline.apart(a.points(64)[8:-8], b.points(64))
    widths = a.half_width + b.half_width
    return float(np.median(apart) / widths)

"""From fitted parameters to curves: points, widths, standard errors, and what looks wrong."""

from functools import cache

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

from napari_splinesketch.engine import constants as const
from napari_splinesketch.engine import spline
from napari_splinesketch.engine.find import scoring
from napari_splinesketch.engine.fit.fitting import Body
from napari_splinesketch.engine.fit.tube import INDEX, TAPER, modes, tapered_width
from napari_splinesketch.engine.look.scene import Scene
from napari_splinesketch.engine.types import POINTS, Array, Curve

ENDS = np.array([0.0, 1.0])


def outline(
    body: Body, sketch: Float[Array, "N 2"], tips: Bool[Array, "2"], seen: Scene
) -> tuple[Float[Array, "K 3"], Float[Array, "P 2"], Float[Array, " P"], Float[Array, " P"]]:
    """A body from tip to tip, with the round caps that the model draws at blunt ends.

    Ends that cannot be `tips` stay; caps beyond the image, or on something that goes on, are left
    out.

    Returns
    -------
    Knots (row, col, half-width) of a natural cubic spline; points uniform in arc length and the
    half-width there; and where they are on the fitted spline: in its caps below 0 and above 1.
    """
    cap = _caps(body, sketch, tips, seen)
    first, last = _inside(body, sketch, seen.valid.shape)
    low, high = first or -cap[0], last if last < 1 else 1 + cap[1]

    def half_width(u: Array) -> Array:
        beyond = np.maximum(-u / (cap[0] + 1e-9), (u - 1) / (cap[1] + 1e-9))
        return _half_width(body.parameters, u) * np.sqrt(
            1 - np.clip(beyond, 0, 1 - const.TAPER_LEAST) ** 2
        )

    even, knots = _uncrowded(body, low, high)
    part = spline.places(knots)
    u = np.interp(part, np.linspace(0, 1, len(knots)), even)
    points = spline.basis(len(knots), part) @ knots
    return np.column_stack([knots, half_width(even)]), points, half_width(u), u


def _caps(
    body: Body, sketch: Float[Array, "N 2"], tips: Bool[Array, "2"], seen: Scene
) -> list[float]:
    """How far a body goes on beyond its first and last knot, in units of the spline's parameter.

    A tapered end is where the taper ends; the more blunt an end is, the more of its cap belongs to
    the curve, and all as far as a clicked sketch reaches into it.
    """
    count = len(body.knots)
    at, ahead, *lines = (basis @ body.knots for basis in _end_bases(count))
    ahead *= np.array([[-1.0], [1.0]]) / (np.linalg.norm(ahead, axis=1, keepdims=True) + 1e-9)
    whole = _half_width(body.parameters, ENDS)
    cap = np.interp(body["tip"], const.BLUNT, (0, 1)) * whole
    beyond = at + np.multiply.outer(const.BEYOND_CAP, whole[:, None] * ahead)
    left = ndimage.map_coordinates(seen.normal, np.moveaxis(beyond, 2, 0), order=1, mode="nearest")
    cap *= left.mean(0) < const.DARK * body["contrast"]
    if scoring.clicked(sketch):
        beyond = sketch[[0, -1]] - at
        further, near = (beyond * ahead).sum(1), scoring.hit(body.half_width)
        most = np.maximum(whole, body.half_width)
        cap = np.clip(further + near, 0, cap)
        further *= further > const.CAP_AHEAD * np.linalg.norm(beyond, axis=1)
        cap = np.clip(further * (further < most + near), cap, most)
    caps = at + cap[:, None] * ahead
    inside = ((caps >= 0) & (caps <= np.array(seen.valid.shape) - 1)).all(1)
    away = np.linspace(0, 2 / count, const.CAP_POINTS)
    lengths = [spline.arc_length(line) for line in lines]
    return [
        float(np.interp(*one, away)) for one in zip(cap * (inside & tips), lengths, strict=True)
    ]


@cache
def _end_bases(count: int) -> list[Float[Array, "P K"]]:
    """Bases of the ends, of the derivative there, and of points beyond the first and the last."""
    away = np.linspace(0, 2 / count, const.CAP_POINTS)
    return [spline.basis(count, *at) for at in ((ENDS, 0), (ENDS, 1), (-away, 0), (1 + away, 0))]


def _inside(body: Body, sketch: Float[Array, "N 2"], shape: tuple[int, ...]) -> tuple[float, float]:
    """Where a body enters and leaves the image: it leaves it only as far as its sketch does.

    The image does not tell how far a body goes on beyond it.
    """
    points = const.BORDER_POINTS * len(body.knots)
    line = body.points(points)
    least = np.minimum(sketch.min(0), -0.5)
    most = np.maximum(sketch.max(0), np.array(shape) - 0.5)
    there = np.linspace(0, 1, points)[((line >= least) & (line <= most)).all(1)]
    return (float(there[0]), float(there[-1])) if len(there) > 1 else (0.0, 1.0)


def _uncrowded(
    body: Body, low: float, high: float
) -> tuple[Float[Array, " K"], Float[Array, "K 2"]]:
    """As many knots as a body has from `low` to `high`, and where on its spline they are.

    Where they would crowd, so that the curve may fold between them, they are evenly spaced.
    """
    count = len(body.knots)
    even = np.linspace(low, high, count)
    knots = spline.basis(count, even) @ body.knots
    apart = np.diff(spline.arc_length(knots))
    if apart.min() >= const.CROWDED * apart.mean():
        return even, knots
    dense = np.linspace(low, high, const.BORDER_POINTS * count)
    line = spline.basis(count, dense) @ body.knots
    s = spline.arc_length(line)
    return np.interp(np.linspace(0, s[-1], count), s, dense), spline.fit_knots(line, count)


def _half_width(g: Float[Array, " G"], u: Float[Array, " P"]) -> Float[Array, " P"]:
    """(P,) half-width at the spline parameters `u`, px; beyond the ends that of the ends."""
    u = np.clip(u, 0, 1)
    log_width = g[: const.WIDTH_MODES] @ modes(u)
    return tapered_width(u, log_width, *(g[INDEX[name]] for name in TAPER), xp=np)


def as_drawn(sketch: Float[Array, "N 2"], reason: str) -> Curve:
    """A curve that failed: the sketch without missing points, with nothing known about it."""
    points = sketch[np.isfinite(sketch).all(axis=1)]
    if len(points) < 2:
        points = np.repeat(points, 2, 0) if len(points) else np.zeros((2, 2))
    points = np.clip(points, -const.FARTHEST_PX, const.FARTHEST_PX)
    line = spline.resample(points, POINTS)
    return Curve(
        np.column_stack([points, np.full(len(points), np.nan)]),
        line,
        np.full(POINTS, np.nan),
        np.full(POINTS, np.inf),
        "failed",
        (reason,),
        np.inf,
    )

"""From fitted parameters to curves: points, widths, standard errors, and what looks wrong."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from napari_splinesketch.engine import spline
from napari_splinesketch.engine.fit.fitting import Body
from napari_splinesketch.engine.fit.tube import INDEX, WIDTH_MODES, modes, tapered_width
from napari_splinesketch.engine.types import POINTS, Array, Curve

SAME_BODY = 0.5
ON_TOP = 0.6
"""Two curves are on the same body where they run along each other, closer than so many half-widths,
for this share of their length."""


def half_width(g: Float[Array, " G"], u: Float[Array, " P"]) -> Float[Array, " P"]:
    """(P,) half-width at the spline parameters `u`, px."""
    log_width = g[:WIDTH_MODES] @ modes(u)
    return tapered_width(u, log_width, g[INDEX["log_power"]], g[INDEX["log_extent"]], np)


def uniform(knots: Float[Array, "K 2"], count: int = POINTS) -> Float[Array, " count"]:
    """(count,) spline parameters of points uniform in arc length."""
    s = spline.arc_length(spline.even_basis(len(knots), 8 * count) @ knots)
    return np.interp(np.linspace(0, s[-1], count), s, np.linspace(0, 1, 8 * count))


def make_curve(
    body: Body,
    u: Float[Array, " P"],
    sd: Float[Array, " P"],
    residual: Float[Array, " m"],
    reasons: tuple[str, ...],
) -> Curve:
    """The curve of a fitted body.

    Parameters
    ----------
    body
        From the last level.
    u, sd
        (P,) spline parameters of its points, and their standard errors, px.
    residual
        (m,) image minus reconstruction in its band, as a share of the contrast.
    reasons
        What looks wrong.
    """
    knots = body.knots
    width = half_width(body.parameters, np.linspace(0, 1, len(knots)))
    return Curve(
        np.column_stack([knots, width]),
        spline.basis(len(knots), u) @ knots,
        half_width(body.parameters, u),
        sd,
        "check" if reasons else "good",
        reasons,
        float(np.sqrt(np.mean(residual**2))) if len(residual) else np.inf,
    )


def as_drawn(sketch: Float[Array, "N 2"], reason: str) -> Curve:
    """A curve that failed: the sketch, with nothing known about it."""
    points = np.asarray(sketch, dtype=np.float64)
    if len(points) < 2 or not np.isfinite(points).all():
        points = points[np.isfinite(points).all(axis=1)] if points.ndim == 2 else points
        points = np.repeat(points[:1], 2, 0) if len(points) else np.zeros((2, 2))
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


def neighbours(curves: list[Float[Array, "P 2"]], reach: float) -> Iterator[list[int]]:
    """Say of each curve which others' bounding boxes come within `reach` of its own."""
    low = np.array([c.min(0) for c in curves]).reshape(-1, 2)
    high = np.array([c.max(0) for c in curves]).reshape(-1, 2)
    for i in range(len(curves)):
        near = ((low <= high[i] + reach) & (high >= low[i] - reach)).all(1)
        near[i] = False
        yield np.flatnonzero(near).tolist()


def doubles(curves: list[Float[Array, "P 2"]], reach: float, share: float) -> dict[int, int]:
    """Curves that run within `reach` of another for much of their length, with its number."""
    found = {}
    for i, (a, beside) in enumerate(zip(curves, neighbours(curves, reach), strict=True)):
        for j in beside:
            if (spline.apart(a[::4], curves[j][::2]) < reach).mean() > share:
                found[i] = j
    return found

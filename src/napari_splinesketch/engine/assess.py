"""From fitted parameters to curves: points, widths, standard errors, and what looks wrong."""

import numpy as np
from jaxtyping import Float

from napari_splinesketch.engine import spline
from napari_splinesketch.engine.fitting import Body
from napari_splinesketch.engine.profile import WIDTH_MODES, modes, tapered_width
from napari_splinesketch.engine.tube import INDEX
from napari_splinesketch.engine.types import POINTS, Array, Curve, Status

LARGE_SD = 0.4
LARGE_RESIDUAL = 3.0
VISIBLE_RESIDUAL = 0.25
MOVED = 0.5
LONGER = 1.8
SHORTER = 2.5
SAME_BODY = 0.5
"""Limits beyond which a curve asks for a look: px; times the noise and share of the contrast;
shares of the sketch's length; factors of length; share of the length that two curves run along
each other."""
CORE = 0.3
"""Pixels with this share of a body's brightness tell how well it is explained."""
INFLATION = 1.2
CROWDED = 1.45
BLIND_END = 1.45
"""What the standard error lacks, because bodies are not exactly tubes: everywhere, beside
another curve, and near the ends. Measured on generated bodies: tests/benchmarks/uncertainty.py.
"""
END_SHARE = 0.1
BESIDE = 2.3
"""Half-widths."""


def half_width(g: Float[Array, " G"], u: Float[Array, " P"]) -> Float[Array, " P"]:
    """(P,) half-width at the spline parameters `u`, px."""
    log_width = g[:WIDTH_MODES] @ modes(u, np)[0]
    return tapered_width(u, log_width, g[INDEX["log_power"]], g[INDEX["log_extent"]], np)


def uniform(knots: Float[Array, "K 2"], count: int = POINTS) -> Float[Array, " count"]:
    """(count,) spline parameters of points uniform in arc length."""
    u = np.linspace(0, 1, 8 * count)
    s = spline.arc_length(spline.basis(len(knots), u) @ knots)
    return np.interp(np.linspace(0, s[-1], count), s, u)


def normal_sd(
    covariance: Float[Array, "D D"], knots: Float[Array, "K 2"], u: Float[Array, " P"]
) -> Float[Array, " P"]:
    """(P,) standard error along the normal, from the covariance of the knots (Laplace)."""
    k = len(knots)
    rows = spline.basis(k, u)
    tangent = spline.basis(k, u, 1) @ knots
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True) + 1e-9
    across = np.concatenate([-tangent[:, 1:] * rows, tangent[:, :1] * rows], axis=1)
    variance = np.einsum("pi,ij,pj->p", across, covariance[: 2 * k, : 2 * k], across)
    return np.sqrt(np.maximum(variance, 0))


def make_curve(
    body: Body,
    residual: Float[Array, " m"],
    noise: float,
    reasons: tuple[str, ...],
    others: Float[Array, "Q 2"],
) -> Curve:
    """The curve of a fitted body.

    Parameters
    ----------
    body
        From the last level.
    residual
        (m,) image minus reconstruction in its band, as a share of the contrast.
    noise
        Standard deviation of the noise that the fit assumed, in the same unit.
    reasons
        What looks wrong.
    others
        (Q, 2) points of the other curves.
    """
    knots = body.knots
    u = uniform(knots)
    rms = float(np.sqrt(np.mean(residual**2))) if len(residual) else np.inf
    points = spline.basis(len(knots), u) @ knots
    sd = np.full(POINTS, np.inf)
    if len(residual):
        sd = normal_sd(body.covariance * max(rms / noise, 1.0) ** 2, knots, u)
    sd *= _inflation(points, others, BESIDE * np.exp(body["log_width_0"]))
    end = int(END_SHARE * POINTS)
    if sd[end:-end].max() > LARGE_SD:
        worst = sd[end:-end].max()
        reasons = (*reasons, f"its position is uncertain by up to {worst:.1f} px")
    status: Status = "check" if reasons else "good"
    width = half_width(body.parameters, np.linspace(0, 1, len(knots)))
    return Curve(
        np.column_stack([knots, width]),
        points,
        half_width(body.parameters, u),
        sd,
        status,
        reasons,
        rms,
    )


def _inflation(
    points: Float[Array, "P 2"], others: Float[Array, "Q 2"], beside: float
) -> Float[Array, " P"]:
    """Factor by which the standard error of each point is too small."""
    factor = np.full(len(points), INFLATION)
    if len(others):
        low, high = points.min(0) - beside, points.max(0) + beside
        close = others[((others > low) & (others < high)).all(1)]
        if len(close):
            apart = np.linalg.norm(points[:, None] - close[None], axis=2).min(1)
            factor[apart < beside] *= CROWDED
    end = int(END_SHARE * len(points))
    factor[:end] *= BLIND_END
    factor[-end:] *= BLIND_END
    return factor


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


def doubts(
    curve: Float[Array, "P 2"],
    sketch: Float[Array, "N 2"],
    residual: Float[Array, " m"],
    noise: float,
    shape: tuple[int, int],
) -> list[str]:
    """What looks wrong with a curve by itself, in words for the user."""
    found = []
    drawn = spline.resample(sketch, len(curve))
    length, before = spline.arc_length(curve)[-1], spline.arc_length(drawn)[-1]
    rms = np.sqrt(np.mean(residual**2)) if len(residual) else np.inf
    if rms > max(LARGE_RESIDUAL * noise, VISIBLE_RESIDUAL):
        found.append(f"the image around it is not explained ({rms / noise:.1f} times the noise)")
    moved = np.linalg.norm(curve.mean(0) - drawn.mean(0))
    if moved > MOVED * max(length, before):
        found.append(f"it moved {moved:.0f} px from its sketch")
    if not 1 / SHORTER < length / before < LONGER * np.pi / 2:
        found.append(f"its length changed from {before:.0f} to {length:.0f} px")
    edge = np.array(shape) - 1
    if ((curve < 0) | (curve > edge)).any():
        found.append("part of it lies outside the image")
    return found


def doubles(
    curves: list[Float[Array, "P 2"]], half_width: float, share: float = SAME_BODY
) -> dict[int, int]:
    """Curves that run along another for much of their length, with the other's number."""
    found = {}
    low = np.array([c.min(0) for c in curves]).reshape(-1, 2) - half_width
    high = np.array([c.max(0) for c in curves]).reshape(-1, 2) + half_width
    for i, a in enumerate(curves):
        meets = np.flatnonzero(((low <= high[i]) & (high >= low[i])).all(1))
        for j in meets[meets != i].tolist():
            apart = np.linalg.norm(a[::4, None] - curves[j][None, ::2], axis=2).min(1)
            if (apart < 0.6 * half_width).mean() > share:
                found[i] = j
    return found

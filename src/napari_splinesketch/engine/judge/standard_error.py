"""How far a curve may be from its body: the standard error of its points along the normal."""

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage, spatial

from napari_splinesketch.engine import constants as const
from napari_splinesketch.engine import spline
from napari_splinesketch.engine.fit.fitting import Body
from napari_splinesketch.engine.look.scene import Scene
from napari_splinesketch.engine.types import Array


def unexplained(seen: Scene, residual: Float[Array, "H W"]) -> Float[Array, "H W"]:
    """(H, W) averages of the residual over the grain, where white noise would have variance 1."""
    grain = const.GRAIN_HW * seen.half_width
    one = np.zeros((2 * int(4 * grain + 0.5) + 1,) * 2)
    one[len(one) // 2, len(one) // 2] = 1
    gain = np.linalg.norm(ndimage.gaussian_filter(one, grain))
    return ndimage.gaussian_filter(residual, grain) / (seen.noise * gain)


def standard_error(
    body: Body,
    u: Float[Array, " P"],
    unexplained: Float[Array, "H W"],
    beside: Bool[Array, " P"],
) -> Float[Array, " P"]:
    """(P,) standard error along the normal, px.

    Laplace's, for the noise that was assumed, times what the image leaves unexplained around
    each point beyond that noise. Residuals that hang together count for more than white ones: as
    much more as they remain when averaged.

    Parameters
    ----------
    body
        From the last level.
    u
        (P,) spline parameters of the points, uniform in arc length.
    unexplained
        See `unexplained`.
    beside
        (P,) which points have another curve near.
    """
    points = spline.basis(len(body.knots), u) @ body.knots
    if not len(body.pixels):
        return np.full(len(u), np.inf)
    half_width = float(np.exp(body["log_width_0"]))
    misfit = _misfit_along(body, points, unexplained, half_width)
    factor = const.SD_EVERYWHERE * np.maximum(misfit, 1.0)
    factor[beside] *= const.SD_BESIDE
    end = int(const.END_SHARE * len(points))
    factor[:end] *= const.SD_END
    factor[-end:] *= const.SD_END
    return factor * normal_sd(body.covariance, body.knots, u)


def normal_sd(
    covariance: Float[Array, "D D"], knots: Float[Array, "K 2"], u: Float[Array, " P"]
) -> Float[Array, " P"]:
    """(P,) standard error along the normal, from the covariance of the knots (Laplace)."""
    k = len(knots)
    rows = spline.basis(k, u)
    tangent = spline.basis(k, u, 1) @ knots
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True) + 1e-9
    across = np.concatenate([-tangent[:, 1:] * rows, tangent[:, :1] * rows], axis=1)
    variance = ((across @ covariance[: 2 * k, : 2 * k]) * across).sum(1)
    return np.sqrt(np.maximum(variance, 0))


def _misfit_along(
    body: Body,
    points: Float[Array, "P 2"],
    unexplained: Float[Array, "H W"],
    half_width: float,
) -> Float[Array, " P"]:
    """(P,) size of what is unexplained near each point; 1 for white noise as assumed."""
    at = np.column_stack(np.divmod(body.pixels, unexplained.shape[1]))
    apart, nearest = spatial.KDTree(points).query(
        at, distance_upper_bound=const.MISFIT_ACROSS_HW * half_width
    )
    near, nearest = np.isfinite(apart), np.asarray(nearest)
    squares = unexplained.ravel()[body.pixels[near]] ** 2
    step = spline.arc_length(points)[-1] / (len(points) - 1)
    reach = const.MISFIT_ALONG_HW * half_width / max(step, 1e-3)
    total, count = (
        ndimage.gaussian_filter1d(np.bincount(nearest[near], w, len(points)), reach, mode="nearest")
        for w in (squares, np.ones(near.sum()))
    )
    return np.sqrt(total / np.maximum(count, 1e-9))

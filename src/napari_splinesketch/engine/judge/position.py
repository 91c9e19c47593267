"""Where a curve is, and how surely: what the image says, and what its sketch adds to that."""

import numpy as np
from jaxtyping import Float
from scipy import ndimage, spatial

from napari_splinesketch.engine import constants as const
from napari_splinesketch.engine import spline
from napari_splinesketch.engine.find import scoring
from napari_splinesketch.engine.fit.fitting import Body
from napari_splinesketch.engine.look.filters import blurred
from napari_splinesketch.engine.look.scene import Scene
from napari_splinesketch.engine.types import POINTS, Array


def unexplained(seen: Scene, residual: Float[Array, "H W"]) -> Float[Array, "H W"]:
    """(H, W) averages of the residual over the grain, where white noise would have variance 1."""
    grain = const.GRAIN_HW * seen.half_width
    one = np.zeros((2 * int(4 * grain + 0.5) + 1,) * 2)
    one[len(one) // 2, len(one) // 2] = 1
    gain = np.linalg.norm(ndimage.gaussian_filter(one, grain))
    return blurred(residual, grain) / (seen.noise * gain)


def covariance(
    body: Body, unexplained: Float[Array, "H W"], others: Float[Array, "N 2"] | None
) -> Float[Array, "2K 2K"]:
    """Covariance of a body's knots (K rows, then K columns), px².

    Laplace's, for the noise that was assumed, times what the image leaves `unexplained` around each
    knot beyond that noise. Residuals that hang together count for more than white ones: as much
    more as they remain when averaged. `others` are points of the curves near it.
    """
    count, half_width = len(body.knots), body.half_width
    points, end = body.points(POINTS), int(const.END_SHARE * POINTS)
    misfit = _misfit_along(body, points, unexplained, half_width)
    factor = const.SD_EVERYWHERE * np.maximum(misfit, 1.0)
    if others is not None:
        near = np.isfinite(spline.apart(points, others, const.BESIDE_HW * half_width))
        factor[near] *= const.SD_BESIDE
    factor[:end] *= const.SD_END
    factor[-end:] *= const.SD_END
    at = np.linspace(0, POINTS - 1, count).round().astype(int)
    each = np.tile(factor[at], 2)
    return body.covariance[: 2 * count, : 2 * count] * each * each[:, None]


def with_sketch(
    knots: Float[Array, "K 2"],
    covariance: Float[Array, "2K 2K"],
    sketch: Float[Array, "N 2"],
    half_width: float,
) -> tuple[Float[Array, "K 2"], Float[Array, "2K 2K"]]:
    """Knots and their covariance, with what the vertices of a clicked sketch say beside the image.

    Each vertex measures where the curve is along the normal beside it, the first and the last also
    where it ends (Kalman's update). Where the image shows a body well they change nothing; where
    it shows nothing, the curve passes through them. A sketch that misses the curve at most of its
    vertices was not clicked with care, or means another body, and says nothing; nor does one that
    would fold the curve.
    """
    count, length = len(knots), float(spline.arc_length(sketch)[-1])
    line = spline.even_basis(count, 8 * POINTS) @ knots
    at = np.asarray(spatial.KDTree(line).query(sketch)[1]) / (len(line) - 1)
    beside = (at > 0) & (at < 1)
    at = np.concatenate([at[beside], [0, 1], [0, 1]])
    drawn = np.concatenate([sketch[beside], *[sketch[[0, -1]]] * 2])
    basis, way = spline.basis(count, at), _tangents(knots, at)
    ends = end_directions(line)
    way[-4:] = np.tile(ends * [[-1.0], [1.0]], (2, 1))
    way[:-2] = way[:-2, ::-1] * [-1.0, 1.0]
    rows = np.concatenate([way[:, :1] * basis, way[:, 1:] * basis], axis=1)
    off = ((drawn - basis @ knots) * way).sum(1)
    near = scoring.hit(half_width, length)
    if np.median(np.abs(off)) > near:
        return knots, covariance
    sd = np.full(len(at), near)
    sd[-2:] += const.CLICKED_END * length
    known = rows @ covariance
    gain = np.linalg.solve(known @ rows.T + np.diag(sd**2), known).T
    move, u = (gain @ off).reshape(2, -1).T, np.linspace(0, 1, count)
    # How far knots slide along the curve is hardly known, and may fold it: as far as its ends do.
    tangents = _tangents(knots, u)
    along = (move * tangents).sum(1)
    move += (np.interp(u, [0, 1], along[[0, -1]]) - along)[:, None] * tangents
    found = knots + move
    before, after = (spline.even_basis(count, POINTS) @ k for k in (knots, found))
    turn = spline.sharpest_turn(after, half_width)
    if turn > const.FOLD_RAD and turn > spline.sharpest_turn(before, half_width):
        return knots, covariance
    return found, covariance - gain @ known


def end_directions(line: Float[Array, "N 2"]) -> Float[Array, "2 2"]:
    """Unit vectors out of a curve at both its ends, which may end in small hooks."""
    points, end = spline.resample(line, POINTS), int(const.END_SHARE * POINTS)
    out = points[[0, -1]] - points[[end, -1 - end]]
    return out / (np.linalg.norm(out, axis=1, keepdims=True) + 1e-9)


def normal_sd(
    covariance: Float[Array, "2K 2K"], knots: Float[Array, "K 2"], u: Float[Array, " P"]
) -> Float[Array, " P"]:
    """(P,) standard error of points along the normal, px, from the covariance of the knots.

    Only what the knots may be off across the curve counts. How far they may slide along it is
    hardly known, and where a curve bends that would count as if it were off.
    """
    own = _tangents(knots, np.linspace(0, 1, len(knots)))
    rows = spline.basis(len(knots), u) * (_tangents(knots, u) @ own.T)
    across = np.concatenate([-rows * own[:, 1], rows * own[:, 0]], axis=1)
    variance = ((across @ covariance) * across).sum(1)
    return np.sqrt(np.maximum(variance, 0))


def _tangents(knots: Float[Array, "K 2"], u: Float[Array, " P"]) -> Float[Array, "P 2"]:
    """(P, 2) unit tangents of a spline."""
    tangent = spline.basis(len(knots), u, 1) @ knots
    return tangent / (np.linalg.norm(tangent, axis=1, keepdims=True) + 1e-9)


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

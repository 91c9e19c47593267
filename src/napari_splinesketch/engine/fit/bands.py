"""Between NumPy and the solver: bands of pixels, priors and start values, padded to few sizes."""

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from napari_splinesketch.engine import constants as const
from napari_splinesketch.engine import spline
from napari_splinesketch.engine.fit.solver import Bands, Level
from napari_splinesketch.engine.fit.tube import GLOBALS, INDEX, Basis
from napari_splinesketch.engine.look.band import band
from napari_splinesketch.engine.look.scene import Scene
from napari_splinesketch.engine.settings import Hold
from napari_splinesketch.engine.types import Array


def padded(count: int, sizes: tuple[int, ...]) -> int:
    """The smallest of `sizes` that holds `count`, or the largest."""
    return next((s for s in sizes if s >= count), sizes[-1])


@cache
def spline_basis(knots: int) -> Basis:
    """The basis at the samples of a curve, float32."""
    coarse = 2 ** int(
        np.ceil(np.log2(max(const.CURVE_SAMPLES, const.CURVE_SAMPLES_A_KNOT * knots)))
    )
    u = np.linspace(0, 1, const.FINER * (coarse - 1) + 1)
    return Basis(*(spline.basis(knots, u, d).astype(np.float32) for d in range(3)))


class Priors(NamedTuple):
    """Means, standard deviation and bounds of the parameters in `tube.GLOBALS`, of n curves."""

    mean: Float[Array, "n G"]
    sd: Float[Array, " G"]
    low: Float[Array, "n G"]
    high: Float[Array, "n G"]


def default_priors(half_widths: Sequence[float]) -> Priors:
    """Priors of curves with about these half-widths, px, in units of a normalised scene."""
    mean, sd, low, high = np.array(list(const.PRIORS.values())).T
    mean, low, high = (np.tile(each, (len(half_widths), 1)) for each in (mean, low, high))
    for each in (mean, low, high):
        each[:, INDEX["log_width_0"]] += np.log(half_widths)
    return Priors(mean, sd, low, high)


def level(seen: Scene) -> Level:
    """What all curves of a scene share."""
    longest = max(const.MOVE_HW * seen.half_width, const.MOVE_PX)
    return Level(np.float32(seen.noise), np.float32(longest))


def begin(
    bodies: Sequence[tuple[Float[Array, "N 2"], float, float]],
    knots: int,
    seen: Scene,
    whole: bool = False,
) -> tuple[Float[Array, "n D"], Priors]:
    """Parameters to start from, and priors, of bodies: their lines, half-widths and contrasts.

    Lines that are `whole` are known to reach from tip to tip.
    """
    priors = default_priors([half_width for _, half_width, _ in bodies])
    priors.mean[:, INDEX["contrast"]] = [contrast for *_, contrast in bodies]
    surer = {} if seen.background_kind == "textured" else const.FLAT_BACKGROUND
    if whole:
        surer = surer | const.WHOLE_ENDS
        priors.mean[:, INDEX["tip"]] = const.WHOLE_TIP
    for name, sd in surer.items():
        priors.sd[INDEX[name]] = sd
    lines = [spline.fit_knots(line, knots).T.ravel() for line, *_ in bodies]
    return np.concatenate([np.reshape(lines, (-1, 2 * knots)), priors.mean], axis=1), priors


def precision(line: Float[Array, "K 2"], hold: Hold) -> Float[Array, "2K 2K"]:
    """Inverse covariance of knots (K rows, then K columns) that are known as `hold` says."""
    count = len(line)
    down, right = map(np.diag, spline.normals(line).T)
    across, along = np.concatenate([down, right]), np.concatenate([right, -down])
    common = hold.along**2 / (hold.stretch**2 + count * hold.along**2)
    together = (np.eye(count) - common) / hold.stretch**2
    return across @ across.T / hold.across**2 + along @ together @ along.T


def stiff(
    line: Float[Array, "N 2"], few: int, knots: int
) -> tuple[Float[Array, " 2K"], Float[Array, "2K 2K"]]:
    """Coordinates of `knots` knots along a line, held to be as smooth as `few` would be."""
    finer = spline.even_basis(few, knots)
    rest = np.eye(knots) - finer @ spline.thinner(knots, few)
    at = finer @ spline.fit_knots(line, few)
    return at.T.ravel(), np.kron(np.eye(2), rest) / const.PIN_PX**2


def band_pixels(
    points: Float[Array, "P 2"], radius: float, valid: Bool[Array, "H W"]
) -> Int[Array, " M"]:
    """Flat indices of the valid pixels of a band.

    Of a band of more pixels than the largest of `PIXEL_SIZES`, every second, third, … pixel.
    """
    rows, columns, mask = band(points, radius, valid.shape)
    r, c = np.nonzero(mask & valid[rows, columns])
    every = max(1, -(-len(r) // const.PIXEL_SIZES[-1]))
    return ((r + rows.start) * valid.shape[1] + c + columns.start)[::every]


def make_bands(
    image: Float[Array, "H W"],
    pixels: list[Int[Array, " m"]],
    theta: Float[Array, "n D"],
    half_width: float,
    priors: Priors,
    hold: Float[Array, "n 2K 2K"],
) -> tuple[Bands, Float[Array, "n D"], Float[Array, "N D"]]:
    """Pad everything, and move every curve to its own centre.

    `pixels` are the bands of the n curves, and of bodies beside them that stay as they are; `hold`
    is the inverse covariance of the knots around where they start, px⁻².

    Returns
    -------
    The bands; what was taken off the parameters of each curve (its centre, repeated); and the
    padded parameters to start from.
    """
    count, d = theta.shape
    k = (d - len(GLOBALS)) // 2
    n, m = padded(len(pixels), const.CURVE_SIZES), padded(max(map(len, pixels)), const.PIXEL_SIZES)
    n *= -(-len(pixels) // n)  # beyond the largest size, multiples of it
    position = np.full((n, 2, m), const.NOWHERE_PX, dtype=np.float32)
    values, weight = np.zeros((2, n, m), np.float32)
    centre = theta[:, : 2 * k].reshape(count, 2, k).mean(2)
    tiles = np.zeros(n, np.int32)
    for i, own in enumerate(pixels):
        here, tiles[i] = slice(len(own)), -(-len(own) // const.TILE)
        values[i, here], weight[i, here] = image.ravel()[own], 1.0
        if i < count:
            position[i, :, here] = np.stack(np.divmod(own, image.shape[1])) - centre[i, :, None]

    shift, begin = np.zeros((count, d)), np.zeros((n, d), np.float32)
    shift[:, : 2 * k] = np.repeat(centre, k, axis=1)
    begin[:count] = theta - shift
    stiff = _stiffness(theta[:, : 2 * k].reshape(count, 2, k), half_width)
    mean, held, slope = begin.copy(), *np.zeros((2, n, d), np.float32)
    mean[:count, 2 * k :] = priors.mean
    precision = np.zeros((n, d, d), np.float32)
    slope[:count, : 2 * k] = (stiff @ begin[:count, : 2 * k, None])[..., 0]
    precision[:count, : 2 * k, : 2 * k] = hold + stiff
    held[:count, : 2 * k] = np.diagonal(hold, axis1=1, axis2=2)
    precision[:count, 2 * k :, 2 * k :] = np.diag(priors.sd**-2.0)
    lower, upper = np.full((2, n, d), [[[-np.inf]], [[np.inf]]], np.float32)
    lower[:count, 2 * k :], upper[:count, 2 * k :] = priors.low, priors.high
    beside = _beside(pixels, n, m)
    priced = mean, precision, held, slope
    return Bands(position, values, weight, beside, tiles, *priced, lower, upper), shift, begin


def _beside(pixels: list[Int[Array, " m"]], n: int, m: int) -> Int[Array, "N M"]:
    """For every pixel of padded bands, where the next curve that sees it has it."""
    at = np.arange(n * m, dtype=np.int32)
    mine = np.concatenate([i * m + np.arange(len(own)) for i, own in enumerate(pixels)])
    at[mine] = mine[_ring(np.concatenate(pixels))]
    return at.reshape(n, m)


def _ring(numbers: Int[Array, " N"]) -> Int[Array, " N"]:
    """Where the same number comes next; after its last place its first."""
    order = np.argsort(numbers, kind="stable")
    first = np.flatnonzero(np.diff(numbers[order], prepend=-1))
    after = np.arange(1, len(order) + 1)
    after[np.append(first, len(order))[1:] - 1] = first
    ring = np.empty(len(order), int)
    ring[order] = order[after]
    return ring


def touching(pixels: list[Int[Array, " m"]]) -> Bool[Array, "n n"]:
    """Which bands share pixels with which others."""
    shared = np.zeros((len(pixels), len(pixels)), dtype=bool)
    owner = np.repeat(np.arange(len(pixels)), [len(own) for own in pixels])
    ring = _ring(np.concatenate(pixels)) if pixels else np.zeros(0, int)
    mine = np.flatnonzero(ring != np.arange(len(ring)))
    at = ring[mine]
    while len(mine):
        shared[owner[mine], owner[at]] = True
        at = ring[at]
        on = at != mine
        mine, at = mine[on], at[on]
    return shared


def _stiffness(xy: Float[Array, "n 2 K"], half_width: float) -> Float[Array, "n 2K 2K"]:
    """What bending costs curves, and spacing their knots unevenly, as quadratic forms."""
    length = np.linalg.norm(np.diff(xy, axis=2), axis=1).sum(1)[:, None, None] + 1e-3
    bend = np.kron(np.eye(2), spline.bending_matrix(xy.shape[2]))
    tangent = xy[:, :, 2:] - xy[:, :, :-2]
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True) + 1e-6
    second = np.diff(np.eye(xy.shape[2]), n=2, axis=0)
    along = np.concatenate([tangent[:, 0, :, None] * second, tangent[:, 1, :, None] * second], 2)
    spacing = const.UNEVEN * length / (xy.shape[2] - 1)
    return (
        const.BEND * half_width / length**3 * bend + along.transpose(0, 2, 1) @ along / spacing**2
    )

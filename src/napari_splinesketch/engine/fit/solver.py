"""Levenberg–Marquardt on all curves of a scene.

Each curve has its own parameters, damping and band of pixels; it sees the others as the sum and
the maximum of their brightness, frozen while it takes its steps. One compiled program serves
every scene: counts, priors and numbers of steps are data, and shapes come in few sizes.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from napari_splinesketch.engine.fit.profile import blend
from napari_splinesketch.engine.fit.tube import INDEX, Basis, brightness
from napari_splinesketch.engine.types import AnyArray as Array

SLOPE_UNIT = 50.0
"""Background slopes are per this many px."""

MOVES, MOVES_PX = 0.8, 4.0
"""Longest move of a knot in one step, half-widths, and px at least."""

HUBER = 4.0
"""Residuals beyond this many standard deviations of the noise count linearly."""


TILE = 704
"""Pixels worked on at a time: a curve costs what its band needs, whatever it is padded to, and
the Jacobian stays in the cache."""

ABREAST = 128
"""Curves that a GPU works on at a time."""

SETTLED = 0.05
"""Improvement of χ² below which a curve has arrived."""


class Bands(NamedTuple):
    """What N curves (padded) see and expect: M pixels each (padded with weight 0)."""

    pixels: Float[Array, "N 2 M"]
    """Row and col of the band's pixels, relative to the curve's centre."""
    values: Float[Array, "N M"]
    """The image there: background about 0, bodies about 1."""
    weight: Float[Array, "N M"]
    slots: Int[Array, "N M"]
    """Number of the pixel, shared by the curves that see it; padding has number N · M - 1."""
    tiles: Int[Array, " N"]
    """How many times TILE pixels hold the curve's band; 0 for padding."""
    prior_mean: Float[Array, "N D"]
    prior_precision: Float[Array, "N D D"]
    """Inverse covariance of the prior of the parameters; 0 for none."""
    bending: Float[Array, " N"]
    """Weight of knotsᵀ Q knots."""
    spacing: Float[Array, " N"]
    """Weight of unequal spacing of the knots along the curve."""


class Level(NamedTuple):
    """What all curves share."""

    lower: Float[Array, " D"]
    upper: Float[Array, " D"]
    noise: Float[Array, ""]
    longest: Float[Array, ""]
    """Move of a knot in one step, px."""


class Fit(NamedTuple):
    """State of the N curves."""

    theta: Float[Array, "N D"]
    own: Float[Array, "N M"]
    """Brightness of each curve in its band."""
    cost: Float[Array, " N"]
    """χ² of data and priors."""
    hessian: Float[Array, "N D D"]
    """Normal matrix of data and priors, in units of 1 / noise²."""
    damping: Float[Array, " N"]
    gain: Float[Array, " N"]
    """Improvement of χ² in the last visit."""


class _Step(NamedTuple):
    theta: Array
    trial: Array
    own: Array
    hessian: Array
    gradient: Array
    cost: Array
    first: Array
    damping: Array
    taken: Array
    done: Array


def start(theta: Float[Array, "N D"], pixels: int) -> Fit:
    """The state before the first visit."""
    n, d = theta.shape
    return Fit(
        theta,
        np.zeros((n, pixels), np.float32),
        np.zeros(n, np.float32),
        np.zeros((n, d, d), np.float32),
        np.full(n, 1e-2, np.float32),
        np.zeros(n, np.float32),
    )


@partial(jax.jit, donate_argnums=(2,), static_argnames="together")
def sweep(
    bands: Bands,
    level: Level,
    fit: Fit,
    basis: Basis,
    bend: Float[Array, "K K"],
    order: Int[Array, " N"],
    count: Int[Array, ""],
    steps: Int[Array, ""],
    *,
    together: int | None = None,
) -> Fit:
    """Visit the first `count` curves of `order`, `together` at a time.

    Each takes at most `steps` evaluations; with one it stays where it is, and its brightness,
    cost and normal matrix are brought up to date. `basis` and `bend` are the spline's basis and
    its bending matrix. One at a time costs least on a CPU, many at a time on a GPU: that is what
    None chooses. The curves are the same.
    """
    if together is None:
        together = 1 if jax.default_backend() == "cpu" else min(len(order), ABREAST)
    maps = brightness_maps(fit.own, bands.slots, None if together > 1 else bands.tiles)

    def visit(i, steps):
        one = jax.tree.map(lambda a: a[i], bands)
        others = others_of(maps, fit.own[i], one.slots)
        step = _visit(one, level, fit.theta[i], fit.damping[i], *others, basis, bend, steps)
        gain = step.first - step.cost
        return Fit(step.theta, step.own, step.cost, step.hessian, step.damping, gain)

    def visit_one(turn, now):
        i = order[turn]
        return jax.tree.map(lambda old, new: old.at[i].set(new), now, visit(i, steps))

    def visit_some(turn, now):
        at = together * turn + jnp.arange(together)
        i = jnp.where(at < count, order[at], len(order))  # those beyond are dropped
        new = jax.vmap(visit)(i, jnp.where(at < count, steps, 0))
        return jax.tree.map(lambda old, new: old.at[i].set(new, mode="drop"), now, new)

    if together == 1:
        return jax.lax.fori_loop(0, count, visit_one, fit)
    return jax.lax.fori_loop(0, -(-count // together), visit_some, fit)


class Maps(NamedTuple):
    """Sum, largest and second largest of the curves' brightness at every slot."""

    total: Float[Array, " S"]
    most: Float[Array, " S"]
    second: Float[Array, " S"]


def brightness_maps(
    own: Float[Array, "N M"], slots: Int[Array, "N M"], tiles: Int[Array, " N"] | None
) -> Maps:
    """Add up the curves, one after the other where their `tiles` are given."""
    nothing = jnp.zeros(own.size, own.dtype)

    def over_tiles(add, start):
        if tiles is None:
            return add(start, own, slots)
        count = tiles

        def over_curve(i, image):
            def over_tile(t, image):
                cut = partial(jax.lax.dynamic_slice, start_indices=(i, t * TILE))
                here, at = (cut(a, slice_sizes=(1, TILE))[0] for a in (own, slots))
                return add(image, here, at)

            return jax.lax.fori_loop(0, count[i], over_tile, image)

        return jax.lax.fori_loop(0, (count > 0).sum(), over_curve, start)

    # One image a loop, never read where it is written: XLA would copy it in every turn.
    total = over_tiles(lambda image, here, at: image.at[at].add(here), nothing)
    most = over_tiles(lambda image, here, at: image.at[at].max(here), nothing)
    second = over_tiles(
        lambda image, here, at: image.at[at].max(jnp.where(here >= most[at], 0.0, here)), nothing
    )
    return Maps(total, most, second)


def others_of(
    maps: Maps, own: Float[Array, " M"], slots: Int[Array, " M"]
) -> tuple[Float[Array, " M"], Float[Array, " M"]]:
    """Sum and maximum of the other curves' brightness in the band of one."""
    most = maps.most[slots]
    return maps.total[slots] - own, jnp.where(own >= most, maps.second[slots], most)


def _visit(
    one: Bands, level: Level, theta, damping, others_sum, others_max, basis, bend, limit
) -> _Step:
    """Up to `limit` evaluations for one curve; the first is at `theta` itself."""
    d = len(theta)
    begin = _Step(
        theta,
        theta,
        jnp.zeros_like(one.values),
        jnp.zeros((d, d)),
        jnp.zeros(d),
        jnp.asarray(jnp.inf),
        jnp.asarray(jnp.inf),
        damping,
        jnp.asarray(0, jnp.int32),
        jnp.asarray(False),
    )

    def step(now: _Step) -> _Step:
        own, hessian, gradient, cost = _linearise(
            one, level, now.trial, others_sum, others_max, basis, bend
        )
        better = cost < now.cost
        small = jnp.where(better, now.cost - cost < SETTLED, now.damping > 1e3)
        pick = partial(jax.tree.map, partial(jnp.where, better))
        theta, own, hessian, gradient, cost = pick(
            (now.trial, own, hessian, gradient, cost),
            (now.theta, now.own, now.hessian, now.gradient, now.cost),
        )
        first = jnp.minimum(now.first, jnp.where(now.taken == 0, cost, jnp.inf))
        damping = jnp.clip(now.damping * jnp.where(better, 0.2, 5.0), 1e-6, 1e6)
        damped = hessian + (damping * jnp.diagonal(hessian) + 1e-3) * jnp.eye(d)
        factor = jax.scipy.linalg.cho_factor(damped)
        move = jax.scipy.linalg.cho_solve(factor, gradient)
        longest = jnp.abs(move[: 2 * len(bend)]).max()
        move = move * jnp.minimum(1.0, level.longest / (longest + 1e-9))
        move = jnp.where(jnp.isfinite(move).all(), move, 0.0)
        trial = jnp.clip(theta + move, level.lower, level.upper)
        return _Step(
            theta, trial, own, hessian, gradient, cost, first, damping, now.taken + 1, small
        )

    return jax.lax.while_loop(lambda s: (s.taken < limit) & ~s.done, step, begin)


def _linearise(one: Bands, level: Level, theta, others_sum, others_max, basis, bend):
    """Brightness, normal matrix, descent direction (right-hand side) and cost at `theta`."""
    k, d = len(bend), len(theta)

    def add_tile(t, sums):
        own, gram, cost = sums
        cut = partial(jax.lax.dynamic_slice_in_dim, start_index=t * TILE, slice_size=TILE, axis=-1)
        seen = (one.pixels, one.values, one.weight, others_sum, others_max)
        here, tile_gram, tile_cost = _tile(level, theta, basis, *map(cut, seen))
        own = jax.lax.dynamic_update_slice_in_dim(own, here, t * TILE, 0)
        return own, gram + tile_gram, cost + tile_cost

    nothing = jnp.zeros_like(one.values), jnp.zeros((d + 1, d + 1)), jnp.asarray(0.0)
    own, gram, data_cost = jax.lax.fori_loop(0, one.tiles, add_tile, nothing)

    apart = theta - one.prior_mean
    away = one.prior_precision @ apart
    hessian = gram[:-1, :-1] + one.prior_precision
    gradient = gram[:-1, -1] - away
    cost = data_cost + apart @ away

    g = 2 * k
    knots = theta[:g].reshape(2, k)
    stiff, pull, energy = _knot_priors(knots, one.bending, one.spacing, bend)
    hessian = hessian.at[:g, :g].add(stiff)
    return own, hessian, gradient.at[:g].add(-pull), cost + energy


def _tile(level: Level, theta, basis, pixels, values, weight, others_sum, others_max):
    """Brightness in some pixels, and their share of the normal matrix (last: residual) and χ²."""
    g = 2 * basis.value.shape[1]
    own, jacobian = brightness(theta, pixels, basis)
    overlap = theta[g + INDEX["overlap"]]
    model = blend(overlap, own, others_sum, others_max)
    slopes = pixels / SLOPE_UNIT
    background = (
        theta[g + INDEX["offset"]]
        + theta[g + INDEX["slope_row"]] * slopes[0]
        + theta[g + INDEX["slope_col"]] * slopes[1]
    )
    residual = (values - model - background) / level.noise
    robust = weight * jnp.minimum(1.0, HUBER / (jnp.abs(residual) + 1e-9))
    visible = 1 - overlap + overlap * (own >= others_max)
    blend_slope = jnp.maximum(own, others_max) - own - others_sum
    rows = jnp.concatenate(
        [
            jacobian[: g + INDEX["overlap"]] * (visible / level.noise),
            jnp.stack([blend_slope, jnp.ones_like(own), slopes[0], slopes[1]]) / level.noise,
            residual[None],
        ]
    )
    return own, (rows * robust) @ rows.T, (weight * _huber(residual)).sum()


def _huber(residual):
    """r² within HUBER, linear beyond."""
    size = jnp.abs(residual)
    return jnp.where(size < HUBER, size**2, 2 * HUBER * size - HUBER**2)


def _knot_priors(knots, bending, spacing, bend):
    """Normal matrix, gradient and energy of bending and of unequal spacing of the knots."""
    k = knots.shape[1]
    stiff = jnp.kron(jnp.eye(2), bending * bend)
    second = knots[:, 2:] - 2 * knots[:, 1:-1] + knots[:, :-2]
    tangent = knots[:, 2:] - knots[:, :-2]
    tangent = tangent / (jnp.linalg.norm(tangent, axis=0) + 1e-6)
    difference = jnp.eye(k)[2:] - 2 * jnp.eye(k)[1:-1] + jnp.eye(k)[:-2]
    rows = jnp.concatenate([tangent[0, :, None] * difference, tangent[1, :, None] * difference], 1)
    uneven = (tangent * second).sum(0)
    flat = knots.reshape(-1)
    pull = stiff @ flat + spacing * rows.T @ uneven
    energy = flat @ stiff @ flat + spacing * (uneven**2).sum()
    return stiff + spacing * rows.T @ rows, pull, energy

"""Levenberg–Marquardt on all curves of a scene.

Each curve has its own parameters, damping and band of pixels; it sees the others as the sum and
the maximum of their brightness, frozen while it takes its steps. One compiled program serves
every scene: counts, priors and numbers of steps are data, and shapes come in few sizes.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from napari_splinesketch.engine import constants as const
from napari_splinesketch.engine.fit.tube import Basis, render
from napari_splinesketch.engine.types import AnyArray as Array


class Bands(NamedTuple):
    """What N curves (padded) see and expect: M pixels each (padded with weight 0)."""

    pixels: Float[Array, "N 2 M"]
    """Row and col of the band's pixels, relative to the curve's centre."""
    values: Float[Array, "N M"]
    """The image there: background about 0, bodies about 1."""
    weight: Float[Array, "N M"]
    beside: Int[Array, "N M"]
    """Flat index of the same pixel in the band of the next curve that sees it, the first after the
    last; of a pixel that no other sees, and of padding, its own."""
    tiles: Int[Array, " N"]
    """How many times TILE pixels hold the curve's band; 0 for padding."""
    prior_mean: Float[Array, "N D"]
    prior_precision: Float[Array, "N D D"]
    """Curvature of what the prior costs: its inverse covariance; 0 for none."""
    held: Float[Array, "N D"]
    """Diagonal of the part of it that holds knots where they are."""
    prior_slope: Float[Array, "N D"]
    """Half of the slope of what the prior costs at its mean: bodies resist bending."""
    lower: Float[Array, "N D"]
    """Least values of the parameters."""
    upper: Float[Array, "N D"]
    """Largest values of the parameters."""


class Level(NamedTuple):
    """What all curves share."""

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


class _Look(NamedTuple):
    """What one curve looks like at `theta`, and which way is down."""

    theta: Array
    own: Array
    hessian: Array
    gradient: Array
    cost: Array


def start(theta: Float[Array, "N D"], pixels: int) -> Fit:
    """The state before the first visit."""
    n, d = theta.shape
    own, hessian = np.zeros((n, pixels), np.float32), np.zeros((n, d, d), np.float32)
    nothing, damping = np.zeros(n, np.float32), np.full(n, const.DAMPING_FIRST, np.float32)
    return Fit(theta, own, nothing, hessian, damping, nothing.copy())


def at_a_time() -> int:
    """How many curves step together: one costs least on a CPU, many on a GPU."""
    return 1 if jax.default_backend() == "cpu" else const.ABREAST


@contextmanager
def settings() -> Iterator[None]:
    """JAX's settings that the engine computes with, whatever the caller's are."""
    # GPUs round the factors of products to eleven bits unless they are told not to.
    with (
        jax.enable_x64(False),
        jax.default_matmul_precision("highest"),
        jax.numpy_rank_promotion("allow"),
        jax.transfer_guard("allow"),
        # A bound that is infinite and a curve that is lost are no faults.
        jax.debug_nans(False),
        jax.debug_infs(False),
    ):
        yield


@partial(jax.jit, donate_argnums=(2,), static_argnames="together")
def sweep(
    bands: Bands,
    level: Level,
    fit: Fit,
    basis: Basis,
    order: Int[Array, " N"],
    count: Int[Array, ""],
    steps: Int[Array, ""],
    *,
    together: int | None = None,
) -> Fit:
    """Visit the first `count` curves of `order`, `together` at a time.

    Each takes at most `steps` evaluations; with one it stays where it is, and its brightness,
    cost and normal matrix are brought up to date. None for as many as is best; those that meet are
    not to step together, and then the curves are the same.
    """
    together = min(len(order), at_a_time()) if together is None else together

    def visit(i, now, steps):
        one = jax.tree.map(lambda a: a[i], bands)
        others = others_of(now.own, bands.beside, i)
        return _visit(one, level, now.theta[i], now.damping[i], others, basis, steps)

    def visit_one(turn, now):
        i = order[turn]
        return jax.tree.map(lambda old, new: old.at[i].set(new), now, visit(i, now, steps))

    def visit_some(turn, now):
        at = together * turn + jnp.arange(together)
        i = order[at]
        new = jax.vmap(visit, (0, None, 0))(i, now, jnp.where(at < count, steps, 0))
        i = jnp.where(at < count, i, len(order))  # those beyond are dropped
        return jax.tree.map(lambda old, new: old.at[i].set(new, mode="drop"), now, new)

    if together == 1:
        return jax.lax.fori_loop(0, count, visit_one, fit)
    return jax.lax.fori_loop(0, -(-count // together), visit_some, fit)


def others_of(
    own: Float[Array, "N M"], beside: Int[Array, "N M"], i: Int[Array, ""]
) -> tuple[Float[Array, " M"], Float[Array, " M"]]:
    """Sum and maximum of the other curves' brightness in the band of curve `i`."""
    every, after = own.ravel(), beside.ravel()
    mine = i * own.shape[1] + jnp.arange(own.shape[1])

    def add(now):
        at, total, most = now
        here = jnp.where(at == mine, 0.0, every[at])
        return jnp.where(at == mine, at, after[at]), total + here, jnp.maximum(most, here)

    begin = beside[i], jnp.zeros_like(own[i]), jnp.zeros_like(own[i])
    return jax.lax.while_loop(lambda now: (now[0] != mine).any(), add, begin)[1:]


def _visit(one: Bands, level: Level, theta, damping, others, basis: Basis, limit) -> Fit:
    """Up to `limit` evaluations for one curve; the first is at `theta` itself."""
    d, knots = len(theta), basis.value.shape[1]

    def step(now):
        best, trial, damping, first, taken, _ = now
        here = _linearise(one, level, trial, others, basis)
        better = here.cost < best.cost
        done = jnp.where(better, best.cost - here.cost < const.SETTLED, damping > 1e3)
        best = jax.tree.map(partial(jnp.where, better), here, best)
        first = jnp.where(taken == 0, here.cost, first)
        damping = jnp.clip(
            damping * jnp.where(better, 1 / const.DAMPING, const.DAMPING), const.DAMPING_LEAST, 1e6
        )
        unexplained = const.DAMPING_MISFIT * best.cost / one.weight.sum()
        least = jnp.minimum(unexplained, const.DAMPING_MISFIT_MOST)
        least = jnp.where(jnp.arange(d) < 2 * knots, least, 0.0)
        # What holds knots costs what the step takes it for: the others are to move freely.
        diagonal = jnp.maximum(damping, least) * (jnp.diagonal(best.hessian) - one.held) + 1e-3
        factor = jax.scipy.linalg.cho_factor(best.hessian + diagonal * jnp.eye(d))
        move = jax.scipy.linalg.cho_solve(factor, best.gradient)
        longest = jnp.abs(move[: 2 * knots]).max()
        move = move * jnp.minimum(1.0, level.longest / (longest + 1e-9))
        move = jnp.where(jnp.isfinite(move).all(), move, 0.0)
        trial = jnp.clip(best.theta + move, one.lower, one.upper)
        done |= move @ best.gradient < const.SETTLED
        return best, trial, damping, first, taken + 1, done

    nothing = jnp.zeros_like(one.values), jnp.zeros((d, d)), jnp.zeros(d)
    unknown = jnp.asarray(jnp.inf)
    begin = (_Look(theta, *nothing, unknown), theta, damping, unknown, jnp.int32(0), False)
    best, _, damping, first, *_ = jax.lax.while_loop(
        lambda now: (now[-2] < limit) & ~now[-1], step, begin
    )
    return Fit(best.theta, best.own, best.cost, best.hessian, damping, first - best.cost)


def _linearise(one: Bands, level: Level, theta, others, basis: Basis) -> _Look:
    """Brightness, normal matrix, descent direction (right-hand side) and cost at `theta`."""

    def add_tile(t, sums):
        own, gram, cost = sums
        cut = partial(
            jax.lax.dynamic_slice_in_dim, start_index=t * const.TILE, slice_size=const.TILE, axis=-1
        )
        pixels, values, weight, *beside = map(cut, (one.pixels, one.values, one.weight, *others))
        model, here, jacobian = render(theta, pixels, *beside, basis=basis)
        residual = values - model
        size = jnp.abs(residual) / level.noise
        robust = weight * jnp.minimum(1.0, const.HUBER / (size + 1e-9))
        columns = jnp.concatenate([jacobian, residual[:, None]], axis=1)
        own = jax.lax.dynamic_update_slice_in_dim(own, here, t * const.TILE, 0)
        return (
            own,
            gram + columns.T @ (columns * robust[:, None]),
            cost + (weight * _huber(size)).sum(),
        )

    d = len(theta)
    nothing = jnp.zeros_like(one.values), jnp.zeros((d + 1, d + 1)), jnp.asarray(0.0)
    own, gram, cost = jax.lax.fori_loop(0, one.tiles, add_tile, nothing)
    apart = theta - one.prior_mean
    away = one.prior_precision @ apart + one.prior_slope
    gram = gram / level.noise**2
    hessian = gram[:-1, :-1] + one.prior_precision
    return _Look(theta, own, hessian, gram[:-1, -1] - away, cost + apart @ (away + one.prior_slope))


def _huber(size):
    """The square of a residual's size within HUBER, linear beyond."""
    return jnp.where(size < const.HUBER, size**2, 2 * const.HUBER * size - const.HUBER**2)

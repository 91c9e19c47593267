"""splender, the paper's own package: its model and its loss, in the paper's three phases.

Its own `optim.fit` trains everything at once and compiles in every call. Here the same model and
loss are trained as the paper says, by a loop that is compiled once for each number of bodies.
"""

from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from typing import Any, cast

import jax
import jax.numpy as jnp
import numpy as np
import optax

from napari_splinesketch.metrics import resample

PERCENTILES = (0.5, 99.5)
NOISE_DECAY = 0.55
_SPLINE = ("loc_params", "knot_params", "global_scale", "opacity")
_BACKGROUND = ("contrast", "brightness")
_TEXTURE = ("kernel", "brush_profile")
_TRAINED = (_BACKGROUND, _BACKGROUND + _SPLINE, _BACKGROUND + _SPLINE + _TEXTURE)

Params = dict[str, jax.Array]


@dataclass(frozen=True)
class Settings:
    """What splender is given.

    Attributes
    ----------
    global_scale
        Width of its blobs.
    knots
        Knots of a spline.
    low, high
        Intensity of background and bodies after the image is stretched.
    steps, rates
        Adam's steps and learning rates in the three phases: background; all but kernel and blob,
        with cosine annealing; everything.
    noise
        Variance of the noise on the second phase's gradients at its start.
    seeds
        Repetitions of the second phase, of which the one with the smallest loss is kept.
    """

    global_scale: float = 0.3
    knots: int = 7
    low: float = 0.0
    high: float = 1.0
    steps: tuple[int, int, int] = (100, 800, 100)
    rates: tuple[float, float, float] = (1e-2, 1e-2, 1e-4)
    noise: float = 0.0
    seeds: int = 1


TUNED = Settings()
COMPILE_ONLY = replace(TUNED, steps=(1, 1, 1), seeds=1)


def fit(
    image: np.ndarray, sketches: tuple[np.ndarray, ...], settings: Settings, *, bright: bool
) -> list[np.ndarray]:
    """Refine all sketches of a square image; returns one (100, 2) per sketch."""
    size = image.shape[0]
    target = jnp.asarray(_stretched(image, settings, bright), jnp.float32)[None]
    start, _ = _phase(_start(size, sketches, settings), target, 0, settings, seed=0)
    tries = [_phase(start, target, 1, settings, seed=s) for s in range(settings.seeds)]
    best = min(tries, key=lambda tried: tried[1])[0]
    params, _ = _phase(best, target, 2, settings, seed=0)
    return [_centreline(params, i, size) for i in range(len(sketches))]


def _start(size: int, sketches: tuple[np.ndarray, ...], settings: Settings) -> Params:
    knots = np.stack([resample(s, settings.knots)[:, ::-1] for s in sketches]) / size
    knots = np.clip(knots, 0.01, 0.99)[None]
    model = _model(size, init_knots=jnp.asarray(knots, jnp.float32))
    model.global_scale = settings.global_scale
    model.__manual_post_init__()
    return {name: getattr(model, name) for name in _TRAINED[-1]}


def _model(size: int, **arrays: jax.Array) -> Any:
    return import_module("splender").image.SplenderImage(key=None, res=size, **arrays)


def _stretched(image: np.ndarray, settings: Settings, bright: bool) -> np.ndarray:
    signed = image if bright else -image
    low, high = np.percentile(signed, PERCENTILES)
    unit = np.clip((signed - low) / (high - low), 0, 1)
    return settings.low + (settings.high - settings.low) * unit


def _phase(
    params: Params, target: jax.Array, phase: int, settings: Settings, *, seed: int
) -> tuple[Params, float]:
    mask = {name: jnp.float32(name in _TRAINED[phase]) for name in params}
    second = phase == 1
    fitted, loss = _descend(
        params,
        target,
        mask,
        settings.steps[phase],
        settings.rates[phase],
        float(second),
        settings.noise * second,
        jax.random.key(seed),
    )
    return fitted, float(loss)


@jax.jit
def _descend(
    params: Params,
    target: jax.Array,
    mask: Params,
    steps: jax.Array,
    rate: jax.Array,
    annealed: jax.Array,
    noise: jax.Array,
    key: jax.Array,
) -> tuple[Params, jax.Array]:
    """Adam on the parameters in the mask; returns them and the last loss."""
    loss_of = partial(_loss, target)
    adam = optax.scale_by_adam()

    def step(i: jax.Array, state: tuple[Params, optax.OptState, jax.Array]) -> Any:
        params, moments, _ = state
        loss, slopes = jax.value_and_grad(loss_of)(params)
        sd = jnp.sqrt(noise / (1.0 + i) ** NOISE_DECAY)
        keys = jax.random.split(jax.random.fold_in(key, i), len(slopes))
        noisy = {
            name: mask[name] * (slope + sd * jax.random.normal(k, slope.shape))
            for k, (name, slope) in zip(keys, slopes.items(), strict=True)
        }
        updates, moments = adam.update(noisy, moments)
        moves = cast(Params, updates)
        cosine = 0.5 * (1 + jnp.cos(jnp.pi * i / steps))
        pace = rate * (annealed * cosine + 1 - annealed)
        moved = {name: params[name] - pace * mask[name] * moves[name] for name in params}
        return moved, moments, loss

    fitted, _, loss = jax.lax.fori_loop(
        0, steps, step, (params, adam.init(params), jnp.float32(jnp.inf))
    )
    return fitted, loss


def _loss(target: jax.Array, params: Params) -> jax.Array:
    model = _model(target.shape[-1], init_knots=jnp.ones(1), **params)
    return import_module("splender").optim.image_loss(model, target)


def _centreline(params: Params, index: int, size: int) -> np.ndarray:
    knots = params["loc_params"][0, index] + params["knot_params"][0, index]
    x, y, _ = _model(size, init_knots=jnp.ones(1)).fit_spline(knots)
    s = jnp.linspace(0, 1, 100)
    return size * np.stack([np.asarray(y(s)), np.asarray(x(s))], axis=1)

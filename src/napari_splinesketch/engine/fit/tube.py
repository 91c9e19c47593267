"""The tube renderer: how the model draws one body's band of pixels, and the derivatives of that."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import erf
from jaxtyping import Float, Int

from napari_splinesketch.engine import constants as const
from napari_splinesketch.engine.types import AnyArray as Array

GLOBALS = tuple(const.PRIORS)
"""Rows of a curve's parameter vector after its 2K coordinates (K rows, then K columns)."""
INDEX = {name: i for i, name in enumerate(GLOBALS)}
TAPER = ("log_power", "log_extent", "tip")


class Basis(NamedTuple):
    """The spline basis at P samples, P - 1 a multiple of FINER: values and two derivatives."""

    value: Float[Array, "P K"]
    first: Float[Array, "P K"]
    second: Float[Array, "P K"]


def render(
    theta: Float[Array, " D"],
    pixels: Float[Array, "2 M"],
    others_sum: Float[Array, " M"],
    others_max: Float[Array, " M"],
    basis: Basis,
) -> tuple[Float[Array, " M"], Float[Array, " M"], Float[Array, "M D"]]:
    """Everything in a body's band: other bodies, its own brightness, the local background.

    The parameters are K rows, K columns, then GLOBALS. Returns the model's pixels, the body's own
    brightness, and the derivatives of the former by the parameters.
    """
    last, count = len(basis.value) - 1, basis.value.shape[1]
    knots = theta[: 2 * count].reshape(2, count)
    curve = [knots @ b.T for b in basis]
    index = _nearest_sample(curve, pixels)
    bend = curve[2][:, index]

    def drawn(point: Array, tangent: Array, g: list[Array]) -> tuple[Array, Array]:
        # A Newton step leads from the sample to the nearest point, which slides as they change.
        step = _newton(pixels - point, tangent, bend, index, last, reach=1)
        apart = pixels - point - tangent * step
        distance = jnp.sqrt((apart**2).sum(0) + 1e-6)
        own = brightness(distance, index / last + step, g)
        model = blend(g[INDEX["overlap"]], own, others_sum, others_max) + g[INDEX["offset"]]
        slopes = g[INDEX["slope_row"]] * pixels[0] + g[INDEX["slope_col"]] * pixels[1]
        return model + slopes / const.SLOPE_UNIT_PX, own

    # Each pixel gets its own copy of the parameters, so that one backward pass gives all columns.
    each = [jnp.broadcast_to(x, pixels.shape[1:]) for x in theta[2 * count :]]
    model, pull, own = jax.vjp(drawn, curve[0][:, index], curve[1][:, index], each, has_aux=True)
    # Computed once, not again in each column that is made of them: compiled and run sooner.
    pulled = jax.lax.optimization_barrier(pull(jnp.ones_like(model)))
    by_point, by_tangent, by_globals = pulled
    # Pixel by pixel, as the basis is read: a third faster than parameter by parameter.
    value, slope = basis.value[index], basis.first[index]
    by_knots = [
        by_point[axis][:, None] * value + by_tangent[axis][:, None] * slope for axis in (0, 1)
    ]
    return model, own, jnp.concatenate([*by_knots, jnp.stack(by_globals, axis=1)], axis=1)


def _nearest_sample(curve: list[Array], pixels: Float[Array, "2 M"]) -> Int[Array, " M"]:
    """(M,) the sample nearest to each pixel: the nearest of every FINER-th, then a Newton step."""
    last = curve[0].shape[1] - 1
    coarse = last // const.FINER + 1
    # Written out by coordinate, so that XLA fuses it with the minimum; the samples lie side by side
    # along the last axis, so that it takes several at a time.
    row, column = jax.lax.optimization_barrier(curve[0][:, :: const.FINER])
    squared = (pixels[0][:, None] - row) ** 2 + (pixels[1][:, None] - column) ** 2
    # A minimum over distances with the index in their low bits is ten times faster than argmin.
    low = (1 << (coarse - 1).bit_length()) - 1
    bits = jax.lax.bitcast_convert_type(squared, jnp.int32)
    index = (bits & ~low) | jnp.arange(coarse, dtype=jnp.int32)
    index = const.FINER * (index.min(1) & low)
    point, tangent, bend = (a[:, index] for a in curve)
    step = _newton(pixels - point, tangent, bend, index, last, reach=const.FINER)
    return index + jnp.rint(step * last).astype(jnp.int32)


def _newton(apart, tangent, bend, index, last: int, reach: int) -> Float[Array, " M"]:
    """By how much u changes from a sample to the nearest point, within `reach` samples of it."""
    speed = (tangent**2).sum(0)
    curvature = jnp.maximum(speed - (apart * bend).sum(0), 0.3 * speed)
    low, high = jnp.maximum(-index, -reach) / last, jnp.minimum(last - index, reach) / last
    return jnp.clip((apart * tangent).sum(0) / curvature, low, high)


def brightness(distance, u, g, xp=jnp, erf=erf):
    """A body's brightness at a distance from the point u of its centreline.

    Along a straight stretch a row of radially symmetric blobs integrates to such a tube
    (paper, section 2.1): its coverage is about 1 inside and 0 outside, its edge is blurred, and
    is darker than its middle. `xp` and `erf` are of the array library to compute with.
    """
    shape = modes(u)
    log_width = sum(g[i] * shape[i] for i in range(const.WIDTH_MODES))
    light = 1 + sum(
        g[const.WIDTH_MODES + i - 1] * shape[i] for i in range(1, 1 + const.LIGHT_MODES)
    )
    blur = xp.exp(g[INDEX["log_blur"]]) * np.sqrt(2.0)
    width = tapered_width(u, log_width, *(g[INDEX[name]] for name in TAPER), xp=xp)
    edge = 0.5 * (erf((width + distance) / blur) + erf((width - distance) / blur))
    across = xp.minimum((distance / width) ** 2, 1.0)
    return g[INDEX["contrast"]] * light * edge * (1 - const.EDGE_SHADE * across)


def tapered_width(u, log_width, log_power, log_extent, tip, xp=jnp):
    """Half-width at u, px: rises from `tip` at the ends, a share of the body's, to all of it.

    The rise is ∝ (distance from the end / extent)^power, with the extent as a share of the length.
    `xp` is the array library to compute with.
    """
    x = xp.clip(xp.minimum(u, 1 - u) * xp.exp(-log_extent), const.TAPER_LEAST, 1.0)
    rise = xp.exp(xp.exp(log_power) * xp.log(x * (1.5 - 0.5 * x**2)))
    return xp.exp(log_width) * (tip + (1 - tip) * rise)


def modes(u):
    """WIDTH_MODES Legendre polynomials of 2u - 1: how bodies may vary along their length."""
    x = 2 * u - 1
    return [1 + 0 * x, x, 1.5 * x**2 - 0.5, 2.5 * x**3 - 1.5 * x]


def blend(overlap, own, others_sum, others_max, xp=jnp):
    """Overlapping bodies: α·max + (1 - α)·sum (paper, section 2.1)."""
    return overlap * xp.maximum(own, others_max) + (1 - overlap) * (own + others_sum)

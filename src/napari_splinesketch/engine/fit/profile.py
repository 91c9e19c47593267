"""Cross-section and taper of a body: how much of a pixel it covers."""

import jax
import jax.numpy as jnp
from jax.scipy.special import erf
from jaxtyping import Array, Float

Pixels = Float[Array, " M"]

FLOOR = 0.02
WIDTH_MODES = 4


def coverage(
    distance: Pixels,
    u: Pixels,
    log_width: Pixels,
    log_blur: Pixels,
    shade: Pixels,
    log_power: Pixels,
    log_extent: Pixels,
) -> Pixels:
    """Coverage of pixels by a tube with tapered ends: about 1 inside, 0 outside.

    Along a straight stretch a row of radially symmetric blobs integrates to such a tube
    (paper, section 2.1).

    Parameters
    ----------
    distance
        (M,) from the nearest point of the centreline, px.
    u
        (M,) spline parameter of that point, 0 to 1.
    log_width
        (M,) log of the half-width before the taper, px.
    log_blur
        (M,) log of the standard deviation of the edge's blur, px.
    shade
        (M,) darkening of the edge against the middle, 0 (flat) to 1.
    log_power, log_extent
        (M,) logs of the taper: half-width ∝ (distance from the end / extent)^power, with the
        extent as a share of the length.
    """
    width = tapered_width(u, log_width, log_power, log_extent)
    blur = jnp.exp(log_blur) * jnp.sqrt(2.0)
    edge = 0.5 * (erf((width + distance) / blur) + erf((width - distance) / blur))
    across = jnp.minimum((distance / width) ** 2, 1.0)
    return edge * (1 - shade * across)


def tapered_width(u, log_width, log_power, log_extent, xp=jnp):
    """Half-width at u, px: the body's width times a rise from FLOOR at the ends to 1.

    `xp` is the array library to compute with.
    """
    x = xp.clip(xp.minimum(u, 1 - u) * xp.exp(-log_extent), FLOOR, 1.0)
    rounded = x * (1.5 - 0.5 * x**2)
    return xp.exp(log_width) * rounded ** xp.exp(log_power)


def blend(overlap, own, others_sum, others_max, xp=jnp):
    """Overlapping bodies: α·max + (1 - α)·sum (paper, section 2.1)."""
    return overlap * xp.maximum(own, others_max) + (1 - overlap) * (own + others_sum)


def modes(u, xp=jnp):
    """Legendre polynomials of 2u - 1 below degree WIDTH_MODES, and their derivatives by u.

    How half-width and brightness may vary along a body. Both are (WIDTH_MODES, M).
    """
    x = 2 * u - 1
    one, zero = xp.ones_like(x), xp.zeros_like(x)
    values = [one, x, 1.5 * x**2 - 0.5, 2.5 * x**3 - 1.5 * x]
    slopes = [zero, 2 * one, 6 * x, 15 * x**2 - 3]
    return xp.stack(values), xp.stack(slopes)


def coverage_partials(*inputs: Pixels) -> tuple[Pixels, tuple[Pixels, ...]]:
    """`coverage` and its partial derivatives by each of the seven inputs, all (M,)."""
    value, pull = jax.vjp(coverage, *inputs)
    return value, pull(jnp.ones_like(value))

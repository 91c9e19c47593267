"""Cross-section and taper of a body: how much of a pixel it covers."""

import jax.numpy as jnp
import numpy as np
from jax.scipy.special import erf
from jaxtyping import Array, Float

Pixels = Float[Array, " M"]

FLOOR = 0.02
WIDTH_MODES = 4


def coverage(
    distance: Pixels, u: Pixels, log_width: Pixels, log_blur, shade, log_power, log_extent
) -> tuple[Pixels, tuple[Pixels, ...]]:
    """Coverage of pixels by a tube with tapered ends, and its seven partial derivatives.

    About 1 inside and 0 outside. Along a straight stretch a row of radially symmetric blobs
    integrates to such a tube (paper, section 2.1). The derivatives are written out: automatic
    ones compute what they share with the value anew.

    Parameters
    ----------
    distance
        (M,) from the nearest point of the centreline, px.
    u
        (M,) spline parameter of that point, 0 to 1.
    log_width
        (M,) log of the half-width before the taper, px.
    log_blur
        Log of the standard deviation of the edge's blur, px.
    shade
        Darkening of the edge against the middle, 0 (flat) to 1.
    log_power, log_extent
        Logs of the taper: see `tapered_width`.
    """
    shrink, sign = jnp.exp(-log_extent), jnp.where(u < 0.5, 1.0, -1.0)
    raw = jnp.minimum(u, 1 - u) * shrink
    x = jnp.clip(raw, FLOOR, 1.0)
    rounded = x * (1.5 - 0.5 * x**2)
    log_taper = jnp.exp(log_power) * jnp.log(rounded)
    width = jnp.exp(log_width + log_taper)
    tapers = (raw > FLOOR) & (raw < 1)
    log_width_x = jnp.where(tapers, jnp.exp(log_power) * 1.5 * (1 - x**2) / rounded, 0.0)

    sharp = jnp.exp(-log_blur) / jnp.sqrt(2.0)
    ends = (width + distance) * sharp, (width - distance) * sharp
    edge = 0.5 * (erf(ends[0]) + erf(ends[1]))
    far, near = (jnp.exp(-(end**2)) / jnp.sqrt(jnp.pi) for end in ends)
    ratio = distance / width
    across = jnp.minimum(ratio**2, 1.0)
    light = 1 - shade * across
    darker = jnp.where(ratio < 1, 2 * shade * edge * ratio, 0.0)
    by_log_width = light * width * sharp * (far + near) + darker * ratio
    return edge * light, (
        light * sharp * (far - near) - darker / width,
        by_log_width * log_width_x * shrink * sign,
        by_log_width,
        -light * (far * ends[0] + near * ends[1]),
        -edge * across,
        by_log_width * log_taper,
        -by_log_width * log_width_x * x,
    )


def tapered_width(u, log_width, log_power, log_extent):
    """Half-width at u, px: the body's width times a rise from FLOOR at the ends to 1.

    About ∝ (distance from the end / extent)^power, with the extent as a share of the length.
    """
    x = np.clip(np.minimum(u, 1 - u) * np.exp(-log_extent), FLOOR, 1.0)
    rounded = x * (1.5 - 0.5 * x**2)
    return np.exp(log_width) * rounded ** np.exp(log_power)


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

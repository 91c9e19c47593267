"""The tube renderer: one curve's brightness in its band of pixels, and its Jacobian."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Float

from napari_splinesketch.engine.fit.profile import WIDTH_MODES, coverage_partials, modes
from napari_splinesketch.engine.types import AnyArray as Array

# Rows of a curve's parameter vector after its 2K coordinates (K rows, then K columns).
SHADE_MODES = 2
GLOBALS = (
    *(f"log_width_{i}" for i in range(WIDTH_MODES)),
    *(f"brightness_{i}" for i in range(1, SHADE_MODES + 1)),
    "contrast",
    "log_blur",
    "shade",
    "log_power",
    "log_extent",
    "overlap",
    "offset",
    "slope_row",
    "slope_col",
)

INDEX = {name: i for i, name in enumerate(GLOBALS)}
FINER = 16
"""Samples of the curve for each one that the nearest is looked for among."""


class Basis(NamedTuple):
    """The spline basis at P samples, P - 1 a multiple of FINER: values and two derivatives."""

    value: Float[Array, "P K"]
    first: Float[Array, "P K"]
    second: Float[Array, "P K"]


class Nearest(NamedTuple):
    """The point of the centreline nearest to each of M pixels."""

    u: Float[Array, " M"]
    distance: Float[Array, " M"]
    normal: Float[Array, "2 M"]
    weights: Float[Array, "K M"]
    slopes: Float[Array, "K M"]
    """Weights of the knots in the point and in the tangent there."""
    du_dpoint: Float[Array, "2 M"]
    du_dtangent: Float[Array, "2 M"]
    """How u slides when the point moves and when the tangent turns."""


def nearest(knots: Float[Array, "2 K"], pixels: Float[Array, "2 M"], basis: Basis) -> Nearest:
    """Nearest points of a curve: the nearest of every FINER-th sample, then two Newton steps.

    The first step leads to another sample, the second to a point within half a sample of it, so
    that values and weights there are right to the precision of the numbers.
    """
    samples, curve = len(basis.value), [knots @ b.T for b in basis]
    coarse = (samples - 1) // FINER + 1
    # Written out by coordinate, so that XLA fuses it with the minimum: fifty times faster.
    row, column = curve[0][:, ::FINER, None]
    squared = (pixels[0][None] - row) ** 2 + (pixels[1][None] - column) ** 2
    # A minimum over distances with the index in their low bits is ten times faster than argmin.
    low = (1 << (coarse - 1).bit_length()) - 1
    bits = jax.lax.bitcast_convert_type(squared, jnp.int32)
    index = (bits & ~low) | jnp.arange(coarse, dtype=jnp.int32)[:, None]
    index = FINER * (index.min(0) & low)

    def newton(index, reach: int):
        point, tangent, bend = (a[:, index] for a in curve)
        apart = pixels - point
        speed = (tangent**2).sum(0)
        curvature = jnp.maximum(speed - (apart * bend).sum(0), 0.3 * speed)
        step = (apart * tangent).sum(0) / curvature * (samples - 1)
        step = jnp.clip(step, jnp.maximum(-index, -reach), jnp.minimum(samples - 1 - index, reach))
        return step, apart, tangent, bend, speed

    index = index + jnp.rint(newton(index, FINER)[0]).astype(jnp.int32)
    step, apart, tangent, bend, speed = newton(index, 1)
    u = (index + step) / (samples - 1)
    step = step / (samples - 1)
    apart = apart - tangent * step - 0.5 * bend * step**2
    tangent = tangent + bend * step
    distance = jnp.sqrt((apart**2).sum(0) + 1e-6)
    inside = (u > 0) & (u < 1)
    denominator = jnp.maximum((tangent**2).sum(0) - (apart * bend).sum(0), 0.3 * speed)
    slopes = basis.first.T[:, index]
    return Nearest(
        u,
        distance,
        apart / distance,
        basis.value.T[:, index] + slopes * step,
        slopes,
        jnp.where(inside, -tangent / denominator, 0.0),
        jnp.where(inside, apart / denominator, 0.0),
    )


def brightness(
    theta: Float[Array, " D"], pixels: Float[Array, "2 M"], basis: Basis
) -> tuple[Float[Array, " M"], Float[Array, "D M"]]:
    """A curve's brightness above the background in its band, and the Jacobian.

    Parameters
    ----------
    theta
        (D,) the curve's parameters: K rows, K columns, then GLOBALS.
    pixels
        (2, M) row and col of the band's pixels.
    basis
        Spline basis.

    Returns
    -------
    (M,) brightness, and (D, M) its derivatives (zero in the rows of overlap and background).
    """
    count = basis.value.shape[1]
    knots = theta[: 2 * count].reshape(2, count)
    g = theta[2 * count :]
    near = nearest(knots, pixels, basis)

    shape, slopes = modes(near.u)
    log_width, log_width_slope = g[:WIDTH_MODES] @ shape, g[:WIDTH_MODES] @ slopes
    varying = slice(WIDTH_MODES, WIDTH_MODES + SHADE_MODES)
    light = 1 + g[varying] @ shape[1 : SHADE_MODES + 1]
    light_slope = g[varying] @ slopes[1 : SHADE_MODES + 1]
    contrast = g[INDEX["contrast"]]

    spread = jnp.full_like(near.u, 1.0)
    cover, partial = coverage_partials(
        near.distance,
        near.u,
        log_width,
        g[INDEX["log_blur"]] * spread,
        g[INDEX["shade"]] * spread,
        g[INDEX["log_power"]] * spread,
        g[INDEX["log_extent"]] * spread,
    )
    scale = contrast * light
    by_u = scale * (partial[1] + partial[2] * log_width_slope) + contrast * light_slope * cover
    by_point = -scale * partial[0] * near.normal + by_u * near.du_dpoint
    zero = jnp.zeros_like(cover)
    jacobian = jnp.concatenate(
        [
            by_point[0] * near.weights + by_u * near.du_dtangent[0] * near.slopes,
            by_point[1] * near.weights + by_u * near.du_dtangent[1] * near.slopes,
            scale * partial[2] * shape,
            contrast * cover * shape[1 : SHADE_MODES + 1],
            jnp.stack(
                [
                    light * cover,
                    scale * partial[3],
                    scale * partial[4],
                    scale * partial[5],
                    scale * partial[6],
                    *[zero] * 4,
                ]
            ),
        ]
    )
    return scale * cover, jacobian

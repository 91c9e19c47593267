"""The paper's loss: squared reconstruction error and four regularizers with their priors."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from napari_splinesketch.engine.spline import bending_matrix
from napari_splinesketch.paper.blobs import Blobs, Place


class Weights(NamedTuple):
    """Weights of the regularizers, and a prior."""

    length: float = 0.008
    """λ₁, per squared unit of length (40 half-widths)."""
    curvature: float = 0.002
    """λ₂."""
    min_width: float = 0.05
    """λ₃."""
    scale: float = 0.05
    """λ₄."""
    prior_width: float = 0.5
    """w̄: what the narrowest r_w of a spline should be, 0 to 1."""


class Target(NamedTuple):
    """What the scene is compared with."""

    image: Float[Array, "H W"]
    """Padded to the canvas' frame."""
    seen: Float[Array, "H W"]
    """1 where there is an image, 0 in the padding."""
    area: Float[Array, ""]
    """Area of a typical body, px²; the squared error is counted in it."""
    length: Float[Array, " N"]
    """ℓ̄, length of the sketches, px."""


def reconstruction_loss(target: Target, reconstruction: Float[Array, "H W"]) -> Float[Array, ""]:
    """‖Y - Ŷ‖², in areas of a body."""
    return (target.seen * (target.image - reconstruction) ** 2).sum() / target.area


def length_term(length: Float[Array, " N"], target: Target, place: Place) -> Float[Array, " N"]:
    """(ℓᵢ - ℓ̄ᵢ)², in squared units of length."""
    return ((length - target.length) / place.unit) ** 2


def curvature_term(scene: Blobs, target: Target, place: Place) -> Float[Array, " N"]:
    """Cᵢ = ∫ |r″(u)|² du / ℓ̄ᵢ², which is ℓᵢ ∫ κ² dℓ where the spline is uniform; no unit."""
    bending = jnp.asarray(bending_matrix(scene.offsets.shape[1]), scene.offsets.dtype)
    squared = jnp.einsum("nkd,kj,njd->n", scene.offsets, bending, scene.offsets)
    return squared * (place.unit / target.length) ** 2


def min_width_term(scene: Blobs, weights: Weights) -> Float[Array, " N"]:
    """(minₖ wₖ - w̄)²."""
    return (jax.nn.sigmoid(scene.widths).min(1) - weights.prior_width) ** 2


def scale_term(scene: Blobs) -> Float[Array, ""]:
    """(W - W̄)², in squared W̄."""
    return (jnp.exp(scene.log_scale) - 1) ** 2


def regularization(
    scene: Blobs, length: Float[Array, " N"], target: Target, place: Place, weights: Weights
) -> Float[Array, ""]:
    """Sum of the four regularizers over the splines that are trained."""
    each = (
        weights.length * length_term(length, target, place)
        + weights.curvature * curvature_term(scene, target, place)
        + weights.min_width * min_width_term(scene, weights)
    )
    moving = jnp.arange(len(length)) < place.moving
    return jnp.where(moving, each, 0.0).sum() + weights.scale * scale_term(scene)

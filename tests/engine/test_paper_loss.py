"""Every term of the paper's loss against a calculation by hand."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from napari_splinesketch.paper import blobs
from napari_splinesketch.paper import loss as paper_loss
from napari_splinesketch.paper.loss import Target, Weights

UNIT = 10.0


def scene_of(offsets: list, widths: list, log_scale: float = 0.0) -> blobs.Blobs:
    count = len(offsets)
    return blobs.Blobs(
        centre=jnp.zeros((count, 2)),
        offsets=jnp.array(offsets, float),
        widths=jnp.array(widths, float),
        log_scale=jnp.array(log_scale),
        blend=jnp.zeros(()),
        brightness=jnp.zeros(()),
        gradient=jnp.zeros(2),
        log_contrast=jnp.zeros(()),
        profile=jnp.asarray(blobs.initial_profile()),
        kernel=jnp.eye(3),
    )


def target_of(lengths: list[float]) -> Target:
    return Target(jnp.zeros((2, 2)), jnp.ones((2, 2)), jnp.ones(()), jnp.array(lengths))


def place_of(count: int) -> blobs.Place:
    number = jnp.array(count)
    return blobs.Place(number, number, jnp.ones(2), jnp.array(UNIT), jnp.array(3.0))


def logit(p: float) -> float:
    return float(np.log(p / (1 - p)))


# A spline through (0, 0), (0, a), (0, 0) has r'' = -12a at its middle knot and falls linearly to
# zero at both ends, so that the integral of its square over u is 48a².
BENT = [[0.0, 0.0], [0.0, 2.0], [0.0, 0.0]]
STRAIGHT = [[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]]


def test_reconstruction_is_the_squared_error_of_seen_pixels_in_areas_of_a_body() -> None:
    image = jnp.array([[1.0, 2.0, 9.0], [3.0, 4.0, 9.0]])
    seen = jnp.array([[1.0, 1.0, 0.0], [1.0, 1.0, 0.0]])
    target = Target(image, seen, jnp.array(5.0), jnp.ones(1))
    drawn = jnp.array([[1.0, 0.0, 0.0], [2.0, 1.0, 0.0]])
    loss = paper_loss.reconstruction_loss(target, drawn)
    assert float(loss) == pytest.approx((0 + 4 + 1 + 9) / 5)


def test_length_is_squared_difference_from_the_sketch_in_units() -> None:
    length = jnp.array([50.0, 38.0])
    term = paper_loss.length_term(length, target_of([40.0, 40.0]), place_of(2))
    np.testing.assert_allclose(term, [1.0, 0.04], rtol=1e-5)


def test_curvature_is_the_integral_of_the_squared_second_derivative() -> None:
    scene = scene_of([BENT, STRAIGHT], [[0.0] * 3] * 2)
    term = paper_loss.curvature_term(scene, target_of([80.0, 20.0]), place_of(2))
    # 48 a² with a = 2 units of 10 px, divided by 80² px².
    np.testing.assert_allclose(term, [48 * 20.0**2 / 80.0**2, 0.0], atol=1e-6)


def test_min_width_is_squared_difference_of_the_narrowest_knot_from_its_prior() -> None:
    scene = scene_of([STRAIGHT] * 2, [[logit(0.9), logit(0.3), 0.0], [logit(0.8)] * 3])
    term = paper_loss.min_width_term(scene, Weights(prior_width=0.5))
    np.testing.assert_allclose(term, [0.04, 0.09], rtol=1e-5)


def test_min_width_pulls_on_the_narrowest_knot_only() -> None:
    def total(widths: jax.Array) -> jax.Array:
        scene = scene_of([STRAIGHT], [[0.0] * 3])._replace(widths=widths)
        return paper_loss.min_width_term(scene, Weights(prior_width=0.5)).sum()

    slope = jax.grad(total)(jnp.array([[logit(0.9), logit(0.3), logit(0.4)]]))
    # d/dx (σ(x) - 0.5)² = 2 (0.3 - 0.5) · 0.3 · 0.7
    np.testing.assert_allclose(slope, [[0.0, -0.084, 0.0]], rtol=1e-5)


def test_scale_is_squared_relative_difference_from_its_prior() -> None:
    scene = scene_of([STRAIGHT], [[0.0] * 3], log_scale=np.log(1.3))
    assert float(paper_loss.scale_term(scene)) == pytest.approx(0.09, rel=1e-5)


def test_the_sum_weighs_the_terms_and_leaves_out_what_is_not_trained() -> None:
    weights = Weights(length=2.0, curvature=3.0, min_width=5.0, scale=7.0, prior_width=0.5)
    scene = scene_of([BENT, BENT], [[logit(0.9), logit(0.3), 0.0]] * 2, log_scale=np.log(1.3))
    given = jnp.array([50.0, 50.0]), target_of([80.0, 80.0])
    per_spline = 2 * 9.0 + 3 * 48 * 20.0**2 / 80.0**2 + 5 * 0.04
    for count in (1, 2):
        found = paper_loss.regularization(scene, *given, place_of(count), weights)
        assert float(found) == pytest.approx(count * per_spline + 7 * 0.09, rel=1e-5)

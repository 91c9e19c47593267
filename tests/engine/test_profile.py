"""Cross-section and taper: limits, areas and derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from napari_splinesketch.engine.fit import profile

FLAT = {"log_blur": np.log(0.5), "shade": 0.0, "log_power": -30.0, "log_extent": np.log(0.25)}
"""No shading, no taper."""


# Each operation outside of a jitted function would be compiled alone.
coverage = jax.jit(profile.coverage)
coverage_partials = jax.jit(profile.coverage_partials)


def cover(distance, u=0.5, width=4.0, **changes) -> np.ndarray:
    distance = np.asarray(distance, np.float32)
    look = {**FLAT, **changes}
    inputs = [np.full_like(distance, v) for v in (u, np.log(width), *look.values())]
    return np.asarray(coverage(distance, *inputs))


def test_a_wide_body_is_one_inside_half_at_the_edge_and_nothing_outside():
    found = cover([0.0, 2.0, 4.0, 6.0, 9.0])
    np.testing.assert_allclose(found, [1, 1, 0.5, 0, 0], atol=1e-4)


@pytest.mark.parametrize("blur", [0.3, 1.0, 3.0])
@pytest.mark.parametrize("width", [0.8, 4.0])
def test_blur_keeps_the_area_of_a_section(width, blur):
    across = np.linspace(0, 30, 6001)
    area = 2 * np.trapezoid(cover(across, width=width, log_blur=np.log(blur)), across)
    assert area == pytest.approx(2 * width, rel=1e-3)


def test_shading_darkens_the_edge_and_leaves_the_middle():
    found = cover([0.0, 2.0, 3.0], shade=0.4)
    np.testing.assert_allclose(found, 1 - 0.4 * np.array([0, 0.25, 0.5625]), atol=0.03)
    np.testing.assert_allclose(found[:2], [1, 0.9], atol=1e-4)


def test_taper_is_symmetric_whole_in_the_middle_and_thin_at_the_ends():
    u = np.linspace(0, 1, 101)
    width = profile.tapered_width(u, np.log(3.0), np.log(0.5), np.log(0.2), np)
    np.testing.assert_allclose(width, width[::-1])
    np.testing.assert_allclose(width[20:81], 3)
    assert (np.diff(width[2:20]) > 0).all()
    # x(1.5 - 0.5 x²) at half of the extent, to the power of 0.5.
    assert width[10] == pytest.approx(3 * np.sqrt(0.5 * (1.5 - 0.125)))
    assert 0 < width[0] < 0.2 * 3
    same = profile.tapered_width(jnp.asarray(u), np.log(3.0), np.log(0.5), np.log(0.2))
    np.testing.assert_allclose(same, width, rtol=1e-4)


def test_modes_are_orthogonal_and_their_slopes_are_right():
    nodes, weights = np.polynomial.legendre.leggauss(8)
    values = profile.modes((nodes + 1) / 2, np)[0]
    gram = (values * weights) @ values.T
    np.testing.assert_allclose(gram, np.diag(2 / (2 * np.arange(4) + 1)), atol=1e-12)
    u, step = np.linspace(0.1, 0.9, 9), 1e-6
    before, after = (profile.modes(u + h, np)[0] for h in (-step, step))
    np.testing.assert_allclose(
        profile.modes(u, np)[1], (after - before) / (2 * step), rtol=1e-6, atol=1e-8
    )


INPUTS = ("distance", "u", "log_width", "log_blur", "shade", "log_power", "log_extent")


@pytest.mark.parametrize("which", range(len(INPUTS)), ids=INPUTS)
def test_partial_derivatives_are_those_of_coverage(which):
    rng = np.random.default_rng(which)
    count = 200
    low = [0.1, 0.03, np.log(1.5), np.log(0.4), 0.0, np.log(0.3), np.log(0.1)]
    high = [6.0, 0.97, np.log(4.0), np.log(2.0), 0.8, np.log(0.8), np.log(0.4)]
    with jax.enable_x64(True):
        inputs = [rng.uniform(a, b, count) for a, b in zip(low, high, strict=True)]
        value, partials = coverage_partials(*inputs)
        step = 1e-6
        moved = [
            np.asarray(coverage(*(a + h * (i == which) for i, a in enumerate(inputs))))
            for h in (-step, step)
        ]
        slope = (moved[1] - moved[0]) / (2 * step)
        exact = np.asarray(partials[which])
        np.testing.assert_array_equal(value, coverage(*inputs))
    # Kinks (the edge of shading, the end of the taper) may lie within a step of a few inputs.
    wrong = np.abs(slope - exact) > 1e-5
    assert wrong.sum() <= 1
    assert np.abs(exact).max() > 0.05

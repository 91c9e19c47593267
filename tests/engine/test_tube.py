"""The tube renderer against exact drawings, brute force and finite differences."""

import jax
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from napari_splinesketch.engine import spline
from napari_splinesketch.engine.fit import bands, tube

SHAPE = (64, 110)
PIXELS = np.indices(SHAPE).reshape(2, -1).astype(np.float32)
KNOTS = 8
BASIS, _ = bands.spline_basis(KNOTS)
render = jax.jit(tube.brightness)

LINE = np.array([[24.3, 15.2], [40.1, 93.7]])
BEND = np.column_stack([32 + 15 * np.sin(np.linspace(-2.2, 2.0, 60)), np.linspace(14, 95, 60)])


def parameters(line: np.ndarray, knots: int = KNOTS, **changes: float) -> np.ndarray:
    look = bands.default_priors(1, 3.0).mean[0]
    for name, value in changes.items():
        look[tube.INDEX[name]] = value
    return np.concatenate([spline.fit_knots(line, knots).T.ravel(), look]).astype(np.float32)


def draw(theta: np.ndarray) -> np.ndarray:
    return np.asarray(render(theta, PIXELS, BASIS)[0])


@pytest.mark.parametrize("line", [LINE, BEND], ids=["straight", "bent"])
def test_nearest_points_are_nearest(line):
    knots = spline.fit_knots(line, KNOTS).T.astype(np.float32)
    near = jax.jit(tube.nearest)(knots, PIXELS, BASIS)
    fine = spline.basis(KNOTS, np.linspace(0, 1, 4001)) @ knots.T
    apart = np.linalg.norm(PIXELS.T[:, None] - fine[None, ::4], axis=2).min(1)
    band = apart < 8
    np.testing.assert_allclose(near.distance[band], apart[band], atol=0.03)
    np.testing.assert_allclose(np.linalg.norm(near.normal[:, band], axis=0)[apart[band] > 0.1], 1,
                               rtol=1e-3)  # fmt: skip
    at = spline.basis(KNOTS, np.clip(np.asarray(near.u)[band], 0, 1)) @ knots.T
    np.testing.assert_allclose(np.linalg.norm(PIXELS.T[band] - at, axis=1), apart[band], atol=0.03)


def exact(line: np.ndarray, half_width: float, blur: float, fine: int = 6) -> np.ndarray:
    """A flat body with round ends: distances on a fine grid, blurred there, then averaged."""
    rows, cols = ((np.arange(fine * n) + 0.5) / fine - 0.5 for n in SHAPE)
    at = np.stack(np.meshgrid(rows, cols, indexing="ij"), axis=-1) - line[0]
    step = line[1] - line[0]
    along = np.clip(at @ step / (step @ step), 0, 1)
    inside = np.linalg.norm(at - along[..., None] * step, axis=2) < half_width
    soft = gaussian_filter(inside.astype(float), blur * fine)
    return soft.reshape(SHAPE[0], fine, SHAPE[1], fine).mean(axis=(1, 3)).ravel()


@pytest.mark.parametrize("blur", [0.6, 1.4])
def test_a_straight_tube_looks_like_an_exact_drawing(blur):
    expected = exact(LINE, 3.0, blur)
    # A pixel's own area blurs by 1/12 px² more.
    soft = float(np.log(np.hypot(blur, np.sqrt(1 / 12))))
    found = draw(parameters(LINE, log_blur=soft, shade=0.0, log_power=-30.0))
    ends = np.linalg.norm(PIXELS.T[:, None] - LINE[None], axis=2).min(1) < 7
    np.testing.assert_allclose(found[~ends], expected[~ends], atol=0.01)
    np.testing.assert_allclose(found[ends], expected[ends], atol=0.12)
    assert found.sum() == pytest.approx(expected.sum(), rel=0.02)


def test_contrast_scales_and_a_moved_body_is_the_same_elsewhere():
    theta = parameters(BEND)
    np.testing.assert_allclose(draw(parameters(BEND, contrast=2.0)), 2 * draw(theta), rtol=1e-5)
    moved = parameters(BEND + np.array([3, -5]))
    here, there = draw(theta).reshape(SHAPE), draw(moved).reshape(SHAPE)
    np.testing.assert_allclose(there[3:, :-5], here[:-3, 5:], atol=1e-4)


def test_the_same_body_drawn_from_its_other_end():
    forth = parameters(BEND, log_width_1=0.2, log_width_2=-0.1, brightness_1=0.1)
    back = parameters(BEND[::-1], log_width_1=-0.2, log_width_2=-0.1, brightness_1=-0.1)
    np.testing.assert_allclose(draw(forth), draw(back), atol=2e-3)


VARIED = {
    "log_width_0": float(np.log(2.7)),
    "log_width_1": 0.15,
    "log_width_2": -0.1,
    "log_width_3": 0.05,
    "brightness_1": 0.1,
    "brightness_2": -0.12,
    "contrast": 1.1,
    "log_blur": float(np.log(0.8)),
}


@pytest.mark.parametrize(("line", "knots"), [(LINE, 8), (BEND, 8), (BEND, 16), (BEND, 24)])
def test_jacobian_is_the_derivative(line, knots):
    theta, (basis, _) = parameters(line, knots, **VARIED), bands.spline_basis(knots)
    jacobian = np.asarray(render(theta, PIXELS, basis)[1])
    names = [f"{axis}{i}" for axis in "rc" for i in range(knots)] + list(tube.GLOBALS)
    for exact, name, unit in zip(
        jacobian, names, np.eye(len(theta), dtype=np.float32), strict=True
    ):
        if name in ("overlap", "offset", "slope_row", "slope_col"):
            np.testing.assert_array_equal(exact, 0)
            continue
        upper, lower = theta + 0.005 * unit, theta - 0.005 * unit
        slope = np.subtract(*(np.asarray(render(at, PIXELS, basis)[0]) for at in (upper, lower)))
        slope /= (upper - lower).max()
        # A few pixels lie on a kink: the edge of the shading, the end of the taper.
        smooth = np.argsort(np.abs(slope - exact))[:-6]
        miss = np.linalg.norm((slope - exact)[smooth]) / np.linalg.norm(slope[smooth])
        assert miss < 0.005, (name, miss)

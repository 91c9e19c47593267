"""The tube renderer against exact drawings, brute force and finite differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from napari_splinesketch.engine import constants, spline
from napari_splinesketch.engine.fit import bands, tube

SHAPE = (64, 110)
PIXELS = np.indices(SHAPE).reshape(2, -1).astype(np.float32)
KNOTS = 8
BASIS = bands.spline_basis(KNOTS)
NOTHING = np.zeros((2, len(PIXELS[0])), np.float32)
render = jax.jit(tube.render)

LINE = np.array([[24.3, 15.2], [40.1, 93.7]])
BEND = np.column_stack([32 + 15 * np.sin(np.linspace(-2.2, 2.0, 60)), np.linspace(14, 95, 60)])


def parameters(line: np.ndarray, knots: int = KNOTS, **changes: float) -> np.ndarray:
    look = bands.default_priors([3.0]).mean[0]
    for name, value in changes.items():
        look[tube.INDEX[name]] = value
    return np.concatenate([spline.fit_knots(line, knots).T.ravel(), look]).astype(np.float32)


def draw(theta: np.ndarray) -> np.ndarray:
    """The body alone."""
    return np.asarray(render(theta, PIXELS, *NOTHING, BASIS)[1])


@pytest.mark.slow
@pytest.mark.parametrize("line", [LINE, BEND], ids=["straight", "bent"])
def test_nearest_points_are_nearest(line, monkeypatch):
    """A body as bright as its distance from each pixel, and one as bright as the point is far."""
    theta = parameters(line)
    found = []
    for seen in (lambda distance, u, g: distance, lambda distance, u, g: u + 0 * distance):
        monkeypatch.setattr(tube, "brightness", seen)
        drawn = jax.jit(lambda *given: tube.render(*given))(theta, PIXELS, *NOTHING, BASIS)
        found.append(np.asarray(drawn[1]))
    knots = theta[: 2 * KNOTS].reshape(2, KNOTS).T
    fine = spline.basis(KNOTS, np.linspace(0, 1, 4001)) @ knots
    apart = np.linalg.norm(PIXELS.T[:, None] - fine[None, ::4], axis=2).min(1)
    band = apart < 8
    np.testing.assert_allclose(found[0][band], apart[band], atol=0.03)
    at = spline.basis(KNOTS, np.clip(found[1][band], 0, 1)) @ knots
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
def test_a_straight_tube_looks_like_an_exact_drawing(blur, monkeypatch):
    monkeypatch.setattr(constants, "EDGE_SHADE", 0.0)
    expected = exact(LINE, 3.0, blur)
    # A pixel's own area blurs by 1/12 px² more.
    soft = float(np.log(np.hypot(blur, np.sqrt(1 / 12))))
    theta = parameters(LINE, log_blur=soft, log_power=-30.0)
    found = np.asarray(jax.jit(lambda *a: tube.render(*a))(theta, PIXELS, *NOTHING, BASIS)[1])
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


FLAT = {"log_blur": np.log(0.5), "log_power": -30.0, "log_extent": np.log(0.25)}
"""No taper."""


def cover(distance, width=4.0, **changes: float) -> np.ndarray:
    """How bright a body is half-way along it, at some distance from its middle."""
    distance = np.asarray(distance, np.float32)
    look = {"contrast": 1.0, "log_width_0": np.log(width), **FLAT, **changes}
    g = [np.full_like(distance, look.get(name, 0.0)) for name in tube.GLOBALS]
    drawn = jax.jit(lambda *given: tube.brightness(*given))
    return np.asarray(drawn(distance, np.full_like(distance, 0.5), g))


KINKS = 60
VARIED = {
    "overlap": 0.6,
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
    theta, basis = parameters(line, knots, **VARIED), bands.spline_basis(knots)
    across = np.abs(PIXELS[1] - 60).astype(np.float32)
    others = np.exp(-((across / 4) ** 2)), 0.8 * np.exp(-((across / 4) ** 2))
    jacobian = np.asarray(render(theta, PIXELS, *others, basis)[2]).T
    names = [f"{axis}{i}" for axis in "rc" for i in range(knots)] + list(tube.GLOBALS)
    for exact, name, unit in zip(
        jacobian, names, np.eye(len(theta), dtype=np.float32), strict=True
    ):
        upper, lower = theta + 0.005 * unit, theta - 0.005 * unit
        slope = np.subtract(
            *(np.asarray(render(at, PIXELS, *others, basis)[0]) for at in (upper, lower))
        )
        slope /= (upper - lower).max()
        # Some pixels lie on a kink: the edge of the shading, the end of the taper, and where one
        # body is as bright as the other.
        smooth = np.argsort(np.abs(slope - exact))[:-KINKS]
        miss = np.linalg.norm((slope - exact)[smooth]) / np.linalg.norm(slope[smooth])
        assert miss < 0.005, (name, miss)


def test_a_jacobian_has_the_background_and_the_blend():
    theta, others = parameters(BEND, KNOTS, **VARIED), 0.3 + NOTHING
    model, own, jacobian = (np.asarray(a) for a in render(theta, PIXELS, *others, BASIS))
    rows = dict(zip(tube.GLOBALS, jacobian.T[2 * KNOTS :], strict=True))
    np.testing.assert_allclose(rows["offset"], 1)
    for name, at in zip(("slope_row", "slope_col"), PIXELS, strict=True):
        np.testing.assert_allclose(rows[name], at / constants.SLOPE_UNIT_PX, rtol=1e-6)
    np.testing.assert_allclose(
        rows["overlap"], np.maximum(own, 0.3) - own - np.float32(0.3), atol=1e-6
    )
    overlap = VARIED["overlap"]
    expected = overlap * np.maximum(own, 0.3) + (1 - overlap) * (own + 0.3)
    np.testing.assert_allclose(model, expected, atol=1e-6)


def test_a_wide_body_is_one_inside_half_at_the_edge_and_nothing_outside(monkeypatch):
    monkeypatch.setattr(constants, "EDGE_SHADE", 0.0)
    found = cover([0.0, 2.0, 4.0, 6.0, 9.0])
    np.testing.assert_allclose(found, [1, 1, 0.5, 0, 0], atol=1e-4)


@pytest.mark.parametrize("blur", [0.3, 1.0, 3.0])
@pytest.mark.parametrize("width", [0.8, 4.0])
def test_blur_keeps_the_area_of_a_section(width, blur, monkeypatch):
    monkeypatch.setattr(constants, "EDGE_SHADE", 0.0)
    across = np.linspace(0, 30, 6001)
    area = 2 * np.trapezoid(cover(across, width=width, log_blur=np.log(blur)), across)
    assert area == pytest.approx(2 * width, rel=1e-3)


def test_shading_darkens_the_edge_and_leaves_the_middle():
    found = cover([0.0, 2.0, 3.0])
    np.testing.assert_allclose(
        found, 1 - constants.EDGE_SHADE * np.array([0, 0.25, 0.5625]), atol=0.03
    )
    np.testing.assert_allclose(found[:2], [1, 1 - constants.EDGE_SHADE / 4], atol=1e-4)


def test_taper_is_symmetric_whole_in_the_middle_and_thin_at_the_ends():
    u = np.linspace(0, 1, 101)
    width = tube.tapered_width(u, np.log(3.0), np.log(0.5), np.log(0.2), 0.1, np)
    np.testing.assert_allclose(width, width[::-1])
    np.testing.assert_allclose(width[20:81], 3)
    assert (np.diff(width[2:20]) > 0).all()
    # x(1.5 - 0.5 x²) at half of the extent, to the power of 0.5.
    assert width[10] == pytest.approx(3 * (0.1 + 0.9 * np.sqrt(0.5 * (1.5 - 0.125))))
    assert 0.1 * 3 < width[0] < 0.2 * 3
    same = tube.tapered_width(jnp.asarray(u), np.log(3.0), np.log(0.5), np.log(0.2), 0.1)
    np.testing.assert_allclose(same, width, rtol=1e-4)


def test_modes_are_orthogonal():
    nodes, weights = np.polynomial.legendre.leggauss(8)
    values = np.array(tube.modes((nodes + 1) / 2))
    gram = (values * weights) @ values.T
    np.testing.assert_allclose(gram, np.diag(2 / (2 * np.arange(4) + 1)), atol=1e-12)


@pytest.mark.parametrize(("overlap", "expected"), [(1.0, 0.7), (0.0, 1.4), (0.5, 1.05)])
def test_blend_is_between_maximum_and_sum(overlap, expected):
    one, total, most = (np.float32(x) for x in (0.6, 0.8, 0.7))
    assert tube.blend(np.float32(overlap), one, total, most) == pytest.approx(expected)

"""Natural cubic splines against analytic truths and finite differences."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from napari_splinesketch.engine import constants as const
from napari_splinesketch.engine import spline

U = np.linspace(0, 1, 41)
COUNTS = [2, 3, 6, 8, 24]


def arc(radius: float = 40.0, degrees: float = 150.0, points: int = 300) -> np.ndarray:
    angle = np.deg2rad(np.linspace(0, degrees, points))
    return radius * np.column_stack([np.sin(angle), np.cos(angle)]) + [60, 90]


def test_three_knots_by_hand():
    # Second derivatives 0, -3, 0 in units of the knots' spacing.
    bump = spline.basis(3, np.array([0.25, 0.5, 0.75])) @ [0.0, 1.0, 0.0]
    np.testing.assert_allclose(bump, [0.6875, 1, 0.6875])
    np.testing.assert_allclose(spline.basis(3, np.array([0.5]), 2) @ [0.0, 1.0, 0.0], -12)


@pytest.mark.parametrize("knots", COUNTS)
def test_basis_is_cardinal_and_reproduces_straight_lines(knots):
    at_knots = np.linspace(0, 1, knots)
    np.testing.assert_allclose(spline.basis(knots, at_knots), np.eye(knots), atol=1e-12)
    line = np.column_stack([3 + 5 * at_knots, 7 - 2 * at_knots])
    rows = spline.basis(knots, U)
    np.testing.assert_allclose(rows @ line, np.column_stack([3 + 5 * U, 7 - 2 * U]), atol=1e-12)
    slope = spline.basis(knots, U, 1) @ line
    np.testing.assert_allclose(slope, np.tile([5, -2], (len(U), 1)), atol=1e-10)


@pytest.mark.parametrize("knots", COUNTS)
def test_ends_are_natural(knots):
    curvature = spline.basis(knots, np.array([0.0, 1.0]), 2)
    np.testing.assert_allclose(curvature, 0, atol=1e-9)


@pytest.mark.parametrize("derivative", [1, 2])
@pytest.mark.parametrize("knots", [6, 24])
def test_derivatives_are_those_of_the_values(knots, derivative):
    step = 1e-5
    u = np.linspace(0.013, 0.987, 37)
    before, after = (spline.basis(knots, u + h, derivative - 1) for h in (-step, step))
    exact = spline.basis(knots, u, derivative)
    scale = np.abs(exact).max()
    np.testing.assert_allclose((after - before) / (2 * step), exact, atol=2e-4 * scale)


def test_resample_is_uniform_and_carries_further_columns():
    corner = np.array([[0.0, 0.0, 10.0], [0.0, 3.0, 13.0], [9.0, 3.0, 4.0]])
    found = spline.resample(corner, 5)
    expected = [[0, 0, 10], [0, 3, 13], [3, 3, 10], [6, 3, 7], [9, 3, 4]]
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_resample_passes_repeated_points():
    line = np.array([[0.0, 0.0], [0.0, 0.0], [0.0, 4.0], [0.0, 4.0]])
    np.testing.assert_allclose(spline.resample(line, 3), [[0, 0], [0, 2], [0, 4]])


def test_arc_length_ignores_further_columns():
    line = np.array([[0.0, 0.0, 50.0], [3.0, 4.0, -50.0], [3.0, 5.0, 0.0]])
    np.testing.assert_allclose(spline.arc_length(line), [0, 5, 6])


def test_sample_is_uniform_in_arc_length():
    knots = np.array([[0.0, 0.0], [6.0, 2.0], [30.0, 5.0], [45.0, 20.0], [48.0, 31.0]])
    steps = np.linalg.norm(np.diff(spline.sample(knots, 100), axis=0), axis=1)
    np.testing.assert_allclose(steps, steps.mean(), rtol=0.02)


@pytest.mark.parametrize("knots", [8, 16])
def test_knots_fitted_to_an_arc_lie_on_it(knots):
    line = arc()
    fitted = spline.fit_knots(line, knots)
    assert fitted.shape == (knots, 2)
    np.testing.assert_allclose(fitted[[0, -1]], line[[0, -1]], atol=1e-2)
    radii = np.linalg.norm(spline.sample(fitted, 200) - [60, 90], axis=1)
    np.testing.assert_allclose(radii, 40, atol=0.3 if knots == 8 else 0.1)


@given(
    st.lists(
        st.tuples(st.floats(-500, 500), st.floats(-500, 500)), min_size=2, max_size=12, unique=True
    ).filter(lambda p: np.linalg.norm(np.diff(p, axis=0), axis=1).sum() > 1e-3)
)
def test_any_polyline_gets_finite_knots_and_keeps_its_ends(points):
    line = np.array(points)
    length = spline.arc_length(line)[-1]
    fitted = spline.fit_knots(line, 8)
    np.testing.assert_allclose(fitted[[0, -1]], line[[0, -1]], atol=1e-3 * length + 1e-9)
    assert np.isfinite(spline.sample(fitted, 50)).all()


@pytest.mark.parametrize("knots", COUNTS)
def test_bending_matrix_is_the_integral(knots):
    shape = np.random.default_rng(knots).normal(size=knots)
    fine = np.linspace(0, 1, 40_001)
    second = spline.basis(knots, fine, 2) @ shape
    expected = np.trapezoid(second**2, fine)
    assert shape @ spline.bending_matrix(knots) @ shape == pytest.approx(expected, rel=1e-4)


def test_many_polylines_are_resampled_as_each_is_alone():
    rng = np.random.default_rng(0)
    lines = [np.cumsum(rng.uniform(0.2, 3, (n, 2)), axis=0) - 1e3 * n for n in (2, 7, 40)]
    for found, line in zip(spline.resample_each(lines, [5, 48, 9])[0], lines, strict=True):
        np.testing.assert_allclose(found, spline.resample(line, len(found)), atol=1e-9)
    counts = [max(8, int(spline.arc_length(line)[-1]) + 1) for line in lines]
    found, lengths = spline.resample_each(lines)
    assert [len(line) for line in found] == counts
    np.testing.assert_allclose(lengths, [spline.arc_length(line)[-1] for line in lines])


def test_distances_are_to_the_nearest_point_and_infinite_beyond_the_most():
    points, line = np.array([[0.0, 0.0], [3.0, 4.0]]), np.array([[0.0, 1.0], [9.0, 9.0]])
    np.testing.assert_allclose(spline.apart(points, line), [1, np.sqrt(18)])
    assert np.isinf(spline.apart(points, line, 2.0)).tolist() == [False, True]


def test_distances_are_the_same_through_a_tree(monkeypatch):
    points, line = np.random.default_rng(0).normal(size=(2, 30, 2))
    one_by_one = [spline.apart(points, line), spline.apart(points, line, 0.3)]
    monkeypatch.setattr(const, "FEW_PAIRS", 0)
    through_tree = [spline.apart(points, line), spline.apart(points, line, 0.3)]
    np.testing.assert_array_equal(one_by_one, through_tree)


def test_the_sharpest_turn_is_over_a_length():
    angle = np.linspace(0, np.pi, 400)
    arc = 20 * np.column_stack([np.sin(angle), np.cos(angle)])
    assert spline.sharpest_turn(arc, 5.0) == pytest.approx(5 / 20, rel=0.02)
    assert spline.sharpest_turn(arc, 0.5) == pytest.approx(0.5 / 20, rel=0.1)
    assert spline.sharpest_turn(arc, 1e3) == pytest.approx(np.pi, rel=0.02)


@pytest.mark.parametrize("back", [1.0, 3.0, 12.0])
def test_a_line_that_runs_back_a_little_has_turned_right_round(back):
    """However short the way back is beside the length that is asked about, also at the end."""
    x = np.concatenate([np.arange(0, 40, 0.5), np.arange(40, 40 - back, -0.5)])
    hooked = np.column_stack([1e-3 * np.arange(len(x)), x])
    there = np.concatenate([hooked, hooked[-1] + [[0, 0.5 * k] for k in range(1, 60)]])
    for line in (hooked, there):
        assert spline.sharpest_turn(line, 5.0) > 3.0

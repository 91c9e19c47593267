import numpy as np
import pytest

from napari_splinesketch.geometry import edges, width_growth
from napari_splinesketch.labels import Label

from .samples import bent


@pytest.mark.parametrize(
    ("direction", "expected"),
    [((0, 1), 2 * 0.5), ((1, 0), 2 * 0.25), ((0, -1), 2 * 0.5)],
    ids=["along x: width is along y", "along y: width is along x", "backwards"],
)
def test_half_width_of_oblong_pixels(direction: tuple[int, int], expected: float) -> None:
    points = np.arange(5)[:, None] * np.array(direction)
    assert np.allclose(2.0 * width_growth(points, (0.5, 0.25)), expected)


def test_half_width_of_an_oblique_body_is_that_of_the_stretched_strip() -> None:
    scale, points = (0.5, 0.25), np.arange(4)[:, None] * np.array([3.0, 4.0])
    tangent, normal = np.array([3.0, 4.0]) / 5, np.array([-4.0, 3.0]) / 5
    edge, along = 2.0 * normal * scale, tangent * scale / np.linalg.norm(tangent * scale)
    distance = abs(edge[0] * along[1] - edge[1] * along[0])
    assert np.allclose(2.0 * width_growth(points, scale), distance)


def test_half_width_where_points_coincide_is_finite() -> None:
    assert np.allclose(width_growth(np.ones((3, 2)), (4.0, 9.0)), 6.0)


def test_resampling_is_uniform_and_keeps_the_ends() -> None:
    label = bent(points=33)
    fine = label.resampled(200)
    steps = np.linalg.norm(np.diff(fine.points, axis=0), axis=1)
    assert np.ptp(steps) < 0.02 * steps.mean()
    assert np.allclose(fine.points[[0, -1]], label.points[[0, -1]])
    assert np.allclose(fine.half_width[[0, -1]], label.half_width[[0, -1]])
    assert fine.arc_length[-1] == pytest.approx(label.arc_length[-1], rel=1e-3)


def test_resampling_a_point_drawn_twice_is_that_point() -> None:
    assert np.array_equal(Label.from_sketch(np.ones((2, 2))).resampled(5).points, np.ones((5, 2)))


def test_edges_lie_a_half_width_beside_the_line() -> None:
    label = bent(points=200)
    for edge in edges(label.points, label.half_width):
        assert np.allclose(np.linalg.norm(edge - label.points, axis=1), label.half_width)
    left, right = edges(label.points, label.half_width)
    tangent = np.gradient(label.points, axis=0)
    assert np.allclose(((left - right) * tangent).sum(axis=1), 0, atol=1e-9)

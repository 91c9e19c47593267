"""What is left unexplained along a body, against sums done by hand."""

import numpy as np
import pytest

from napari_splinesketch.grids import across, mean_across


def straight(row: float, half_width: float) -> tuple[np.ndarray, np.ndarray]:
    points = np.column_stack([np.full(100, row), np.linspace(5, 45, 100)])
    return points, np.full(100, half_width)


def test_sections_reach_from_edge_to_edge() -> None:
    points, half_width = straight(10.0, 3.0)
    places = across(points, half_width)
    np.testing.assert_allclose(np.ptp(places[..., 0], axis=1), 6.0)
    np.testing.assert_allclose(places[..., 1], np.broadcast_to(points[:, 1:], places.shape[:2]))
    assert np.abs(np.diff(places[..., 0], axis=1)).max() <= 0.5


def test_a_ramp_across_a_body_averages_to_its_middle() -> None:
    rows, cols = np.mgrid[:40, :60].astype(float)
    points, half_width = straight(12.3, 2.7)
    np.testing.assert_allclose(mean_across(rows, points, half_width), 12.3, atol=1e-9)
    np.testing.assert_allclose(mean_across(7 * cols, points, half_width), 7 * points[:, 1])


def test_a_stripe_counts_by_its_share_of_the_section() -> None:
    picture = np.zeros((40, 60))
    picture[10] = 8.0
    points, half_width = straight(10.0, 4.0)
    # Linear interpolation makes the stripe a triangle of area 8 in a section of 8 px; the mean is
    # taken over 17 places, of which those at -0.5, 0 and 0.5 px see 4, 8 and 4.
    np.testing.assert_allclose(mean_across(picture, points, half_width), 16 / 17)


def test_it_follows_a_slanted_body() -> None:
    rows, cols = np.mgrid[:80, :80].astype(float)
    points = np.linspace([20, 20], [60, 50], 100)
    beside = (rows - 20) * 3 / 5 - (cols - 20) * 4 / 5
    along = (rows - 20) * 4 / 5 + (cols - 20) * 3 / 5
    widths = np.linspace(1, 4, 100)
    np.testing.assert_allclose(mean_across(beside, points, widths), 0, atol=1e-9)
    found = mean_across(along, points, widths)
    np.testing.assert_allclose(found, np.linspace(0, 50, 100), atol=1e-9)


def test_missing_pixels_are_left_out() -> None:
    picture = np.full((40, 60), 3.0)
    picture[:, 20:30] = np.nan
    points, half_width = straight(10.0, 2.0)
    found = mean_across(picture, points, half_width)
    inside = (points[:, 1] > 20) & (points[:, 1] < 29)
    assert np.isnan(found[inside]).all()
    np.testing.assert_allclose(found[~inside], 3.0)


@pytest.mark.parametrize("row", [-3.0, 0.0, 39.0])
def test_a_body_at_the_border_sees_only_the_picture(row: float) -> None:
    points, half_width = straight(row, 2.0)
    found = mean_across(np.full((40, 60), 5.0), points, half_width)
    np.testing.assert_allclose(found, np.nan if row < -2 else 5.0)


def test_a_failed_curve_has_no_width() -> None:
    points, _ = straight(10.0, 2.0)
    found = mean_across(np.full((40, 60), 5.0), points, np.full(100, np.nan))
    np.testing.assert_allclose(found, 5.0)
    assert np.isnan(mean_across(np.zeros((4, 4)), points, np.full(100, np.nan))).all()

"""One body of a crossing, alone."""

import numpy as np

from napari_splinesketch.grids import Grid, Patch, alone

from .fakes import as_drawn

ROWS, COLS = np.mgrid[:60, :80].astype(float)
LYING = as_drawn(np.array([[30.0, 8.0], [30.0, 70.0]]), half_width=np.full(100, 3.0))
UPRIGHT = as_drawn(np.array([[5.0, 40.0], [55.0, 40.0]]), half_width=np.full(100, 3.0))
BACKGROUND = 100 + ROWS


def tube(distance: np.ndarray) -> np.ndarray:
    return -20 / (1 + np.exp(4 * (distance - 3)))


def test_a_body_goes_on_through_a_crossing() -> None:
    a = tube(np.hypot(ROWS - 30, np.maximum(np.abs(COLS - 39) - 31, 0)))
    b = tube(np.hypot(COLS - 40, np.maximum(np.abs(ROWS - 30) - 25, 0)))
    for together in (np.minimum(a, b), a + b):
        patch = Patch(Grid(np.zeros(2), np.ones(2)), BACKGROUND + together, BACKGROUND)
        for body, curve, other in ((a, LYING, UPRIGHT), (b, UPRIGHT, LYING)):
            found = alone(patch, curve, [other]) - BACKGROUND
            # Rings are half a pixel wide, and the edge falls by 10 a half-pixel.
            assert np.abs(found - body).max() < 5
            assert np.abs(found - body).mean() < 0.05
        far = np.abs(COLS - 40) > 8
        np.testing.assert_allclose(
            (alone(patch, LYING, [UPRIGHT]) - BACKGROUND)[far], a[far], atol=0.01
        )


def test_it_lies_where_the_block_says() -> None:
    a = tube(np.hypot(ROWS - 30, np.maximum(np.abs(COLS - 39) - 31, 0)))
    patch = Patch(Grid(np.array([10.0, 4.0]), np.ones(2)), (BACKGROUND + a)[10:, 4:])
    found = alone(patch, LYING, [])
    near = np.hypot(ROWS - 30, np.maximum(np.abs(COLS - 39) - 31, 0)) < 5
    np.testing.assert_allclose(found[near[10:, 4:]], (BACKGROUND + a)[near])
    assert (found == 0).mean() > 0.5


def test_a_failed_curve_has_no_body() -> None:
    patch = Patch(Grid(np.zeros(2), np.ones(2)), BACKGROUND + 1, BACKGROUND)
    failed = as_drawn(
        np.array([[5.0, 5], [9, 9]]), status="failed", half_width=np.full(100, np.nan)
    )
    np.testing.assert_array_equal(alone(patch, failed, [LYING]), BACKGROUND)

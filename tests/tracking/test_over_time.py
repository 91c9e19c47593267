"""Velocity and curvature over a body and over time."""

import numpy as np
import pytest

from napari_splinesketch.engine.spline import fit_knots
from napari_splinesketch.engine.types import Curve
from napari_splinesketch.tracking import kymograph

RADIUS = 20.0


def arc(turned: float = 0.0, radius: float = RADIUS) -> Curve:
    angle = np.linspace(0, 2, 400) + turned
    line = radius * np.column_stack([np.sin(angle), np.cos(angle)]) + 50
    points = line[np.linspace(0, 399, 100).astype(int)]
    knots = np.column_stack([fit_knots(line, 12), np.full(12, 2.0)])
    return Curve(knots, points, np.full(100, 2.0), np.full(100, 0.1), "good", (), 0.05)


def test_curvature_is_that_of_the_circle() -> None:
    made = kymograph({3: arc(), 4: arc(radius=40.0)}, points=50)
    np.testing.assert_array_equal(made.frames, [3, 4])
    assert made.curvature.shape == (2, 50)
    np.testing.assert_allclose(np.abs(made.curvature[0, 15:35]), 1 / RADIUS, rtol=0.05)
    np.testing.assert_allclose(np.abs(made.curvature[1, 15:35]), 1 / 40, rtol=0.05)


def test_velocity_is_along_a_body_that_glides_and_across_one_that_drifts() -> None:
    gliding = kymograph({t: arc(0.05 * t) for t in range(4)})
    np.testing.assert_allclose(gliding.along, 0.05 * RADIUS, rtol=0.02)
    np.testing.assert_allclose(gliding.across[1:3], 0.0, atol=0.02)
    np.testing.assert_allclose(gliding.speed, 0.05 * RADIUS, rtol=0.03)
    growing = kymograph({0: arc(), 1: arc(radius=RADIUS + 1)})
    np.testing.assert_allclose(np.abs(growing.across), 1.0, rtol=0.05)


def test_frames_without_a_curve_are_said() -> None:
    made = kymograph({1: arc(), 2: arc(0.1), 5: arc(0.3)})
    np.testing.assert_array_equal(np.isnan(made.curvature).all(1), [0, 0, 1, 1, 0])
    np.testing.assert_array_equal(np.isnan(made.speed), [0, 0, 1, 1, 1])


def test_what_is_no_body_over_time_is_refused_in_words() -> None:
    for curves in ({}, [arc()], {0: np.eye(2)}, {0.0: arc(), 1.0: arc(0.1)}):
        with pytest.raises(ValueError, match="give the curves of one body, by frame"):
            kymograph(curves)  # pyright: ignore[reportArgumentType]
    for points in (1, 50.0):
        with pytest.raises(ValueError, match="give a whole number of points, from 2"):
            kymograph({0: arc()}, points)  # pyright: ignore[reportArgumentType]

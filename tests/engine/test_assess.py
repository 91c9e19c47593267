"""Curves that are on the same body, and those that are near."""

import numpy as np

from napari_splinesketch.engine import spline


def across(row: float, begin: float = 20.0, end: float = 60.0) -> np.ndarray:
    """A horizontal line of 100 points."""
    return np.column_stack([np.full(100, row), np.linspace(begin, end, 100)])


def test_two_curves_on_one_body_are_told_and_others_are_not() -> None:
    curves = [across(10), across(11, 25, 55), across(20), across(30, 10, 40), across(30, 38, 90)]
    assert spline.doubles(curves, 1.5, 0.5) == {0: 1, 1: 0}
    assert spline.doubles(curves, 0.5, 0.5) == {}


def test_only_near_curves_are_neighbours() -> None:
    near = list(spline.neighbours([across(10), across(13), across(30, 62, 90)], 4.0))
    assert near == [[1], [0], []]
    assert list(spline.neighbours([across(10), across(13)], 2.0)) == [[], []]

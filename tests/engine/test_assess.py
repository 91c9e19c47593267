"""What looks wrong with a curve by itself: each sign alone, on either side of its limit."""

import numpy as np
import pytest

from napari_splinesketch.engine.judge import assess

SHAPE = (60, 100)
EXPLAINED = np.full(50, 0.01)
NOISE = 0.05


def across(row: float, begin: float = 20.0, end: float = 60.0) -> np.ndarray:
    """A horizontal line of 100 points."""
    return np.column_stack([np.full(100, row), np.linspace(begin, end, 100)])


SKETCH = across(30)[[0, -1]]

CASES = {
    "all is well": (across(32), EXPLAINED, ""),
    "half of its length away": (across(49), EXPLAINED, ""),
    "farther away": (across(51.5), EXPLAINED, "moved 22 px from its sketch"),
    "as long as a sketch may be drawn too short": (across(30, 1.5, 98), EXPLAINED, ""),
    "much shorter": (across(30, 34, 46), EXPLAINED, "length changed from 40 to 12 px"),
    "not explained": (across(30), np.full(50, 0.9), "not explained (18.0 times the noise)"),
    "partly unexplained": (across(30), np.full(50, 0.7), ""),
    "no pixels": (across(30), np.zeros(0), "not explained"),
    "at the left border": (across(30, 0.5, 45), EXPLAINED, "reaches the border"),
    "at the right border": (across(30, 40, 98.5), EXPLAINED, "reaches the border"),
    "beyond the height, within the width": (across(30, 60, 90), EXPLAINED, ""),
    "at the lower border": (across(58.5, 20, 90), EXPLAINED, "reaches the border"),
}


@pytest.mark.parametrize("name", CASES)
def test_what_looks_wrong_is_said(name: str) -> None:
    curve, residual, expected = CASES[name]
    sketch = across(58, 20, 90)[[0, -1]] if "lower" in name else SKETCH
    sketch = across(30, 50, 90)[[0, -1]] if "width" in name else sketch
    said = assess.doubts(curve, sketch, residual, NOISE, SHAPE)
    assert len(said) == bool(expected)
    assert all(expected in reason for reason in said)


def test_two_curves_on_one_body_are_told_and_others_are_not() -> None:
    curves = [across(10), across(11, 25, 55), across(20), across(30, 10, 40), across(30, 38, 90)]
    assert assess.doubles(curves, 1.5, 0.5) == {0: 1, 1: 0}
    assert assess.doubles(curves, 0.5, 0.5) == {}


def test_only_near_curves_are_neighbours() -> None:
    near = list(assess.neighbours([across(10), across(13), across(30, 62, 90)], 4.0))
    assert near == [[1], [0], []]
    assert list(assess.neighbours([across(10), across(13)], 2.0)) == [[], []]

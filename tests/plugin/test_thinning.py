"""Lines as they are drawn: few points, near the line that they stand for."""

from dataclasses import replace

import numpy as np
import pytest

from napari_splinesketch.engine import spline
from napari_splinesketch.geometry import thinned
from napari_splinesketch.plugin.layers.looks import halo, outline, ribbon

from .fakes import as_drawn, winding
from .hand import assert_drawn

ALONG = np.linspace(0, 1, 100)
CASES = {
    "straight": np.column_stack([10 + 40 * ALONG, 300 - 25 * ALONG]),
    "arc": 20 * np.column_stack([np.sin(2 * ALONG), np.cos(2 * ALONG)]),
    "wave": np.column_stack([3 * np.sin(9 * ALONG), 50 * ALONG]),
    "corner": np.column_stack([np.abs(ALONG - 0.4) * 30, 50 * ALONG]),
    "closed": 9 * np.column_stack([np.sin(2 * np.pi * ALONG), np.cos(2 * np.pi * ALONG)]),
    "two points": np.array([[1.0, 2], [3, 9]]),
}
FEW = {"straight": 2, "arc": 33, "wave": 50, "corner": 4, "closed": 65, "two points": 2}


@pytest.mark.parametrize("name", CASES)
def test_few_points_say_the_same(name: str) -> None:
    (line,) = thinned([CASES[name]])
    assert_drawn(line, CASES[name])
    assert len(line) <= FEW[name]


def test_lines_do_not_meddle_with_each_other() -> None:
    lines = list(CASES.values())
    for together, line in zip(thinned(lines), lines, strict=True):
        np.testing.assert_array_equal(together, thinned([line])[0])
    assert thinned([]) == []


def test_a_line_that_stays_in_its_place() -> None:
    (line,) = thinned([np.ones((100, 2))])
    assert line.shape == (2, 2)


def test_what_is_drawn_of_a_long_winding_curve_follows_its_spline() -> None:
    curve = replace(as_drawn(CASES["arc"], sd=np.full(100, 0.5)), **winding())
    exact = spline.sample(curve.knots[:, :2], 20_000)
    drawn = {0.0: spline.fine(curve).points, 2.0: outline(curve), 5.0: halo(curve, 3.0)}
    for away, line in (drawn | {1.0: ribbon(curve)}).items():
        assert line is not None
        dense = spline.resample(line, 20_000)
        middle = dense[(dense[:, 1] > 60) & (dense[:, 1] < 1540)]
        near = 0.15 if away else 0.1
        np.testing.assert_allclose(spline.apart(middle, exact), away, atol=near)
    assert (
        len(spline.fine(curve).half_width)
        == len(spline.fine(curve).sd)
        == len(spline.fine(curve).points)
    )
    short = as_drawn(CASES["arc"])
    assert spline.fine(short) is short
    failed = replace(curve, status="failed")
    assert spline.fine(failed) is failed

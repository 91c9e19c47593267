"""One trial of every named case: the body is found, or its curve says that it wants a look."""

import numpy as np
import pytest
from stability_cases import CASES
from stability_rows import FAR

from napari_splinesketch import refine
from napari_splinesketch.engine.types import Curve
from napari_splinesketch.metrics import average_dtw

from .test_refine import assert_whole


@pytest.fixture(scope="module")
def results():
    """Every case is refined once."""
    found = {}

    def get(name: str):
        if name not in found:
            trial = CASES[name].make(0)
            found[name] = trial, refine(trial.image, trial.sketches, **trial.options)
        return found[name]

    return get


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_results_are_whole(results, name):
    trial, found = results(name)
    assert_whole(found, len(trial.sketches), trial.image.shape)


WEAK = {
    "tangle": "where six bodies cross, ends of curves may lie on a neighbour's, unmarked",
    "too_short": "a clicked end stays where the body goes on, and is marked if both ends do",
}
"""Known weaknesses: see docs/limits.md."""


@pytest.mark.parametrize("name", CASES)
def test_found_or_marked(results, name, request):
    if name in WEAK:
        request.applymarker(pytest.mark.xfail(reason=WEAK[name], strict=True))
    trial, found = results(name)
    expects = CASES[name].expects
    for curve, truth in zip(found.curves, trial.truths, strict=True):
        on_body = truth is not None and average_dtw(curve.points, truth) < FAR
        marked = curve.status != "good"
        if expects == "marked" and truth is None:
            assert marked
        elif expects == "found":
            assert on_body
        else:
            assert on_body or marked


@pytest.mark.parametrize("name", CASES)
def test_trials_are_what_they_say(name):
    case = CASES[name]
    first, again, other = case.make(0), case.make(0), case.make(1)
    np.testing.assert_array_equal(first.image, again.image)
    assert first.image.shape != other.image.shape or not np.array_equal(
        first.image, other.image, equal_nan=first.image.dtype.kind == "f"
    )
    assert len(first.sketches) == len(first.truths)
    for sketch, truth in zip(first.sketches, first.truths, strict=True):
        assert np.isfinite(sketch).all()
        if truth is not None:
            assert ((truth > -1) & (truth < np.array(first.image.shape))).all()


def test_a_half_width_that_no_body_has_is_told_of(results):
    _, found = results("told_wide")
    assert any("No body here" in note for note in found.model.notes)


def only_body(name: str, seed: int) -> tuple[Curve, float]:
    """The curve of a trial of one body, and how far it is from the truth, px."""
    trial = CASES[name].make(seed)
    (truth,) = trial.truths
    assert truth is not None
    (curve,) = refine(trial.image, trial.sketches).curves
    return curve, average_dtw(curve.points, truth)


@pytest.mark.parametrize("seed", [1, 11])
def test_the_rim_of_a_plate_does_not_draw_a_curve_away(seed):
    _, apart = only_body("plate_edge", seed)
    assert apart < 0.5


@pytest.mark.parametrize("seed", [0, 1, 11])
def test_a_body_that_is_cut_off_is_followed_to_the_border(seed):
    _, apart = only_body("leaving", seed)
    assert apart < 0.6


@pytest.mark.parametrize("half_width", [2.5, 5.0])
def test_a_body_across_the_image_ends_with_it(half_width):
    rows, columns = np.mgrid[:120, :90]
    noise = 0.02 * np.random.default_rng(1).standard_normal(rows.shape)
    image = np.clip(half_width - np.abs(columns - 45), 0, 1) + noise
    sketch = np.array([(0.0, 45.0), (40, 45), (80, 45), (119, 45)])
    curve = refine(image, [sketch]).curves[0]
    ends = curve.points[[0, -1], 0]
    assert -0.5 <= ends[0] < 1 and 118 < ends[1] <= 119.5

"""Two bodies side by side that touch: each sketch gets the one on its side."""

import numpy as np
import pytest
from stability_cases import CASES

from napari_splinesketch import refine
from napari_splinesketch.metrics import average_dtw

ON_BODY = 2.0


def missed(curves, truths) -> list[float]:
    return [average_dtw(c.points, t) for c, t in zip(curves, truths, strict=True)]


@pytest.mark.parametrize("case", ["parallel", "parallel_chords"])
@pytest.mark.parametrize("seed", [300, 301, 302, 307, 310])
def test_both_are_found(case, seed):
    trial = CASES[case].make(seed)
    found = refine(trial.image, trial.sketches, "balanced").curves
    assert max(missed(found, trial.truths)) < ON_BODY


def test_sketches_that_change_places_change_the_curves():
    trial = CASES["parallel"].make(300)
    swapped = refine(trial.image, trial.sketches[::-1], "balanced").curves
    assert max(missed(swapped, trial.truths[::-1])) < ON_BODY


def test_two_sketches_on_one_body_stay_on_it_and_say_so():
    trial = CASES["same_body"].make(1)
    found = refine(trial.image, trial.sketches, "balanced").curves
    assert all("same body" in " ".join(c.reasons) for c in found)
    widths = [np.median(c.half_width) for c in found]
    assert min(widths) > 2.0


def test_sketches_that_are_the_same_are_one_curve_fitted_once():
    trial = CASES["same_body"].make(1)
    one, other = trial.sketches[0], trial.sketches[0] + [60.0, 0.0]
    alone = refine(trial.image, [one]).curves[0]
    found = refine(trial.image, [one, other, one, one])
    assert len(found.curves) == len(found.model.knots) == 4
    for i, twin in ((0, 3), (2, 0), (3, 0)):
        np.testing.assert_array_equal(found.curves[i].points, found.curves[0].points)
        assert found.curves[i].status == "check"
        assert found.curves[i].reasons[-1] == f"it lies on the same body as curve {twin}"
    many = refine(trial.image, [one] * 80)
    assert many.seconds < 10
    np.testing.assert_array_equal(many.curves[79].points, alone.points)
    blank = refine(np.zeros((60, 60)), [np.array([[9.0, 9.0], [40.0, 40.0]])] * 2)
    assert [curve.status for curve in blank.curves] == ["failed"] * 2

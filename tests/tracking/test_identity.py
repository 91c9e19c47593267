"""Who gets which suggestion, and which curve of a frame."""

import numpy as np

from napari_splinesketch.tracking.bodies import Body
from napari_splinesketch.tracking.identity import kept, place
from napari_splinesketch.tracking.motion import Predicted

from .test_follow import LINE, OTHER, curve, moved

FIRST, SECOND = (Body(n, ((0, curve(line)),)) for n, line in ((1, LINE), (2, OTHER)))
EXPECTED = {1: LINE, 2: OTHER}


def test_each_body_gets_the_nearest_that_is_free_the_right_way_round() -> None:
    free = [moved(OTHER, 3, 1)[::-1], moved(LINE, 5, 0), moved(LINE, 9, 0)]
    found = place([FIRST, SECOND], EXPECTED, free, [moved(LINE, 5, 1)])
    np.testing.assert_allclose(found[1], moved(LINE, 9, 0))
    np.testing.assert_allclose(found[2], moved(OTHER, 3, 1))


def test_nothing_is_better_than_something_far_off_or_unlike() -> None:
    far = moved(LINE, 25, 0)
    short = LINE[0] + (LINE - LINE[0]) * 0.2
    assert place([FIRST], EXPECTED, [far, short], []) == {}
    assert place([FIRST], EXPECTED, [], []) == {}
    assert place([], {}, [LINE], []) == {}


def test_the_sum_counts_not_the_first_come() -> None:
    between = moved(LINE, 8, 0)
    near = moved(LINE, 2, 0)
    other = Body(2, ((0, curve(moved(LINE, 9, 0))),))
    found = place([other, FIRST], {1: LINE, 2: moved(LINE, 9, 0)}, [near, between], [])
    np.testing.assert_allclose(found[1], near)
    np.testing.assert_allclose(found[2], between)


def test_a_curve_that_no_other_body_explains_stays_where_nobody_predicted_it() -> None:
    bodies = {1: FIRST, 2: SECOND}
    predicted = {1: Predicted(curve(LINE).points, 0.5), 2: Predicted(curve(OTHER).points, 0.5)}
    far, there = curve(moved(LINE, 12, 0)), curve(OTHER)
    assert kept(predicted, {1: far, 2: there}, bodies, []) == {1: far, 2: there}
    assert kept(predicted, {1: there}, bodies, [far]) == {2: there}, "it is the other's"
    across = curve(moved(LINE, 12.5, 3))
    assert kept(predicted, {1: far, 2: there}, bodies, [across]) == {2: there}, "it shows another"
    swapped = kept(predicted, {1: there, 2: curve(LINE)}, bodies, [])
    assert swapped[2] is there and set(swapped) == {1, 2}

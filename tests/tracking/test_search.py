"""Who gets which suggestion."""

import numpy as np

from napari_splinesketch.tracking.bodies import Body
from napari_splinesketch.tracking.search import place

from .test_follow import LINE, OTHER, curve, moved

FIRST, SECOND = (Body(n, ((0, curve(line)),)) for n, line in ((1, LINE), (2, OTHER)))
EXPECTED = {1: LINE, 2: OTHER}
REACH = (18.0, 18.0)


def test_each_body_gets_the_nearest_that_is_free_the_right_way_round() -> None:
    free = [moved(OTHER, 3, 1)[::-1], moved(LINE, 5, 0), moved(LINE, 9, 0)]
    found = place([FIRST, SECOND], EXPECTED, free, [moved(LINE, 5, 1)], REACH)
    np.testing.assert_allclose(found[1], moved(LINE, 9, 0))
    np.testing.assert_allclose(found[2], moved(OTHER, 3, 1))


def test_nothing_is_better_than_something_far_off_or_unlike() -> None:
    far = moved(LINE, 25, 0)
    short = LINE[0] + (LINE - LINE[0]) * 0.2
    assert place([FIRST], EXPECTED, [far, short], [], REACH[:1]) == {}
    assert place([FIRST], EXPECTED, [], [], REACH[:1]) == {}
    assert place([], {}, [LINE], [], []) == {}


def test_a_body_may_have_gone_farther_the_less_its_prediction_is_worth() -> None:
    far = moved(LINE, 25, 0)
    assert place([FIRST], EXPECTED, [far], [], [24.0]) == {}
    np.testing.assert_allclose(place([FIRST], EXPECTED, [far], [], [26.0])[1], far)


def test_the_sum_counts_not_the_first_come() -> None:
    between = moved(LINE, 8, 0)
    near = moved(LINE, 2, 0)
    other = Body(2, ((0, curve(moved(LINE, 9, 0))),))
    found = place([other, FIRST], {1: LINE, 2: moved(LINE, 9, 0)}, [near, between], [], REACH)
    np.testing.assert_allclose(found[1], near)
    np.testing.assert_allclose(found[2], between)

"""Curves of several sets of paths are mixed, and say how contested they are."""

import numpy as np
import pytest

from napari_splinesketch.engine.find.judging import best_starts
from napari_splinesketch.engine.find.trials import Comparison, Start, Trial
from napari_splinesketch.engine.fit.fitting import Body
from napari_splinesketch.engine.fit.tube import GLOBALS, INDEX
from napari_splinesketch.engine.judge.doubt import NO_RIVAL

SHAPE = (60, 80)
WIDTH = 2.0


def body(row: float, brightness: float = 1.0) -> Body:
    """A horizontal body from column 10 to 70."""
    knots = np.column_stack([np.full(6, row), np.linspace(10, 70, 6)])
    look = np.zeros(len(GLOBALS))
    look[INDEX["overlap"]] = 1.0
    drawn = np.zeros(SHAPE)
    drawn[int(row) - 2 : int(row) + 3, 10:71] = brightness
    pixels = np.flatnonzero(drawn)
    theta = np.concatenate([knots.T.ravel(), look])
    return Body(theta, pixels, drawn.ravel()[pixels], 0.0, np.eye(len(theta)), True)


def trial(*rows: float) -> Trial:
    return Trial(0, [Start(body(r).points(), True, body=body(r)) for r in rows])


def line(row: float) -> np.ndarray:
    return np.array([[row, 10.0], [row, 70.0]])


def judged(image, *trials: Trial, rows=(10, 40)):
    comparison = Comparison(image, 0.1, lambda *_: [])
    return best_starts(list(trials), [line(r) for r in rows], WIDTH, comparison)


@pytest.fixture
def image():
    """Bodies in rows 10 and 40."""
    drawn = np.zeros(SHAPE)
    for row in (10, 40):
        drawn[row - 2 : row + 3, 10:71] = 1.0
    return drawn


def rows_of(starts) -> list[float]:
    return [float(s.body.points()[:, 0].mean()) for s in starts]


def test_right_curves_of_two_half_right_sets_are_put_together(image):
    found = judged(image, trial(10, 30), trial(22, 40))
    assert rows_of(found) == pytest.approx([10, 40])


def test_the_set_that_explains_the_image_wins_alone(image):
    found = judged(image, trial(10, 52), trial(10, 40))
    assert rows_of(found) == pytest.approx([10, 40])


def test_only_a_contested_curve_has_a_margin(image):
    found = judged(image, trial(10, 40), trial(10, 42))
    assert found[0].margin == NO_RIVAL
    assert 0 < found[1].margin < NO_RIVAL


def test_the_closer_the_rival_the_smaller_the_margin(image):
    near, far = (judged(image, trial(10, 40), trial(10, row))[1].margin for row in (42, 43))
    assert near < far
    twice = judged(image, trial(10, 40), trial(10, 42), trial(10, 43))
    assert twice[1].margin == pytest.approx(near)


def test_the_order_of_the_sets_does_not_matter(image):
    sets = [trial(10, 30), trial(22, 40), trial(11, 42)]
    forth, back = judged(image, *sets), judged(image, *sets[::-1])
    assert rows_of(forth) == pytest.approx(rows_of(back))
    assert [s.margin for s in forth] == pytest.approx([s.margin for s in back])


def test_a_body_without_a_sketch_is_taken_where_it_explains_something(image):
    image[54:59, 10:71] = 1.0
    with_one = trial(10, 40, 56)
    assert rows_of(judged(image, trial(10, 40), with_one)) == pytest.approx([10, 40, 56])
    image[54:59] = 0.0
    assert rows_of(judged(image, trial(10, 40), with_one)) == pytest.approx([10, 40])


def test_something_strong_elsewhere_does_not_draw_a_curve_away(image):
    image[38:43, 10:71] = 3.0
    other = Trial(0, [Start(line(40), True, body=body(40, brightness=3.0))])
    found = judged(image, other, trial(10), rows=(12,))
    assert rows_of(found) == pytest.approx([10])

"""What is known of a body, and what of it is hidden."""

from dataclasses import replace

import numpy as np
import pytest

from napari_splinesketch.tracking import Body, View
from napari_splinesketch.tracking.bodies import INFERRED
from napari_splinesketch.tracking.search import Search

from .test_follow import BRIGHT, LINE, FakeRefine, curve

WHOLE = np.linspace(0, 60, 61)


def at(frame: int, first: float = 0, last: float = 60) -> np.ndarray:
    """A body that glides by 2 px a frame, or a part of it."""
    s = WHOLE[(first <= WHOLE) & (last >= WHOLE)]
    return np.column_stack([30 + 0 * s, 10 + 2 * frame + s])


BODY = Body(1, tuple((t, curve(at(t))) for t in range(6)))


@pytest.mark.parametrize("part", [(0, 52), (8, 60)], ids=["its head", "its tail"])
def test_what_something_hides_is_added_at_the_end_that_its_movement_says(part) -> None:
    seen = curve(at(6, *part))
    assert BODY.lacks(seen) and not BODY.lacks(curve(at(6, 0, 59.5)))
    np.testing.assert_allclose(BODY.completed(6, seen)[[0, -1]], at(6)[[0, -1]], atol=0.1)


def test_a_length_that_was_not_seen_tells_nothing_of_the_length() -> None:
    short = curve(at(6, 0, 40))
    assert BODY.with_curve(6, short).lengths[-1] == pytest.approx(40)
    inferred = replace(short, reasons=(f"part of it is {INFERRED}",))
    assert BODY.with_curve(6, inferred).lengths == (BODY.lengths or (pytest.approx(60),) * 6)


def test_a_body_of_unknown_width_is_held_as_others_are() -> None:
    """Labels of other programs may have none."""
    unknown = replace(curve(LINE), half_width=np.full(100, np.nan))
    body = Body(7, ((0, unknown), (1, unknown)))
    refine = FakeRefine((0, 0))
    search = Search(2, View(BRIGHT), {7: LINE}, {}, refine, "balanced", lambda told: None)
    assert search.held([body], {7: (unknown.points, 0.5)})[7].trusted

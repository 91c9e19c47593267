"""A body of which something hides a part is made whole by how bright it used to be."""

import numpy as np
import pytest

from napari_splinesketch import Curve, refine
from napari_splinesketch.tracking import Body, View
from napari_splinesketch.tracking.bodies import curve_inferred
from napari_splinesketch.tracking.covered import completed
from napari_splinesketch.tracking.drift import Light
from napari_splinesketch.tracking.motion import Foretold

from .test_follow import curve

LENGTH, HALF_WIDTH = 50.0, 2.5
SHAPE = (50, 110)


def at(frame: int, first: float = 0, last: float = LENGTH) -> np.ndarray:
    """A body that glides by 2 px a frame, or a part of it."""
    s = np.linspace(first, last, 100)
    return np.column_stack([25 + 0 * s, 10 + 2 * frame + s])


def image_of(frame: int, first: float = 0, last: float = LENGTH) -> np.ndarray:
    """A part of the body, which is brighter towards its end."""
    rows, columns = np.indices(SHAPE)
    s = columns - 10.0 - 2 * frame
    inside = (s >= first) & (s <= last)
    shading = 0.7 + 0.6 * np.clip(s / LENGTH, 0, 1)
    rng = np.random.default_rng(frame)
    bright = inside * shading / (1 + np.exp(2 * (np.abs(rows - 25) - HALF_WIDTH)))
    return bright + 0.03 * rng.standard_normal(SHAPE)


def light_of(pixels: np.ndarray, line: np.ndarray) -> Light:
    return Light(View(pixels), refine(pixels, [line], "fast"), None)


def body_of(frames: int = 6) -> Body:
    """The body in some frames in which all of it was seen."""
    body = Body(1, ())
    for t in range(frames):
        bright = light_of(image_of(t), at(t)[::20]).along(at(t), HALF_WIDTH)
        body = body.with_curve(t, curve(at(t), HALF_WIDTH), bright)
    return body


def whole(body: Body, frame: int, part: tuple[float, float], by: float = 0.0) -> Curve | None:
    """What is seen of a body, made whole, where it is foretold so far off along itself."""
    light = light_of(image_of(frame, *part), at(frame, *part)[::20])
    seen = curve(at(frame, *part), HALF_WIDTH)
    return completed(body, seen, Foretold(at(frame) + np.array([0, by]), 0.7), [], light)


@pytest.mark.parametrize("part", [(0, 34), (16, LENGTH), (10, 40)], ids=["head", "tail", "both"])
@pytest.mark.parametrize("by", [-2.0, 0.0, 2.0])
def test_the_brightness_says_where_what_is_seen_lies_on_the_body(part, by) -> None:
    found = whole(body_of(), 6, part, by)
    assert found is not None and curve_inferred(found)
    np.testing.assert_allclose(found.points[[0, -1]], at(6)[[0, -1]], atol=2)


def test_nothing_is_hidden_of_a_body_that_is_seen() -> None:
    assert whole(body_of(), 6, (0, LENGTH)) is None


def test_what_is_hidden_and_goes_with_the_body_is_not_there() -> None:
    body, found = body_of(), None
    for t in range(6, 14):
        found = whole(body, t, (0, 40))
        assert found is not None
        if not curve_inferred(found):
            break
        bright = light_of(image_of(t, 0, 40), at(t, 0, 40)[::20]).along(found.points, HALF_WIDTH)
        body = body.with_curve(t, found, bright)
    assert found is not None and found.length == pytest.approx(40, abs=1)


def test_nothing_is_learned_from_a_body_while_some_of_it_is_hidden() -> None:
    body, short = body_of(), curve(at(6, 0, 38), HALF_WIDTH)
    found = whole(body, 6, (0, 38))
    assert found is not None
    hidden = body.with_curve(6, found, np.ones(100))
    after = hidden.with_curve(7, short, np.ones(100))
    assert after.lengths == body.lengths and after.shown == body.shown
    again = after.with_curve(8, curve(at(8), HALF_WIDTH), np.ones(100))
    assert len(again.lengths) == len(body.lengths) + 1 and not again.hidden

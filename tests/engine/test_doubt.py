"""Signs of a wrong curve, weighed together."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from napari_splinesketch import refine
from napari_splinesketch.engine import constants
from napari_splinesketch.engine.find import scoring
from napari_splinesketch.engine.find.finding import Start
from napari_splinesketch.engine.judge import doubt
from napari_splinesketch.engine.judge.doubt import Evidence, collect, reasons


def known(**features: float) -> np.ndarray:
    return np.array([features.get(name, 0.0) for name in scoring.FEATURES])


SURE = Evidence(0.2, 4.0, half_width=3.0, room=4.0, known=known(unseen=0.02), margin=np.inf)
WORSE = {
    "sd": ({"sd": 9.0}, "uncertain by up to 9.0 px"),
    "astray": ({"astray": 140.0}, "strays up to 140 px"),
    "rival": ({"margin": 0.2, "astray": 9.0}, "another path is nearly as likely"),
    "unseen": ({"known": known(unseen=0.6), "sd": 3.0}, "60% of it cannot be seen"),
    "kink": ({"known": known(kink=1.0), "sd": 3.0}, "bends sharply"),
    "missed": ({"known": known(missed=9.0), "sd": 3.0}, "misses points of its sketch"),
}


def test_a_plain_curve_raises_no_doubt():
    assert reasons(SURE) == []


@pytest.mark.parametrize("sign", WORSE)
def test_a_strong_sign_is_told_in_words(sign):
    change, words = WORSE[sign]
    assert any(words in text for text in reasons(replace(SURE, **change)))


def test_several_weak_signs_add_up():
    weak = {"sd": 1.6, "astray": 12.0, "known": known(unseen=0.2)}
    assert all(reasons(replace(SURE, **{k: v})) == [] for k, v in weak.items())
    assert len(reasons(replace(SURE, **weak))) > 1


@given(
    st.floats(0, allow_infinity=True),
    st.floats(0, 1e6),
    st.floats(1, 1e4),
    st.floats(0, allow_infinity=True),
    st.lists(st.floats(0, 1e3), min_size=6, max_size=6),
)
def test_any_evidence_is_weighed(sd, astray, room, margin, features):
    evidence = Evidence(sd, astray, 3.0, room, np.array(features), margin)
    assert np.isfinite(evidence.signs).all()
    assert all(isinstance(text, str) and text for text in reasons(evidence))


def without_caps(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A curve without caps: its points, and where they are on its spline."""
    return points, np.linspace(0, 1, len(points))


def test_caps_do_not_count_as_astray():
    straight = np.column_stack([np.zeros(101), np.linspace(-4, 64, 101)])
    capped = straight, np.linspace(-4 / 60, 64 / 60, 101)
    sketch = np.array([[0.0, 0.0], [0.0, 60.0]])
    start = Start(sketch, True, sketch, 4, 2.0, 1.0, known())
    far, near = (collect(*one, np.ones(101), 2.0, start).astray
                 for one in (without_caps(straight), capped))  # fmt: skip
    assert far == pytest.approx(4, abs=0.1)
    assert near < 0.7


def test_what_is_collected_of_a_curve():
    along = np.linspace(0, 60, 100)
    straight = np.column_stack([np.zeros(100), along])
    sd = np.where((along > 20) & (along < 30), 0.5, 0.1)
    sd[0] = 9.0
    sketch = np.array([[3.0, 0.0], [3.0, 60.0]])
    start = Start(sketch, True, sketch, 4, 2.0, 1.0, known(unseen=0.1), margin=1.5)
    found = collect(*without_caps(straight), sd, 2.0, start)
    assert found.sd == 0.5
    assert found.astray == pytest.approx(3.0)
    assert (found.half_width, found.known[0], found.margin) == (2.0, 0.1, 1.5)


def test_a_line_of_one_stroke_may_be_farther_from_its_body_than_a_clicked_one():
    straight, sd = np.column_stack([np.zeros(100), np.linspace(0, 60, 100)]), np.full(100, 0.1)
    starts = (Start(straight, True, straight[::n], 4, 2.0, 1.0, known()) for n in (1, 20))
    stroke, clicks = (collect(*without_caps(straight), sd, 2.0, x).room for x in starts)
    assert stroke > clicks >= 2.0


def test_long_clicked_sketches_may_be_farther_from_their_bodies():
    sd, rooms = np.full(100, 0.1), []
    for length in (60, 600):
        line = np.column_stack([np.zeros(100), np.linspace(0, length, 100)])
        start = Start(line, True, line[::20], 4, 2.0, 1.0, known())
        rooms.append(collect(*without_caps(line), sd, 2.0, start).room)
    assert rooms[1] - rooms[0] > 1


@pytest.mark.parametrize(
    ("change", "ends_off"),
    [
        (lambda line: line, 0.0),
        (lambda line: line + np.array([20.0, 0.0]), 0.0),  # drawn beside it as a whole
        (lambda line: line[10:], 0.0),
        (lambda line: line[30:], 19.1),
        (lambda line: np.concatenate([line, line[-1] + [[12.0, 4.0], [24.0, 8.0]]]), 25.3),
        (lambda line: line[[0, -1]] + [[0.0, 0.0], [20.0, 0.0]], 20.0),
    ],
    ids=["on it", "moved", "a little short", "short", "hooked", "straight"],
)
def test_a_curve_that_ends_far_from_the_ends_of_a_stroke_says_so(change, ends_off: float) -> None:
    along = np.linspace(0, 60, 100)
    bent = np.column_stack([6 * np.sin(along / 10), along])
    stroke = change(bent)
    start = Start(stroke, True, stroke, 4, 2.0, 1.0, known())
    found = collect(*without_caps(bent), np.full(100, 0.1), 2.0, start)
    assert found.missed_end == pytest.approx(ends_off, abs=0.5)
    assert any("from an end of its sketch" in x for x in reasons(found)) == (ends_off > 0)


def test_signs_and_weights_belong_together():
    assert (
        len(doubt.SIGNS)
        == len(constants.DOUBT_WEIGHTS)
        == len(constants.DOUBT_USUAL)
        == len(SURE.signs)
    )


@pytest.mark.parametrize(("seed", "half_width"), [(0, 2), (0, 3), (4, 3), (5, 2), (6, 3), (7, 2)])
@pytest.mark.parametrize(("too_long", "marked"), [(0, False), (13, True), (20, True)])
def test_a_curve_that_ends_long_before_its_clicked_sketch_says_so(
    too_long: float, marked: bool, seed: int, half_width: float
) -> None:
    """It ends where its body does, and not in the background that was clicked."""
    rows, columns = np.mgrid[:80, :140].astype(float)
    beside = np.hypot(rows - 40, np.clip(np.abs(columns - 60) - 30, 0, None))
    image = 1 / (1 + np.exp((beside - half_width) / 0.4))
    image += np.random.default_rng(seed).normal(0, 0.05, image.shape)
    end = 90 + half_width
    sketch = np.column_stack([np.full(6, 40.0), np.linspace(28, end + too_long, 6)])
    curve = refine(image, [sketch]).curves[0]
    assert abs(curve.points[-1, 1] - end) < 3
    assert any("from an end of its sketch" in reason for reason in curve.reasons) == marked

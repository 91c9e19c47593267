"""What is known of a body, and what of it is hidden."""

from dataclasses import replace

import numpy as np
import pytest

from napari_splinesketch import Curve, Refinement, refine
from napari_splinesketch.tracking import Body, View
from napari_splinesketch.tracking.bodies import INFERRED, Given, Tracked, curve_inferred
from napari_splinesketch.tracking.drift import ShownPlaces, distance, doubts, misleads
from napari_splinesketch.tracking.follow import after, follow
from napari_splinesketch.tracking.motion import Predicted
from napari_splinesketch.tracking.search import Search

from .test_follow import BRIGHT, LINE, MODEL, FakeRefine, curve, moved

LENGTH, HALF_WIDTH = 50.0, 2.5


def at(frame: int, first: float = 0, last: float = LENGTH) -> np.ndarray:
    """A body that glides by 2 px a frame, or a part of it."""
    s = np.linspace(first, last, 100)
    return np.column_stack([25 + 0 * s, 10 + 2 * frame + s])


BODY = Body(1, tuple((t, curve(at(t), HALF_WIDTH)) for t in range(6)))


def held(
    line: np.ndarray, first: float = 0, last: float = LENGTH, places: ShownPlaces | None = None
) -> Curve:
    """The body where it is predicted so, in an image of a part of it."""
    part = at(6, first + HALF_WIDTH, last - HALF_WIDTH)  # round ends
    rng = np.random.default_rng(0)
    rows, columns = np.indices((50, 100))
    apart = np.linalg.norm(np.stack([rows, columns], -1)[..., None, :] - part, axis=-1).min(-1)
    pixels = 1 / (1 + np.exp(2 * (apart - HALF_WIDTH))) + 0.05 * rng.standard_normal(rows.shape)
    predicted = {1: Predicted(line, 0.7)}
    shown = places or ShownPlaces()
    search = Search(View(pixels), predicted, {}, refine, "fast", lambda told: None, shown=shown)
    return search.held([BODY])[1].curve


@pytest.mark.parametrize("part", [(0, 38), (12, LENGTH)], ids=["its head", "its tail"])
def test_what_something_hides_is_added_at_the_end_that_is_not_seen(part) -> None:
    found = held(at(6), *part)
    np.testing.assert_allclose(found.points[[0, -1]], at(6)[[0, -1]], atol=1)
    assert curve_inferred(found)


def test_nothing_hides_a_body_where_one_was_seen_before() -> None:
    """Its tail lags in what is predicted, and nothing but the film before says that it does."""
    lagging, shown = moved(at(6), 0, -4), ShownPlaces()
    for frame in range(6):
        shown.add(at(frame, 0, 34 + 12 - 2 * frame), HALF_WIDTH)
    found = [held(lagging, 0, 34, places) for places in (None, shown)]
    before, now = (abs(curve.points[0, 1] - at(6)[0, 1]) for curve in found)
    assert before > 3 and now < 2
    assert curve_inferred(found[1])


def test_a_curve_is_longer_than_its_body_by_what_lengths_have_varied() -> None:
    longer = curve(at(6, 0, LENGTH + 5))
    known = replace(BODY, lengths=(LENGTH, LENGTH + 0.5, LENGTH - 0.5) * 3)
    assert known.exceeded(longer) and not BODY.exceeded(longer)
    assert any("length" in said for said in doubts(known, longer, at(6)))
    assert not known.exceeded(curve(at(6, 0, LENGTH + 2)))
    wild = replace(known, lengths=(LENGTH - 3, LENGTH, LENGTH + 3) * 3)
    assert not wild.exceeded(longer)
    assert replace(known, lengths=(*known.lengths, 80.0)).length_sd < 1


def test_a_jump_is_no_doubt_where_the_prediction_may_be_off_by_as_much() -> None:
    jumped = curve(moved(at(6), 20, 0), HALF_WIDTH)
    assert doubts(BODY, jumped, at(6)) == ["it jumped by 20 px"]
    assert doubts(BODY, jumped, at(6), astray=19.0) and not doubts(BODY, jumped, at(6), astray=21.0)


def test_bodies_are_looked_for_by_their_polarity_not_by_that_of_noise() -> None:
    rows, columns = np.indices((50, 100))
    along = np.clip(columns, *at(6, 2, LENGTH - 2)[[0, -1], 1])
    pixels = 1 / (1 + np.exp(2 * (np.hypot(rows - 30, columns - along) - HALF_WIDTH)))
    where = {1: Predicted(at(6), 0.7)}
    search = Search(View(pixels), where, {}, FakeRefine((0, 0)), "balanced", polarity="bright")
    search.refinement = Refinement((), pixels, pixels, replace(MODEL, polarity="dark"), 0.0)
    found = search._as_suggested([BODY])  # pyright: ignore[reportPrivateUsage]
    assert distance(found[1], moved(at(6), 5, 0)) < 1


@pytest.mark.parametrize("aside", [0.0, 19.0])
def test_a_body_is_known_again_wherever_it_comes_out(aside: float) -> None:
    """For 26 frames something hides it; meanwhile it goes where no prediction has it."""
    start, rng = curve(at(0), HALF_WIDTH), np.random.default_rng(0)
    rows, columns = np.indices((90, 150))

    def read(frame: int, lines: object) -> View:
        pixels = 0.05 * rng.standard_normal(rows.shape)
        if not 6 <= frame < 32:
            line = moved(at(frame, 2, LENGTH - 2), aside * (frame >= 32), 0)
            apart = np.abs(rows - line[0, 0])
            along = np.clip(columns, line[0, 1], line[-1, 1])
            pixels += 1 / (1 + np.exp(2 * (np.hypot(apart, columns - along) - HALF_WIDTH)))
        return View(pixels)

    *_, last = follow(range(1, 40), [Body(1, ((0, start),))], read)
    assert not last.drifting
    assert np.abs(last.by_id[1].points - moved(at(39), aside, 0)).max() < 1.5


def uncertain(line: np.ndarray) -> Curve:
    return replace(curve(line, HALF_WIDTH), sd=np.full(100, 0.8))


def test_a_curve_that_slid_along_others_does_not_tell_how_its_body_moves() -> None:
    slid, crossing = moved(at(6), 0, 4), curve(moved(at(6), 3, 20), HALF_WIDTH)
    for one in (uncertain(slid), curve(at(6, -4, LENGTH + 2), HALF_WIDTH)):
        assert misleads(BODY, 6, one)
        for others, last in (((crossing,), 5), ((), 6)):
            result = Tracked(6, dict(enumerate((one, *others), start=1)))
            known = after({1: BODY, 2: replace(BODY, id=2)}, result, Given())
            assert known[1].seen[-1][0] == last
            assert known[1].misses == 0, "it is there"
    predicted = BODY.predicted(7).line
    np.testing.assert_allclose(predicted, at(7), atol=0.5)


def test_a_curve_where_its_body_is_expected_or_as_certain_as_usual_tells_how_it_moves() -> None:
    assert not misleads(BODY, 6, uncertain(at(6)))
    assert not misleads(BODY, 6, curve(moved(at(6), 0, 4), HALF_WIDTH))
    unsure = replace(BODY, seen=tuple((t, uncertain(c.points)) for t, c in BODY.seen))
    assert not misleads(unsure, 6, uncertain(moved(at(6), 0, 4)))


def test_what_misleads_for_long_is_how_the_body_moves() -> None:
    bodies = {1: BODY, 2: replace(BODY, id=2)}
    for frame in range(6, 10):
        curves = uncertain(moved(at(frame), 0, 4)), curve(moved(at(frame), 3, 20), HALF_WIDTH)
        result = Tracked(frame, dict(zip((1, 2), curves, strict=True)))
        bodies = after(bodies, result, Given())
        assert bodies[1].seen[-1][0] == (5 if frame < 9 else 9)


def test_an_end_that_is_never_shown_is_not_hidden() -> None:
    usual = ShownPlaces()
    usual.learn(BODY.id, 0.15)
    assert curve_inferred(held(at(6), 0, 44))
    assert not curve_inferred(held(at(6), 0, 44, usual))


def test_a_body_that_was_out_of_sight_is_known_again_by_most_of_it() -> None:
    for shown, back in ((70, False), (90, True)):
        pixels = np.zeros((50, 100))
        pixels[:, :shown] = 1.0
        line, fake = np.array([[25.0, 20], [25, 90]]), FakeRefine((0, 0))
        body = Body(1, tuple((t, curve(line)) for t in range(5)), misses=3)
        predicted = {1: Predicted(body.seen[-1][1].points, 1.0)}
        search = Search(View(pixels), predicted, {}, fake, "fast", lambda told: None)
        assert search([body])[1].trusted == back
        search = Search(View(pixels), predicted, {}, fake, "fast", lambda told: None)
        assert search([replace(body, misses=0)])[1].trusted


@pytest.mark.parametrize("by", [-1.5, 1.5])
def test_ends_that_are_seen_are_believed_where_others_are_predicted(by) -> None:
    found = held(moved(at(6), 0, by))
    np.testing.assert_allclose(found.points[[0, -1]], at(6)[[0, -1]], atol=0.7)
    assert not curve_inferred(found)


def test_a_length_that_was_not_seen_tells_nothing_of_the_length() -> None:
    short = curve(at(6, 0, 40))
    assert BODY.lacks(short) and not BODY.lacks(curve(at(6, 0, LENGTH - 0.5)))
    assert BODY.with_curve(6, short).lengths[-1] == pytest.approx(40)
    inferred = replace(short, reasons=(f"part of it is {INFERRED}",))
    assert BODY.with_curve(6, inferred).lengths == (BODY.lengths or (pytest.approx(LENGTH),) * 6)


def test_a_body_of_unknown_width_is_held_as_others_are() -> None:
    """Labels of other programs may have none."""
    unknown = replace(curve(LINE), half_width=np.full(100, np.nan))
    body = Body(7, ((0, unknown), (1, unknown)))
    refine = FakeRefine((0, 0))
    predicted = {7: Predicted(unknown.points, 0.5)}
    search = Search(View(BRIGHT), predicted, {}, refine, "balanced", lambda told: None)
    assert search.held([body])[7].trusted

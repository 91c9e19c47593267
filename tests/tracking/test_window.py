"""What the frames around tell: gaps bridged, nothing held back without need."""

from collections.abc import Sequence
from functools import partial
from typing import Any
from weakref import WeakSet

import numpy as np
import pytest
from generated_films import Film, film

from napari_splinesketch.engine.types import Refinement
from napari_splinesketch.metrics import average_dtw
from napari_splinesketch.tracking import Body, Given, Tracked, View, after, follow
from napari_splinesketch.tracking.bodies import curve_inferred
from napari_splinesketch.tracking.search import Search
from napari_splinesketch.tracking.surface import REACH
from napari_splinesketch.tracking.window import LONGEST, UNDECIDED, Window

from .test_follow import BRIGHT, LINE, FakeRefine, curve, moved, run


def tracked(made: Film) -> list[Tracked]:
    start = [Body(i, ((0, curve(line, 2.5)),)) for i, line in enumerate(made.centrelines[0])]
    frames = range(1, len(made.images))
    return list(follow(frames, start, lambda t, _: View(made.images[t]), preset="fast"))


def test_a_body_out_of_sight_is_followed_and_marked() -> None:
    made = film(
        4, hidden=3, crossing=False, frames=14, bodies=2, length=40.0, shape=(120, 100), speed=1.5
    )
    results = tracked(made)
    assert [r.frame for r in results] == list(range(1, 14))
    for result in results:
        assert sorted(result.ids) == [0, 1]
        gone = ~made.visible[result.frame].any(1)
        for i, one in zip(result.ids, result.curves, strict=True):
            assert average_dtw(one.points, made.centrelines[result.frame, i]) < 2
            assert any("inferred" in reason for reason in one.reasons) == gone[i]


def test_a_gap_in_the_image_is_bridged() -> None:
    dark = np.zeros_like(BRIGHT)

    def read(frame: int, lines: Sequence[np.ndarray]) -> View:
        return View(dark if frame in (5, 6) else BRIGHT)

    results = run(FakeRefine((0, 1)), range(1, 11), start={7: [(0, curve(LINE))]}, read=read)
    assert [r.frame for r in results] == list(range(1, 11))
    assert all(r.ids == (7,) for r in results)
    marked = [any("inferred" in why for why in r.curves[0].reasons) for r in results]
    assert [r.frame for r, there in zip(results, marked, strict=True) if there] == [5, 6]
    columns = np.array([r.curves[0].points[0, 1] for r in results])
    assert (np.diff(columns) > 0).all()
    assert (results[4].curves[0].sd >= results[3].curves[0].sd).all()


def test_a_frame_that_cannot_be_refined_has_no_curve_of_any_body() -> None:
    """Not even of one that is in doubt, which frames around it tell of."""
    gone = BRIGHT * (np.arange(60)[:, None] > 25)
    images = {4: gone, 5: np.full_like(BRIGHT, np.nan)}
    bodies = {7: [(0, curve(LINE))], 3: [(0, curve(moved(LINE, 30, 5)))]}
    results = run(FakeRefine(), range(1, 11), start=bodies, read=lambda t, _: images.get(t, BRIGHT))
    assert [bool(r.error) for r in results] == [r.frame == 5 for r in results]
    assert [sorted(r.ids) for r in results] == [[] if r.frame == 5 else [3, 7] for r in results]


def test_a_gap_is_bridged_although_others_have_waited_too_long() -> None:
    """Two bodies run along each other for ever; a third that met them goes out of sight."""
    pair = {1: curve(LINE), 2: curve(moved(LINE, 3, 0))}
    gone = range(LONGEST - 2, LONGEST + 4)
    bodies = {i: Body(i, ((0, c),)) for i, c in {**pair, 3: curve(moved(LINE, 44, 48))}.items()}
    window = Window(partial(Search, refine=FakeRefine((0, 0)), preset="fast"), True)
    results: list[Tracked] = []
    for frame in range(1, LONGEST + 11):
        third = {} if frame in gone else {3: curve(moved(LINE, 2 * abs(frame - LONGEST // 2), 48))}
        now = {**pair, **third}
        missing = {} if third else {3: "nothing like it is there"}
        result = Tracked(frame, now, missing=missing)
        known = window.push(result, {}, bodies)
        bodies = after(bodies, result, Given()) | known
        results += window.ready()
    results += window.rest()
    assert [r.frame for r in results] == list(range(1, LONGEST + 11))
    for result in results:
        assert curve_inferred(result.by_id[3]) == (result.frame in gone)


def test_a_body_that_does_not_come_back_is_lost_after_forty_frames() -> None:
    half = BRIGHT.copy()
    half[:25] = 0
    results = run(FakeRefine((0, 0)), range(1, 44), read=lambda frame, lines: View(half))
    assert [sorted(r.lost) for r in results].index([7]) == 40
    assert all(r.ids == (3,) for r in results)


@pytest.mark.slow
def test_memory_does_not_grow_with_the_frames() -> None:
    views: WeakSet[View] = WeakSet()
    alive = []

    def read(frame: int, lines: Sequence[np.ndarray]) -> View:
        view = View(BRIGHT if frame % 20 < 16 else np.zeros_like(BRIGHT))
        views.add(view)
        return view

    start = [Body(7, ((0, curve(LINE)),))]
    last = 0
    for result in follow(range(1, 200), start, read, refine=FakeRefine((0, 0))):
        alive.append(len(views))
        last = result.frame
    assert last == 199
    assert max(alive) <= LONGEST + REACH
    assert max(alive[100:]) <= max(alive[:100])


def test_frames_wait_without_their_pictures_and_are_gone_through_again_around_their_bodies() -> (
    None
):
    large = np.ones((300, 400))
    sizes: list[int] = []
    fake = FakeRefine((0, 1))

    def refine(image: np.ndarray, *args: Any, **options: Any) -> Refinement:
        sizes.append(image.size)
        return fake(image, *args, **options)

    def read(frame: int, lines: Sequence[np.ndarray]) -> View:
        return View(np.zeros_like(large) if frame in (5, 6) else large)

    def read_and_note(frame: int, lines: Sequence[np.ndarray]) -> View:
        alive.append(len(views))
        view = read(frame, lines)
        views.add(view)
        return view

    views: WeakSet[View] = WeakSet()
    alive: list[int] = []
    start = [Body(7, ((0, curve(LINE)),))]
    tracked = follow(range(1, 11), start, read_and_note, refine=refine, pictures=False)
    results = list(tracked)
    assert max(alive) <= 1, "whole frames are not kept"
    assert [r.frame for r in results] == list(range(1, 11))
    assert all(r.refinement is not None and not r.refinement.background.size for r in results)
    assert max(sizes) == large.size and min(sizes) < large.size / 4


def test_a_cancelled_window_is_gone_on_with() -> None:
    dark = np.zeros_like(BRIGHT)

    def read(frame: int, lines: Sequence[np.ndarray]) -> View:
        return View(dark if frame in (5, 6, 7) else BRIGHT)

    start = {7: Body(7, ((0, curve(LINE)),))}
    refine, frames = FakeRefine((0, 1)), range(1, 12)
    whole = list(follow(frames, start.values(), read, refine=refine))
    first = list(
        follow(
            frames, start.values(), read, refine=refine,
            on_progress=lambda told: told.fraction < 6 / len(frames),
        )
    )  # fmt: skip
    assert [r.frame for r in first] == [1, 2, 3, 4, 5, 6], "what is done is kept"
    assert not any(UNDECIDED in c.reasons for r in first[:4] for c in r.curves)
    assert all(UNDECIDED in c.reasons for r in first[4:] for c in r.curves)
    bodies = start
    for result in first:
        bodies = after(bodies, result, Given())
    rest = list(follow(frames[6:], bodies.values(), read, refine=refine))
    assert [r.frame for r in (*first, *rest)] == list(frames)
    assert [r.ids for r in rest] == [r.ids for r in whole[6:]]
    for one, other in zip(rest, whole[6:], strict=True):
        assert average_dtw(one.curves[0].points, other.curves[0].points) < 2


def test_frames_that_are_held_back_are_told_of_early() -> None:
    dark = np.zeros_like(BRIGHT)
    came: list[tuple[str, int]] = []
    early: dict[int, Tracked] = {}

    def read(frame: int, lines: Sequence[np.ndarray]) -> View:
        came.append(("read", frame))
        return View(dark if frame in (5, 6) else BRIGHT)

    def note(result: Tracked) -> None:
        came.append(("early", result.frame))
        early[result.frame] = result

    start = [Body(7, ((0, curve(LINE)),))]
    results = list(follow(range(1, 11), start, read, refine=FakeRefine((0, 1)), early=note))
    assert [r.frame for r in results] == list(range(1, 11))
    assert {5, 6, 7} <= set(early) and not {1, 2, 3, 10} & set(early)
    assert came.index(("early", 7)) < came.index(("read", 8))
    assert all(r.view is None and r.refinement is None for r in early.values())
    assert UNDECIDED in early[7].curves[0].reasons
    assert early[7].curves[0].status == "check"
    assert not any(UNDECIDED in c.reasons for r in results for c in r.curves)


def test_nothing_is_held_back_without_need() -> None:
    coming: list[int] = []

    def read(frame: int, lines: Sequence[np.ndarray]) -> View:
        coming.append(frame)
        return View(BRIGHT)

    start = [Body(1, ((0, curve(LINE)),)), Body(2, ((0, curve(moved(LINE, 30, 0))),))]
    for result in follow(range(1, 6), start, read, refine=FakeRefine()):
        assert coming[-1] == result.frame

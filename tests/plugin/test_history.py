"""Steps are taken back and done again."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from napari_splinesketch.grids import Grid, Patch
from napari_splinesketch.plugin import model as history
from napari_splinesketch.plugin.model import History, Record, Refined, State, bytes_beside

from .fakes import as_drawn

A = np.array([[0.0, 0], [0, 40]])


@given(st.lists(st.sampled_from(["apply", "undo", "redo"]), max_size=60))
def test_it_is_a_walk_along_the_values(steps: list[str]) -> None:
    made: History[int] = History(0)
    values, at = [0], 0
    for number, step in enumerate(steps, start=1):
        if step == "apply":
            values, at = [*values[: at + 1], number], at + 1
            made.apply(f"step {number}", number)
        elif step == "undo":
            assert bool(made.undo()) == (at > 0)
            at = max(at - 1, 0)
        else:
            assert bool(made.redo()) == (at < len(values) - 1)
            at = min(at + 1, len(values) - 1)
        assert made.value == values[at]
        assert bool(made.done) == (at > 0)
        assert bool(made.undone) == (at < len(values) - 1)


def test_it_says_what_it_takes_back() -> None:
    made: History[str] = History("a")
    made.apply("write b", "b")
    made.apply("write c", "c")
    assert (made.done, made.undo(), made.done, made.undone) == (
        "write c",
        "write c",
        "write b",
        "write c",
    )
    made.apply("write d", "d")
    assert (made.undone, made.undo(), made.value) == ("", "write d", "b")


def test_the_oldest_steps_are_forgotten() -> None:
    made: History[int] = History(0)
    for number in range(1, history.STEPS + 50):
        made.apply("count", number)
    back = 0
    while made.undo():
        back += 1
    assert back == history.STEPS


def test_heavy_steps_are_forgotten_earlier() -> None:
    made: History[int] = History(0, lambda old, new: history.WEIGHT // 3)
    for number in range(1, 10):
        made.apply("count", number)
    while made.undo():
        pass
    assert made.value == 6


def test_a_step_that_is_too_heavy_can_be_taken_back() -> None:
    made: History[int] = History(0, lambda old, new: 2 * history.WEIGHT)
    made.apply("one", 1)
    made.apply("two", 2)
    assert (made.undo(), made.value, made.undo()) == ("two", 1, "")


def record(number: int, frame: int = 0) -> Record:
    return Record(number, frame, A, as_drawn(A))


def test_a_state_changes_by_giving_another() -> None:
    state = State((record(1), record(2), record(1, frame=3)))
    accepted = state.marked([(0, 2)], review="accepted").marked([(3, 1)], locked=True)
    assert [r.review for r in accepted.records] == ["open", "accepted", "open"]
    assert [r.locked for r in accepted.records] == [False, False, True]
    assert [r.review for r in state.records] == ["open", "open", "open"]
    less = accepted.without([(0, 2)])
    assert [(r.frame, r.id) for r in less.records] == [(0, 1), (3, 1)]
    back = less.restored([(0, 2)])
    assert [(r.frame, r.id) for r in back.records] == [(0, 1), (0, 2), (3, 1)]
    assert back.records[1].review == "accepted"
    assert not back.deleted


def test_of_several_that_were_deleted_the_last_comes_back() -> None:
    state = State((record(1),)).marked([(0, 1)], locked=True).without([(0, 1)])
    again = state.with_records(record(1)).marked([(0, 1)], review="rejected").without([(0, 1)])
    assert [(r.locked, r.review) for r in again.deleted] == [(True, "open"), (False, "rejected")]
    back = again.restored([(0, 1)])
    assert [(r.locked, r.review) for r in back.records] == [(False, "rejected")]
    assert not back.deleted


def test_pictures_of_the_latest_frames_stay(monkeypatch: pytest.MonkeyPatch) -> None:
    def refined(state: State, frame: int) -> State:
        patch = Patch(Grid(np.zeros(2), np.ones(2)), np.zeros((10, 10), np.float32))
        region = np.zeros(2), np.full(2, 9.0)
        return state.refined(frame, [record(1, frame)], Refined((), patch, (), region))

    state = State()
    monkeypatch.setattr(history, "PICTURES", 800)
    for frame in (3, 1, 2, 1, 5):
        state = refined(state, frame)
    assert [*state.patches] == [1, 5]
    assert [r.frame for r in state.records] == [1, 2, 3, 5]
    monkeypatch.setattr(history, "PICTURES", 10)
    assert [*refined(state, 0).patches] == [0]


def test_pictures_that_are_shared_weigh_nothing() -> None:
    grid = Grid(np.zeros(2), np.ones(2))
    first, second = (Patch(grid, np.zeros((10, 10), np.float32)) for _ in range(2))
    old, new = State(patches={0: first}), State(patches={0: first, 1: second})
    assert bytes_beside(old, new) == 0
    assert bytes_beside(new, old) == 400


def test_curves_that_are_shared_weigh_nothing() -> None:
    old = State((record(1), record(2)))
    assert bytes_beside(old, old.marked([(0, 1)], review="accepted").without([(0, 2)])) == 0
    assert bytes_beside(old, old.with_records(record(1))) == history.CURVE


def test_curves_hold_about_what_they_are_weighed_with() -> None:
    curve = record(1).curve
    held = sum(a.nbytes for a in (curve.knots, curve.points, curve.half_width, curve.sd))
    assert history.CURVE / 4 < held < history.CURVE

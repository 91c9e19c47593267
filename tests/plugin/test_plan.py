"""What is refined, and what is left alone."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from napari_splinesketch.plugin.layers.drawn import Drawn
from napari_splinesketch.plugin.model import Record, State
from napari_splinesketch.plugin.plan import Plan, Scope, make_plan

from .fakes import as_drawn

BENT = np.column_stack([16 * np.sin(np.linspace(0, np.pi, 9)), np.linspace(0, 40, 9)])
A, B, C, D = (np.array([[20.0 * i, 0], [20.0 * i, 40]]) for i in range(4))


def record(number: int, line: np.ndarray, **how: Any) -> Record:
    return Record(number, 0, line, as_drawn(line), **how)


OPEN = record(1, A)
ACCEPTED = record(2, B, review="accepted")
REJECTED = record(3, C, review="rejected")
LOCKED = record(2, B, locked=True)
EDITED = record(1, A, edited=True)
FAILED = replace(OPEN, curve=replace(OPEN.curve, status="failed"))
PIECE = record(9, D, drawn=False)
CARRIED = State((PIECE, replace(PIECE, frame=1)))
DOUBTED = CARRIED.with_records(replace(PIECE, curve=replace(PIECE.curve, status="check")))
DELETED = State(deleted=(OPEN,))
READ, READ_DOUBTED = (
    State(tuple([replace(r, drawn=True, from_file=True) for r in state.records]))
    for state in (CARRIED, DOUBTED)
)

Case = tuple[State, list[np.ndarray], Scope, dict[str, Any], list[int], int, int]
CASES: dict[str, Case] = {
    "all new": (State(), [A, B], "new", {}, [1, 2], 0, 0),
    "one new": (State((OPEN,)), [A, B], "new", {}, [2], 1, 0),
    "nothing new": (State((OPEN,)), [A], "new", {}, [], 1, 0),
    "changed": (State((OPEN,)), [A + 3], "new", {}, [1], 0, 0),
    "changed though accepted": (State((ACCEPTED,)), [B + 3], "new", {}, [], 1, 1),
    "changed though locked": (State((LOCKED,)), [B + 3], "new", {}, [], 1, 1),
    "changed though rejected": (State((REJECTED,)), [C + 3], "new", {}, [3], 0, 0),
    "rejected takes no part": (State((REJECTED,)), [C, D], "new", {}, [4], 0, 0),
    "failed takes no part": (State((FAILED,)), [A, D], "new", {}, [2], 0, 0),
    "edited by hand": (State((EDITED,)), [A, B], "new", {}, [1, 2], 0, 0),
    "deleted": (DELETED, [A, B], "new", {}, [2], 0, 0),
    "deleted, all": (DELETED, [A, B], "all", {}, [2], 0, 0),
    "deleted, then changed": (DELETED, [A + 3], "new", {}, [1], 0, 0),
    "deleted, then selected": (DELETED, [A], "selected", {"chosen": [0]}, [1], 0, 0),
    "over one that was carried here": (CARRIED, [D + 2], "new", {}, [9], 0, 0),
    "over one that was carried here and deleted": (
        CARRIED.without([(0, 9)]), [D + 3], "new", {}, [9], 0, 0,
    ),
    "beside one that was carried here and deleted": (
        CARRIED.without([(0, 9)]), [A], "new", {}, [10], 0, 0,
    ),
    "beside one that was carried here": (CARRIED, [A], "new", {}, [10], 1, 0),
    "over a body that touches one that was carried here": (
        CARRIED, [D + 4], "new", {}, [10], 1, 0,
    ),
    "off one that was carried here and is to be checked": (
        DOUBTED, [D + 9], "new", {}, [9], 0, 0,
    ),
    "off one that was carried here and deleted": (
        CARRIED.without([(0, 9)]), [D + 9], "new", {}, [9], 0, 0,
    ),
    "over one of a file": (READ, [D, D + 2], "new", {}, [9], 0, 0),
    "over a body that touches one of a file": (READ, [D, D + 4], "new", {}, [10], 1, 0),
    "off one of a file that is to be checked": (READ_DOUBTED, [D, D + 9], "new", {}, [9], 0, 0),
    "off one of a file that was deleted": (
        READ.without([(0, 9)]), [D, D + 9], "new", {}, [9], 0, 0,
    ),
    "the line of a file, moved": (READ, [D + 9], "new", {}, [9], 0, 0),
    "all of a file": (READ, [D], "all", {}, [9], 0, 0),
    "beside one of a file in a single frame": (
        State((READ_DOUBTED.records[0],)), [D, D + 9], "new", {}, [10], 1, 0,
    ),
    "a straight line over one that bends": (
        State((record(1, BENT),)), [BENT, BENT[[-1, 0]] + 1], "new", {}, [1], 0, 0,
    ),
    "a straight line that ends beside one that bends": (
        State((record(1, BENT),)), [BENT, BENT[[0, -1]] + [0, 9]], "new", {}, [2], 1, 0,
    ),
    "all that is open": (
        State((OPEN, ACCEPTED, REJECTED, PIECE)), [A, B, C], "all", {}, [1, 9], 1, 0,
    ),
    "selected lines": (State((OPEN,)), [A, B], "selected", {"chosen": [0]}, [1], 0, 0),
    "selected curves": (
        State((OPEN, REJECTED, PIECE)), [A, C], "selected",
        {"selection": [(0, 3), (0, 9), (1, 1)]}, [3, 9], 1, 0,
    ),
    "selected but accepted": (
        State((ACCEPTED,)), [B], "selected", {"selection": [(0, 2)]}, [], 1, 1,
    ),
    "the same line pasted over itself": (State((OPEN,)), [A, A], "new", {}, [], 1, 0),
    "the same line twice, all": (State((OPEN,)), [A, A], "all", {}, [1], 0, 0),
    "the same line twice, the copy selected": (
        State((OPEN,)), [A, A], "selected", {"chosen": [1]}, [1], 0, 0,
    ),
    "a curve for each of two lines that are the same": (
        State((OPEN, replace(OPEN, id=2))), [A, A], "all", {}, [1, 2], 0, 0,
    ),
    "a piece beside a new line": (State((PIECE,)), [D + 3], "new", {}, [10], 1, 0),
    "over a piece along a row": (State((PIECE,)), [D + 2], "new", {}, [9], 0, 0),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_plan(name: str) -> None:
    state, lines, scope, how, ids, fixed, decided = CASES[name]
    plan = make_plan(state, 0, Drawn(tuple(lines)), scope, **how)
    assert sorted(numbers(plan)) == ids
    assert len(plan.fixed) == fixed
    assert plan.decided == decided


def numbers(plan: Plan) -> Sequence[int]:
    return [target.id for target in plan.targets]


def test_where_it_begins() -> None:
    moved = replace(EDITED, curve=as_drawn(A + 5))
    (target,) = make_plan(State((moved,)), 0, Drawn((A,)), "new").targets
    np.testing.assert_array_equal(target.start, moved.curve.points)
    np.testing.assert_array_equal(target.sketch, A)
    (target,) = make_plan(State((moved,)), 0, Drawn((A + 1,)), "new").targets
    np.testing.assert_array_equal(target.start, A + 1, "a line drawn since goes before")
    assert not target.new


@pytest.mark.parametrize("scope", ["selected", "all"])
def test_what_was_corrected_goes_on_from_there(scope: Scope) -> None:
    moved = replace(OPEN, curve=as_drawn(A + 5), corrected=True)
    (target,) = make_plan(State((moved,)), 0, Drawn((A,)), scope, selection=[(0, 1)]).targets
    np.testing.assert_array_equal(target.start, moved.curve.points)
    assert target.refined(0, moved.curve).corrected, "and will once more"
    gone = State((moved,)).without([(0, 1)])
    (target,) = make_plan(gone, 0, Drawn((A,)), "selected", chosen=[0]).targets
    np.testing.assert_array_equal(target.start, A, "its line was asked for")


@pytest.mark.parametrize("line", [D + 2, D + 9])
def test_the_line_of_a_file_is_not_taken_up_where_another_puts_its_curve_right(
    line: np.ndarray,
) -> None:
    for state in (READ_DOUBTED, READ_DOUBTED.without([(0, 9)])):
        (target,) = make_plan(state, 0, Drawn((D, line)), "new").targets
        assert target.again
        right = record(9, target.sketch)
        before = [r for r in (*state.deleted, *state.records) if r.id == 9]
        after = replace(state, deleted=()).with_records(right).set_aside(before)
        assert not make_plan(after, 0, Drawn((D, line)), "new").targets
        assert right.by_hand


def test_a_curve_of_a_file_is_nobodys_until_it_is_changed() -> None:
    (target,) = make_plan(READ, 0, Drawn((D,)), "all").targets
    again = target.refined(0, READ.records[0].curve)
    assert (again.drawn, again.corrected, again.from_file) == (True, False, True)
    assert not any(r.by_hand for r in READ.records)


def test_curves_whose_line_is_gone_are_named() -> None:
    assert make_plan(State((OPEN, PIECE)), 0, Drawn(), "new").orphans == (1,)
    elsewhere = replace(OPEN, frame=4)
    assert make_plan(State((elsewhere,)), 0, Drawn(), "new").orphans == ()


def test_two_lines_that_are_the_same_keep_their_curves() -> None:
    plan = make_plan(State((OPEN, replace(OPEN, id=2))), 0, Drawn((A, A)), "new")
    assert not plan.orphans


def test_a_curve_that_was_turned_stays_so() -> None:
    turned = replace(OPEN, curve=as_drawn(A[::-1]))
    (target,) = make_plan(State((turned,)), 0, Drawn((A,)), "all").targets
    np.testing.assert_array_equal(target.start, A[::-1])
    np.testing.assert_array_equal(target.sketch, A)
    (target,) = make_plan(State((turned,)), 0, Drawn((A + 1,)), "all").targets
    np.testing.assert_array_equal(target.start, A + 1)


def test_a_line_over_a_curve_from_another_frame_runs_as_that_does() -> None:
    (target,) = make_plan(CARRIED, 0, Drawn((D[::-1] + 2,)), "new").targets
    np.testing.assert_array_equal(target.start, D + 2)
    np.testing.assert_array_equal(target.sketch, D[::-1] + 2)

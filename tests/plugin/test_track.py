"""Next frame and Track to the end in the window: carried, flagged, never over what was accepted."""

import weakref
from dataclasses import replace
from functools import partial
from importlib import import_module
from itertools import islice
from pathlib import Path
from threading import Semaphore
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from napari.layers.base import ActionType
from qtpy.QtCore import Qt

from napari_splinesketch.engine.types import Refinement
from napari_splinesketch.plugin import commands, engine, films
from napari_splinesketch.plugin.dock import SplinesketchDock
from napari_splinesketch.plugin.files import labels_of_layer
from napari_splinesketch.plugin.films import NOT_FOUND, Tracking, bodies_at, confirmed, taken_in
from napari_splinesketch.plugin.layers.space import times_of
from napari_splinesketch.plugin.model import Record, State, key_of
from napari_splinesketch.tracking import Tracked, View
from napari_splinesketch.tracking.bodies import INFERRED
from napari_splinesketch.tracking.events import DIVIDED, LEFT
from napari_splinesketch.tracking.window import UNDECIDED

from .fakes import FakeEngine, as_drawn
from .hand import QTest, canvas, canvas_point, click, fit_view, refine, until

LINES = [np.array([[1.0, 20, 20], [1, 20, 60]]), np.array([[1.0, 60, 30], [1, 64, 80]])]


@pytest.fixture
def film(viewer: Any, dock: SplinesketchDock, fake: FakeEngine) -> Any:
    """Six frames, refined in frame 1; everything is body to the engine."""
    viewer.add_image(np.zeros((6, 96, 128), np.float32), name="film")
    viewer.add_shapes(LINES, shape_type="line", name="film sketches")

    def seen(*arguments: Any, **options: Any) -> Refinement:
        made = fake.refine(*arguments, **options)
        return Refinement(made.curves, made.reconstruction, made.background + 1, made.model, 0.1)

    engine.refine = seen  # the fixture `fake` puts the real one back
    viewer.dims.set_point(0, 1)
    refine(dock)
    return dock


def keys(dock: SplinesketchDock) -> list[tuple[int, int]]:
    return [(record.frame, record.id) for record in dock.controller.records()]


def away(record: Record, rows: float = 9) -> Record:
    points = record.curve.points + np.array([rows, 0])
    return replace(record, curve=replace(record.curve, points=points))


def over(dock: SplinesketchDock) -> None:
    until(lambda: dock.controller.progress is None, 60)


def test_next_frame_carries_over_refines_and_steps(viewer: Any, film: SplinesketchDock) -> None:
    assert film.track.isVisible()
    film.controller.select([(1, 2)])
    click(film.track.buttons["next_frame"])
    over(film)
    assert keys(film) == [(1, 1), (1, 2), (2, 1), (2, 2)]
    assert film.controller.selection == ((2, 2),), "what is selected is the body in view"
    viewer.dims.set_point(0, 1)
    assert film.curve.title.text() == "Curve 2 of frame 2: good"
    viewer.dims.set_point(0, 2)
    assert viewer.dims.current_step[0] == 2
    assert not any(record.drawn for record in film.controller.records(2))
    assert viewer.layers["film curves"].nshapes == 4, "it is over when all is in view"
    assert "To correct a curve, draw a line over it" in film.hint.text()
    click(film.track.buttons["next_frame"])
    over(film)
    assert keys(film)[-2:] == [(3, 1), (3, 2)]
    click(film.undo)
    assert keys(film)[-2:] == [(2, 1), (2, 2)]
    until(lambda: viewer.layers["film curves"].nshapes == 4, 20)


def test_back_to_the_first_frame_is_one_step_and_a_single_one_shows_it(
    viewer: Any, film: SplinesketchDock, fake: FakeEngine
) -> None:
    viewer.dims.set_point(0, 1)
    click(film.track.buttons["track"])
    over(film)
    viewer.dims.set_point(0, 4)
    film.controller.delete(*[(t, i) for t in (0, 1, 2, 3) for i in (1, 2)])
    work = film.controller.work
    assert work is not None
    work.history.amend(replace(work.state, deleted=()))
    fake.calls.clear()
    click(film.track.buttons["previous_frame"])
    over(film)
    assert viewer.dims.current_step[0] == 3
    assert keys(film) == [(t, i) for t in (3, 4, 5) for i in (1, 2)]
    begins = [line.mean(axis=0) for line in fake.calls[0]["lines"]]
    np.testing.assert_allclose(begins[0], LINES[0][:, 1:].mean(axis=0), atol=1)
    click(film.track.buttons["track_back"])
    over(film)
    assert keys(film) == [(t, i) for t in range(6) for i in (1, 2)]
    assert "Tracked to frame 0: 2 curves there" in film.notice.text()
    assert len(fake.calls) == 4, "one frame after the other, from here to the first"
    click(film.undo)
    assert keys(film)[0] == (3, 1)
    viewer.dims.set_point(0, 0)
    assert not film.track.buttons["track_back"].isEnabled()


@pytest.mark.window(shown=True)
def test_the_frame_stays_in_view_while_a_line_is_drawn_there(
    viewer: Any, film: SplinesketchDock
) -> None:
    fit_view(viewer)
    click(film.draw)
    click(film.track.buttons["next_frame"])
    surface, layer = canvas(viewer), film.controller.sketches
    begin, end = canvas_point(viewer, (40, 20)), canvas_point(viewer, (44, 90))
    QTest.mousePress(surface, Qt.MouseButton.LeftButton, pos=begin)
    over(film)
    assert keys(film)[-2:] == [(2, 1), (2, 2)]
    QTest.mouseMove(surface, end)
    QTest.qWait(20)
    QTest.mouseRelease(surface, Qt.MouseButton.LeftButton, pos=end)
    assert layer is not None
    np.testing.assert_allclose(layer.data[-1], [[1, 40, 20], [1, 44, 90]], atol=1)


def test_to_the_end_is_one_step_and_leaves_alone_what_was_decided(
    viewer: Any, film: SplinesketchDock, fake: FakeEngine
) -> None:
    controller = film.controller
    click(film.track.buttons["track"])
    over(film)
    assert keys(film) == [(t, i) for t in range(1, 6) for i in (1, 2)]
    assert "Tracked to frame 5: 2 curves there" in film.notice.text()
    assert viewer.dims.current_step[0] == 1
    controller.review("accepted", (2, 1), (3, 1), (3, 2))
    controller.delete((4, 2))
    before = {(r.frame, r.id): r.curve for r in controller.records()}
    fake.calls.clear()
    click(film.track.buttons["track"])
    over(film)
    after = {(r.frame, r.id): r.curve for r in controller.records()}
    assert {key for key in after if after[key] is before[key]} == {
        *((1, 1), (1, 2), (2, 1), (3, 1), (3, 2))
    }
    assert (4, 2) not in after
    assert [len(call["lines"]) for call in fake.calls] == [1, 2, 2]
    assert [len(call["fixed"]) for call in fake.calls] == [1, 0, 0]
    click(film.undo)
    assert controller.records()[2].curve is before[2, 1]
    assert {(r.frame, r.id): r.curve for r in controller.records()} == before


def test_curves_that_were_deleted_are_not_counted(film: SplinesketchDock, fake: FakeEngine) -> None:
    fake.changes = {0: {"half_width": np.full(100, 9.0)}}
    click(film.track.buttons["track"])
    over(film)
    assert "2 curves there. 5 curves to check for drift." in film.notice.text()
    film.controller.delete((4, 1), (5, 1))
    click(film.track.buttons["track"])
    over(film)
    said = film.notice.text()
    assert "1 curve there. 3 curves to check for drift." in said
    assert "Left out: 2 curves that you deleted" in said


def test_all_curves_of_the_last_frame_are_counted(viewer: Any, film: SplinesketchDock) -> None:
    click(film.track.buttons["track"])
    over(film)
    film.controller.delete((3, 2))
    viewer.dims.set_point(0, 3)
    click(film.track.buttons["next_frame"])
    over(film)
    assert keys(film)[-4:-2] == [(4, 1), (4, 2)]
    assert film.notice.text() == "✓ Tracked to frame 4: 2 curves there."
    film.controller.review("rejected", (4, 2))
    viewer.dims.set_point(0, 3)
    click(film.track.buttons["next_frame"])
    over(film)
    assert film.notice.text() == "✓ Tracked to frame 4: 1 curve there."


def test_curves_of_a_file_are_fitted_again_only_around_a_correction(
    viewer: Any, film: SplinesketchDock, tmp_path: Path, npe2pm_installed: None
) -> None:
    c, buttons = film.controller, film.track.buttons
    click(buttons["track"])
    over(film)
    wrong = [(2, 1), (3, 1), (4, 1)]
    c.apply("Go wrong", c.state.with_records(*(away(c.state.by_key[key]) for key in wrong)))
    c.export(tmp_path / "film.csv")
    over(film)
    viewer.open(tmp_path / "film.csv", plugin="napari-splinesketch")
    click(film.offer.labels)
    over(film)
    viewer.dims.set_point(0, 2)
    assert "Correct a curve of this frame first" in c.actions.problem("around")
    before = dict(c.state.by_key)
    viewer.dims.set_point(0, 1)
    click(buttons["track"])
    over(film)
    assert c.state.by_key == before, "they stay"
    viewer.dims.set_point(0, 2)
    c.refine("all")
    over(film)
    assert "Correct a curve of this frame first" in c.actions.problem("around"), "still a file's"
    right = away(c.state.by_key[2, 1], -9)
    c.apply("Edit", c.state.with_records(commands.edited(right, right.curve)))
    c.review("accepted", (4, 2))
    before = dict(c.state.by_key)
    click(buttons["around"])
    over(film)
    assert "Refitted 2 frames around frame 2, from 3 to 4." in film.notice.text()
    after = c.state.by_key
    assert {key for key in after if after[key] is not before[key]} == {(3, 1), (4, 1)}
    np.testing.assert_allclose(after[4, 1].curve.points[0], [20, 20], atol=0.5)
    assert not any(r.by_hand for key, r in after.items() if key != (2, 1))
    for frame in (3, 4):
        viewer.dims.set_point(0, frame)
        assert not c.request().targets, "each line has its curve"


def test_what_is_said_of_curves_is_theirs_though_their_drawing_was_overtaken(
    film: SplinesketchDock,
) -> None:
    work = film.controller.work
    assert work is not None
    first = work.records[0]
    other = replace(first, frame=3, curve=replace(first.curve))
    work.history.apply("Track", work.state.with_records(other))
    slot = work.slots["curves"]
    next(slot.update())  # its line is there, and another frame comes
    for _ in slot.update():
        pass
    assert slot.layer.features["frame"].tolist() == [1, 1, 3]


def test_cancelling_keeps_what_is_done(
    viewer: Any, film: SplinesketchDock, fake: FakeEngine
) -> None:
    whole = engine.refine

    def slow(*arguments: Any, **options: Any) -> Refinement:
        if len(fake.calls) == 3:
            fake.go.clear()
        return whole(*arguments, **options)

    engine.refine = slow
    click(film.track.buttons["track"])
    until(lambda: (3, 2) in keys(film), 20)
    assert film.progress.isVisible()
    until(lambda: "frame 4" in film.stage.text().lower(), 20)
    click(film.cancel)
    assert "Kept: 2 frames tracked by then" in film.notice.text()
    fake.go.set()
    QTest.qWait(300)
    assert keys(film)[-1] == (3, 2)


def test_what_is_done_is_kept_and_said_where_tracking_fails(
    film: SplinesketchDock, monkeypatch: pytest.MonkeyPatch
) -> None:
    begin = Tracking.start

    def start(self: Tracking, carry: Any, *bodies: Any) -> None:
        def fail(*arguments: Any, **options: Any) -> Any:
            yield from islice(carry(*arguments, **options), 2)
            raise MemoryError("full")

        begin(self, fail, *bodies)

    monkeypatch.setattr(Tracking, "start", start)
    click(film.track.buttons["track"])
    over(film)
    assert keys(film)[-1] == (3, 2)
    said = film.notice.text()
    assert "Tracking failed. Kept: 2 frames tracked by then. MemoryError: full" in said


def test_frames_that_wait_for_others_are_seen_meanwhile_and_kept_by_cancel(
    viewer: Any, film: SplinesketchDock, fake: FakeEngine
) -> None:
    whole, turns = engine.refine, Semaphore(0)

    def slow(*arguments: Any, **options: Any) -> Refinement:
        turns.acquire(timeout=20)
        return whole(*arguments, **options)

    def not_confirmed() -> set[tuple[int, int]]:
        records = film.controller.records()
        return {(r.frame, r.id) for r in records if UNDECIDED in r.curve.reasons}

    engine.refine = slow
    fake.changes = {0: {"half_width": np.full(100, 9.0)}}  # is doubted, whatever is tried
    click(film.track.buttons["track"])
    turns.release(8)
    until(lambda: (2, 1) in keys(film), 20)
    assert film.controller.progress
    assert not_confirmed() >= {(2, 1)}
    film.controller.review("accepted", (2, 1))
    accepted = film.controller.state.by_key[2, 1].curve
    click(film.cancel)
    turns.release(100)
    assert "tracked by then. Track on to confirm " in film.notice.text()
    there = keys(film)
    assert (2, 1) in there and (2, 2) in there
    QTest.qWait(300)
    assert keys(film) == there
    fake.changes = {}
    engine.refine = whole
    viewer.dims.set_point(0, there[-1][0])
    click(film.track.buttons["track"])
    over(film)
    assert film.controller.state.by_key[2, 1].curve is accepted
    assert not_confirmed() == {(2, 1)}, "what was not confirmed is tracked again"
    assert keys(film)[-1] == (5, 2)


def test_tracking_goes_on_from_the_last_frame_that_was_decided() -> None:
    line = LINES[0][:, 1:]

    def record(frame: int) -> Record:
        unsure = {"status": "check", "reasons": (UNDECIDED,)} if frame in (3, 4) else {}
        return Record(1, frame, line, as_drawn(line, **unsure), drawn=False)

    state = State(records=tuple(map(record, range(2, 6))))
    assert [confirmed(state, frame) for frame in (2, 3, 4, 5)] == [2, 2, 2, 5]
    assert [confirmed(state, frame, -1) for frame in (3, 4)] == [5, 5]
    taken_up = state.marked([(3, 1)], review="accepted")
    assert confirmed(taken_up, 4) == 3
    assert confirmed(state.without([(2, 1)]), 4) == 4, "there is nothing to go on from"


def test_a_curve_that_other_frames_do_not_confirm_goes_again_unless_it_was_judged() -> None:
    line = LINES[0][:, 1:]

    def tracked(*ids: int) -> Tracked:
        return Tracked(1, dict.fromkeys(ids, as_drawn(line)), dict.fromkeys(ids, line))

    state = taken_in(State(), tracked(1, 2, 3, 4))
    state = state.marked([(1, 2)], review="accepted").marked([(1, 4)], review="rejected")
    state = taken_in(state, tracked(3, 4), before=(1, 2, 3, 4))
    reviews = {number: record.review for (_, number), record in state.by_key.items()}
    assert reviews == {2: "accepted", 3: "open", 4: "rejected"}


def test_frames_are_taken_over_without_looking_through_all_curves_of_the_film_for_each(
    film: SplinesketchDock, monkeypatch: pytest.MonkeyPatch
) -> None:
    c, looked = film.controller, list[int]()
    known = c.records(1)
    far = [replace(record, frame=frame) for record in known for frame in (3, 4, 5)]
    c.apply("Track", c.state.with_records(*far))

    def taken(state: State, *rest: Any) -> State:
        looked.append(len(state.records))
        return taken_in(state, *rest)

    monkeypatch.setattr(films, "taken_in", taken)
    click(film.track.buttons["next_frame"])
    over(film)
    assert looked == [0], "none is known in frame 2"
    assert [record for record in c.records() if record.frame != 2] == sorted(
        [*known, *far], key=key_of
    )


def test_curves_of_an_earlier_tracking_are_in_doubt_where_their_body_is_not_found(
    viewer: Any, film: SplinesketchDock
) -> None:
    c, track = film.controller, film.track.buttons["track"]
    click(track)
    over(film)
    c.review("rejected", (4, 2))
    c.review("accepted", (5, 2))
    viewer.dims.set_point(0, 0)
    first = replace(c.state.by_key[1, 2], frame=0)
    c.apply("Let it leave the image", c.state.with_records(away(first, -45)))
    viewer.dims.set_point(0, 1)
    before = dict(c.state.by_key)
    for _ in range(2):
        click(track)
        over(film)
        assert "Left the image: 2 (frame 3)." in film.notice.text()
    assert c.state.by_key.keys() == before.keys()
    assert c.state.by_key[3, 2].curve.status == "check"
    assert c.state.by_key[3, 2].curve.reasons == (NOT_FOUND,)
    assert all(c.state.by_key[key] is before[key] for key in ((4, 2), (5, 2))), (
        "what was said stays"
    )


def test_what_is_decided_while_tracking_is_a_step_of_its_own(film: SplinesketchDock) -> None:
    controller, whole, turns = film.controller, engine.refine, Semaphore(1)

    def slow(*arguments: Any, **options: Any) -> Refinement:
        turns.acquire(timeout=20)
        return whole(*arguments, **options)

    engine.refine = slow
    click(film.track.buttons["track"])
    until(lambda: (2, 2) in keys(film), 20)
    controller.review("accepted", (1, 1))
    turns.release(3)
    over(film)
    assert keys(film)[-1] == (5, 2)
    click(film.undo)
    click(film.undo)
    assert keys(film)[-1] == (2, 2), "what came after the verdict is taken back first"
    assert controller.records()[0].review == "open"


def test_knots_are_done_when_tracking_begins(viewer: Any, film: SplinesketchDock) -> None:
    controller = film.controller
    controller.select([(1, 1)])
    controller.toggle_knots()
    knots = viewer.layers["film knots of curve 1"]
    moved = knots.data + np.eye(10, 3)[:, [1, 0, 2]]
    knots.data = moved
    knots.events.data(value=moved, action=ActionType.CHANGED, data_indices=(0,), vertex_indices=())
    click(film.track.buttons["track"])
    assert controller.knots is None, "Esc would take back the frames that come"
    assert controller.steps.done == "Move knots of curve 1"
    over(film)
    assert keys(film)[-1] == (5, 2)


def test_drift_is_flagged_and_lost_bodies_are_named(
    viewer: Any, film: SplinesketchDock, fake: FakeEngine, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(import_module("napari_splinesketch.tracking.follow"), "PATIENCE", 2)
    fake.changes = {0: {"half_width": np.full(100, 9.0)}}
    click(film.track.buttons["track"])
    over(film)
    flagged = [r for r in film.controller.records(2) if r.curve.status == "check"]
    assert flagged
    assert "half-width jumped" in flagged[0].curve.reasons[0]
    assert "to check for drift" in film.notice.text()
    assert "Lost: " in film.notice.text()


def test_a_correction_is_carried_around_and_no_further(
    viewer: Any, film: SplinesketchDock, fake: FakeEngine
) -> None:
    controller, button = film.controller, film.track.buttons["around"]
    assert not button.isEnabled()
    assert "no tracked curve of what you drew" in button.toolTip()
    click(film.track.buttons["track"])
    over(film)
    viewer.dims.set_point(0, 4)
    assert not button.isEnabled()
    assert "draw a line over it" in button.toolTip()
    moved = []
    for record in controller.records():
        wrong = record.id == 1 and record.frame in (2, 3)
        points = record.curve.points + np.array([9.0 * wrong, 0])
        moved.append(replace(record, curve=replace(record.curve, points=points)))
        moved[-1] = replace(moved[-1], drawn=(record.frame, record.id) == (4, 1))
    work = controller.work
    assert work is not None
    controller.apply("Correct", replace(work.state, records=tuple(moved)))
    fake.calls.clear()
    click(button)
    over(film)
    assert "Refitted 2 frames around frame 4, from 2 to 3." in film.notice.text()
    assert [len(call["lines"]) for call in fake.calls] == [1] * len(fake.calls)
    after = {(r.frame, r.id): r.curve for r in controller.records()}
    before = {(r.frame, r.id): r.curve for r in moved}
    assert {key for key in after if after[key] is not before[key]} == {(2, 1), (3, 1)}
    np.testing.assert_allclose(after[2, 1].points[0], [20, 20], atol=0.5)
    click(film.undo)
    assert {(r.frame, r.id): r.curve for r in controller.records()} == before


def test_a_curve_that_was_corrected_and_refined_stays_as_it_is(
    viewer: Any, film: SplinesketchDock
) -> None:
    controller, buttons = film.controller, film.track.buttons
    click(buttons["track"])
    over(film)
    viewer.dims.set_point(0, 3)
    controller.select([(3, 2)])
    controller.actions.run("flip")
    turned = controller.state.by_key[3, 2]
    controller.select([(3, 1)])
    edited = commands.edited(controller.records(3)[0], controller.records(3)[0].curve)
    controller.apply("Edit", controller.state.with_records(edited))
    controller.refine("selected")
    over(film)
    mine = controller.state.by_key[3, 1]
    assert mine.curve is not edited.curve
    assert not mine.edited
    assert buttons["around"].isEnabled()
    before = controller.state.by_key[4, 1]
    viewer.dims.set_point(0, 1)
    click(buttons["track"])
    over(film)
    assert controller.records(3) == (mine, turned)
    assert controller.state.by_key[4, 1] is not before


def test_the_end_of_bodies_is_said_and_no_pictures_are_kept() -> None:
    view = partial(View, np.zeros((4, 5)))
    line = LINES[0][:, 1:]
    made, lines = {3: as_drawn(line), 4: as_drawn(line)}, {3: line, 4: line}
    divided = {3: f"{DIVIDED} of 20 and 22 px"}
    results = [
        Tracked(1, made, lines, entered=(np.zeros((2, 2)),), view=view()),
        Tracked(2, {4: made[4]}, lines, missing=divided, lost=frozenset({3}), view=view()),
        Tracked(3, missing={4: LEFT}, lost=frozenset({4}), view=view()),
    ]
    told: list[Any] = []
    elsewhere: Any = SimpleNamespace(
        work=None,
        finish=told.append,
        apply=lambda *step, work: None,
        show=lambda work, last: last(),
    )
    going = Tracking(elsewhere, cast(Any, SimpleNamespace(state=State())), range(4), range(1, 4))
    going.results += results
    pictures = [weakref.ref(one.view) for one in results]
    results.clear()
    going.over()
    assert not going.results
    assert [picture() for picture in pictures] == [None] * 3
    said = told[0]
    assert "Divided: 3 (frame 2). Left the image: 4 (frame 3)." in said
    assert "1 body came into view, without a curve: frame 1." in said


def test_tracking_goes_on_with_what_was_known_before() -> None:
    line = np.array([[5.0, 5], [5, 40]])

    def record(number: int, frame: int, **more: Any) -> Record:
        return Record(number, frame, line, as_drawn(line + np.array([frame, 0.0])), **more)

    records = [*(record(1, t) for t in range(12)), *(record(2, t) for t in range(9))]
    records += [record(3, 2), record(4, 10, review="rejected"), record(4, 9)]
    state = State(records=tuple(records), deleted=(record(5, 11),))
    bodies = {body.id: body for body in bodies_at(state, 11)}
    assert {number: body.misses for number, body in bodies.items()} == {1: 0, 2: 3, 3: 9, 4: 2}
    assert [t for t, _ in bodies[1].seen] == list(range(5, 12))
    backwards = {body.id: body for body in bodies_at(state, 0, -1)}
    assert [t for t, _ in backwards[1].seen] == [6, 5, 4, 3, 2, 1, 0]
    assert bodies_at(replace(state, deleted=(record(2, 11),)), 11)[-1].id != 2
    curve = replace(records[11].curve, reasons=(INFERRED,))
    hidden = replace(records[11], curve=curve, drawn=False)
    for review, misses in (("open", [1]), ("accepted", [0]), ("rejected", [])):
        guessed = State(records=(*records[:11], replace(hidden, review=review)))
        assert [body.misses for body in bodies_at(guessed, 11)] == misses, "not seen there"


def test_buttons_say_why_not(viewer: Any, dock: SplinesketchDock) -> None:
    viewer.add_image(np.zeros((60, 70)), name="still")
    assert not dock.track.isVisible()
    viewer.add_image(np.zeros((3, 60, 70)), name="film")
    assert dock.track.isVisible()
    assert "refine it first" in dock.track.buttons["next_frame"].toolTip()
    viewer.dims.set_point(0, 2)
    assert "last frame" in dock.track.buttons["next_frame"].toolTip()
    assert not dock.track.buttons["track"].isEnabled()


def test_a_frame_of_rejected_curves_is_not_called_empty(film: SplinesketchDock) -> None:
    film.controller.review("rejected", (1, 1), (1, 2))
    for button in film.track.buttons.values():
        assert not button.isEnabled()
    assert "are rejected or failed: redraw one" in film.track.buttons["track"].toolTip()


@pytest.mark.parametrize("labels", [None, ("t", "z", "y", "x")])
def test_a_stack_at_a_single_time_is_tracked_along_its_planes(
    viewer: Any, film: SplinesketchDock, labels: tuple[str, ...] | None
) -> None:
    viewer.layers.clear()
    viewer.add_image(np.zeros((1, 3, 96, 128), np.float32), name="stack", axis_labels=labels)
    lines = [np.insert(line - [1, 0, 0], 0, 0, axis=1) for line in LINES]
    viewer.add_shapes(lines, shape_type="line", name="stack sketches")
    refine(film)
    click(film.track.buttons["track"])
    over(film)
    assert {frame for frame, _ in keys(film)} == {0, 1, 2}


@pytest.mark.parametrize(
    ("labels", "there"), [(("t", "z", "y", "x"), [1, 4, 7]), (("z", "t", "y", "x"), [0, 1, 2])]
)
def test_curves_are_carried_along_time_in_the_plane_in_view(
    viewer: Any, film: SplinesketchDock, labels: tuple[str, ...], there: list[int], tmp_path: Path
) -> None:
    viewer.layers.clear()
    viewer.add_image(np.zeros((3, 3, 96, 128), np.float32), name="film", axis_labels=labels)
    lines = [np.insert(line, 0, 0, axis=1) for line in LINES]
    if labels[0] == "z":
        lines = [line[:, [1, 0, 2, 3]] - [1, 0, 0, 0] for line in lines]
    viewer.add_shapes(lines, shape_type="line", name="film sketches")
    refine(film)
    click(film.track.buttons["next_frame"])
    over(film)
    assert film.controller.frame == there[1]
    assert {frame for frame, _ in keys(film)} == set(there[:2])
    click(film.track.buttons["track"])
    over(film)
    assert film.notice.text().startswith("✓ Tracked to frame 2: "), "by its time"
    assert film.controller.steps.done == "Track to frame 2"
    first = film.controller.state.records[0]
    plane = f"0, z {1 if labels[0] == 't' else 0}"
    film.controller.select([(first.frame, first.id)])
    assert film.curve.title.text() == f"Curve 1 of frame {plane}: good"
    assert times_of(film.controller.image).place(first.frame) == plane
    assert {frame for frame, _ in keys(film)} == set(there)
    data, meta, _ = viewer.layers["film curves"].as_layer_data_tuple()
    saved = labels_of_layer(data, meta).labels
    assert [(label.frame, label.curve) for label in saved] == keys(film)
    assert {label.status for label in saved} == {"good"}
    data, meta, _ = viewer.layers["film sketches"].as_layer_data_tuple()
    with pytest.raises(ValueError, match="have a time and a plane"):
        labels_of_layer(data, meta)
    film.controller.export(tmp_path / "a.csv")
    over(film)
    place = times_of(film.controller.image).place(there[2])
    assert f"over all planes: frame {place} is {there[2]}." in film.notice.text()
    click(film.track.buttons["next_frame"])
    over(film)
    assert film.controller.actions.problem("next_frame") == "This is the last frame"
    click(film.track.buttons["previous_frame"])
    over(film)
    assert film.controller.frame == there[1]

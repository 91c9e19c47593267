"""Many curves: they come and go a few at a time, and only those that changed."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from napari_splinesketch.labels.types import Review
from napari_splinesketch.plugin.commands import Commands
from napari_splinesketch.plugin.controller import Controller
from napari_splinesketch.plugin.dock import SplinesketchDock
from napari_splinesketch.plugin.layers import drawn
from napari_splinesketch.plugin.layers.drawn import CHUNK
from napari_splinesketch.plugin.layers.looks import LETTER, LINE_HEIGHT, MOST, View, readable
from napari_splinesketch.plugin.model import Record

from .fakes import HALF_WIDTH, FakeEngine, as_drawn
from .hand import assert_drawn, click, refine, until

VIEW = View(0, np.zeros(2), np.full(2, 200.0), np.full(2, 0.5))


@pytest.mark.slow
def test_many_curves_come_and_go_a_few_at_a_time(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine
) -> None:
    count = 220
    rows = np.arange(count) * 4.0
    lines = [np.array([[row, 10.0], [row + 1, 60]]) for row in rows]
    viewer.add_image(np.zeros((900, 80), np.float32), name="cells")
    sketches = viewer.add_shapes(lines, shape_type="line", name="cells sketches")
    fake.changes = {3: {"status": "check", "reasons": ("why",)}}
    steps: list[int] = []
    refine(dock)
    curves = viewer.layers["cells curves"]
    assert curves.nshapes == count
    assert list(curves.features["id"]) == list(range(1, count + 1))
    viewer.scene.camera.zoom = 8.0
    viewer.scene.camera.center = (0, *lines[3].mean(axis=0))
    marks = viewer.layers["cells marks"]
    until(lambda: marks.text.values.tolist() == ["4 ?"], 10)
    viewer.scene.camera.center = (0, *lines[200].mean(axis=0))
    until(lambda: len(marks.data) == 0, 10)
    before = list(curves.data)
    curves.events.data.connect(lambda event: steps.append(len(event.data_indices)))
    dock.controller.delete((0, 5), (0, 9))
    until(lambda: curves.nshapes == count - 2, 30)
    assert 5 not in set(curves.features["id"])
    click(dock.undo)
    until(lambda: list(curves.features["id"])[-2:] == [5, 9], 30)
    assert curves.nshapes == count
    assert max(steps) <= CHUNK
    kept = {id(data) for data in curves.data} & {id(data) for data in before}
    assert len(kept) == count - 2
    wanted = {record.id: record.curve.points for record in dock.controller.records()}
    for number, data in zip(curves.features["id"], curves.data, strict=True):
        assert_drawn(data, wanted[number])
    assert len(sketches.data) == count


def test_marks_are_in_view_and_never_overprinted() -> None:
    rng = np.random.default_rng(0)
    places = rng.uniform(0, 400, (1000, 2))
    records = [
        Record(i, i % 2, line, as_drawn(line, status="good" if i % 3 else "check"))
        for i, at in enumerate(places, 1)
        for line in [at + np.array([[0, 0], [0, 30]])]
    ]
    view = View(1, np.array([100.0, 50.0]), np.array([300.0, 350.0]), np.array([0.5, 0.5]))
    found = list(readable(records, view))
    assert 20 < len(found) <= MOST
    assert all(record.frame == 1 and record.curve.status == "check" for record, _ in found)
    at = np.array([place for _, place in found])
    assert (at > view.low).all() and (at < view.high).all()
    apart = np.abs(at[:, None] - at)
    over = (apart[..., 0] < 8) & (apart[..., 1] < 5 * 4.5)
    assert over.sum() <= len(found) + 2 * (apart[..., 1] > 3 * 4.5)[over].sum()


@pytest.mark.parametrize("review", ["accepted", "rejected"])
def test_a_curve_that_was_judged_has_no_mark(review: Review) -> None:
    line = np.array([[100.0, 80], [100, 120]])
    record = Record(7, 0, line, as_drawn(line, status="check"))
    assert list(readable([record], VIEW))
    assert not list(readable([replace(record, review=review)], VIEW))


def test_marks_of_equally_bad_curves_are_spread_over_the_view() -> None:
    view = View(0, np.zeros(2), np.full(2, 1000.0), np.ones(2))
    records = []
    for i in range(1000):
        row, column = divmod(i, 25)
        line = np.array([[25.0 * row + 12, 40 * column + 5], [25 * row + 12, 40 * column + 35]])
        records.append(Record(i + 1, 0, line, as_drawn(line, status="check")))
    found = np.array([place for _, place in readable(records, view)])
    assert len(found) == MOST
    quarters = np.histogram2d(*found.T, bins=2, range=[[0, 1000]] * 2)[0]
    assert quarters.min() >= 0.7 * MOST / 4


def test_a_mark_does_not_lie_on_the_ends_of_a_bent_body() -> None:
    along = np.linspace(-1, 1, 100)
    line = np.column_stack([110 - 30 * np.abs(along), 100 + 10 * along])
    curve = as_drawn(line, points=line, status="check")
    (found,) = readable([Record(7, 0, line, curve)], VIEW)
    size = np.array([LINE_HEIGHT, LETTER * len("7 ?")]) * VIEW.pixel / 2
    inside = np.abs(found[0].curve.points - found[1]) < size
    assert not inside.all(axis=1).any()


def test_a_mark_does_not_lie_on_another_body() -> None:
    lines = [np.array([[row, 80.0], [row, 120.0]]) for row in (100.0, 94.0)]
    low, high = (Record(i, 0, line, as_drawn(line)) for i, line in enumerate(lines, 1))
    low = replace(low, curve=replace(low.curve, status="check"))
    ((_, alone),) = readable([low], VIEW)
    ((_, beside),) = readable([low, high], VIEW)
    assert alone[0] < 100 < beside[0], "below it, as there is another one above"


@pytest.mark.parametrize("turned", [0, 1])
def test_a_mark_lies_beside_its_body_whichever_way_that_runs(turned: int) -> None:
    line = np.roll([[100.0, 80], [100, 120]], turned, axis=1)
    record = Record(12345, 0, line, as_drawn(line, status="check"))
    ((_, place),) = readable([record], VIEW)
    wide = np.array([LINE_HEIGHT, LETTER * len("12345 ?")]) * VIEW.pixel / 2
    clear = np.abs(place - 100)[turned] - HALF_WIDTH - wide[turned]
    assert 0 < clear < 3, "no letter of it lies on the body"


def test_marks_follow_what_is_known(viewer: Any, dock: SplinesketchDock, fake: FakeEngine) -> None:
    viewer.add_image(np.zeros((90, 80), np.float32), name="cells")
    viewer.add_shapes([[[r, 9], [r, 60]] for r in (10, 30, 50)], shape_type="line")
    fake.changes = {1: {"status": "check", "reasons": ("why",)}}
    refine(dock)
    curves = next(layer for layer in viewer.layers if layer.name.endswith("curves"))
    marks = next(layer for layer in viewer.layers if layer.name.endswith("marks"))
    assert marks.text.values.tolist() == ["2 ?"]
    dock.controller.delete((0, 2))
    until(lambda: curves.nshapes == 2, 30)
    until(lambda: len(marks.data) == 0, 30)


def test_lines_that_have_curves_step_back(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine
) -> None:
    viewer.add_image(np.zeros((90, 80), np.float32), name="cells")
    lines = viewer.add_shapes(
        [[[r, 9], [r, 60]] for r in (10, 30)], shape_type="line", edge_color="blue"
    )
    refine(dock)
    lines.add([[50, 9], [50, 60]], shape_type="line", edge_color="blue")
    assert np.round(lines.edge_color[:, 3], 2).tolist() == [0.3, 0.3, 1.0]
    assert (lines.edge_color[:, :3] == [0, 0, 1]).all(), "colours are the user's own"
    dock.controller.delete((0, 1))
    until(lambda: np.round(lines.edge_color[:, 3], 2).tolist() == [1.0, 0.3, 1.0], 20)


def test_with_many_lines_too_the_frame_in_view_is_summed_up_while_something_runs(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(drawn, "MANY", 1)
    viewer.add_image(np.zeros((3, 90, 80), np.float32), name="cells")
    viewer.add_shapes([[[1, r, 9], [1, r, 60]] for r in (10, 30)], shape_type="line")
    viewer.dims.set_point(0, 1)
    until(dock.refine.isEnabled)
    refine(dock)
    assert dock.results.text() == "2 good"
    fake.go.clear()
    dock.controller.refine("all")
    viewer.dims.set_point(0, 2)
    until(lambda: not dock.results.text(), 20)
    fake.go.set()


def test_each_part_of_the_dock_listens_to_what_it_shows(
    viewer: Any, dock: SplinesketchDock, monkeypatch: pytest.MonkeyPatch
) -> None:
    viewer.add_image(np.zeros((90, 80), np.float32), name="cells")
    viewer.add_shapes([[[r, 9], [r, 60]] for r in (10, 30)], shape_type="line")
    refine(dock)
    asked: list[str] = []
    problem, request = Commands.problem, Controller.request
    monkeypatch.setattr(Commands, "problem", lambda c, n: asked.append(n) or problem(c, n))
    monkeypatch.setattr(
        Controller, "request", lambda c, *s: asked.append("request") or request(c, *s)
    )
    changes = dock.controller.changes
    for signal in (changes.progress, changes.said, changes.shown):
        signal.emit()
    assert not asked
    dock.controller.select([(0, 2)])
    assert asked == list(dock.curve.buttons), "no plan is made for a selection"
    asked.clear()
    changes.curves.emit()
    assert asked.count("refine") == 1, "and each is asked once"
    assert "(W)" in dock.suggest.toolTip()
    dock.controller.choose(keys={"suggest": "Y"})
    assert "(Y)" in dock.suggest.toolTip(), "tooltips follow the keys"

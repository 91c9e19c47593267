"""Only what is new is refined; the rest takes part as it is."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from napari.utils.interactions import mouse_press_callbacks
from qtpy.QtCore import Qt

from napari_splinesketch.plugin.dock import SplinesketchDock
from napari_splinesketch.plugin.layers.drawn import FADED, new_sketch_layer
from napari_splinesketch.plugin.layers.space import go_to_frame
from napari_splinesketch.plugin.words import to_do

from .bench import SOON, Bench, bench
from .fakes import FakeEngine, as_drawn
from .hand import QTest, canvas, canvas_point, choose, click, draw, fit_view, refine, until

LINES = [np.array([[20.0, 20], [20, 60]]), np.array([[50.0, 30], [60, 70], [80, 80]])]
THIRD = [[30, 90], [70, 100]]


def sketched(viewer: Any) -> Any:
    rng = np.random.default_rng(0)
    viewer.add_image(rng.normal(100, 5, (96, 128)).astype(np.float32), name="cells")
    return viewer.add_shapes(LINES, shape_type=["line", "path"], name="cells sketches")


@pytest.mark.slow
@pytest.mark.window
def test_new_lines_join_the_finished_ones(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine
) -> None:
    layer = sketched(viewer)
    fit_view(viewer)
    refine(dock)
    assert not dock.refine.isEnabled()
    assert "Every line here has its curve" in dock.hint.text()
    draw(viewer, layer, THIRD)
    assert dock.refine.text() == "Refine 1 new line"
    dock.controller.review("accepted", (0, 1))
    QTest.keyClick(canvas(viewer), Qt.Key.Key_G)
    until(lambda: len(dock.controller.records()) == 3, 20)
    until(lambda: not dock.controller.progress, 20)
    assert [len(call["lines"]) for call in fake.calls] == [2, 1]
    assert len(fake.calls[1]["fixed"]) == 2
    assert dock.controller.records()[0].review == "accepted"
    layer.mode = "select"
    layer.selected_data = {0}
    assert not dock.refine.isEnabled()
    assert "an accepted or locked curve. Reject or unlock" in dock.hint.text()
    layer.selected_data = set()
    choose(dock, "Refine all")
    until(lambda: not dock.controller.progress, 20)
    assert len(fake.calls[2]["fixed"]) == 1
    dock.controller.select([(0, 3)])
    choose(dock, "Refine selected")
    until(lambda: not dock.controller.progress, 20)
    assert [len(call["lines"]) for call in fake.calls] == [2, 1, 2, 1]


@pytest.mark.slow
@pytest.mark.window
def test_lines_are_refined_as_they_are_drawn(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine
) -> None:
    layer = sketched(viewer)
    fit_view(viewer)
    viewer.layers.selection.active = layer
    layer.mode = "add_line"
    QTest.keyClick(canvas(viewer), Qt.Key.Key_G, Qt.KeyboardModifier.ShiftModifier)
    assert dock.at_once.isChecked()
    until(lambda: len(dock.controller.records()) == 2, 20)
    until(lambda: not dock.controller.progress, 20)
    fake.go.clear()
    draw(viewer, layer, THIRD)
    until(lambda: len(fake.calls) == 2, 20)
    draw(viewer, layer, [[80, 20], [60, 15]])
    fake.go.set()
    until(lambda: len(dock.controller.records()) == 4, 20)
    until(lambda: not dock.controller.progress, 20)
    assert [len(call["lines"]) for call in fake.calls] == [2, 1, 1]
    click(dock.at_once)
    assert not dock.controller.at_once
    draw(viewer, layer, [[10, 90], [10, 110]])
    QTest.qWait(50)
    assert len(fake.calls) == 3
    assert layer.mode == "add_line"


def test_a_line_drawn_again_beside_a_new_one_leaves_nothing_to_refine(
    qapp: Any, fake: FakeEngine
) -> None:
    with bench() as made:
        made.begin()
        layer = made.controller.sketches
        assert layer is not None
        layer.add_paths([np.array(THIRD) + 10.0, LINES[0] + 1])
        made.refine()
        assert [record.id for record in made.controller.records()] == [1, 2, 3]
        assert [record.id for record in made.controller.state.deleted] == [4]
        assert not made.controller.request().targets, "each line has its curve, or had one"


@pytest.mark.parametrize("by", [[[0, 0], [4, 3]], [[2, 2], [2, 2]], [[1, 0], [0, 0]]])
def test_a_line_moved_and_another_drawn_over_its_body_leave_nothing_to_refine(
    qapp: Any, fake: FakeEngine, by: Any
) -> None:
    with bench() as made:
        made.begin()
        layer = made.controller.sketches
        assert layer is not None
        layer.data = [layer.data[0] + by, layer.data[1]]
        layer.add(LINES[0] + 1, shape_type="line")
        made.refine()
        np.testing.assert_allclose(made.controller.records()[0].sketch, LINES[0] + 1)
        assert not made.controller.request().targets, "the line that was moved is left alone"
        assert made.controller.request().deleted == 1
        made.controller.undo()
        assert len(made.controller.request().targets) == 1


def test_a_line_drawn_again_replaces_the_curve_in_one_step(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine
) -> None:
    layer = sketched(viewer)
    refine(dock)
    before = dock.controller.records()
    layer.add([[21, 22], [20, 62]], shape_type="line")
    assert dock.refine.text() == "Refine 1 changed"
    refine(dock)
    assert [record.id for record in dock.controller.records()] == [1, 2]
    assert np.allclose(dock.controller.records()[0].sketch, [[21, 22], [20, 62]])
    assert not dock.refine.isEnabled(), "the old line is left alone"
    assert "Left out: 1 line with a deleted or replaced curve" in dock.hint.text()
    dock.controller.refine("all")
    until(lambda: not dock.controller.progress, 20)
    assert len(dock.controller.records()) == 2
    click(dock.undo)
    click(dock.undo)
    assert dock.controller.records() == before
    layer.add([[26, 20], [26, 60]], shape_type="line")
    refine(dock)
    assert len(dock.controller.records()) == 3, "a body beside it, not the same"


@pytest.mark.slow
@pytest.mark.window
def test_a_path_that_is_given_up_leaves_nothing_behind(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine
) -> None:
    layer = sketched(viewer)
    fit_view(viewer)
    layer.mode = "add_path"
    surface, where = canvas(viewer), canvas_point(viewer, (80, 20))
    QTest.mouseMove(surface, where)
    QTest.mouseClick(surface, Qt.MouseButton.LeftButton, pos=where)
    assert layer.nshapes == 3
    QTest.keyClick(surface, Qt.Key.Key_Escape)
    assert layer.nshapes == 2
    draw(viewer, layer, THIRD)
    refine(dock)
    assert dock.results.text() == "3 good"
    assert "could not be shown" not in dock.notice.text()
    until(lambda: np.allclose(layer.edge_color[:3, 3], FADED), 20)


def test_what_is_decided_while_curves_are_refined_stays(qapp: Any, fake: FakeEngine) -> None:
    with bench() as made:
        made.image()
        made.sketches([np.array([[y, 20.0], [y, 60]]) for y in (10.0, 30, 50, 70)])
        made.refine()
        fake.curve = lambda line, **how: as_drawn(line + 1, **how)
        fake.go.clear()
        c = made.controller
        c.refine("all")
        c.review("accepted", (0, 1))
        c.review("rejected", (0, 2))
        c.delete((0, 3))
        decided = c.state
        fake.go.set()
        made.rest()
        assert c.records()[:2] == decided.records[:2]
        assert c.state.deleted == decided.deleted
        assert [record.curve.points[0, 0] for record in c.records()] == [10, 30, 71]
        assert c.notice.text.endswith(", without 3 curves that you decided on.")
        assert c.steps.done == "Refine curve 4"
        c.undo()
        assert c.state is decided


def test_a_line_over_which_the_frame_was_changed_is_in_the_last_one(
    qapp: Any, fake: FakeEngine
) -> None:
    with bench() as made:
        image = made.image((3, 96, 128))
        layer: Any = new_sketch_layer(made.viewer, image)
        layer.add_lines(np.array([[0.0, 20, 20], [0, 20, 60]]))
        made.click(layer, (0, 50, 20), (0, 50, 40))
        go_to_frame(made.viewer, image, 1)
        made.click(layer, (1, 50, 60), (1, 50, 80))
        layer.remove([])  # ends it, as Enter does
        until(lambda: made.controller.request().targets)
        assert layer.shape_type == ["line", "path"]
        assert [set(line[:, 0]) for line in layer.data] == [{0.0}, {1.0}]
        made.refine()
        assert [record.frame for record in made.controller.records()] == [1]


def test_a_line_that_is_being_drawn_waits_until_it_is_finished(qapp: Any, fake: FakeEngine) -> None:
    with bench() as made:
        made.begin()
        layer, controller = made.controller.sketches, made.controller
        assert layer is not None
        made.click(layer, (80, 20))
        said = to_do(controller.request())
        assert "stray" not in said and "a polyline ends with a double click" in said
        made.click(layer, (80, 40), (90, 60))
        controller.toggle_at_once()
        assert controller.progress is None and len(fake.calls) == 1
        layer.remove([])  # ends it, as Enter does
        until(lambda: len(fake.calls) == 2, SOON)
        made.rest()
        assert len(controller.records()) == 3
        assert "polyline" not in to_do(controller.request())


def give_up(made: Bench, layer: Any) -> list[int]:
    """End a polyline, as Enter does, after one vertex; give the lines that there are."""
    made.click(layer, (0, 80, 20))
    assert layer.nshapes == 3
    layer.remove([])
    return [0, 1]


def remove_a_vertex(made: Bench, layer: Any) -> list[int]:
    """Take a vertex of the first line, which had two, by napari's tool; give what is left."""
    layer.mode = "vertex_remove"
    made.viewer.layers.selection.active = layer
    press = {"position": (0, 20, 20), "view_direction": None, "dims_displayed": [1, 2]}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(type(layer), "get_value", lambda *_, **__: (0, 0))
        mouse_press_callbacks(layer, SimpleNamespace(**press, modifiers=(), type="mouse_press"))
    return [1]


@pytest.mark.parametrize("lose", [give_up, remove_a_vertex])
def test_lines_outlive_one_that_is_no_more_and_a_view_in_3d(
    lose: Callable[[Bench, Any], list[int]], qapp: Any, fake: FakeEngine
) -> None:
    with bench() as made:
        made.image((3, 96, 128))
        lines = [np.insert(line, 0, 0, axis=1) for line in LINES]
        layer: Any = made.sketches(lines)
        layer.features = {"id": [7, 8]}
        left = lose(made, layer)
        until(lambda: len(layer.edge_color) == len(layer.features) == len(left), SOON)
        for axes in (3, 2):
            made.viewer.dims.ndisplay = axes
        for i, there in zip(left, layer.data, strict=True):
            np.testing.assert_array_equal(there, lines[i])
        if lose is give_up:  # napari drops the wrong row where it takes a line from the middle
            assert [*layer.features["id"]] == [7, 8]

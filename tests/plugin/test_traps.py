"""What users do while a refinement runs."""

from typing import Any

import numpy as np
import pytest

from napari_splinesketch.plugin.dock import SplinesketchDock
from napari_splinesketch.plugin.layers.pictures import ASKED
from napari_splinesketch.plugin.layers.results import OVER

from .fakes import FakeEngine
from .hand import QTest, add_dock, click, draw, drawn, fit_view, refine, refine_all, rest, until

LINES = [np.array([[1.0, 20.0, 20], [1, 20, 60]]), np.array([[1.0, 50, 30], [1, 80, 80]])]


@pytest.fixture
def running(viewer: Any, dock: SplinesketchDock, fake: FakeEngine) -> Any:
    """A film whose refinement has begun."""
    viewer.add_image(np.random.default_rng(0).random((3, 96, 128)), name="film")
    layer = viewer.add_shapes(LINES, shape_type="line", name="film sketches")
    viewer.dims.set_point(0, 1)
    fake.go.clear()
    click(dock.refine)
    until(lambda: fake.calls)
    return layer


def finish(dock: SplinesketchDock, fake: FakeEngine) -> None:
    fake.go.set()
    until(lambda: dock.controller.progress is None)


def check_result(viewer: Any) -> None:
    curves = viewer.layers["film curves"]
    assert curves.nshapes == 2
    for line, curve in zip(LINES, curves.data, strict=True):
        np.testing.assert_allclose(curve[[0, -1]], line, atol=1e-4)


@pytest.mark.parametrize(
    "error", [RuntimeError("XLA ran out"), ValueError("bad"), KeyError("k"), MemoryError("full")]
)
def test_an_error_of_the_engine_lets_go_of_the_widget(
    viewer: Any,
    dock: SplinesketchDock,
    fake: FakeEngine,
    running: Any,
    error: Exception,
    caplog: pytest.LogCaptureFixture,
) -> None:
    fake.error = error
    finish(dock, fake)
    assert type(error).__name__ in dock.notice.text()
    assert [record.exc_info and record.exc_info[1] for record in caplog.records] == [error]
    assert "Refining failed. No curve was refined." in dock.notice.text()
    assert dock.refine.isEnabled()
    assert len(viewer.layers) == 2
    fake.error = None
    refine(dock)
    check_result(viewer)
    assert "Refined 2 curves" in dock.notice.text()


def test_changing_the_frame(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine, running: Any
) -> None:
    viewer.dims.set_point(0, 2)
    finish(dock, fake)
    check_result(viewer)
    assert not dock.results.isVisible(), "this frame has none"
    viewer.dims.set_point(0, 1)
    assert dock.results.text() == "2 good"
    film = viewer.layers["film reconstruction"].data
    assert np.isnan(film[2]).all()
    assert np.isfinite(film[1]).all()


def test_editing_the_sketches(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine, running: Any
) -> None:
    running.data = [line + np.array([0, 9, 9]) for line in LINES]
    running.add([[1, 5, 5], [1, 5, 50]], shape_type="line")
    edited = drawn(running)
    finish(dock, fake)
    check_result(viewer)
    for old, new in zip(edited, running.data, strict=True):
        np.testing.assert_array_equal(old, new)
    assert dock.refine.text() == "Refine 1 new, 2 changed"


@pytest.mark.slow
@pytest.mark.window
def test_drawing_goes_on(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine, running: Any
) -> None:
    fit_view(viewer)
    draw(viewer, running, [[30, 30], [60, 50]])
    finish(dock, fake)
    assert viewer.layers.selection.active is running
    assert running.mode == "add_line"
    draw(viewer, running, [[40, 90], [70, 110]])
    assert running.nshapes == 4
    assert {shape[0, 0] for shape in running.data} == {1.0}


def test_renaming_layers(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine, running: Any
) -> None:
    running.name = "mine"
    viewer.layers["film"].name = "other"
    finish(dock, fake)
    check_result(viewer)
    viewer.layers["film curves"].name = "the curves"
    refine_all(dock)
    assert len(viewer.layers) == 7, "they are known whatever their names"
    assert viewer.layers["the curves"].nshapes == 2


@pytest.mark.parametrize("name", ["film", "film sketches"])
def test_deleting_a_layer(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine, running: Any, name: str
) -> None:
    viewer.layers.remove(name)
    finish(dock, fake)
    assert len(viewer.layers) == 1
    assert "was removed" in dock.notice.text()
    assert not dock.refine.isEnabled()


def test_deleting_the_curves_ends_what_makes_more_of_them(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine, running: Any
) -> None:
    finish(dock, fake)
    check_result(viewer)
    fake.go.clear()
    dock.controller.refine("all")
    until(lambda: len(fake.calls) == 2)
    viewer.layers.remove("film curves")
    finish(dock, fake)
    until(lambda: "gone with their layer" in dock.notice.text(), 20)
    QTest.qWait(100)
    assert not dock.controller.records()
    dock.controller.undo()
    until(lambda: "film curves" in viewer.layers and not dock.controller.drawing.runs, 20)
    check_result(viewer)


def test_deleting_the_curves_looks_through_them_once(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine, running: Any, monkeypatch: Any
) -> None:
    finish(dock, fake)
    check_result(viewer)
    asked, plan = [], dock.controller.plan
    counted = lambda state, *rest: asked.append(len(state.records)) or plan(state, *rest)  # noqa: E731
    monkeypatch.setattr(dock.controller, "plan", counted)
    viewer.layers.remove("film curves")
    told = len(asked)
    until(lambda: "gone with their layer" in dock.notice.text(), 20)
    assert told
    assert not any(asked[told:])


def test_deleting_all_layers_and_beginning_anew(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine, running: Any
) -> None:
    viewer.layers.clear()
    viewer.add_image(np.zeros((30, 40)), name="new")
    finish(dock, fake)
    viewer.add_shapes([[[2, 2], [20, 30]]], shape_type="line", name="new sketches")
    refine(dock)
    assert viewer.layers["new curves"].nshapes == 1


def test_a_double_click_refines_once(
    dock: SplinesketchDock, fake: FakeEngine, running: Any
) -> None:
    click(dock.refine)
    dock.controller.refine()
    finish(dock, fake)
    assert len(fake.calls) == 1


@pytest.mark.slow
@pytest.mark.window(shown=True)
def test_closing_the_dock(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine, running: Any
) -> None:
    viewer.window.remove_dock_widget(dock)
    until(lambda: fake.calls[0].get("cancelled"), 5)
    QTest.qWait(100)
    assert len(viewer.layers) == 2
    fake.go.set()
    viewer.dims.set_point(0, 0)
    viewer.dims.set_point(0, 1)
    again = add_dock(viewer)
    refine(again)
    check_result(viewer)


@pytest.mark.window(shown=True)
def test_closing_the_window(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine, running: Any
) -> None:
    viewer.close()
    until(lambda: fake.calls[0].get("cancelled"), 5)
    QTest.qWait(100)


@pytest.mark.slow
@pytest.mark.window(shown=True)
def test_closing_the_window_while_results_are_drawn(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine, running: Any
) -> None:
    fake.go.set()
    until(lambda: "film outlines" in viewer.layers)
    assert dock.controller.progress, "the curves are still to come"
    viewer.close()
    QTest.qWait(200)


def test_deleting_the_image_while_results_are_drawn(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine, running: Any
) -> None:
    fake.go.set()
    until(lambda: "film outlines" in viewer.layers)
    viewer.layers.remove("film")
    until(lambda: dock.controller.progress is None)
    assert "film curves" not in viewer.layers
    assert not dock.refine.isEnabled()


def test_cancelling_twice_and_running_again_at_once(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine, running: Any
) -> None:
    dock.controller.cancel()
    dock.controller.cancel()
    click(dock.refine)
    until(lambda: len(fake.calls) == 2)
    finish(dock, fake)
    check_result(viewer)
    assert len(viewer.layers) == 7


def test_results_follow_an_image_that_becomes_a_film(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine
) -> None:
    picture = np.random.default_rng(0).random((96, 128))
    image = viewer.add_image(picture, name="worms")
    sketches = viewer.add_shapes([line[:, 1:] for line in LINES], shape_type="line", name="s")
    refine(dock)
    for data in (np.stack([picture] * 3), picture, picture[None]):
        image.data = data
        until(lambda: not dock.controller.drawing.runs, 20)
        layers = [dock.controller.work.layer(role) for role in OVER]  # type: ignore[union-attr]
        assert all(layer.visible and layer.ndim == image.ndim for layer in layers)
        assert viewer.layers["s reconstruction"].ndim == image.ndim
        assert viewer.dims.nsteps == data.shape, "nothing lies outside of the image"
        for line, curve in zip(LINES, layers[1].data, strict=True):
            np.testing.assert_allclose(curve[[0, -1], -2:], line[:, 1:], atol=1e-4)
    assert sketches.nshapes == 2


@pytest.mark.parametrize(
    "placed",
    [{"scale": (0.5, 0.25), "units": "um"}, {"translate": (9, -7), "rotate": 30}],
    ids=["scaled", "turned"],
)
def test_results_follow_an_image_that_is_placed_elsewhere(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine, placed: dict[str, Any]
) -> None:
    image = viewer.add_image(np.random.default_rng(0).random((96, 128)), name="worms")
    sketches = viewer.add_shapes([line[:, 1:] for line in LINES], shape_type="line", name="s")
    refine(dock)
    for entry in dock.eyes.entries.values():
        entry.trigger()
    until(lambda: not dock.controller.drawing.runs, 20)
    own = [layer for layer in viewer.layers if layer not in (image, sketches)]
    assert len(own) == len(OVER) + 1 + len(ASKED)
    for name, value in placed.items():
        setattr(image, name, value)
    place = np.array([3.0, 5.0])

    def lies_on_it(layer: Any) -> bool:
        return np.allclose(layer.data_to_world(place), image.data_to_world(place))

    until(lambda: all(map(lies_on_it, own)), 5)
    assert {layer.units for layer in own} == {image.units}
    viewer.layers["s reconstruction"].translate = 50, 0
    viewer.scene.camera.zoom *= 2
    QTest.qWait(60)
    assert viewer.layers["s reconstruction"].translate[0] == 50, "beside it: the user's choice"
    np.testing.assert_array_equal(sketches.data[0], LINES[0][:, 1:])


def test_layers_that_were_being_added_are_shown_by_what_comes_next(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine, running: Any
) -> None:
    fake.go.set()
    until(lambda: any("outlines" in layer.name for layer in viewer.layers))
    work = dock.controller.work
    assert work is not None
    dock.controller.show(work)
    until(lambda: not dock.controller.drawing.runs, 20)
    assert all(work.layer(role).visible for role in OVER)


def test_curves_that_come_while_the_view_is_3d_are_shown_in_2d(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine
) -> None:
    viewer.add_image(np.random.default_rng(0).random((96, 128)), name="worms")
    viewer.add_shapes([line[:, 1:] for line in LINES], shape_type="line", name="worms sketches")
    fake.go.clear()
    click(dock.refine)
    viewer.dims.ndisplay = 3
    fake.go.set()
    rest(dock)
    assert dock.controller.notice.text.startswith("Refined 2 curves")
    viewer.dims.ndisplay = 2
    until(lambda: "worms curves" in viewer.layers and viewer.layers["worms curves"].nshapes == 2)


@pytest.mark.parametrize("hidden_in", [2, 3])
def test_curves_that_were_hidden_while_the_view_was_turned_are_changed(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine, running: Any, hidden_in: int
) -> None:
    finish(dock, fake)
    until(lambda: not dock.controller.drawing.runs)
    viewer.dims.ndisplay = hidden_in
    viewer.layers["film curves"].visible = False
    viewer.dims.ndisplay = 5 - hidden_in
    dock.controller.select([(1, 1)])
    dock.controller.actions.run("flip")
    until(lambda: not dock.controller.drawing.runs)
    assert dock.controller.notice.text == ""
    assert viewer.layers["film curves"].nshapes == 2
    viewer.layers["film curves"].visible = True
    viewer.dims.ndisplay = 2


def test_nothing_is_cut_or_extended_where_the_pointer_shows_no_place(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine, running: Any
) -> None:
    finish(dock, fake)
    controller = dock.controller
    before = controller.state
    controller.select([(1, 1)])
    for view, said in ({"ndisplay": 3}, "2-D"), ({"ndisplay": 2, "order": (1, 0, 2)}, "sliders"):
        for name, value in view.items():
            setattr(viewer.dims, name, value)
        for command in ("split", "extend"):
            controller.tell()
            controller.actions.run(command)
            assert said in controller.notice.text
    assert controller.state is before


@pytest.mark.window
def test_linked_layers_are_drawn_into_after_a_view_in_3d(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine
) -> None:
    viewer.add_image(np.zeros((96, 128)), name="worms")
    lines = [line[:, 1:] for line in LINES]
    sketches = viewer.add_shapes(lines, shape_type="line", name="worms sketches")
    refine(dock)
    viewer.layers.link_layers(list(viewer.layers))
    for axes in (3, 2):
        viewer.dims.ndisplay = axes
        QTest.qWait(20)
    dock.controller.draw()
    assert sketches.mode == "add_line"
    assert not viewer.layers["worms curves"].editable


@pytest.mark.slow
@pytest.mark.window(shown=True)
def test_the_view_is_turned_to_3d_and_back(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine
) -> None:
    viewer.add_image(np.random.default_rng(0).random((96, 128)), name="worms")
    viewer.add_shapes([line[:, 1:] for line in LINES], shape_type="line", name="worms sketches")
    refine(dock)
    for axes in (3, 2):
        viewer.dims.ndisplay = axes
        QTest.qWait(200)  # an error while it is drawn would fail this test
    assert dock.results.text() == "2 good"

"""Suggest in the window: ordinary lines, taken back by one step, never in the user's way."""

import gc
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from types import SimpleNamespace
from typing import Any
from weakref import ref

import numpy as np
import pytest
from qtpy.QtCore import Qt

from napari_splinesketch import suggest
from napari_splinesketch.data import load_sample
from napari_splinesketch.engine.find.suggest import Suggestions
from napari_splinesketch.engine.types import OnProgress, Progress
from napari_splinesketch.plugin import engine, words
from napari_splinesketch.plugin.dock import SplinesketchDock

from .bench import LINES, SOON, Bench, bench
from .fakes import FakeEngine
from .hand import QTest, canvas, click, draw, drawn, fit_view, refine, until

CONTROL, SHIFT = Qt.KeyboardModifier.ControlModifier, Qt.KeyboardModifier.ShiftModifier
PLACE = {"scale": (1, 0.5, 0.25), "translate": (0, 3, -4)}


@pytest.fixture(scope="module")
def film() -> np.ndarray:
    return load_sample("worms_swimming")[0][:2, 100:200, 60:200].copy()


def press_suggest(dock: SplinesketchDock) -> None:
    assert dock.suggest.isEnabled(), dock.suggest.toolTip()
    click(dock.suggest)
    until(lambda: dock.controller.progress is None, 60)


def test_suggested_lines_are_lines_like_any_other(
    viewer: Any, dock: SplinesketchDock, film: np.ndarray
) -> None:
    image = viewer.add_image(film, name="worms", **PLACE)
    fit_view(viewer)
    viewer.dims.set_point(0, 1)
    press_suggest(dock)
    layer = viewer.layers["worms sketches"]
    wanted = suggest(film[1])
    assert len(wanted) > 4
    assert f"Suggested {len(wanted)} lines" in dock.notice.text()
    for line, expected in zip(drawn(layer), wanted, strict=True):
        assert (line[:, 0] == 1).all()
        pixels = np.array([image.world_to_data(layer.data_to_world(point)) for point in line])
        np.testing.assert_allclose(pixels[:, 1:], expected, atol=1e-3)
    assert dock.refine.text() == f"Refine {len(wanted)} new lines"
    refine(dock)
    assert len(dock.controller.records()) == len(wanted)


def test_lines_that_are_suggested_are_seen_though_the_others_were_hidden(
    viewer: Any, dock: SplinesketchDock, film: np.ndarray
) -> None:
    viewer.add_image(np.full((60, 70), 5, np.uint8), name="blank")
    image = viewer.add_image(film[0], name="worms")
    dock.controller.draw()
    layer = viewer.layers["worms sketches"]
    layer.visible = False
    dock.controller.image = viewer.layers["blank"]
    press_suggest(dock)
    assert not layer.visible, "there are none to be seen"
    dock.controller.image = image
    press_suggest(dock)
    assert layer.nshapes
    assert layer.visible


@pytest.mark.window
def test_one_undo_takes_them_all_back_but_not_what_was_drawn(
    viewer: Any, dock: SplinesketchDock, film: np.ndarray
) -> None:
    viewer.add_image(film[0], name="worms")
    fit_view(viewer)
    click(dock.draw)
    layer = viewer.layers["worms sketches"]
    draw(viewer, layer, [(5, 5), (9, 60)])
    press_suggest(dock)
    count = layer.nshapes - 1
    assert count > 4
    moved = drawn(layer)
    moved[2] = moved[2] + 4
    layer.data = moved
    viewer.layers.selection.active = layer
    QTest.keyClick(canvas(viewer), Qt.Key.Key_Z, CONTROL)
    until(lambda: layer.nshapes == 2, 20)
    np.testing.assert_allclose(drawn(layer)[1], moved[2])
    QTest.keyClick(canvas(viewer), Qt.Key.Key_Z, CONTROL | SHIFT)
    until(lambda: layer.nshapes == count + 1, 20)
    until(lambda: not dock.controller.drawing.runs, 20)
    assert layer.nshapes == count + 1, "one that was moved does not come back beside itself"


def test_lines_that_are_being_added_all_come_whatever_is_done_meanwhile(
    viewer: Any, dock: SplinesketchDock
) -> None:
    viewer.add_image(np.zeros((600, 100)), name="worms")
    controller = dock.controller
    controller.draw()
    work, layer = controller.work, viewer.layers["worms sketches"]
    assert work is not None
    lines = [np.array([[row, 10.0], [row, 60.0]]) for row in range(0, 600, 4)]
    controller.apply("Suggest lines", work.state.suggested(0, lines))
    until(lambda: layer.nshapes)
    assert layer.nshapes < len(lines), "they come a few at a time"
    controller.apply("Something else", work.state)
    until(lambda: work not in controller.drawing.runs)
    assert layer.nshapes == len(lines)
    controller.undo()
    controller.undo()
    until(lambda: layer.nshapes == 0)
    controller.redo()
    until(lambda: 0 < layer.nshapes < len(lines))
    controller.undo()
    until(lambda: work not in controller.drawing.runs)
    assert layer.nshapes == 0


@pytest.mark.slow
def test_suggesting_again_leaves_what_is_there_and_replaces_what_was_only_suggested(
    viewer: Any, dock: SplinesketchDock
) -> None:
    viewer.add_image(load_sample("worms_swimming")[0][0], name="worms")
    fit_view(viewer)
    slider = dock.sensitivity
    QTest.keyClick(slider, Qt.Key.Key_Home)
    assert dock.controller.suggestions.sensitivity == 0
    press_suggest(dock)
    layer = viewer.layers["worms sketches"]
    few = layer.nshapes
    layer.selected_data = {0}
    layer.mode = "select"
    viewer.layers.selection.active = layer
    refine(dock)
    assert len(dock.controller.records()) == 1
    layer.selected_data = set()
    QTest.keyClick(slider, Qt.Key.Key_End)
    assert dock.controller.suggestions.sensitivity == 1
    press_suggest(dock)
    assert layer.nshapes >= few
    lines = [np.round(line, 2).tobytes() for line in drawn(layer)]
    assert len(set(lines)) == len(lines)
    assert len(dock.controller.request().targets) == layer.nshapes - 1


def test_nothing_new_is_said_and_cancel_changes_nothing(
    viewer: Any, dock: SplinesketchDock, film: np.ndarray, fake: FakeEngine
) -> None:
    assert not dock.suggest.isEnabled()
    assert "Open an image" in dock.suggest.toolTip()
    viewer.add_image(np.full((60, 70), 5, np.uint8), name="blank")
    press_suggest(dock)
    assert "No further body stands out" in dock.notice.text()
    assert "Settings" not in dock.notice.text()
    assert not dock.undo.isVisible()
    viewer.add_image(film[0], name="worms")
    dock.controller.suggestions.suggest()
    click(dock.cancel)
    QTest.qWait(1500)
    assert "Nothing was changed" in dock.notice.text()
    assert all(layer.nshapes == 0 for layer in viewer.layers if hasattr(layer, "nshapes"))


def test_the_slider_previews_as_it_moves_without_looking_at_the_image_again(
    viewer: Any, dock: SplinesketchDock, monkeypatch: pytest.MonkeyPatch
) -> None:
    viewer.add_image(load_sample("worms_swimming")[0][0], name="worms")
    prepare, looked = import_module("napari_splinesketch.engine.find.suggest").prepare, []
    monkeypatch.setattr(
        "napari_splinesketch.engine.find.suggest.prepare",
        lambda *given, **how: looked.append(1) or prepare(*given, **how),
    )
    press_suggest(dock)
    layer, slider = viewer.layers["worms sketches"], dock.sensitivity
    usual = layer.nshapes
    QTest.keyClick(slider, Qt.Key.Key_Home)
    until(lambda: 0 < layer.nshapes < usual, 20)
    until(lambda: f"Suggested {layer.nshapes} lines" in dock.notice.text(), 20)
    assert layer.nshapes < usual
    QTest.keyClick(slider, Qt.Key.Key_End)
    until(lambda: layer.nshapes > usual, 20)
    assert len(looked) == 1
    until(lambda: dock.undo.isEnabled(), 20)
    click(dock.undo)
    until(lambda: layer.nshapes == 0, 20)
    assert not dock.undo.isEnabled(), "however far it was moved, it is one step"


def deleted_and_moved(viewer: Any, dock: SplinesketchDock) -> tuple[Any, int, Any, Any]:
    """Suggest lines, and delete the first and move the second; gives how many and which they were.

    First comes their layer.
    """
    viewer.add_image(load_sample("worms_swimming")[0][0], name="worms")
    press_suggest(dock)
    layer = viewer.layers["worms sketches"]
    usual, (gone, moved, *_) = layer.nshapes, drawn(layer)
    layer.data = [moved + 4, *drawn(layer)[2:]]
    return layer, usual, gone, moved


@pytest.mark.slow
def test_the_slider_leaves_alone_what_was_refined_moved_or_deleted(
    viewer: Any, dock: SplinesketchDock
) -> None:
    layer, usual, gone, moved = deleted_and_moved(viewer, dock)
    slider = dock.sensitivity
    viewer.layers.selection.active, layer.mode, layer.selected_data = layer, "select", {2, 3}
    refine(dock)
    QTest.keyClick(slider, Qt.Key.Key_End)
    until(lambda: layer.nshapes > usual, 20)
    until(lambda: not dock.controller.drawing.runs, 20)
    fresh = layer.nshapes - 3
    assert f"Suggested {fresh} lines" in dock.notice.text(), "not those refined, moved or deleted"
    lines = [np.round(line, 2).tobytes() for line in drawn(layer)]
    assert len(set(lines)) == len(lines), "no line is there twice"
    assert not {np.round(line, 2).tobytes() for line in (gone, moved)} & {*lines}
    click(dock.undo)
    until(lambda: layer.nshapes == usual - 1, 20)
    assert len(dock.controller.records()) == 2
    assert not dock.controller.request().orphans, "lines of curves stay"
    press_suggest(dock)
    assert np.round(gone, 2).tobytes() in {np.round(line, 2).tobytes() for line in drawn(layer)}


def test_the_slider_never_brings_back_what_was_moved_or_deleted(
    viewer: Any, dock: SplinesketchDock
) -> None:
    layer, usual, gone, moved = deleted_and_moved(viewer, dock)
    slider = dock.sensitivity
    QTest.keyClick(slider, Qt.Key.Key_Home)
    until(lambda: layer.nshapes < usual, 20)
    until(lambda: not dock.controller.drawing.runs, 20)
    QTest.keyClick(slider, Qt.Key.Key_End)
    until(lambda: layer.nshapes > usual, 20)
    until(lambda: not dock.controller.drawing.runs, 20)
    lines = {np.round(line, 2).tobytes() for line in drawn(layer)}
    assert not {np.round(line, 2).tobytes() for line in (gone, moved)} & lines
    assert np.round(moved + 4, 2).tobytes() in lines


def test_the_slider_is_no_part_of_a_step_in_another_frame(
    viewer: Any, dock: SplinesketchDock, film: np.ndarray
) -> None:
    viewer.add_image(film, name="worms")
    press_suggest(dock)
    layer, slider = viewer.layers["worms sketches"], dock.sensitivity
    first = layer.nshapes
    viewer.dims.set_point(0, 1)
    press_suggest(dock)
    click(dock.undo)
    until(lambda: layer.nshapes == first, 20)
    QTest.keyClick(slider, Qt.Key.Key_End)
    until(lambda: layer.nshapes > first, 20)
    until(lambda: not dock.controller.drawing.runs, 20)
    click(dock.undo)
    until(lambda: layer.nshapes == first, 20)


@contextmanager
def suggesting(monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    """A bench with an image in which up to four lines are found, as many as are asked for."""
    lines = [np.array([[10.0 * i, 5], [10.0 * i, 60]]) for i in range(1, 5)]
    found = SimpleNamespace(choose=lambda some: lines[: int(4 * some)])
    monkeypatch.setattr(engine, "suggest", lambda *task: found)
    with bench() as made:
        made.image()
        yield made


def test_suggested_lines_are_not_refined_as_if_they_were_drawn(
    qapp: Any, fake: FakeEngine, monkeypatch: pytest.MonkeyPatch
) -> None:
    with suggesting(monkeypatch) as made:
        layer, c = made.sketches([]), made.controller
        c.toggle_at_once()
        c.suggestions.suggest()
        made.rest()
        c.suggestions.change_sensitivity(1.0)
        until(lambda: layer.nshapes == 4, SOON)
        c.undo()
        until(lambda: not layer.nshapes, SOON)
        c.redo()
        until(lambda: layer.nshapes == 4, SOON)
        QTest.qWait(50)
        assert not fake.calls
        layer.add_paths([np.array([[80.0, 5], [80, 60]])])
        until(lambda: c.records(), SOON)


def test_what_was_deleted_in_one_frame_stays_so_when_lines_are_suggested_in_another(
    qapp: Any, fake: FakeEngine, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = Suggestions(tuple(LINES), np.ones(len(LINES)))
    monkeypatch.setattr(engine, "suggest", lambda *task: found)
    with bench() as made:
        made.image((2, 96, 128))
        c = made.controller
        c.suggestions.suggest()
        made.rest()
        layer = c.sketches
        assert layer is not None
        count = layer.nshapes
        layer.remove([0])
        made.viewer.dims.set_point(0, 1)
        c.suggestions.suggest()
        made.rest()
        frames = [int(shape[0, 0]) for shape in layer.data]
        assert (frames.count(0), frames.count(1)) == (count - 1, count)


def test_the_slider_is_followed_when_what_runs_has_ended(
    qapp: Any, fake: FakeEngine, monkeypatch: pytest.MonkeyPatch
) -> None:
    with suggesting(monkeypatch) as made:
        layer, c = made.sketches([]), made.controller
        c.suggestions.suggest()
        made.rest()
        fake.go.clear()
        c.refine()
        c.suggestions.change_sensitivity(1.0)
        QTest.qWait(100)
        assert layer.nshapes == 2
        fake.go.set()
        until(lambda: layer.nshapes == 4, SOON)
        assert len(c.records()) == 2


def test_the_slider_changes_nothing_in_a_frame_that_is_not_in_view(
    viewer: Any, dock: SplinesketchDock, film: np.ndarray
) -> None:
    viewer.add_image(film, name="worms")
    press_suggest(dock)
    layer, slider = viewer.layers["worms sketches"], dock.sensitivity
    usual = layer.nshapes
    viewer.dims.set_point(0, 1)
    QTest.keyClick(slider, Qt.Key.Key_End)
    QTest.qWait(300)
    assert layer.nshapes == usual
    assert dock.controller.suggestions.sensitivity == 1
    assert dock.controller.notice.text == words.NEXT_TIME
    viewer.dims.set_point(0, 0)
    QTest.keyClick(slider, Qt.Key.Key_Home)
    QTest.keyClick(slider, Qt.Key.Key_End)
    until(lambda: layer.nshapes > usual, 20)


def test_lines_go_into_the_layer_that_they_were_suggested_for(
    qapp: Any, fake: FakeEngine, monkeypatch: pytest.MonkeyPatch
) -> None:
    go = threading.Event()

    def held(*task: Any) -> Any:
        assert go.wait(SOON)
        return Suggestions(tuple(LINES), np.ones(len(LINES)))

    monkeypatch.setattr(engine, "suggest", held)
    with bench() as made:
        made.image()
        mine = made.sketches([], name="mine")
        made.controller.suggestions.suggest()
        other = made.sketches([], name="other")
        go.set()
        made.rest()
        assert (mine.nshapes, other.nshapes) == (2, 0)
        made.controller.sketches = mine
        made.controller.undo()
        until(lambda: mine.nshapes == 0, SOON)


def test_no_line_is_suggested_that_would_replace_a_curve(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine
) -> None:
    image = np.random.default_rng(0).normal(0, 0.05, (60, 120))
    image[29:32, 20:61] += 1
    image[9:12, 40:101] += 1
    viewer.add_image(image, name="worms")
    fit_view(viewer)
    longer = np.array([[30.0, 20.0], [30.0, 82.0]])
    viewer.add_shapes([longer], shape_type="path", name="worms sketches")
    refine(dock)
    assert len(dock.controller.records()) == 1
    press_suggest(dock)
    assert "Suggested 1 line" in dock.notice.text()
    refine(dock)
    assert len(dock.controller.records()) == 2


def test_suggested_lines_that_were_refined_stay_whatever_a_layer_rounds_them_to(
    qapp: Any, fake: FakeEngine, monkeypatch: pytest.MonkeyPatch
) -> None:
    line = np.array([[100.02499999, 20.0], [100.02499999, 90.0]])
    assert np.round(line, 2).tobytes() != np.round(np.float32(line).astype(float), 2).tobytes()
    answers = [Suggestions((), np.ones(0)), Suggestions((line,), np.ones(1))]
    monkeypatch.setattr(engine, "suggest", lambda *task: answers.pop())
    with bench() as made:
        made.image((200, 128))
        layer = made.sketches([])
        made.controller.suggestions.suggest()
        made.rest()
        made.refine()
        made.controller.suggestions.suggest()
        made.rest()
        assert layer.nshapes == len(made.controller.records()) == 1


def test_a_polyline_that_is_being_drawn_outlives_other_suggestions(
    qapp: Any, fake: FakeEngine, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = Suggestions(tuple(LINES), np.array([0.9, 0.4]))
    monkeypatch.setattr(engine, "suggest", lambda *task: found)
    monkeypatch.setattr(Suggestions, "choose", lambda self, share: LINES[: round(2 * share)])
    with bench() as made:
        made.image()
        layer = made.sketches([np.array([[10.0, 10], [10, 90]])])
        made.controller.suggestions.sensitivity = 1
        made.controller.suggestions.suggest()
        made.rest()
        made.click(layer, (80, 20), (80, 40), (90, 60))
        made.controller.suggestions.change_sensitivity(0)
        until(lambda: layer.nshapes == 2, SOON)
        assert made.controller.notice.kind == "done"
        assert [line[-1].tolist() for line in layer.data] == [[10, 90], [80, 40]]
        made.click(layer, (30, 20), (30, 40), (30, 60))
        assert layer.nshapes == 3


def test_suggest_is_stopped_and_a_second_press_waits_for_the_first_to_end(
    qapp: Any, fake: FakeEngine, monkeypatch: pytest.MonkeyPatch
) -> None:
    inside, most, told = list[int](), list[int](), list[bool | None]()
    go = threading.Event()

    def prepare(image: np.ndarray, *, on_progress: OnProgress, **how: Any) -> Suggestions:
        inside.append(1)
        most.append(len(inside))
        assert go.wait(SOON)
        told.append(on_progress(Progress("looking for bodies", 0.5)))
        inside.pop()
        return Suggestions(tuple(LINES), np.ones(len(LINES)))

    monkeypatch.setattr("napari_splinesketch.engine.find.suggest.prepare", prepare)
    with bench() as made:
        made.image()
        layer, c = made.sketches([]), made.controller
        c.suggestions.suggest()
        c.suggestions.suggest()
        until(lambda: most, SOON)
        c.cancel()
        assert c.notice.text == "Cancelled. Nothing was changed."
        c.suggestions.suggest()
        until(lambda: c.progress and c.progress.stage == "waiting for what was cancelled", SOON)
        c.cancel()
        c.suggestions.suggest()
        go.set()
        made.rest()
        until(lambda: layer.nshapes == len(LINES), SOON)
    assert told == [False, True], "the one that was cancelled while it waited never began"
    assert max(most) == 1


def test_the_end_of_the_slider_promises_nothing_fainter() -> None:
    assert words.suggested(0, 0.5).endswith("to find fainter ones.")
    assert words.suggested(0, 1) == "No further body stands out."
    assert words.suggested(1, 1).startswith("Suggested 1 line. ")


def test_a_half_width_of_other_images_is_named_where_it_finds_nothing(
    viewer: Any, dock: SplinesketchDock, film: np.ndarray
) -> None:
    dock.controller.choose(half_width=9.0, half_width_unit="px")
    viewer.add_image(film[0], name="worms")
    press_suggest(dock)
    assert "Only bodies as described under Settings are looked for." in dock.notice.text()
    controller = dock.controller
    controller.choose(half_width=0.0)
    controller.suggestions.change_sensitivity(0.6)
    controller.tell()
    until(lambda: controller.notice.text, SOON)
    assert "Only bodies as described" in controller.notice.text, "as when lines were looked for"


@pytest.mark.slow
@pytest.mark.garbage
def test_an_image_that_is_removed_goes_from_memory(
    viewer: Any, dock: SplinesketchDock, film: np.ndarray
) -> None:
    image = ref(viewer.add_image(film[0].copy(), name="worms"))
    press_suggest(dock)
    viewer.layers.clear()
    until(lambda: gc.collect() >= 0 and image() is None, SOON)


def test_lines_that_have_become_curves_stay_in_a_layer_that_lies_elsewhere(
    qapp: Any, fake: FakeEngine, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As napari's button makes it beside an image with a place on its stage."""
    places = np.random.default_rng(1).uniform(20, 480, (60, 1, 2))
    lines = tuple(np.array([[0.0, 0], [3, 17], [5, 31]]) + places)
    found = [Suggestions(lines, np.ones(len(lines))), Suggestions((), np.zeros(0))]
    monkeypatch.setattr(engine, "suggest", lambda *task: found.pop(0))
    with bench() as made:
        image = made.image((512, 512))
        image.scale, image.translate = np.array([0.3, 0.3]), np.array([5000.0, 8000.0])
        layer = made.sketches([])
        layer.scale = image.scale
        made.controller.suggestions.suggest()
        until(lambda: layer.nshapes == len(lines) and not made.controller.progress, SOON)
        made.refine()
        made.controller.suggestions.suggest()
        made.rest()
        until(lambda: not made.controller.drawing.runs, SOON)
        assert layer.nshapes == len(lines)
        assert not made.controller.request().orphans

"""Correcting curves with mouse and keys, in a real window."""

from typing import Any

import numpy as np
import pytest
from napari.layers import Points
from napari.utils.key_bindings import coerce_keybinding
from qtpy.QtCore import QPoint, Qt

from napari_splinesketch.plugin.commands import pick
from napari_splinesketch.plugin.dock import SplinesketchDock
from napari_splinesketch.plugin.knots import SIZE
from napari_splinesketch.plugin.widgets import CommandButton

from .bench import SOON, bench
from .fakes import FakeEngine
from .hand import LEFT, NO_KEY, QTest, canvas, canvas_point, click, fit_view, refine, until

SHIFT = Qt.KeyboardModifier.ShiftModifier
LINES = [np.array([[1.0, 20, 20], [1, 20, 90]]), np.array([[1.0, 60, 20], [1, 60, 90]])]
ENDS = [line[[0, -1], 1:] for line in LINES]


class Hand:
    """Points, clicks and presses keys over the canvas."""

    def __init__(self, viewer: Any):
        self.viewer = viewer

    def point(self, row: float, col: float) -> QPoint:
        where = canvas_point(self.viewer, (2 * row, 2 * col))
        QTest.mouseMove(canvas(self.viewer), where)
        QTest.qWait(20)
        return where

    def click(self, row: float, col: float, modifiers: Any = NO_KEY) -> None:
        QTest.mouseClick(canvas(self.viewer), LEFT, modifiers, self.point(row, col))

    def drag(self, begin: tuple[float, float], end: tuple[float, float]) -> None:
        QTest.mousePress(canvas(self.viewer), LEFT, NO_KEY, self.point(*begin))
        for share in (0.5, 1.0):
            self.point(*(np.array(begin) + share * (np.array(end) - begin)))
        QTest.mouseRelease(canvas(self.viewer), LEFT, NO_KEY, self.point(*end))
        QTest.qWait(20)

    def press(self, key: str, modifiers: Any = NO_KEY) -> None:
        QTest.keyClick(canvas(self.viewer), getattr(Qt.Key, f"Key_{key}"), modifiers)


@pytest.fixture
def hand(viewer: Any, dock: SplinesketchDock) -> Hand:
    """Two refined lines in the second frame of a film of large pixels; curves can be clicked."""
    pixels = np.random.default_rng(0).random((3, 96, 128)).astype(np.float32)
    viewer.add_image(pixels, name="film", scale=(1, 2, 2))
    viewer.add_shapes(LINES, shape_type="line", name="film sketches", scale=(1, 2, 2))
    viewer.dims.set_point(0, 1)
    refine(dock)
    fit_view(viewer)
    made = Hand(viewer)
    viewer.layers.selection.active = viewer.layers["film sketches"]
    viewer.layers["film sketches"].mode = "add_line"
    made.press("H")
    assert viewer.layers.selection.active is viewer.layers["film curves"]
    return made


def ends(dock: SplinesketchDock) -> dict[int, Any]:
    return {r.id: np.round(r.curve.points[[0, -1]]).tolist() for r in dock.controller.records()}


def settled(dock: SplinesketchDock, number: int) -> None:
    shapes: Any = dock.controller.viewer.layers["film curves"]
    until(lambda: shapes.nshapes == number, 20)
    until(lambda: not dock.controller.progress, 20)


@pytest.mark.slow
@pytest.mark.window(shown=True)
def test_keys_act_on_the_curve_under_the_mouse(dock: SplinesketchDock, hand: Hand) -> None:
    controller = dock.controller
    for key, modifiers, done in (
        ("K", SHIFT, "Lock curve 2"),
        ("K", SHIFT, "Unlock curve 2"),
        ("H", SHIFT, "Flip curve 2"),
        ("Q", SHIFT, "Delete curve 2"),
        ("W", SHIFT, "Restore curve 2"),
    ):
        controller.select([])
        hand.point(60, 50)
        hand.press(key, modifiers)
        assert controller.steps.done == done
    controller.select([])
    hand.press("U")
    assert controller.knots
    hand.press("U")
    hand.point(90, 120)
    for key in "KQHU":
        controller.select([])
        hand.press(key, SHIFT)
        assert "or point at it" in dock.notice.text()
        controller.tell()


@pytest.mark.slow
@pytest.mark.window
def test_selecting_and_turning(viewer: Any, dock: SplinesketchDock, hand: Hand) -> None:
    controller = dock.controller
    hand.click(60, 50)
    assert controller.selection == ((1, 2),)
    assert "Curve 2" in dock.curve.title.text()
    until(lambda: "film selected" in viewer.layers, 5)
    curves, mark = viewer.layers["film curves"], viewer.layers["film selected"]
    until(lambda: mark.edge_width, 5)
    curve = dock.controller.records()[1].curve
    away = np.linalg.norm(mark.data[:, 0, 1:, None] - curve.points.T, axis=1).min(axis=1)
    assert away.min() > curve.half_width.max() + mark.edge_width / 2, "nothing lies on the body"
    assert mark.edge_width < curves.edge_width[1], "it is thin"
    hand.press("H", SHIFT)
    assert ends(dock) == {1: ENDS[0].tolist(), 2: ENDS[1][::-1].tolist()}
    hand.click(20, 50, SHIFT)
    assert set(controller.selection) == {(1, 1), (1, 2)}
    hand.press("K", SHIFT)
    assert all(record.locked for record in controller.records())
    hand.press("H", SHIFT)
    assert "locked" in dock.notice.text()
    assert ends(dock)[1] == ENDS[0].tolist()
    click(dock.curve.buttons["lock"])
    hand.click(80, 100)
    assert controller.selection == ()
    assert not dock.curve.buttons["flip"].isEnabled()
    assert not mark.edge_width, "nothing is marked"
    hand.drag((60, 50), (70, 60))
    assert controller.selection == (), "moving the camera selects nothing"
    hand.press("H")
    lines = viewer.layers["film sketches"]
    assert viewer.layers.selection.active is lines
    assert lines.mode == "add_line"
    viewer.scene.camera.zoom /= 3
    hand.click(60, 50)
    until(lambda: controller.selection == ((1, 2),), 5)
    hand.click(20, 50, SHIFT)
    until(lambda: controller.selection == ((1, 2), (1, 1)), 5)
    assert lines.nshapes == 2, "a click selects while drawing, too, and is no line at any zoom"
    until(lambda: mark.edge_width, 5)
    before = mark.edge_width
    viewer.scene.camera.zoom /= 3
    until(lambda: mark.edge_width > 2.5 * before, 5)
    shown = mark.edge_width * viewer.scene.camera.zoom * mark.scale[-2:].mean()
    assert shown > 1.8, "it is seen at any zoom, px of the screen"
    size = viewer.scene.camera.zoom * curves.scale[-2:].mean()
    assert size * min(curves.edge_width) > 1.3, "and so are the curves"
    assert size * max(curves.edge_width) < 4.0, "which are no broader than the eye needs"
    hand.drag((30, 30), (50, 50))
    assert lines.nshapes == 3, "a short line is one"


@pytest.mark.slow
@pytest.mark.window(shown=True)
def test_splitting_joining_and_deleting(
    viewer: Any, dock: SplinesketchDock, hand: Hand, fake: FakeEngine
) -> None:
    controller = dock.controller
    hand.point(20, 40)
    hand.press("U", SHIFT)
    settled(dock, 3)
    assert ends(dock)[1] == [[20, 20], [20, 40]]
    assert ends(dock)[3] == [[20, 40], [20, 90]]
    assert set(controller.selection) == {(1, 1), (1, 3)}
    assert dock.refine.text() == "Refine 2 changed"
    hand.press("G")
    settled(dock, 3)
    begins = [np.round(line[[0, -1]]).tolist() for line in fake.calls[1]["lines"]]
    assert begins == [[[20, 20], [20, 40]], [[20, 40], [20, 90]]]
    assert len(fake.calls[1]["fixed"]) == 1
    assert not dock.refine.isEnabled()
    controller.select([(1, 1), (1, 3)])
    hand.press("J", SHIFT)
    settled(dock, 2)
    assert ends(dock) == {1: ENDS[0].tolist(), 2: ENDS[1].tolist()}
    hand.press("J", SHIFT)
    assert "Select two curves" in dock.notice.text()
    hand.press("Delete")
    settled(dock, 1)
    until(lambda: list(ends(dock)) == [2], 20)
    assert "1 line with a deleted or replaced curve" in dock.hint.text(), "it stays deleted"
    click(dock.curve.buttons["restore"])
    settled(dock, 2)
    for _ in range(5):
        click(dock.undo)
    settled(dock, 2)
    assert ends(dock) == {1: ENDS[0].tolist(), 2: ENDS[1].tolist()}
    assert controller.work and controller.work.history.done == "Refine 2 curves"


@pytest.mark.slow
@pytest.mark.window
def test_an_end_is_extended_and_refined(
    viewer: Any, dock: SplinesketchDock, hand: Hand, fake: FakeEngine
) -> None:
    hand.click(60, 85)
    hand.press("N", SHIFT)
    settled(dock, 2)
    assert ends(dock)[2] == [[60, 20], [60, 94]], "by the body's width"
    assert len(fake.calls[1]["lines"]) == 1
    assert dock.controller.work and dock.controller.work.history.done == "Refine curve 2"


@pytest.mark.slow
@pytest.mark.window
def test_knots_lead_a_curve(
    viewer: Any, dock: SplinesketchDock, hand: Hand, fake: FakeEngine
) -> None:
    controller = dock.controller
    hand.press("U")
    assert "Select one curve" in dock.notice.text()
    hand.click(60, 50)
    hand.press("U")
    name = "film knots of curve 2"
    knots = viewer.layers[name]
    assert viewer.layers.selection.active is knots
    assert knots.data.shape == (10, 3)
    assert "Drag the knots" in dock.notice.text()
    assert knots.mode == "select"
    assert dock.refine.text() == "Refine curve 2"
    for zoom in (1.0, 2.0):  # a border is at least half of the least size on the screen
        viewer.scene.camera.zoom = zoom
        assert knots.canvas_size_limits[0] < SIZE / 4
        np.testing.assert_allclose(knots.size * 2 * zoom, SIZE, rtol=1e-5)
    hand.press("Escape")
    viewer.scene.camera.zoom = 0.1
    hand.press("U")
    knots = viewer.layers[name]
    apart = np.linalg.norm(np.diff(knots.data[:, 1:], axis=0), axis=1) * 2
    assert np.median(apart) * viewer.scene.camera.zoom > 1.9 * SIZE, "they can be told apart"
    fit_view(viewer)
    before = controller.work and controller.work.state
    shown: list[float] = []
    preview = viewer.layers["film on the way"]
    preview.events.data.connect(lambda event: shown.append(preview.data[:, 0, 1].max()))
    place = tuple(knots.data[5, 1:])
    hand.drag(place, (place[0] + 12, place[1]))
    until(lambda: dock.undo.isEnabled(), 20)
    np.testing.assert_allclose(knots.data[5], (1, place[0] + 12, place[1]), atol=0.6)
    assert len(shown) >= 2, "it is drawn while it moves"
    assert shown[-1] == pytest.approx(place[0] + 12, abs=0.7)
    hand.press("Z", Qt.KeyboardModifier.ControlModifier)
    assert viewer.layers[name].data[5, 1] == pytest.approx(60)
    assert controller.work and controller.work.state is before
    hand.press("Z", SHIFT | Qt.KeyboardModifier.ControlModifier)
    assert viewer.layers[name].data[5, 1] == pytest.approx(place[0] + 12, abs=0.7)
    hand.press("Return")
    settled(dock, 2)
    assert name not in viewer.layers
    (line,) = fake.calls[1]["lines"]
    assert line[:, 0].max() == pytest.approx(72, abs=1)
    assert len(fake.calls[1]["fixed"]) == 1
    np.testing.assert_array_equal(controller.records()[0].curve.points[:, 0], 20)
    assert viewer.layers.selection.active.name == "film curves"


@pytest.mark.slow
@pytest.mark.window
def test_knots_that_are_taken_back_or_kept(
    viewer: Any, dock: SplinesketchDock, hand: Hand, fake: FakeEngine
) -> None:
    controller = dock.controller
    hand.click(60, 50)
    click(dock.curve.buttons["knots"])
    name = "film knots of curve 2"
    place = tuple(viewer.layers[name].data[5, 1:])
    hand.drag(place, (place[0] + 12, place[1]))
    hand.press("Escape")
    assert name not in viewer.layers
    assert controller.records()[1].curve.status == "good"
    assert not controller.steps.undone, "nor is it done again"
    hand.press("U")
    viewer.layers[name].selected_data = {5}
    viewer.layers[name].remove_selected()
    until(lambda: dock.controller.steps.done == "Move knots of curve 2", 20)
    assert len(viewer.layers[name].data) == 9
    hand.press("U")
    until(lambda: len(controller.records()[1].curve.knots) == 9, 20)
    assert controller.records()[1].curve.status == "check"
    np.testing.assert_array_equal(controller.records()[1].curve.half_width, 2)
    assert dock.refine.text() == "Refine 1 changed"
    hand.press("U")
    dropped = np.add(viewer.layers[name].data, [0, 5, 0])
    viewer.layers[name].data = dropped
    controller.toggle_knots()
    knots = controller.records()[1].curve.knots[:, 0]
    np.testing.assert_allclose(knots, dropped[:, 1], err_msg="what was dropped just before is kept")
    hand.press("U")
    viewer.layers.remove(name)
    assert not controller.knots
    assert "film on the way" not in viewer.layers
    assert len(fake.calls) == 1


def test_the_key_that_selects_all_shapes_selects_all_curves_of_the_frame(
    qapp: Any, fake: FakeEngine
) -> None:
    with bench() as made:
        made.begin()
        controller = made.controller
        assert controller.work is not None
        curves = controller.work.layer("curves")
        curves.keymap[coerce_keybinding("A")](curves)
        assert controller.selection == ((0, 1), (0, 2))
        controller.delete()
        until(lambda: not controller.drawing.runs, SOON)
        assert curves.nshapes == 0
        controller.undo()
        until(lambda: curves.nshapes == 2, SOON)
        assert len(controller.selection) == 2


def test_a_locked_curve_is_not_deleted(qapp: Any, fake: FakeEngine) -> None:
    with bench() as made:
        made.begin()
        controller = made.controller
        controller.lock(True, (0, 2))
        controller.select([(0, 1), (0, 2)])
        controller.actions.run("delete")
        assert controller.notice.text == "Curve 2 is locked."
        controller.changes.erased.emit()  # Delete in the layer of curves
        assert [record.id for record in controller.records()] == [1, 2]
        controller.lock(False)
        controller.actions.run("delete")
        assert not controller.records()


def test_buttons_cut_and_extend_where_the_curve_was_clicked(qapp: Any, fake: FakeEngine) -> None:
    with bench() as made:
        made.begin()
        controller = made.controller
        controller.select([(0, 1)])
        split, extend = (CommandButton(controller.actions, name) for name in ("split", "extend"))
        made.viewer.cursor.position = (50, 127)  # on the way to the button
        for button in (split, extend):
            click(button)
            assert "Click the curve there first" in controller.notice.text
        made.viewer.cursor.position = (20, 30)
        pick(controller)
        made.viewer.cursor.position = (50, 127)
        click(extend)
        made.rest()
        assert controller.records()[0].curve.points[:, 1].min() < 20
        click(split)
        first = controller.records()[0].curve.points[:, 1]
        assert abs(first.max() - 30) < 1


def test_undo_says_what_it_took_back_though_it_puts_the_knots_away(
    qapp: Any, fake: FakeEngine
) -> None:
    with bench() as made:
        made.begin()
        made.controller.select([(0, 1)])
        made.controller.toggle_knots()
        assert "Drag the knots" in made.controller.notice.text
        made.controller.undo()
        assert not made.controller.knots
        assert made.controller.notice.text == "Undone: refine 2 curves."


def test_the_knots_of_a_locked_curve_are_not_shown(qapp: Any, fake: FakeEngine) -> None:
    with bench() as made:
        made.begin()
        made.controller.select([(0, 2)])
        made.controller.lock(True)
        made.controller.actions.run("knots")
        assert not made.controller.knots
        assert made.controller.notice.text == "Curve 2 is locked."


def test_knots_that_were_only_looked_at_leave_what_can_be_redone(
    qapp: Any, fake: FakeEngine
) -> None:
    with bench() as made:
        made.begin()
        controller = made.controller
        controller.select([(0, 1)])
        controller.toggle_knots()
        layer: Any = made.viewer.layers.selection.active
        layer.data = layer.data + 3.0
        controller.toggle_knots()
        controller.undo()
        controller.toggle_knots()
        assert controller.knots
        controller.knots.discard()
        assert controller.steps.undone == "Move knots of curve 1"


def test_escape_keeps_what_was_done_with_the_knots_before(qapp: Any, fake: FakeEngine) -> None:
    with bench() as made:
        made.begin()
        controller = made.controller
        controller.select([(0, 1)])

        def move() -> None:
            layer: Any = made.viewer.layers.selection.active
            layer.data = layer.data + 3.0
            until(lambda: controller.records()[0].edited, 5)

        controller.toggle_knots()
        move()
        controller.toggle_knots()
        kept = controller.records()[0].curve
        controller.lock(True, (0, 2))
        controller.toggle_knots()
        controller.undo()  # the lock
        move()
        until(lambda: controller.records()[0].curve is not kept, 5)
        assert controller.knots
        controller.knots.discard()
        assert controller.records()[0].curve is kept


def test_knots_are_put_away_whatever_is_selected(qapp: Any, fake: FakeEngine) -> None:
    with bench() as made:
        made.begin()
        controller = made.controller
        controller.select([(0, 1)])
        controller.toggle_knots()
        made.viewer.cursor.position = (20, 30)
        controller.actions.run("split")
        assert len(controller.selection) == 2
        done = CommandButton(controller.actions, "knots")
        assert done.text() == "Done"
        click(done)
        assert not controller.knots


def test_knots_are_not_pasted(qapp: Any, fake: FakeEngine) -> None:
    with bench() as made:
        made.begin()
        made.controller.select([(0, 1)])
        made.controller.toggle_knots()
        layer = made.viewer.layers.selection.active
        assert isinstance(layer, Points)
        layer.selected_data = set(range(len(layer.data)))
        layer._copy_data()
        layer.keymap[coerce_keybinding("Control-V")](layer)
        assert len(layer.data) == len(made.controller.records()[0].curve.knots)


def test_knots_follow_their_image(qapp: Any, fake: FakeEngine) -> None:
    with bench() as made:
        made.begin()
        image: Any = made.controller.image
        made.controller.select([(0, 1)])
        made.controller.toggle_knots()
        knots, curves = made.viewer.layers.selection.active, made.viewer.layers["sketches curves"]
        assert isinstance(knots, Points)
        image.scale, image.translate, image.rotate = (0.5, 0.5), (10, 5), 30
        until(lambda: np.allclose(curves.data_to_world((7, 8)), image.data_to_world((7, 8))), 5)
        assert np.allclose(knots.data_to_world((7, 8)), image.data_to_world((7, 8)))


def test_delete_takes_no_line_unseen_where_a_curve_was_selected_while_drawing(
    qapp: Any, fake: FakeEngine
) -> None:
    with bench() as made:
        made.begin()
        layer: Any = made.controller.sketches
        layer.mode = "add_line"
        layer.add_lines([[[10, 10], [10, 90]]])
        layer.selected_data = {2}  # as napari leaves it
        made.refine()
        made.controller.actions.run("next")
        assert made.controller.selection == ((0, 1),)
        layer.remove_selected()
        assert layer.nshapes == 3

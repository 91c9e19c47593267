"""Selecting, judging, deleting, and taking it back, in a real window."""

from typing import Any

import numpy as np
import pytest
from qtpy.QtCore import Qt

from napari_splinesketch.plugin.dock import SplinesketchDock

from .fakes import FakeEngine
from .hand import QTest, canvas, canvas_point, click, fit_view, refine, until

CONTROL, SHIFT = Qt.KeyboardModifier.ControlModifier, Qt.KeyboardModifier.ShiftModifier
LINES = [np.array([[20.0, 20], [20, 60]]), np.array([[50.0, 30], [60, 70], [80, 80]])]


def sketched(viewer: Any) -> Any:
    rng = np.random.default_rng(0)
    viewer.add_image(rng.normal(100, 5, (96, 128)).astype(np.float32), name="cells")
    return viewer.add_shapes(LINES, shape_type=["line", "path"], name="cells sketches")


def press(viewer: Any, key: Any, modifiers: Any = Qt.KeyboardModifier.NoModifier) -> None:
    QTest.keyClick(canvas(viewer), key, modifiers)


@pytest.mark.slow
@pytest.mark.window
def test_steps_are_taken_back_by_keys_and_buttons(viewer: Any, dock: SplinesketchDock) -> None:
    sketches = sketched(viewer)
    refine(dock)
    controller, curves = dock.controller, viewer.layers["cells curves"]
    assert dock.undo.toolTip() == "Undo the last step (Ctrl+Z): refine 2 curves"
    controller.review("accepted", (0, 1))
    controller.lock(True, (0, 2))
    until(lambda: list(curves.features["review"]) == ["accepted", "open"])
    until(lambda: list(curves.features["locked"]) == [False, True])
    viewer.layers.selection.active = curves
    controller.select([(0, 1)])
    press(viewer, Qt.Key.Key_Delete)
    until(lambda: curves.nshapes == 1, 20)
    until(lambda: [r.id for r in controller.records()] == [2], 20)
    press(viewer, Qt.Key.Key_Z, CONTROL)
    until(lambda: curves.nshapes == 2, 20)
    assert controller.records()[0].review == "accepted"
    assert "Undone: delete curve 1" in dock.notice.text()
    press(viewer, Qt.Key.Key_Z, CONTROL | SHIFT)
    until(lambda: curves.nshapes == 1, 20)
    click(dock.undo)
    click(dock.undo)
    assert not controller.records()[1].locked
    click(dock.undo)
    assert controller.records()[0].review == "open"
    viewer.layers.selection.active = sketches
    press(viewer, Qt.Key.Key_Z, CONTROL)
    assert not controller.records()
    until(lambda: curves.nshapes == 0)
    assert "cells reconstruction" not in viewer.layers
    assert not dock.undo.isEnabled()
    click(dock.redo)
    until(lambda: curves.nshapes == 2, 20)
    until(lambda: "cells reconstruction" in viewer.layers)


@pytest.mark.slow
@pytest.mark.window
def test_other_layers_keep_their_own_undo(viewer: Any, dock: SplinesketchDock) -> None:
    sketched(viewer)
    refine(dock)
    labels = viewer.add_labels(np.zeros((96, 128), int), name="painted")
    labels.paint((5, 5), 1)
    press(viewer, Qt.Key.Key_Z, CONTROL)
    assert labels.data[5, 5] == 0
    assert len(dock.controller.records()) == 2
    viewer.add_points([[1, 1]], name="other")
    press(viewer, Qt.Key.Key_Z, CONTROL)
    assert len(dock.controller.records()) == 2
    viewer.window.remove_dock_widget(dock)
    viewer.layers.selection.active = viewer.layers["cells curves"]
    press(viewer, Qt.Key.Key_Z, CONTROL)
    QTest.qWait(100)
    assert viewer.layers["cells curves"].nshapes == 2, "a dock that is closed hears no keys"


@pytest.mark.slow
@pytest.mark.window
def test_the_selection_is_the_same_everywhere(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine
) -> None:
    sketched(viewer)
    refine(dock)
    controller, curves = dock.controller, viewer.layers["cells curves"]
    heard: list[Any] = []
    controller.changes.selection.connect(lambda: heard.append(controller.selection))
    controller.select([(0, 2)])
    controller.select([(0, 1)])
    assert heard == [((0, 2),), ((0, 1),)]
    controller.select([(0, 1), (0, 2)])
    assert controller.selection == ((0, 1), (0, 2))
    fit_view(viewer)
    viewer.layers.selection.active = curves
    QTest.mouseClick(canvas(viewer), Qt.MouseButton.LeftButton, pos=canvas_point(viewer, (20, 40)))
    assert controller.selection == ((0, 1),)
    controller.delete()
    assert not controller.selection
    until(lambda: curves.nshapes == 1, 20)
    controller.restore()
    assert controller.selection == ((0, 1),)
    until(lambda: curves.nshapes == 2)


def test_what_is_said_of_a_curve_again_is_no_step(viewer: Any, dock: SplinesketchDock) -> None:
    sketched(viewer)
    refine(dock)
    controller = dock.controller
    controller.select([(0, 1)])
    for _ in range(4):  # the last ones where no curve is left
        controller.actions.run("accept")
    assert [record.review for record in controller.records()] == ["accepted", "accepted"]
    assert "No curve is left" in dock.notice.text()
    controller.undo()
    assert [record.review for record in controller.records()] == ["accepted", "open"]

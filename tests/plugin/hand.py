"""A hand that uses the window: mouse, keys, patience."""

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from napari import Viewer
from napari.layers import Layer, Shapes
from qtpy import QtTest
from qtpy.QtCore import QPoint, Qt

from napari_splinesketch.geometry import SEEN
from napari_splinesketch.plugin.dock import SplinesketchDock

QTest: Any = QtTest.QTest
"""Its signatures are not all known to the type checker."""
LEFT, NO_KEY = Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier


def add_dock(viewer: Any) -> SplinesketchDock:
    """Dock the widget as the menu does."""
    made = SplinesketchDock(viewer)
    if isinstance(viewer, Viewer):
        viewer.window.add_dock_widget(made, name="Splinesketch", area="right")
    else:
        made.show()
    QTest.qWait(20)
    return made


def until(condition: Callable[[], Any], seconds: float = 60.0) -> None:
    """Let the window live until something holds."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it never came true"
        QTest.qWait(2)


def click(button: Any) -> None:
    """Click a button with the mouse."""
    QTest.mouseClick(button, LEFT)


def refine(dock: SplinesketchDock) -> None:
    """Click Refine and wait for the end."""
    assert dock.refine.isEnabled(), dock.refine.toolTip()
    click(dock.refine)
    until(lambda: dock.controller.progress is None)


def rest(dock: SplinesketchDock) -> None:
    """Wait until nothing runs."""
    until(lambda: dock.controller.progress is None)


def refine_all(dock: SplinesketchDock) -> None:
    """Choose to refine all again, the last entry beside Refine, and wait for the end."""
    assert dock.more.isEnabled()
    dock.more.entries[-1].trigger()
    until(lambda: dock.controller.progress is None)


def choose(dock: SplinesketchDock, text: str) -> None:
    """Choose an entry beside Refine, by how it begins."""
    assert dock.more.isEnabled()
    next(entry for entry in dock.more.entries if entry.text().startswith(text)).trigger()


def canvas(viewer: Any) -> Any:
    """Give the widget that takes the mouse."""
    return viewer.window._qt_viewer.canvas.native


def canvas_point(viewer: Any, world: Sequence[float]) -> QPoint:
    """Give the pixel of the canvas where a point (row, col) of the world is shown."""
    scene = viewer.window._qt_viewer.canvas.view.scene
    x, y, _, w = scene.transform.map([world[-1], world[-2], 0, 1])
    return QPoint(round(x / w), round(y / w))


def fit_view(viewer: Any) -> None:
    """Show everything, once the window has its size."""
    QTest.qWait(200)
    viewer.reset_view()
    QTest.qWait(50)


def draw(viewer: Any, layer: Shapes, world: Any) -> None:
    """Draw with the mouse through points (row, col) of the world: a line, or clicks of a path."""
    viewer.layers.selection.active = layer
    where = [canvas_point(viewer, point) for point in world]
    surface = canvas(viewer)
    if len(where) == 2:
        layer.mode = "add_line"
        QTest.mousePress(surface, LEFT, NO_KEY, where[0])
        for point in ((where[0] + where[1]) / 2, where[1]):
            QTest.mouseMove(surface, point)
            QTest.qWait(20)
        QTest.mouseRelease(surface, LEFT, NO_KEY, where[1])
    else:
        layer.mode = "add_polyline"
        for point in where:
            QTest.mouseMove(surface, point)
            QTest.qWait(20)
            QTest.mouseClick(surface, LEFT, NO_KEY, point)
        QTest.keyClick(surface, Qt.Key.Key_Return)
    QTest.qWait(10)


def layer_named(viewer: Any, name: str) -> Any:
    """Give a layer by its name."""
    return viewer.layers[name]


def drawn(layer: Layer) -> list[np.ndarray]:
    """Give copies of a layer's shapes."""
    assert isinstance(layer, Shapes)
    return [np.array(shape) for shape in layer.data]


def outlines(layer: Any) -> list[np.ndarray]:
    """Give the closed lines that the pieces of a layer make: where each begins, and its way."""
    found, begin, pieces = [], 0, layer.data
    for end in range(1, len(pieces) + 1):
        if np.allclose(pieces[begin, 0], pieces[end - 1].sum(axis=0), atol=1e-4):
            found.append(pieces[begin:end])
            begin = end
    assert begin == len(pieces), "a line is open"
    return found


def assert_drawn(line: Any, points: np.ndarray) -> None:
    """Check that a drawn line runs through some of a curve's points, and near to all others."""
    line = np.asarray(line, dtype=float)
    np.testing.assert_allclose(line[[0, -1]], points[[0, -1]], atol=1e-4)
    begin, way = line[:-1], np.diff(line, axis=0)
    off = points[:, None] - begin
    share = np.clip((off * way).sum(axis=2) / (way**2).sum(axis=1), 0, 1)
    apart = np.linalg.norm(off - share[..., None] * way, axis=2)
    assert apart.min(axis=1).max() < SEEN + 1e-4
    assert np.linalg.norm(points[:, None] - line, axis=2).min(axis=0).max() < 1e-4

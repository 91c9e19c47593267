"""Make the pictures of the real window that the README and the tutorial show.

    python docs/make_screenshots.py [FOLDER]

Needs a display; without one: xvfb-run -s "-screen 0 1400x900x24" python docs/make_screenshots.py
The settings and the saved work of whoever runs it are left alone.
"""

from pathlib import Path
from typing import Any

import window as w
from napari import Viewer
from qtpy.QtCore import QPoint, Qt

from napari_splinesketch.plugin.dock import SplinesketchDock

NEAR = (4.2, (0, 118, 96))
"""Zoom and centre that show the upper left worms."""
BARE = (6.0, (0, 236, 160))
"""The same for three worms without lines ..."""
LINES = (
    ((212, 168), (225, 148)),
    ((233, 131), (252, 150)),
    ((247, 161), (257, 190)),
)
"""... and the lines that are drawn over them, (row, col), px."""
WIDTH = 900
"""Of the moving picture, px."""
MOVE_MS, STEP_MS, LOOK_MS = 120, 700, 1800
"""How long a picture is shown: while something moves, after a step, to look at it."""


def reviewing(viewer: Viewer, dock: SplinesketchDock, folder: Path) -> None:
    """Open the panel, look at the worst curve, and at what the model leaves unexplained."""
    w.look(viewer, *NEAR)
    w.click(dock.review)
    dock.controller.actions.run("next")
    w.shoot(viewer, folder / "review.png")
    dock.colour_by.native.setCurrentIndex(1)
    w.shoot(viewer, folder / "colours.png")
    dock.colour_by.native.setCurrentIndex(0)
    dock.eyes.entries["residual"].trigger()
    w.shoot(viewer, folder / "residual.png")
    dock.eyes.entries["residual"].trigger()
    w.click(dock.review)
    w.wait(0.5)


def canvas_point(viewer: Viewer, row: float, col: float) -> Any:
    """Give the pixel of the canvas where a pixel of the image is shown."""
    scene = viewer.window._qt_viewer.canvas.view.scene
    x, y, _, far = scene.transform.map([col, row, 0, 1])
    return QPoint(round(x / far), round(y / far))


def movie(viewer: Viewer, dock: SplinesketchDock, path: Path) -> None:
    """Draw three lines, refine, accept: as one picture that moves."""
    made = w.Movie(viewer, WIDTH)
    surface = viewer.window._qt_viewer.canvas.native
    viewer.layers.selection.active = viewer.layers["worms sketches"]
    viewer.layers["worms sketches"].mode = "add_line"
    w.look(viewer, *BARE)
    w.wait(0.5)
    made.take(STEP_MS)
    for start, end in LINES:
        drag(viewer, made, surface, start, end)
    w.QTest.keyClick(surface, Qt.Key.Key_G)
    w.live(lambda: _take(made) or dock.controller.progress is None)
    w.wait(0.5)
    made.take(LOOK_MS)
    w.click(dock.review)
    w.wait(0.5)
    for key in (Qt.Key.Key_N, Qt.Key.Key_J, Qt.Key.Key_J):
        w.QTest.keyClick(surface, key)
        w.wait(0.7)
        made.take(LOOK_MS)
    made.save(path)


def drag(viewer: Viewer, made: w.Movie, surface: Any, start: Any, end: Any) -> None:
    """Draw a line with the mouse, and take pictures of it."""
    left, free = Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier
    first, last = (canvas_point(viewer, *place) for place in (start, end))
    w.QTest.mousePress(surface, left, free, first)
    for share in (0.35, 0.7, 1.0):
        point = first + (last - first) * share
        w.QTest.mouseMove(surface, point)
        w.wait(0.1)
        made.take(MOVE_MS, (surface, point))
    w.QTest.mouseRelease(surface, left, free, last)
    w.wait(0.1)
    made.take(STEP_MS // 2, (surface, last))


def _take(made: w.Movie) -> None:
    made.take(MOVE_MS)


def main() -> None:
    """Make all pictures."""
    folder = w.folder(__doc__)
    viewer, dock = w.open_window()
    w.look(viewer, *NEAR)
    w.refine(dock)
    w.shoot(viewer, folder / "window.png")
    reviewing(viewer, dock, folder)
    movie(viewer, dock, folder / "labelling.gif")
    viewer.close()


if __name__ == "__main__":
    main()

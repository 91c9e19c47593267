"""Make the pictures of the real window that the README and the tutorial show.

    python docs/make_screenshots.py [FOLDER]

Needs a display; without one: xvfb-run -s "-screen 0 1400x900x24" python docs/make_screenshots.py
"""

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from napari import Viewer
from PIL import Image
from qtpy import QtTest
from qtpy.QtCore import Qt
from qtpy.QtWidgets import QApplication, QDockWidget, QPushButton

from napari_splinesketch.plugin.demo import open_demo
from napari_splinesketch.plugin.dock import SplinesketchDock

IMAGES = Path(__file__).with_name("images")
DOCK_WIDTH = 290
COLOURS = 255
"""Of a picture's palette: a quarter of the bytes, and nobody sees it."""
NEAR = (4.2, (0, 118, 96))
"""Zoom and centre that show the upper left worms."""
PATIENCE = 600.0
"""For a refinement on a slow machine, s."""

QTest: Any = QtTest.QTest


def live(until: Callable[[], bool], seconds: float = PATIENCE) -> None:
    """Let the window live until something holds, or the time is over."""
    end = time.monotonic() + seconds
    while not until() and time.monotonic() < end:
        QApplication.processEvents()
        time.sleep(0.005)


def wait(seconds: float) -> None:
    """Let the window live for a while."""
    live(lambda: False, seconds)


def click(button: QPushButton) -> None:
    """Click a button with the mouse."""
    QTest.mouseClick(button, Qt.MouseButton.LeftButton)


def shoot(viewer: Viewer, path: Path) -> None:
    """Save a picture of the whole window."""
    wait(0.5)
    pixels = viewer.screenshot(canvas_only=False, flash=False)
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(pixels[..., :3]).quantize(COLOURS, dither=Image.Dither.NONE).save(
        path, optimize=True
    )
    print(f"{path} {path.stat().st_size / 1000:.0f} kB")


def look(viewer: Viewer, zoom: float, centre: tuple[float, float, float]) -> None:
    """Point the camera."""
    viewer.scene.camera.zoom = zoom
    viewer.scene.camera.center = centre


def refine(dock: SplinesketchDock) -> None:
    """Click Refine and wait for the end."""
    click(dock.refine)
    live(lambda: dock.controller.progress is None)
    if not dock.controller.records():
        raise SystemExit(f"There is nothing to show: {dock.notice.text()}")


def widen(viewer: Viewer, dock: SplinesketchDock) -> None:
    """Give the dock its width."""
    around = dock.parent()
    while not isinstance(around, QDockWidget):
        around = around.parent()  # pyright: ignore[reportOptionalMemberAccess]
    window = viewer.window._qt_window
    window.resizeDocks([around], [DOCK_WIDTH], Qt.Orientation.Horizontal)
    wait(0.5)


def main() -> None:
    """Go through the demo and take a picture at every step."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path, default=IMAGES)
    folder = parser.parse_args().folder
    viewer = open_demo(block=False)
    dock = next(w for w in viewer.window.dock_widgets.values() if isinstance(w, SplinesketchDock))
    wait(1.0)
    widen(viewer, dock)
    look(viewer, *NEAR)
    shoot(viewer, folder / "sketches.png")
    refine(dock)
    shoot(viewer, folder / "window.png")
    eyes = dock.visibility.findChildren(QPushButton)
    for eye in eyes:
        click(eye)
    shoot(viewer, folder / "model.png")
    for eye in eyes:
        click(eye)
    viewer.reset_view()
    wait(0.2)
    shoot(viewer, folder / "whole.png")
    viewer.close()


if __name__ == "__main__":
    main()

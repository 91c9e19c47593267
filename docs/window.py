"""A real window for pictures: a hand that clicks and drags, patience, and a camera."""
# ruff: noqa: E402

import argparse
import atexit
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

# Before napari is imported, which reads them then: settings and saved work stay as they are.
_HOME = tempfile.mkdtemp(prefix="splinesketch-pictures-")
atexit.register(shutil.rmtree, _HOME, ignore_errors=True)
os.environ |= {f"XDG_{name}_HOME": f"{_HOME}/{name}" for name in ("CONFIG", "DATA", "STATE")}

import numpy as np
from napari import Viewer
from napari.settings import get_settings
from PIL import Image, ImageDraw
from qtpy import QtTest
from qtpy.QtCore import QPoint, Qt
from qtpy.QtWidgets import QApplication, QDockWidget, QWidget

from napari_splinesketch.plugin.dock import SplinesketchDock
from napari_splinesketch.plugin.files import open_demo

IMAGES = Path(__file__).with_name("images")
DOCK_WIDTH = 290
COLOURS = 255
"""Of a picture's palette: a quarter of the bytes, and nobody sees it."""
PATIENCE = 600.0
"""For a refinement on a slow machine, s."""
SIGNALS = ("#d55e00", "#e69f00", "#009e73", "#56b4e9", "#0072b2", "#4560c4")
"""Colours that a common palette must not lose."""
RING = 11
"""Radius of the ring around the mouse, px."""

QTest: Any = QtTest.QTest


def folder(about: str | None) -> Path:
    """Give the folder for pictures that the command line names, or that of the documentation."""
    parser = argparse.ArgumentParser(description=about)
    parser.add_argument("folder", nargs="?", type=Path, default=IMAGES)
    return parser.parse_args().folder


def live(until: Callable[[], bool], seconds: float = PATIENCE) -> None:
    """Let the window live until something holds, or the time is over."""
    end = time.monotonic() + seconds
    while not until() and time.monotonic() < end:
        QApplication.processEvents()
        time.sleep(0.005)


def wait(seconds: float) -> None:
    """Let the window live for a while."""
    live(lambda: False, seconds)


def open_window() -> tuple[Viewer, SplinesketchDock]:
    """Open the demo and give the dock its width."""
    get_settings().plugins.extension2reader = {"*.csv": "napari-splinesketch"}  # says so once
    viewer = open_demo(block=False)
    dock = next(w for w in viewer.window.dock_widgets.values() if isinstance(w, SplinesketchDock))
    wait(1.0)
    widen(viewer, dock)
    wait(0.5)
    return viewer, dock


def widen(viewer: Viewer, dock: SplinesketchDock) -> None:
    """Give the dock its width."""
    around = dock.parent()
    while not isinstance(around, QDockWidget):
        around = around.parent()  # pyright: ignore[reportOptionalMemberAccess]
    window = viewer.window._qt_window
    window.resizeDocks([around], [DOCK_WIDTH], Qt.Orientation.Horizontal)


def click(button: Any) -> None:
    """Click a button with the mouse."""
    QTest.mouseClick(button, Qt.MouseButton.LeftButton)


def refine(dock: SplinesketchDock, seen: Callable[[], None] = lambda: None) -> None:
    """Click Refine and wait for the end; `seen` is called now and then."""
    click(dock.refine)

    def over() -> bool:
        seen()
        return dock.controller.progress is None

    live(over)
    if not dock.controller.records():
        raise SystemExit(f"There is nothing to show: {dock.notice.text()}")


def look(viewer: Viewer, zoom: float, centre: Sequence[float]) -> None:
    """Point the camera."""
    viewer.scene.camera.zoom = zoom
    viewer.scene.camera.center = tuple(centre)  # pyright: ignore[reportAttributeAccessIssue]


def pixels(viewer: Viewer) -> Image.Image:
    """Take a picture of the whole window."""
    return Image.fromarray(viewer.screenshot(canvas_only=False, flash=False)[..., :3])


def shoot(viewer: Viewer, path: Path) -> None:
    """Save a picture of the whole window."""
    wait(0.5)
    path.parent.mkdir(parents=True, exist_ok=True)
    small = pixels(viewer).quantize(COLOURS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    small.save(path, optimize=True)
    print(f"{path} {path.stat().st_size / 1000:.0f} kB")


class Movie:
    """Pictures of the window, with a ring where the mouse is.

    Parameters
    ----------
    viewer
        The window.
    width
        Of the pictures, px.
    """

    def __init__(self, viewer: Viewer, width: int):
        self._viewer, self._width = viewer, width
        self._pictures: list[Image.Image] = []
        self._lasts: list[int] = []

    def take(self, last: int, mouse: tuple[QWidget, QPoint] | None = None) -> None:
        """Take a picture, shown for so many ms."""
        picture = pixels(self._viewer)
        if mouse is not None:
            widget, point = mouse
            at = widget.mapTo(self._viewer.window._qt_window, point)
            box = [at.x() - RING, at.y() - RING, at.x() + RING, at.y() + RING]
            ImageDraw.Draw(picture).ellipse(box, outline="#d55e00", width=4)
        size = self._width, round(picture.height * self._width / picture.width)
        self._pictures.append(picture.resize(size, Image.Resampling.LANCZOS))
        self._lasts.append(last)

    def save(self, path: Path) -> None:
        """Save the pictures as one that moves, with one palette for all."""
        every = self._pictures[:: max(len(self._pictures) // 8, 1)]
        signals = [Image.new("RGB", (self._width, 40), colour) for colour in SIGNALS]
        strip = Image.fromarray(np.concatenate([np.asarray(p) for p in (*every, *signals)]))
        palette = strip.quantize(COLOURS, dither=Image.Dither.NONE)
        frames = [p.quantize(palette=palette, dither=Image.Dither.NONE) for p in self._pictures]
        path.parent.mkdir(parents=True, exist_ok=True)
        frames[0].save(path, save_all=True, append_images=frames[1:], duration=self._lasts, loop=0)
        print(f"{path} {len(frames)} pictures, {path.stat().st_size / 1e6:.2f} MB")

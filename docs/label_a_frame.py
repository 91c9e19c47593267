"""Label every worm in the first frame of worms_swimming.tif through the window, and count.

    python docs/label_a_frame.py [--by-hand] [--picture FILE]

Only mouse and keys are used, at the pace of a practised hand: 1.1 s to bring the mouse somewhere,
0.1 s to press or release its button, 0.28 s for a key (the keystroke-level model of Card, Moran
and Newell). The worms are those of worms_of_a_frame.csv, found by eye. One of them is turned, and
one is dragged by hand. Lines are suggested; --by-hand draws all of them. Versions without keys are
used in the way that they have.

Needs a display; without one: xvfb-run -s "-screen 0 1400x900x24" python docs/label_a_frame.py
"""

import argparse
import time
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import napari
import numpy as np
from napari.layers import Shapes
from qtpy import QtTest
from qtpy.QtCore import QPoint, Qt
from qtpy.QtWidgets import QApplication

from napari_splinesketch.data import load_sample
from napari_splinesketch.engine.spline import resample
from napari_splinesketch.plugin.dock import SplinesketchDock

REACH, BUTTON, KEY = 1.1, 0.1, 0.28
"""Seconds to bring the mouse somewhere, to press or release its button, to press a key."""
PATIENCE = 300.0
LED = 2.0
"""How far a curve is dragged by hand, px."""
WORMS = Path(__file__).with_name("worms_of_a_frame.csv")
ALONE = 10
"""A worm that lies alone: it is turned. The first one is dragged by hand."""
NEAR = 8.0
"""A line is over a worm if both its ends are this near to the worm's, px."""
SHIFT, PLAIN = Qt.KeyboardModifier.ShiftModifier, Qt.KeyboardModifier.NoModifier
QTest: Any = QtTest.QTest
Point = Sequence[float]


class Hand:
    """Uses the window at the pace of a hand, and counts."""

    def __init__(self, viewer: napari.Viewer):
        self._viewer = viewer
        self._canvas: Any = viewer.window._qt_viewer.canvas.native
        self.clicks = self.drags = self.keys = 0

    def go(self, place: Point) -> QPoint:
        """Bring the mouse to a place of the image."""
        live(lambda: False, REACH)
        where = self._on_canvas(place)
        QTest.mouseMove(self._canvas, where)
        return where

    def click(self, place: Point, modifiers: Any = PLAIN) -> None:
        """Click on the canvas."""
        where = self.go(place)
        live(lambda: False, 2 * BUTTON)
        QTest.mouseClick(self._canvas, Qt.MouseButton.LeftButton, modifiers, where)
        self.clicks += 1

    def press_button(self, button: Any) -> None:
        """Click a button of the dock."""
        live(lambda: False, REACH + 2 * BUTTON)
        QTest.mouseClick(button, Qt.MouseButton.LeftButton)
        self.clicks += 1

    def drag(self, begin: Point, end: Point) -> None:
        """Press the mouse at one place and release it at another."""
        where = self.go(begin)
        live(lambda: False, BUTTON)
        QTest.mousePress(self._canvas, Qt.MouseButton.LeftButton, PLAIN, where)
        for share in (0.3, 0.6, 1.0):
            live(lambda: False, REACH / 3)
            middle = np.asarray(begin) + share * (np.asarray(end) - begin)
            QTest.mouseMove(self._canvas, self._on_canvas(middle))
        live(lambda: False, BUTTON)
        QTest.mouseRelease(self._canvas, Qt.MouseButton.LeftButton, PLAIN, self._on_canvas(end))
        self.drags += 1

    def key(self, name: str, modifiers: Any = PLAIN) -> None:
        """Press a key over the canvas."""
        live(lambda: False, KEY)
        QTest.keyClick(self._canvas, getattr(Qt.Key, f"Key_{name}"), modifiers)
        self.keys += 1

    def _on_canvas(self, place: Point) -> QPoint:
        scene = self._viewer.window._qt_viewer.canvas.view.scene
        x, y, _, w = scene.transform.map([place[1], place[0], 0, 1])
        return QPoint(round(x / w), round(y / w))


def live(until: Callable[[], Any], seconds: float = PATIENCE) -> None:
    """Let the window live until something holds, or the time is over."""
    end = time.monotonic() + seconds
    while not until() and time.monotonic() < end:
        QApplication.processEvents()
        time.sleep(0.004)


def settle(dock: SplinesketchDock) -> None:
    """Wait until nothing runs."""
    live(lambda: False, 0.1)
    live(lambda: dock.controller.progress is None)


def curve_at(dock: SplinesketchDock, place: Point) -> Any:
    """Give the curve nearest to a place."""
    curves = [record.curve for record in dock.controller.records()]
    return min(curves, key=lambda c: np.linalg.norm(c.points - place, axis=1).min())


def over(line: Any, worm: Any) -> bool:
    """Whether a line lies over a worm, whichever way it runs."""
    ends = np.asarray(line)[[0, -1], -2:]
    return any(np.linalg.norm(ends - way, axis=1).max() < NEAR for way in (worm, worm[::-1]))


def clear_place(line: Any, others: list[Any]) -> Any:
    """Give the point of a line that is farthest from other lines: there is no doubt about it."""
    share = np.linspace(0, 1, 20)[1:-1]
    places = [(1 - t) * a + t * b for a, b in pairwise(line) for t in share]
    beside = np.concatenate([resample(other, 100) for other in others])
    return max(places, key=lambda place: np.linalg.norm(beside - place, axis=1).min())


def suggested(hand: Hand, dock: SplinesketchDock, worms: list[Any]) -> list[Any]:
    """Let lines be suggested, and delete the wrong ones; give the worms that have none."""
    hand.key("W")
    settle(dock)
    layer = dock.controller.sketches
    assert isinstance(layer, Shapes)
    lines = [np.array(line)[:, -2:] for line in layer.data]
    wrong = [line for line in lines if not any(over(line, worm) for worm in worms)]
    if wrong:
        hand.key("S")
    for line in wrong:
        hand.click(clear_place(line, [other for other in lines if other is not line]), SHIFT)
    if wrong:
        hand.key("Delete")
        hand.key("L")
    else:
        hand.key("H")
    return [worm for worm in worms if not any(over(line, worm) for line in lines)]


def with_keys(hand: Hand, dock: SplinesketchDock, worms: list[Any], by_hand: bool) -> None:
    """Draw while what was drawn is refined; correct the curves themselves."""
    if by_hand:
        hand.key("H")
    lines = worms if by_hand else suggested(hand, dock, worms)
    hand.key("G", SHIFT)
    for line in lines:
        hand.drag(*line)
    settle(dock)
    hand.key("H")
    hand.go(curve_at(dock, worms[ALONE].mean(axis=0)).points[30])
    hand.key("H", SHIFT)
    settle(dock)
    led = curve_at(dock, worms[0].mean(axis=0))
    hand.click(led.points[30])
    hand.key("U")
    live(lambda: dock.controller.knots is not None)
    knot = led.knots[len(led.knots) // 2, :2]
    hand.drag(knot, knot + np.array([LED, 0]))
    hand.key("Return")
    settle(dock)


def without_keys(hand: Hand, dock: SplinesketchDock, worms: list[Any]) -> None:
    """Draw, press Refine; correct the lines and press Refine again for each correction."""

    def refine() -> None:
        hand.press_button(dock.refine)
        settle(dock)

    hand.press_button(dock.draw)
    for line in worms[:-1]:
        hand.drag(*line)
    refine()
    hand.drag(*worms[-1])
    refine()
    hand.key("S")
    hand.click(worms[ALONE].mean(axis=0))
    hand.key("Delete")
    hand.key("L")
    hand.drag(*worms[ALONE][::-1])
    refine()
    middle = worms[0].mean(axis=0)
    hand.key("S")
    hand.click(middle)
    hand.key("I")
    hand.click(middle)
    hand.key("D")
    hand.drag(middle, middle + np.array([LED, 0]))
    refine()


def main() -> None:
    """Label the frame and print the counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--by-hand", action="store_true", help="draw all lines")
    parser.add_argument("--picture", type=Path, help="where a picture of the end goes")
    chosen = parser.parse_args()
    film, _ = load_sample("worms_swimming")
    worms = list(np.loadtxt(WORMS, delimiter=",", skiprows=1).reshape(-1, 2, 2))
    viewer = napari.Viewer()
    viewer.window.resize(1300, 860)
    viewer.add_image(film, name="worms")
    viewer.dims.set_point(0, 0)
    dock = SplinesketchDock(viewer)
    viewer.window.add_dock_widget(dock, name="Splinesketch")
    live(lambda: False, 20.0)  # What is compiled once is not what is measured.
    viewer.reset_view()
    live(lambda: False, 0.5)
    hand, began = Hand(viewer), time.perf_counter()
    if hasattr(dock.controller, "knots"):
        with_keys(hand, dock, worms, chosen.by_hand)
    else:
        without_keys(hand, dock, worms)
    seconds = time.perf_counter() - began
    records = dock.controller.records()
    good = sum(record.curve.status == "good" for record in records)
    print(
        f"{len(worms)} worms, {len(records)} curves, {good} good: {hand.drags} drags, "
        f"{hand.clicks} clicks, {hand.keys} keys, {seconds:.0f} s"
    )
    if chosen.picture:
        live(lambda: False, 0.5)
        viewer.screenshot(str(chosen.picture), canvas_only=False, flash=False)
    viewer.close()


if __name__ == "__main__":
    main()

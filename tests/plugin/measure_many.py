"""Measure how long the window stands still with many curves in one frame.

    python tests/plugin/measure_many.py [--counts 10 100 1000] [--write]

For each action the longest gap between two ticks of a 5 ms timer, and in brackets the time that the
window's own thread was at work in the busiest gap: on an idle machine with a graphics card the two
are nearly the same; on a busy one, or where a program draws in the place of a card, the gap is
longer. The engine is a stand-in that answers at once, so that only the window is
measured. --write puts the table into docs/films.md.
"""

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import napari
import numpy as np
from fakes import FakeEngine
from hand import QTest, add_dock, canvas, canvas_point, click, draw
from qtpy.QtCore import Qt, QTimer
from qtpy.QtWidgets import QApplication

from napari_splinesketch.plugin import engine
from napari_splinesketch.plugin.dock import SplinesketchDock

ROOT = Path(__file__).parents[2]
COUNTS = (10, 100, 1000)
SIZE = 1024
WORM = 30.0
TICK_MS = 5
SETTLE = 0.5
"""Seconds in which the window may stand still after an action."""


Gap = tuple[float, float]
"""Seconds by the clock, and of work in the window's thread."""


class Ticks:
    """Notes the longest time between two ticks."""

    def __init__(self) -> None:
        self._last = self._now()
        self.longest: Gap = (0.0, 0.0)
        self._timer = QTimer()
        self._timer.setInterval(TICK_MS)
        self._timer.timeout.connect(self._tick)
        self._timer.start()

    def _now(self) -> Gap:
        return time.perf_counter(), time.thread_time()

    def _tick(self) -> None:
        now = self._now()
        clock, work = (b - a for a, b in zip(self._last, now, strict=True))
        self.longest = max(self.longest[0], clock), max(self.longest[1], work)
        self._last = now


def watch(done: Callable[[], bool], action: Callable[[], object] = lambda: None) -> Gap:
    """Do something and let the window live until something holds and a little longer."""
    ticks = Ticks()
    for _ in range(4):
        QApplication.processEvents()
    action()
    while not done():
        QApplication.processEvents()
        time.sleep(0.001)
    end = time.perf_counter() + SETTLE
    while time.perf_counter() < end:
        QApplication.processEvents()
        time.sleep(0.001)
    return ticks.longest


def bodies(count: int) -> list[np.ndarray]:
    """Lines on a grid, each turned another way."""
    side = int(np.ceil(np.sqrt(count)))
    step = SIZE / side
    rng = np.random.default_rng(0)
    lines = []
    for i in range(count):
        middle = step * (np.array(divmod(i, side)) + 0.5)
        angle, length = rng.uniform(0, np.pi), min(WORM, 0.8 * step)
        along = length / 2 * np.array([np.sin(angle), np.cos(angle)])
        lines.append(np.linspace(middle - along, middle + along, 8))
    return lines


def measured(count: int) -> dict[str, Gap]:
    """Do what a user does with so many curves; longest gap of each action, s."""
    made: list[np.ndarray] = bodies(count)
    fake = FakeEngine()
    fake.go.set()
    fake.changes = {i: {"status": "check", "reasons": ("why",)} for i in range(0, count, 5)}
    engine.refine, engine.warm_up = fake.refine, lambda report: None
    engine.suggest = lambda task, report: tuple(made)
    viewer: Any = napari.Viewer()
    viewer.window.resize(1300, 860)
    rng = np.random.default_rng(0)
    viewer.add_image(rng.normal(100, 5, (SIZE, SIZE)).astype(np.float32), name="cells")
    dock = add_dock(viewer)
    QTest.qWait(1000)
    viewer.reset_view()
    QTest.qWait(1000)
    gaps = {"nothing": watch(lambda: True)}

    def act(name: str, action: Callable[[], object], done: Callable[[], bool]) -> None:
        """Note the longest gap until something holds, and a little longer."""
        gaps[name] = watch(done, action)

    steps(viewer, dock, count, act)
    viewer.close()
    return gaps


def steps(viewer: Any, dock: SplinesketchDock, count: int, act: Callable[..., None]) -> None:
    """Go through a user's hour."""
    controller = dock.controller

    def idle() -> bool:
        return controller.progress is None

    def shown(number: int) -> Callable[[], bool]:
        return lambda: (
            idle()
            and "cells curves" in viewer.layers
            and (viewer.layers["cells curves"].nshapes == number)
        )

    act("suggest", lambda: click(dock.suggest.button), idle)
    sketches = viewer.layers["cells sketches"]
    assert sketches.nshapes == count
    act("draw a line", lambda: draw(viewer, sketches, [(4, 4), (4, 40)]), lambda: True)
    act("refine", lambda: click(dock.refine), shown(count + 1))
    viewer.layers.selection.active = viewer.layers["cells curves"]
    viewer.layers["cells curves"].mode = "select"
    middle = controller.records()[count // 2].curve.points[50]
    place = canvas_point(viewer, middle)
    act(
        "select a curve on the canvas",
        lambda: QTest.mouseClick(canvas(viewer), Qt.MouseButton.LeftButton, pos=place),
        lambda: True,
    )
    assert len(controller.selection) == 1, controller.selection
    act("open the table", lambda: click(dock.review), lambda: dock.panel.panel is not None)
    accept, following = controller.actions["accept"], controller.actions["next"]
    act("accept, and on to the next", accept.run, lambda: True)
    act("on to the next", following.run, lambda: True)
    act("delete a curve", controller.delete, shown(count))
    act("undo", lambda: click(dock.undo), shown(count + 1))
    act("zoom", lambda: setattr(viewer.scene.camera, "zoom", 5), lambda: True)
    act("hide the curves", lambda: _toggle(viewer), lambda: True)


def _toggle(viewer: Any) -> None:
    viewer.layers["cells curves"].visible = False


def main() -> None:
    """Measure, print, and write if asked to."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--counts", nargs="+", type=int, default=list(COUNTS))
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args()
    results = {count: measured(count) for count in options.counts}
    head = " | ".join(f"{count:,} curves" for count in results)
    lines = [f"| action | {head} |", "|---" * (len(results) + 1) + "|"]
    for name in next(iter(results.values())):
        both = [gaps[name] for gaps in results.values()]
        cells = " | ".join(f"{1000 * clock:.0f} ({1000 * work:.0f})" for clock, work in both)
        lines.append(f"| {name} | {cells} |")
    table = "\n".join(lines) + "\n"
    print(table)
    if options.write:
        sys.path.insert(0, str(ROOT / "tests" / "benchmarks"))
        from insert import insert

        insert("many", table, ROOT / "docs" / "films.md")


if __name__ == "__main__":
    main()

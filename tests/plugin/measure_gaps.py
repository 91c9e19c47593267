"""Measure the longest gap between ticks of the event loop in a fresh process; prints JSON."""

import json
import sys
import time
from collections.abc import Callable
from typing import Any, cast

from qtpy.QtCore import QTimer
from qtpy.QtWidgets import QApplication

from napari_splinesketch.engine import warmup
from napari_splinesketch.plugin import engine
from napari_splinesketch.plugin.dock import SplinesketchDock
from napari_splinesketch.plugin.files import open_demo

TICK_MS = 5
LINES = 6


class Ticks:
    """Notes the longest time between two ticks."""

    def __init__(self) -> None:
        self._last = time.perf_counter()
        self.longest = 0.0
        self._timer = QTimer()
        self._timer.setInterval(TICK_MS)
        self._timer.timeout.connect(self._tick)
        self._timer.start()

    def _tick(self) -> None:
        now = time.perf_counter()
        self.longest = max(self.longest, now - self._last)
        self._last = now


def phase(done: Callable[[], bool]) -> tuple[float, float]:
    """Let the window live until something holds; seconds and longest gap."""
    ticks, began = Ticks(), time.perf_counter()
    while not done():
        QApplication.processEvents()
        time.sleep(0.002)
    return time.perf_counter() - began, ticks.longest


def wait(seconds: float) -> tuple[float, float]:
    """Let the window live for a while."""
    end = time.perf_counter() + seconds
    return phase(lambda: time.perf_counter() > end)


def main() -> None:
    """Open the demo, warm up with nothing compiled, refine; and again, from the cache on disk."""
    # One program and a few lines are enough to see that nothing holds the window up.
    warmup.LINES, warmup.KNOTS = warmup.LINES[-1:], warmup.KNOTS[:1]
    warm: list[bool] = []
    warm_up = engine.warm_up
    engine.warm_up = lambda report: (warm_up(report), warm.append(True))  # pyright: ignore
    viewer = open_demo(block=False)
    dock = next(iter(viewer.window.dock_widgets.values()))
    assert isinstance(dock, SplinesketchDock)
    assert "jax" not in sys.modules
    wait(0.2)
    sketches = cast(Any, dock.controller.sketches)
    sketches.data = sketches.data[:LINES]
    phases = {"idle": wait(0.2), "import and warm-up": phase(lambda: bool(warm))}
    for name in ("first refinement", "from the cache"):
        if name == "from the cache":
            sys.modules["jax"].clear_caches()
        dock.controller.refine("new" if name == "first refinement" else "all")
        phases[name] = phase(lambda: dock.controller.progress is None)
        assert len(dock.controller.records()) == LINES
    viewer.close()
    print(json.dumps(phases))


if __name__ == "__main__":
    main()

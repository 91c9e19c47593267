"""How long the window stands still: the longest time between two ticks of a timer."""

import time
from collections.abc import Callable

from qtpy.QtCore import QTimer
from qtpy.QtWidgets import QApplication

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


def watch(
    done: Callable[[], bool], action: Callable[[], object] = lambda: None, settle: float = SETTLE
) -> Gap:
    """Do something and let the window live until something holds and a little longer."""
    ticks = Ticks()
    for _ in range(4):
        QApplication.processEvents()
    action()
    while not done():
        QApplication.processEvents()
        time.sleep(0.001)
    end = time.perf_counter() + settle
    while time.perf_counter() < end:
        QApplication.processEvents()
        time.sleep(0.001)
    return ticks.longest

"""Bringing layers in step with what is known, a little at a time."""

import logging
from collections.abc import Callable, Iterator
from functools import partial

from qtpy.QtCore import QTimer

from napari_splinesketch.plugin.work import Work

_log = logging.getLogger(__name__)

BREATH_MS = 30
"""Between two steps of drawing results: time for the window to paint and to answer."""
FIRST_MS = 5
"""Before the first one: what has changed the state is still to be seen in the dock."""


class Drawing:
    """Shows works in their layers, step by step; the window lives in between.

    Parameters
    ----------
    failed
        Called with the exception if a step fails.
    """

    def __init__(self, failed: Callable[[Exception], None]):
        self._failed = failed
        self._steps: dict[Work, Iterator[None]] = {}
        self._last: dict[Work, list[Callable[[], None]]] = {}

    def start(self, work: Work, last: Callable[[], None]) -> None:
        """Show what is known, from the next turn of the event loop on; then call `last`."""
        running = work in self._steps
        self._steps[work] = work.show()
        self._last.setdefault(work, []).append(last)
        if not running:
            QTimer.singleShot(FIRST_MS, partial(self._go_on, work))

    @property
    def busy(self) -> bool:
        """Whether anything is still to be shown."""
        return bool(self._steps)

    def drop(self, work: Work) -> bool:
        """Show nothing more of a work; say whether there was something left."""
        self._last.pop(work, None)
        return self._steps.pop(work, None) is not None

    def stop(self) -> None:
        """Show nothing more."""
        self._steps.clear()
        self._last.clear()

    def _go_on(self, work: Work) -> None:
        if work not in self._steps:
            return
        try:
            next(self._steps[work])
        except StopIteration:
            del self._steps[work]
            for last in self._last.pop(work):
                last()
        except Exception as error:
            _log.exception("The results could not be shown")
            del self._steps[work], self._last[work]
            self._failed(error)
        else:
            QTimer.singleShot(BREATH_MS, partial(self._go_on, work))

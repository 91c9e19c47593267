"""Work beside the window: a thread does it, the window's own thread hears of it."""

import atexit
import logging
import threading
from collections.abc import Callable
from typing import Any, Literal

from qtpy.QtCore import QObject, QTimer, Signal  # pyright: ignore[reportPrivateImportUsage]

from napari_splinesketch.engine.types import OnProgress, Progress

POLL_MS = 50
"""How often the window looks after the thread: at most 20 updates a second."""
PATIENCE = 20.0
"""How long leaving Python waits for a thread: ending amid a compilation would crash, s."""

_log = logging.getLogger(__name__)


class _Worker:
    """The thread's side: knows neither Qt nor napari, so that it may end when it likes."""

    def __init__(self, work: Callable[[OnProgress], Any]):
        self.news: Progress | None = None
        self.outcome: tuple[Literal["done", "failed"], Any] | None = None
        self.cancelled = False
        self._work: Callable[[OnProgress], Any] | None = work
        self.thread = threading.Thread(target=self._run, name="splinesketch", daemon=True)

    def start(self) -> None:
        _workers.add(self)
        self.thread.start()

    def _run(self) -> None:
        # Whoever still holds the job does not hold the arrays that it worked on.
        work, self._work = self._work, None
        assert work is not None
        try:
            self.outcome = "done", work(self._report)
        except Exception as error:
            if not self.cancelled:
                _log.exception("Work beside the window failed")
            self.outcome = "failed", f"{type(error).__name__}: {error}"
        finally:
            del work
            _workers.discard(self)

    def _report(self, progress: Progress) -> bool:
        self.news = progress
        return not self.cancelled


class Job(QObject):
    """Work in a thread of its own, of which the window hears through signals.

    The thread leaves its news, and a timer of the window's thread takes them. A job that was
    cancelled is never heard of again, whatever its thread still does.

    Parameters
    ----------
    work
        Called in the thread with a function to report progress to, which returns False once the
        job was cancelled.
    parent
        The Qt object that the job ends with.
    """

    progressed = Signal(object)
    done = Signal(object)
    failed = Signal(str)

    def __init__(self, work: Callable[[OnProgress], Any], parent: QObject | None = None):
        super().__init__(parent)
        self._worker = _Worker(work)
        self._timer = QTimer(self)
        self._timer.setInterval(POLL_MS)
        self._timer.timeout.connect(self._look)

    def start(self) -> None:
        """Begin."""
        self._worker.start()
        self._timer.start()

    def cancel(self) -> None:
        """Ask the thread to end, and say nothing of it any more."""
        self._worker.cancelled = True
        self._timer.stop()

    def wait(self) -> None:
        """Let the window stand still until it is done, and tell what came of it."""
        self._worker.thread.join(PATIENCE)
        self._look()

    def _look(self) -> None:
        outcome = self._worker.outcome
        news, self._worker.news = self._worker.news, None
        if news is not None:
            self.progressed.emit(news)
        if outcome is not None and not self._worker.cancelled:
            self._timer.stop()
            kind, value = outcome
            (self.done if kind == "done" else self.failed).emit(value)


_workers: set[_Worker] = set()


@atexit.register
def _wait_for_threads() -> None:
    for worker in tuple(_workers):
        worker.cancelled = True
        worker.thread.join(PATIENCE)

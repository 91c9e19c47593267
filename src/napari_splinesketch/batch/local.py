"""Workers on this machine: processes with a core each that die with the one that started them."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, MutableMapping
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing.connection import Connection
from typing import Any, Self

AHEAD = 2
"""Tasks in progress for each process: one running, one waiting."""
ONE_EACH = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
XLA, XLA_FLAG = "XLA_FLAGS", "--xla_cpu_multi_thread_eigen"


class Local:
    """Works in `jobs` other processes on this machine; replaces them when one dies."""

    deaths = (BrokenProcessPool,)
    """What a future raises where its worker died, rather than the work itself."""

    def __init__(self, jobs: int) -> None:
        self._jobs = jobs
        self.room = AHEAD * jobs

    def __enter__(self) -> Self:
        """Be ready to start processes; they start with the first task."""
        limit_threads(os.environ)  # which they inherit; this process has its threads already
        self._start()
        return self

    def __exit__(self, *error: object) -> None:
        """Stop at once and abandon what is in progress."""
        self._stop()

    def submit(self, work: Callable[..., Any], task: Any) -> Future[Any]:
        """Give a task to the next process that is free."""
        with _interrupts_wait():
            try:
                return self._pool.submit(work, task)
            except BrokenProcessPool:
                self._stop()
                self._start()
                return self._pool.submit(work, task)

    def _start(self) -> None:
        # Not forked: JAX has threads, and a fork of a process with threads may hang.
        context = multiprocessing.get_context("spawn")
        self._ends, self._lifeline = context.Pipe(duplex=False)
        self._pool = ProcessPoolExecutor(self._jobs, context, _begin, (self._ends,))

    def _stop(self) -> None:
        self._lifeline.close()
        self._pool.shutdown(wait=True, cancel_futures=True)
        self._ends.close()


@contextmanager
def _interrupts_wait() -> Iterator[None]:
    """Hold Ctrl-C back from here and from processes that are started: from their first moment."""
    if os.name == "nt":
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin(lifeline: Connection) -> None:
    """Leave Ctrl-C to the process that started this one, and end when that one ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with, args=(lifeline,), daemon=True).start()


def _end_with(lifeline: Connection) -> None:
    try:
        lifeline.recv()
    except (EOFError, OSError):
        os._exit(1)


def limit_threads(environment: MutableMapping[str, str]) -> None:
    """Limit BLAS and XLA to one thread, unless the user has chosen; call before importing them.

    The environment is changed in place.
    """
    for name in ONE_EACH:
        environment.setdefault(name, "1")
    chosen = environment.get(XLA, "")
    if XLA_FLAG not in chosen:
        environment[XLA] = f"{chosen} {XLA_FLAG}=false".strip()

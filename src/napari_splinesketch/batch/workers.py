"""Tasks through workers, here or on a cluster: a few at a time, and none lost when one dies."""

import asyncio
import logging
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator, MutableMapping
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing.connection import Connection
from typing import Any, Self, TypeVar

from napari_splinesketch.engine.types import InputError
from napari_splinesketch.files import INSTALL

AHEAD = 2  # tasks in progress for each process: one running, one waiting
MOST_ON_WINDOWS = 61  # processes: Python cannot wait for more there
ALONE = 2  # a task during which so many workers died is tried once more, with no other beside it
ONE_EACH = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
XLA, XLA_FLAG = "XLA_FLAGS", "--xla_cpu_multi_thread_eigen"
PATIENCE = 20.0  # how long a scheduler may take to answer, and the first worker to appear, s
FRESH = 2.0  # how long the number of a cluster's workers is cached, s

Task = TypeVar("Task")
Done = TypeVar("Done")


class DeadlyError(RuntimeError):
    """A task whose workers die."""


def through(
    workers: "Local | Cluster",
    work: Callable[[Task], Done],
    tasks: Iterable[Task],
    *,
    retry: Callable[[Task, BaseException], Task | None] = lambda task, error: None,
) -> Iterator[tuple[Task, Done | DeadlyError]]:
    """Give each task with its result as soon as it is done, in whatever order.

    No more tasks than the workers have room for exist at a time; the next is taken when one is done
    and the caller has dealt with its result. `work` must be importable.

    `retry` is given what `work` raises, and returns a task to do instead, or None: then it ends
    everything. A task that cannot be done must therefore be reported in its result.
    """
    # Each task with the number of workers that have died of it.
    begun, again = dict[Future[Done], tuple[Task, int]](), list[tuple[Task, int]]()
    source = ((task, 0) for task in tasks)

    def is_room() -> bool:
        """Whether another task may begin; one that may kill its worker runs alone."""
        if any(died >= ALONE for _, died in (*again[:1], *begun.values())):
            return not begun
        return len(begun) < max(workers.room, 1)

    while True:
        while is_room() and (item := again.pop(0) if again else next(source, None)):
            begun[workers.submit(work, item[0])] = item
        if not begun:
            return
        finished, _ = wait(begun, return_when=FIRST_COMPLETED)
        while finished:  # they are forgotten one by one
            future = finished.pop()
            task, died = begun.pop(future)
            if future.cancelled():
                raise ConnectionError("the scheduler of the workers is gone")
            error = future.exception()
            if error is None:
                yield task, future.result()
            elif isinstance(error, workers.deaths) and died == ALONE:
                yield task, DeadlyError(f"its worker died {ALONE + 1} times")
            elif isinstance(error, workers.deaths):
                again.append((task, died + 1))
            elif better := retry(task, error):
                again.append((better, died))
            else:
                raise error


class Local:
    """Processes on this machine, with a core each; replaces them when one dies."""

    deaths = (BrokenProcessPool,)
    """What a future raises where its worker died, rather than the work itself."""

    def __init__(self, jobs: int) -> None:
        self._jobs = min(jobs, MOST_ON_WINDOWS) if os.name == "nt" else jobs
        self.room = AHEAD * self._jobs

    def __enter__(self) -> Self:
        """Be ready to start processes; they start with the first task."""
        limit_threads(os.environ)  # which they inherit; this process has its threads already
        self._start()
        return self

    def __exit__(self, *error: object) -> None:
        """Stop at once and abandon what is in progress."""
        self._lifeline.close()
        self._pool.shutdown(wait=True, cancel_futures=True)
        self._ends.close()

    def submit(self, work: Callable[..., Any], task: Any) -> Future[Any]:
        """Give a task to the next process that is free."""
        with _interrupts_wait():
            try:
                return self._pool.submit(work, task)
            except BrokenProcessPool:
                self.__exit__()
                self._start()
                return self._pool.submit(work, task)

    def _start(self) -> None:
        # Not forked: JAX has threads, and a fork of a process with threads may hang.
        context = multiprocessing.get_context("spawn")
        self._ends, self._lifeline = context.Pipe(duplex=False)
        self._pool = ProcessPoolExecutor(self._jobs, context, _begin, (self._ends,))


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

    def end() -> None:
        try:
            lifeline.recv()
        except (EOFError, OSError):
            os._exit(1)

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=end, daemon=True).start()


def limit_threads(environment: MutableMapping[str, str]) -> None:
    """Let an environment limit BLAS and XLA to one thread, unless the user has chosen.

    For processes that are yet to start, and for this one before it imports them.
    """
    for name in ONE_EACH:
        environment.setdefault(name, "1")
    chosen = environment.get(XLA, "")
    if XLA_FLAG not in chosen:
        environment[XLA] = f"{chosen} {XLA_FLAG}=false".strip()


@contextmanager
def cluster(address: str) -> Iterator["Cluster"]:
    """Connect to the Dask cluster of a scheduler, such as tcp://10.0.0.5:8786.

    InputError says what to do where that fails. In the end what runs is abandoned, not the cluster.
    """
    try:
        from distributed import Client, KilledWorker
    except ImportError:
        raise InputError(f"--scheduler needs a library; {INSTALL.format('cluster')}") from None
    # Dask's messages at the end of a connection are replaced by one sentence of ours.
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    try:
        asyncio.run(_greet(address))  # a client of none keeps Python from ending for 40 s
        client = Client(address, timeout=PATIENCE, set_as_default=False)
    except (MemoryError, OSError, ValueError) as error:  # no answer, or no address at all
        # What is taken for the length of an answer does not fit into memory.
        other = isinstance(error, MemoryError | TimeoutError)
        why = "but something else, such as its dashboard" if other else f"({error})"
        raise InputError(
            f"--scheduler {address}: no scheduler answers there {why}; start one "
            "with `dask scheduler`, which prints its address"
        ) from None
    with client:
        try:
            client.wait_for_workers(1, timeout=PATIENCE)
        except TimeoutError:
            raise InputError(
                f"--scheduler {address} has no workers; start some with "
                f"`dask worker {address} --nworkers auto --nthreads 1`"
            ) from None
        with client.get_executor(pure=False) as executor:
            try:
                yield Cluster(client, executor, (KilledWorker,))
            finally:
                executor.shutdown(wait=False)


async def _greet(address: str) -> None:
    """Connect to a scheduler for a moment: Dask's client waits without end for what is none."""
    from distributed.comm.core import connect
    from distributed.security import Security

    async with asyncio.timeout(PATIENCE):
        one = await connect(address, PATIENCE / 2, **Security().get_connection_args("client"))
        await one.close()


class Cluster:
    """Workers of a Dask cluster; Dask itself replaces those that die."""

    def __init__(self, client: Any, executor: Executor, deaths: tuple[type[BaseException]]) -> None:
        self._client, self.submit, self.deaths = client, executor.submit, deaths
        self._asked, self._room = -FRESH, 1

    @property
    def room(self) -> int:
        """How many tasks keep all workers busy, as of a moment ago: workers come and go."""
        now = time.monotonic()
        if now - self._asked > FRESH:
            self._asked, self._room = now, AHEAD * sum(self._client.nthreads().values())
        return self._room

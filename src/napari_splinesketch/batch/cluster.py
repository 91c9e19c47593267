"""Workers of a Dask cluster that is already running."""

import logging
import time
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import ExitStack
from typing import Any, Self

from napari_splinesketch.batch.local import AHEAD
from napari_splinesketch.files import INSTALL

PATIENCE = 20.0
"""How long a scheduler may take to answer, and the first worker to appear, s."""
FRESH = 2.0
"""How long the number of workers is cached, s."""


class Cluster:
    """Works on the cluster of a scheduler; Dask itself replaces workers that die.

    `address` is the scheduler's, such as tcp://10.0.0.5:8786.
    """

    def __init__(self, address: str) -> None:
        self._address = address
        self._asked, self._room = -FRESH, 1

    def __enter__(self) -> Self:
        """Connect; ValueError says what to do where that fails."""
        try:
            from distributed import Client, KilledWorker
            from distributed.comm.addressing import resolve_address
        except ImportError:
            needed = INSTALL.format("cluster")
            raise ValueError(f"--scheduler needs a library; {needed}") from None
        self.deaths = (KilledWorker,)
        # Dask's messages at the end of a connection are replaced by one sentence of ours.
        logging.getLogger("distributed").setLevel(logging.CRITICAL)
        try:
            resolve_address(self._address)  # a client of none keeps Python from ending for 40 s
            client = Client(self._address, timeout=PATIENCE, set_as_default=False)
        except (OSError, ValueError) as error:  # no answer, or no address at all
            raise ValueError(
                f"--scheduler {self._address}: no scheduler answers there ({error}); start one "
                "with `dask scheduler`, which prints its address"
            ) from None
        with ExitStack() as inside:
            self._client = inside.enter_context(client)
            try:
                client.wait_for_workers(1, timeout=PATIENCE)
            except TimeoutError:
                raise ValueError(
                    f"--scheduler {self._address} has no workers; start some with "
                    f"`dask worker {self._address} --nworkers auto --nthreads 1`"
                ) from None
            self._executor = inside.enter_context(client.get_executor(pure=False))
            self._inside = inside.pop_all()
        return self

    def __exit__(self, *error: object) -> None:
        """Abandon what is in progress; the cluster stays."""
        self._executor.shutdown(wait=False)
        self._inside.close()

    @property
    def room(self) -> int:
        """How many tasks keep all workers busy, as of a moment ago: workers come and go."""
        now = time.monotonic()
        if now - self._asked > FRESH:
            self._asked = now
            threads: Any = self._client.nthreads()
            self._room = AHEAD * sum(threads.values())
        return self._room

    def submit(self, work: Callable[..., Any], task: Any) -> Future[Any]:
        """Give a task to the cluster."""
        return self._executor.submit(work, task)

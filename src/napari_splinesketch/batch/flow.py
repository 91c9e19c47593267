"""Tasks through workers: a few in progress at a time, and none lost when a worker dies."""

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from typing import Any, TypeVar

from napari_splinesketch.batch.cluster import Cluster
from napari_splinesketch.batch.local import Local

ALONE = 2
"""A task during which so many workers died is tried once more, with no other beside it."""

Task = TypeVar("Task")
Done = TypeVar("Done")
Workers = Local | Cluster


class DeadlyError(RuntimeError):
    """A task whose workers die."""


def through(
    workers: Workers,
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
    while True:
        while _is_room(workers, begun.values(), again):
            item = again.pop(0) if again else next(source, None)
            if item is None:
                break
            begun[workers.submit(work, item[0])] = item
        if not begun:
            return
        finished, _ = wait(begun, return_when=FIRST_COMPLETED)
        while finished:  # they are forgotten one by one
            future = finished.pop()
            task, died = item = begun.pop(future)
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


def _is_room(
    workers: Workers, begun: Collection[tuple[Any, int]], again: Sequence[tuple[Any, int]]
) -> bool:
    """Whether another task may begin; one that may kill its worker runs alone."""
    if any(died >= ALONE for _, died in (*again[:1], *begun)):
        return not begun
    return len(begun) < max(workers.room, 1)

"""Choosing the workers."""

from contextlib import AbstractContextManager, nullcontext

from napari_splinesketch.batch.flow import Here, Progress, Workers


def workers_of(
    jobs: int, scheduler: str | None, progress: Progress
) -> AbstractContextManager[Workers]:
    """Give the workers: the cluster of a scheduler's address, other processes, or this one.

    `progress` is called with the progress within a task, where this process does it.
    """
    if scheduler:
        from napari_splinesketch.batch.cluster import Cluster

        return Cluster(scheduler)
    if jobs > 1:
        from napari_splinesketch.batch.local import Local

        return Local(jobs)
    return nullcontext(Here(progress))

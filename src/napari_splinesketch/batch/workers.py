"""Choosing the workers."""

from collections.abc import Iterator
from contextlib import contextmanager

from napari_splinesketch.batch.flow import Here, Progress, Workers


@contextmanager
def workers_of(jobs: int, scheduler: str | None, progress: Progress) -> Iterator[Workers]:
    """Give the workers: a cluster, other processes, or this one.

    Parameters
    ----------
    jobs
        Number of processes.
    scheduler
        Address of the cluster's scheduler; None works on this machine.
    progress
        Called with the progress within a task, where this process does it.
    """
    if scheduler:
        from napari_splinesketch.batch.cluster import Cluster

        with Cluster(scheduler) as cluster:
            yield cluster
    elif jobs > 1:
        from napari_splinesketch.batch.local import Local

        with Local(jobs) as local:
            yield local
    else:
        yield Here(progress)

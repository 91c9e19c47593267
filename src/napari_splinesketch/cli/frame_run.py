"""All frames of a run, one path whoever does the work: this process, others, or a cluster."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial as bind

import numpy as np
from jaxtyping import Real

from napari_splinesketch.batch.flow import DeadlyError, Here, Progress, Workers, through
from napari_splinesketch.cli.frame_source import Source
from napari_splinesketch.cli.frame_task import Finder, FrameDone, FrameTask, do_frame, failed
from napari_splinesketch.cli.images import ImageError
from napari_splinesketch.cli.run import FrameJob, Run

Report = Callable[[float, int], None]
"""Told how many frames are done, counting part of the one being worked on, and how many to do."""


@dataclass(frozen=True, kw_only=True)
class SharedJob(FrameJob):
    """A job whose frames can be shared out among workers; the attributes are its options."""

    jobs: int = 1
    scheduler: str | None = None


def work(
    job: SharedJob, run: Run, finders: Iterable[tuple[int, Finder]], count: int, report: Report
) -> None:
    """Work on frames, `count` in all, and keep each as soon as it is done."""
    tally = _Tally(report, count)
    with _workers(job, tally.part) as workers:
        reading = _Reading(run, here=isinstance(workers, Here))
        tasks = _tasks(run, finders, reading, tally)
        for task, done in through(workers, do_frame, tasks, mend=reading.mend):
            if isinstance(done, DeadlyError):
                done = failed(task, str(done))
            run.partial.save(done.report, done.table, done.reconstruction)
            tally.add()


def _tasks(
    run: Run, finders: Iterable[tuple[int, Finder]], reading: "_Reading", tally: "_Tally"
) -> Iterator[FrameTask]:
    """Give the frames that are not finished; those of an earlier run count as done."""
    for frame, finder in finders:
        if run.partial.done(frame):
            tally.add()
        else:
            yield FrameTask(frame, reading.of(frame), finder, run.head.scale, run.head.units)


@contextmanager
def _workers(job: SharedJob, progress: Progress) -> Iterator[Workers]:
    if job.scheduler:
        from napari_splinesketch.batch.cluster import Cluster

        with Cluster(job.scheduler) as cluster:
            yield cluster
    elif job.jobs > 1:
        from napari_splinesketch.batch.local import Local

        with Local(job.jobs) as local:
            yield local
    else:
        yield Here(progress)


class _Tally:
    """Counts frames, and tells."""

    def __init__(self, report: Report, count: int) -> None:
        self._report, self._count, self._done = report, count, 0

    def add(self) -> None:
        self._done += 1
        self.part(0.0)

    def part(self, share: float) -> None:
        self._report(self._done + share, self._count)


class _Reading:
    """How a frame's pixels come to who works on it: read there where the image is, or sent."""

    def __init__(self, run: Run, *, here: bool) -> None:
        self._images = run.images
        self._here, self._send = here, False
        job = run.job
        self._source = Source.of(job.image, job.channel, job.z, run.images)

    def of(self, frame: int) -> Callable[[], Real[np.ndarray, "H W"]]:
        if self._here:
            return bind(self._images.__getitem__, frame)
        return self._sent(frame) if self._send else bind(self._source.read, frame)

    def mend(self, task: FrameTask, done: FrameDone) -> FrameTask | None:
        """Send the pixels where a worker cannot open the image."""
        if done.reached:
            return None
        self._send = True
        return replace(task, read=self._sent(task.frame))

    def _sent(self, frame: int) -> Callable[[], Real[np.ndarray, "H W"]]:
        try:
            return bind(np.asarray, self._images[frame])
        except ImageError as error:
            return bind(_refuse, str(error))


def _refuse(why: str) -> Real[np.ndarray, "H W"]:
    raise ImageError(why)

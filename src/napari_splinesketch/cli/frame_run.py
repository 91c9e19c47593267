"""All frames of a run, one path whoever does the work: this process, others, or a cluster."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial as bind
from pathlib import Path
from typing import Protocol

import numpy as np
from jaxtyping import Real

from napari_splinesketch.batch.flow import DeadlyError, Here, Progress, Workers, through
from napari_splinesketch.cli.frame_source import Source
from napari_splinesketch.cli.frame_task import Finder, FrameDone, FrameTask, do_frame, failed
from napari_splinesketch.cli.images import Frames, ImageError
from napari_splinesketch.cli.outcome import gather
from napari_splinesketch.cli.partial import Partial
from napari_splinesketch.cli.report import Spool
from napari_splinesketch.labels import Labels, table, write_labels
from napari_splinesketch.labels.formats import writer_of

Report = Callable[[float, int], None]
"""Told how many frames are done, counting part of the one being worked on, and how many to do."""


class FrameJob(Protocol):
    """What all jobs that go through frames have in common."""

    @property
    def image(self) -> str: ...  # noqa: D102
    @property
    def channel(self) -> int | None: ...  # noqa: D102
    @property
    def z(self) -> int | None: ...  # noqa: D102
    @property
    def output(self) -> Path: ...  # noqa: D102
    @property
    def overwrite(self) -> bool: ...  # noqa: D102
    @property
    def jobs(self) -> int: ...  # noqa: D102
    @property
    def scheduler(self) -> str | None: ...  # noqa: D102


@dataclass(frozen=True, eq=False)
class FrameRun:
    """A run over the frames of an image.

    Attributes
    ----------
    job
        What the user asked for.
    images
        The frames.
    partial
        Keeps what is finished.
    head
        The size of a pixel, as labels without curves.
    """

    job: FrameJob
    images: Frames
    partial: Partial
    head: Labels

    def work(self, finders: Iterable[tuple[int, Finder]], count: int, report: Report) -> None:
        """Work on frames, `count` in all, and keep each as soon as it is done."""
        tally = _Tally(report, count)
        with self._workers(tally.part) as workers:
            reading = _Reading(self, here=isinstance(workers, Here))
            tasks = self._tasks(finders, reading, tally)
            for task, done in through(workers, do_frame, tasks, mend=reading.mend):
                if isinstance(done, DeadlyError):
                    done = failed(task, str(done))
                self.partial.save(done.report, done.table, done.reconstruction)
                tally.add()

    def write(
        self,
        frames: Iterable[int],
        preset: str,
        options: dict[str, object],
        *,
        checksums: bool = False,
    ) -> tuple[Spool, Labels, tuple[str, ...]]:
        """Write the labels of all frames.

        Parameters
        ----------
        frames
            Their numbers, rising.
        preset, options
            For the provenance.
        checksums
            Whether the frames' checksums are wanted in what the labels share.

        Returns
        -------
        The reports, what the labels share, and what their format cannot hold.
        """
        reports = Spool(filter(None, map(self.partial.done, frames)))
        native = writer_of(self.job.output).write is table.write
        labels = gather(
            self.head,
            self.images,
            self.partial,
            reports,
            preset=preset,
            options=options,
            curves=not native,
            checksums=checksums or not native,
        )
        if not native:
            losses = write_labels(self.job.output, labels, overwrite=self.job.overwrite)
            return reports, replace(labels, labels=()), losses
        tables = (self.partial.table(done.frame) for done in reports)
        scale = self.head.scale
        rows = table.join(self.job.output, tables, scale, overwrite=self.job.overwrite)
        lost = table.lost(provenance=bool(labels.provenance), scale=bool(scale and not rows))
        return reports, labels, lost

    def _tasks(
        self, finders: Iterable[tuple[int, Finder]], reading: "_Reading", tally: "_Tally"
    ) -> Iterator[FrameTask]:
        """Give the frames that are not finished; those of an earlier run count as done."""
        for frame, finder in finders:
            if self.partial.done(frame):
                tally.add()
            else:
                read = reading.of(frame)
                yield FrameTask(frame, read, finder, self.head.scale, self.head.units)

    @contextmanager
    def _workers(self, progress: Progress) -> Iterator[Workers]:
        if self.job.scheduler:
            from napari_splinesketch.batch.cluster import Cluster

            with Cluster(self.job.scheduler) as cluster:
                yield cluster
        elif self.job.jobs > 1:
            from napari_splinesketch.batch.local import Local

            with Local(self.job.jobs) as local:
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

    def __init__(self, run: FrameRun, *, here: bool) -> None:
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

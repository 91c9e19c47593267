"""A run over the frames of an image: one loop, for any workers and any order."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from dataclasses import dataclass, field, fields, replace
from datetime import UTC, datetime
from functools import cached_property, partial
from itertools import chain, starmap
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from napari_splinesketch import __version__
from napari_splinesketch.batch import workers
from napari_splinesketch.batch.frame_task import (
    Find,
    FrameDone,
    FrameReport,
    FrameTask,
    Source,
    UnreachableError,
    do_frame,
    failed,
    sent,
)
from napari_splinesketch.batch.partial import Partial, Spool
from napari_splinesketch.cli.jobs import FrameJob, SharedJob
from napari_splinesketch.cli.terminal import Report, was_interrupted
from napari_splinesketch.engine.checks import check_call, check_options
from napari_splinesketch.engine.types import InputError
from napari_splinesketch.files import atomic, checksum_of_file, counted
from napari_splinesketch.images.frames import Frames, checksum, is_url, open_frames
from napari_splinesketch.labels import Label, Labels, masks, table
from napari_splinesketch.labels.formats import writer_of
from napari_splinesketch.labels.types import AnyLabels, ByFrame

FREE = {"image", "pixel_size", "units", "json", "overwrite", "resume", "verbose"}
FREE |= {"jobs", "scheduler"}
"""Options, beside files, that labels do not depend on, or that are compared in another way."""
T = TypeVar("T")
Todo = tuple[int, Find, tuple[Label, ...]]
"""A frame, what to do with its image, and its labels where that fails."""


@dataclass(frozen=True)
class Outcome:
    """What a command did."""

    frames: Spool
    """A report of each frame that was worked on."""
    notes: tuple[str, ...]
    """What was left out of the sketches, or could not be written into the labels."""
    labels: ByFrame
    """What was written."""
    written: Sequence[Path]
    """Where: an output that shows refined frames is left out where there are none."""


@dataclass(eq=False)
class Run:
    """A run over the frames of an image."""

    job: FrameJob
    images: Frames
    partial: Partial
    """Keeps what is finished."""
    head: Labels
    """The size of a pixel, as labels without curves."""
    settings: Mapping[str, object]
    """Options that the labels depend on."""
    report: Report
    outputs: ExitStack
    """Holds the outputs until all are written."""
    count: int = 0
    """Of the frames that are to be worked on."""
    alike: bool = False
    """Whether frames have to be of one size, as pages of a TIFF are."""
    _written: list[Path] = field(default_factory=list, init=False)
    _shape: tuple[int, ...] | None = field(default=None, init=False)
    _same: bool = field(default=False, init=False)
    _done: int = field(default=0, init=False)
    _reached: float = field(default=0.0, init=False)

    def reach(self, done: float) -> None:
        """Report how many frames are done, counting parts of them; the count never falls."""
        self._reached = max(self._reached, done)
        self.report(self._reached, self.count)

    def part(self, share: float) -> None:
        """Report how much of the next frame is done."""
        self.reach(self._done + share)

    def keep(self, done: FrameDone) -> None:
        """Keep a finished frame; what a library returns after Ctrl-C is not a result."""
        if was_interrupted():
            raise KeyboardInterrupt
        if self.alike and (shape := done.report.shape):
            self._shape = self._shape or shape
            if shape != self._shape:
                height, width = shape
                raise InputError(
                    f"frame {done.report.frame} has {height} x {width} px, and others have"
                    f" {self._shape[0]} x {self._shape[1]}; masks and reconstructions are of one"
                    " size: add --resume and leave them out, or refine each size on its own"
                )
        labels = replace(self.head, labels=done.labels)
        self.partial.save(done.report, labels, done.reconstruction)
        self._count()

    def _count(self) -> None:
        self._done += 1
        self.part(0.0)

    def shared(self, job: SharedJob, todo: Iterable[Todo]) -> None:
        """Work on independent frames, here or shared among workers."""
        left = (each for each in todo if not self.finished(each[0]))
        address = job.scheduler
        if job.jobs == 1 and address is None:
            for frame, find, instead in left:
                read = partial(self.images.__getitem__, frame)
                self.keep(do_frame(FrameTask(frame, read, find, instead), self.part))
            return
        image = job.image if is_url(job.image) else str(Path(job.image).absolute())
        source = Source(image, job.channel, job.z, self.images.count)
        unreachable = False

        def task_of(frame: int, find: Find, instead: tuple[Label, ...]) -> FrameTask:
            read = sent(self.images, frame) if unreachable else partial(source.read, frame)
            return FrameTask(frame, read, find, instead)

        def again(task: FrameTask, error: BaseException) -> FrameTask | None:
            nonlocal unreachable
            if not isinstance(error, UnreachableError):
                return None
            unreachable = True
            return replace(task, read=sent(self.images, task.frame))

        with workers.Local(job.jobs) if address is None else workers.cluster(address) as many:
            tasks = starmap(task_of, left)
            for task, done in workers.through(many, do_frame, tasks, retry=again):
                dead = isinstance(done, workers.DeadlyError)
                self.keep(failed(task, str(done)) if dead else done)

    def finished(self, frame: int) -> FrameReport | None:
        """Give the report of a frame that an earlier run has finished, of the same image; count it.

        None where it could not be read, or killed its workers, and can be read by now. Pixels are
        compared for the first such frame, and where a file has been written since.
        """
        done = self.partial.done(frame, pictured=bool(getattr(self.job, "reconstruction", None)))
        if done is None:
            return None
        if not done.sha256:
            with suppress(InputError):
                self.images[frame]
                return None
        elif not self._same or self._is_newer(frame):
            if checksum(self.images[frame]) != done.sha256:
                raise InputError(
                    f"frame {frame} of {self.images.name} is not the one that the interrupted run"
                    f" in {self.partial.folder} has finished; delete that folder and start again"
                )
            self._same, self._shape = True, done.shape
        self._count()
        return done

    def _is_newer(self, frame: int) -> bool:
        files, kept = self.images.files, self.partial.table(frame).stat()
        file = files[frame] if files else self._newest
        return file.exists() and _came(file) >= kept.st_mtime

    @cached_property
    def _newest(self) -> Path:
        """What was written last of the image: a Zarr has many files."""
        image = Path(self.job.image)
        every = filter(Path.exists, chain([image], image.rglob("*")))
        return max(every, key=_came, default=image)

    def write(self, frames: Iterable[int], notes: Iterable[str] = ()) -> Outcome:
        """Write the labels of all frames, in rising order, however many; `notes` come first."""
        reports = Spool(map(self.partial.finished, frames))
        labels = self._labels(reports)
        writer, output = writer_of(self.job.output), self.job.output
        if writer is table.FORMAT:  # as the frames are kept: there is nothing to be read
            numbers = (done.frame for done in reports)
            self.put(self.partial.join, output, numbers, labels.head.scale)
        else:
            notes = (*notes, *self.put(writer.write_whole, output, labels))
        return Outcome(reports, tuple(notes), labels, self._written)

    def put(self, write: Callable[..., T], path: Path, *content: Any) -> T:
        """Write an output; all of them take their places together, at the end of the run."""
        own = atomic(path, overwrite=self.job.overwrite)
        self._written.append(path)
        return write(self.outputs.enter_context(own), *content)

    def _labels(self, reports: Spool) -> ByFrame:
        first = next((self.images[done.frame] for done in reports if done.error is None), None)
        head = self.head
        if first is not None:
            image = {
                "name": self.images.name,
                "shape": list(first.shape),
                "dtype": first.dtype.name,
                "sha256": {str(done.frame): done.sha256 for done in reports if done.sha256},
            }
            source = {
                "software": f"napari-splinesketch {__version__}",
                "date": datetime.now(UTC).isoformat(timespec="seconds"),
                "preset": str(self.settings.get("preset", "")),
                "options": {key: self.settings[key] for key in self.settings if key != "preset"},
                "image": image,
            }
            shapes = {done.shape for done in reports if done.shape}
            shape: Any = shapes.pop() if len(shapes) == 1 else None
            head = replace(head, shape=shape, provenance=source)
        kept = (done.frame for done in reports if self.partial.has_labels(done.frame))
        frames = np.fromiter(kept, dtype=np.int64)
        return ByFrame(frames, head, lambda: (self.partial.labels(int(f)) for f in frames))


def _came(file: Path) -> float:
    """Tell when a file was written or put in its place: a copy may be as old as what was copied."""
    return max(file.stat().st_mtime, file.stat().st_ctime)


def is_judged(line: Label) -> bool:
    """Tell whether somebody has reviewed or locked a line."""
    return line.review != "open" or line.locked


def judged(number: int) -> Iterator[str]:
    """Say what becomes of lines that somebody has reviewed or locked."""
    if number:
        yield f"{counted(number, 'reviewed or locked line')} refined again, and open"


@contextmanager
def open_run(job: FrameJob, report: Report, drawn: AnyLabels | None = None) -> Iterator[Run]:
    """Open the image of a job; on success, outputs take their places and finished frames go.

    What is `drawn` gives the size of a pixel where neither the job nor the image does. What every
    frame or the last output would fail for is refused at once.
    """
    with open_frames(job.image, channel=job.channel, z=job.z) as images:
        check_call(None, getattr(job, "seed", 0))
        masked = writer_of(job.output) is masks.FORMAT or getattr(job, "masks", None)
        if masked and drawn:
            masks.page_count(drawn)
        if masked or job.half_width is not None:
            try:
                height, width = images[0].shape
            except InputError:
                pass  # frames that cannot be read are reported one by one
            else:
                check_options((height, width), job.polarity, job.half_width)
                if masked:
                    masks.drawn_shape(Labels(shape=(height, width)))
        head = Labels()
        # The last word is the user's; an image's may be wrong.
        for known in (drawn and drawn.head, images, job):
            if known and known.scale:
                units = known.units if known is images else known.units or head.units
                with suppress(InputError) if known is images else nullcontext():
                    head = Labels(scale=known.scale, units=units)
        others = [f.name for f in fields(job) if not {"read", "written"} & f.metadata.keys()]
        settings = {
            "command": type(job).__name__.removesuffix("Job").lower(),
            **{name: getattr(job, name) for name in others if name not in FREE},
        }
        depends = {
            "version": __version__,
            "image": [images.name, images.count],
            "pixel size": [head.scale, head.units],
            "sketches": [checksum_of_file(path) for path in job.files("read")],
            **settings,
        }
        kept = Partial(job.output, depends, resume=job.resume)
        settings |= {"sketches": [path.name for path in job.files("read")]}
        with ExitStack() as outputs:
            yield Run(job, images, kept, head, settings, report, outputs)
        kept.remove()

"""A run over the frames of an image: what the commands that make one have in common."""

from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial as bind
from pathlib import Path

import numpy as np

from napari_splinesketch import __version__
from napari_splinesketch.cli.images import Frames, is_part_of, open_frames
from napari_splinesketch.cli.partial import Partial
from napari_splinesketch.cli.report import Reports, Spool
from napari_splinesketch.engine.types import Polarity
from napari_splinesketch.files import check_outputs, owned, same_file
from napari_splinesketch.labels import Labels, table
from napari_splinesketch.labels.formats import writer_of
from napari_splinesketch.labels.json_tree import Members
from napari_splinesketch.labels.provenance import provenance
from napari_splinesketch.labels.stream import ByFrame


@dataclass(frozen=True, kw_only=True)
class FrameJob:
    """What a command was asked for; the attributes are its options."""

    image: str
    output: Path
    polarity: Polarity = "auto"
    half_width: float | None = None
    channel: int | None = None
    z: int | None = None
    scale: tuple[float, float] | None = None
    units: str | None = None
    resume: bool = False
    overwrite: bool = False

    def outputs(self) -> tuple[Path, ...]:
        """Give every file that the job writes."""
        return (self.output,)

    def inputs(self) -> tuple[Path, ...]:
        """Give every file that the job reads, beside the image."""
        return ()

    def check(self) -> None:
        """Refuse a job whose outputs could not be written, before it has cost any time."""
        writer_of(self.output)
        check_outputs(self.outputs(), self._reads, overwrite=self.overwrite)

    def _reads(self, path: Path) -> bool:
        return is_part_of(path, self.image) or any(same_file(path, own) for own in self.inputs())


@dataclass(frozen=True, eq=False)
class Run:
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

    def write(
        self, frames: Iterable[int], preset: str = "", /, **options: object
    ) -> tuple[Reports, ByFrame, tuple[str, ...]]:
        """Write the labels of all frames, however many.

        Parameters
        ----------
        frames
            Their numbers, rising.
        preset, options
            For the provenance.

        Returns
        -------
        The reports, the labels, and what their format cannot hold.
        """
        reports = Spool(map(self.partial.finished, frames))
        labels = self._labels(reports, preset, options)
        output, overwrite = self.job.output, self.job.overwrite
        writer = writer_of(output)
        if writer.write is table.write:  # as the frames are kept: there is nothing to be read
            tables = (self.partial.table(done.frame) for done in reports)
            table.join(output, tables, labels.scale, overwrite=overwrite)
        else:
            writer.write(output, labels, overwrite=overwrite)
        return reports, labels, writer.lost(labels)

    def _labels(self, reports: Reports, preset: str, options: dict[str, object]) -> ByFrame:
        first = next((self.images[done.frame] for done in reports if done.error is None), None)
        head = self.head
        if first is not None:
            source = provenance(
                image=self.images.name,
                shape=first.shape,
                dtype=str(first.dtype),
                checksums=Members(bind(_checksums, reports)),
                preset=preset,
                options={
                    "polarity": self.job.polarity,
                    "half_width": self.job.half_width,
                    **options,
                },
            )
            shape = first.shape[0], first.shape[1]
            head = Labels((), head.scale, head.units, shape, source)
        kept = (done.frame for done in reports if self.partial.has_labels(done.frame))
        frames = np.fromiter(kept, dtype=np.int64)
        return ByFrame(frames, head, lambda: (self.partial.labels(int(f)) for f in frames))


def _checksums(reports: Reports) -> Iterator[tuple[str, object]]:
    return ((str(done.frame), done.sha256) for done in reports if done.sha256)


@dataclass(frozen=True)
class Outcome:
    """What a command did.

    Attributes
    ----------
    frames
        A report of each frame that was worked on.
    notes
        What was left out of the sketches, or could not be written into the labels.
    """

    frames: Reports
    notes: tuple[str, ...]


@contextmanager
def open_run(job: FrameJob, drawn: Labels | None = None, /, **settings: object) -> Iterator[Run]:
    """Open the image of a job; what is finished is deleted when the block ends well.

    Parameters
    ----------
    job
        What the user asked for.
    drawn
        Tells the size of a pixel, where neither the job nor the image does.
    settings
        What the results depend on, beside what all jobs have.
    """
    with ExitStack() as inside:
        for path in job.outputs():
            inside.enter_context(owned(path))
        job.check()  # once more: another run may have ended just before it was ours
        images = inside.enter_context(open_frames(job.image, channel=job.channel, z=job.z))
        head = Labels()
        for known in (drawn, images, job):  # the last word is the user's
            if known and known.scale:
                head = Labels(scale=known.scale, units=known.units)
        depends = {
            "version": __version__,
            "image": [images.name, images.count],
            "polarity": job.polarity,
            "half-width": job.half_width,
            "channel": job.channel,
            "z": job.z,
            "pixel size": [head.scale, head.units],
            **settings,
        }
        partial = Partial(job.output, depends, resume=job.resume)
        yield Run(job, images, partial, head)
        partial.remove()

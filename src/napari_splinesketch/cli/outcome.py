"""What the commands that go through frames have in common: checks before, labels after."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from napari_splinesketch.cli.images import Frames
from napari_splinesketch.cli.partial import Partial
from napari_splinesketch.cli.report import FrameReport
from napari_splinesketch.labels import Labels
from napari_splinesketch.labels.formats import writer_of
from napari_splinesketch.labels.provenance import provenance


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

    frames: tuple[FrameReport, ...]
    notes: tuple[str, ...]


class Scaled(Protocol):
    """The size of a pixel as the user gave it."""

    @property
    def scale(self) -> tuple[float, float] | None:
        """(y, x) size in `units`, or None."""
        ...

    @property
    def units(self) -> str | None:
        """Physical unit, or None."""
        ...


def check_files(labels: Path, outputs: Sequence[Path], *, overwrite: bool) -> None:
    """Refuse outputs that cannot be written, of which `labels` is the file of labels."""
    writer_of(labels)
    for path in outputs:
        if not path.parent.is_dir():
            raise FileNotFoundError(f"{path.parent}: no such folder; make it first")
        if path.exists() and not overwrite:
            raise FileExistsError(f"{path} exists already; choose another name or add --overwrite")
    if len({path.resolve() for path in outputs}) < len(outputs):
        raise ValueError("two outputs have the same name; give each its own")


def words(error: Exception) -> str:
    """Say why a frame could not be worked on, in one line."""
    text = " ".join(str(error).split())
    return text if isinstance(error, ValueError) else f"{type(error).__name__}: {text}"


def gather(
    job: Scaled,
    images: Frames,
    partial: Partial,
    reports: Sequence[FrameReport],
    *,
    preset: str,
    options: dict[str, object],
    sketches: Labels | None = None,
) -> Labels:
    """Put the labels of all frames together, with the size of a pixel and where they come from.

    Parameters
    ----------
    job
        What the user asked for.
    images
        The frames.
    partial
        Holds the labels of each.
    reports
        What came of them.
    preset, options
        For the provenance.
    sketches
        Give the size of a pixel where nobody else does.
    """
    done = [report.frame for report in reports if report.error is None]
    first = images[done[0]] if done else None
    scale, units = job.scale, job.units
    if not scale:
        scale, units = images.scale, images.units
    if not scale and sketches:
        scale, units = sketches.scale, sketches.units
    source: dict[str, object] = {}
    if first is not None:
        source = provenance(
            image=images.name,
            shape=first.shape,
            dtype=str(first.dtype),
            checksums={r.frame: r.sha256 for r in reports if r.sha256},
            preset=preset,
            options=options,
        )
    labels = tuple(label for r in reports for label in partial.labels(r.frame).labels)
    return Labels(labels, scale, units, first.shape if first is not None else None, source)

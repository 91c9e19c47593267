"""What the commands that go through frames have in common: checks before, labels after."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from napari_splinesketch.cli.images import Frames
from napari_splinesketch.cli.partial import Partial
from napari_splinesketch.cli.report import Reports
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

    frames: Reports
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


def pixel_size(job: Scaled, images: Frames, sketches: Labels | None = None) -> Labels:
    """Give the size of a pixel, as labels without curves: the user's, else the image's own."""
    for known in (job, images, sketches):
        if known and known.scale:
            return Labels(scale=known.scale, units=known.units)
    return Labels()


def gather(
    size: Labels,
    images: Frames,
    partial: Partial,
    reports: Reports,
    *,
    preset: str,
    options: dict[str, object],
    curves: bool = True,
    checksums: bool = True,
) -> Labels:
    """Put the labels of all frames together, with the size of a pixel and where they come from.

    Parameters
    ----------
    size
        The size of a pixel, as `pixel_size` gives it.
    images
        The frames.
    partial
        Holds the labels of each.
    reports
        What came of them.
    preset, options
        For the provenance.
    curves
        Whether to read the labels; False gives what they share alone.
    checksums
        Whether the provenance lists the checksums of all frames.
    """
    first = next((images[report.frame] for report in reports if report.error is None), None)
    source: dict[str, object] = {}
    if first is not None:
        source = provenance(
            image=images.name,
            shape=first.shape,
            dtype=str(first.dtype),
            checksums={r.frame: r.sha256 for r in reports if r.sha256 and checksums},
            preset=preset,
            options=options,
        )
    frames = (report.frame for report in reports) if curves else ()
    labels = tuple(label for frame in frames for label in partial.labels(frame).labels)
    shape = first.shape if first is not None else None
    return Labels(labels, size.scale, size.units, shape, source)

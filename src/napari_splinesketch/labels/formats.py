"""Reading and writing labels, whatever the format."""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from napari_splinesketch.engine.types import Curve, Refinement
from napari_splinesketch.labels import (
    coco,
    geojson,
    imagej,
    masks,
    numpy_splines,
    shapes_csv,
    sleap,
    swc,
    table,
    tierpsy,
    wcon,
)
from napari_splinesketch.labels.files import LabelsError
from napari_splinesketch.labels.stream import AnyLabels, ByFrame, facts_of
from napari_splinesketch.labels.types import Labels

HEAD = 4096


class Write(Protocol):
    """Writes a whole file or nothing."""

    def __call__(
        self, path: str | os.PathLike[str], labels: AnyLabels, *, overwrite: bool = False
    ) -> None:
        """Write `labels`; FileExistsError unless `overwrite`."""


@dataclass(frozen=True)
class Reader:
    """A format that can be read.

    Attributes
    ----------
    name
        For menus and messages.
    suffix
        How the file's name ends, in lower case.
    read
        Reads a file.
    fits
        Whether a file that begins with these bytes may be of this format.
    by_frame
        Opens a file to be read frame by frame, or gives None where this one cannot be; None where
        the format cannot.
    """

    name: str
    suffix: str
    read: Callable[[str | os.PathLike[str]], Labels]
    fits: Callable[[bytes], bool] = lambda head: True
    by_frame: Callable[[str | os.PathLike[str]], ByFrame | None] | None = None


@dataclass(frozen=True)
class Writer:
    """A format that can be written.

    Attributes
    ----------
    name
        For menus and messages.
    suffix
        How the file's name must end, in lower case; the longest that fits decides.
    write
        Writes a file.
    losses
        Says what of the labels the format has no place for, one sentence each.
    reviews
        Whether it has a place for what the user says of a curve.
    """

    name: str
    suffix: str
    write: Write
    losses: Callable[[AnyLabels], tuple[str, ...]]
    reviews: bool = False

    def lost(self, labels: AnyLabels) -> tuple[str, ...]:
        """Say everything of the labels that the format has no place for."""
        told = self.losses(labels)
        if not self.reviews and facts_of(labels).reviewed:
            told += (f"{self.name}: no place for what you accepted or rejected",)
        return told


READERS = (
    Reader("napari Shapes CSV", ".csv", shapes_csv.read, shapes_csv.fits),
    Reader("labels CSV", ".csv", table.read, by_frame=table.by_frame),
    Reader("GeoJSON", ".geojson", geojson.read),
    Reader("GeoJSON, named .json", ".json", geojson.read, lambda head: b'"Feature' in head),
    Reader("ImageJ ROIs", ".zip", imagej.read),
    Reader("ImageJ ROI", ".roi", imagej.read),
    Reader("NumPy splines", ".npy", numpy_splines.read, by_frame=numpy_splines.by_frame),
    Reader("NumPy splines, packed", ".npz", numpy_splines.read, by_frame=numpy_splines.by_frame),
    Reader("SWC", ".swc", swc.read),
    Reader("WCON", ".wcon", wcon.read),
    Reader("WCON, named .json", ".json", wcon.read, lambda head: b'"units"' in head),
)
"""Those of one suffix in the order in which they are tried."""

WRITERS = (
    Writer("labels CSV", ".csv", table.write, table.losses, reviews=True),
    Writer("napari Shapes CSV", ".shapes.csv", shapes_csv.write, shapes_csv.losses),
    Writer("GeoJSON", ".geojson", geojson.write, geojson.losses, reviews=True),
    Writer("ImageJ ROIs", ".zip", imagej.write, imagej.losses),
    Writer("SWC", ".swc", swc.write, swc.losses),
    Writer("WCON", ".wcon", wcon.write, wcon.losses, reviews=True),
    Writer("COCO keypoints", ".coco.json", coco.write, coco.losses),
    Writer("SLEAP", ".slp", sleap.write, sleap.losses),
    Writer("Tierpsy skeletons", "_skeletons.hdf5", tierpsy.write, tierpsy.losses),
    Writer("masks, a label image a frame", ".masks.tif", masks.write, masks.losses),
    Writer("masks, one a body", ".stack.tif", masks.write_stack, masks.stack_losses),
)


def reader_of(path: str | os.PathLike[str]) -> Reader:
    """Find the format of an existing file by its name and its first bytes."""
    name = Path(path).name.lower()
    with Path(path).open("rb") as file:
        head = file.read(HEAD)
    for reader in READERS:
        if name.endswith(reader.suffix) and reader.fits(head):
            return reader
    allowed = ", ".join(sorted({reader.suffix for reader in READERS}))
    raise LabelsError(path, "", f"not a file of labels; expected one of {allowed}")


def writer_of(path: str | os.PathLike[str]) -> Writer:
    """Find the format that a file of this name is written in."""
    name = Path(path).name
    fitting = [writer for writer in WRITERS if name.lower().endswith(writer.suffix)]
    if not fitting:
        allowed = ", ".join(f"{writer.suffix} ({writer.name})" for writer in WRITERS)
        raise ValueError(f"{name}: no format has this ending; expected one of {allowed}")
    return max(fitting, key=lambda writer: len(writer.suffix))


def read_labels(path: str | os.PathLike[str]) -> Labels:
    """Read labels from a file.

    Parameters
    ----------
    path
        A file in one of the formats of `READERS`; its name and content tell which.

    Returns
    -------
    Labels
        Points in (row, col) pixels. A CSV table gives back what was written, bit for bit.

    Raises
    ------
    LabelsError
        When the file is malformed: names the file, the place and the reason.
    """
    return reader_of(path).read(path)


def write_labels(
    path: str | os.PathLike[str],
    labels: AnyLabels | Refinement | Sequence[Curve],
    *,
    overwrite: bool = False,
) -> tuple[str, ...]:
    """Write labels to a file, whole or not at all.

    Parameters
    ----------
    path
        The file to write; its directory must exist. The ending of its name decides the format.
    labels
        Labels, in memory or read frame by frame, a refinement, or refined curves; the last two
        are taken as frame 0.
    overwrite
        Replace an existing file; otherwise it raises FileExistsError.

    Returns
    -------
    tuple of str
        What the format has no place for and the file therefore lacks, one sentence each.
    """
    writer = writer_of(path)
    labels = as_labels(labels)
    writer.write(path, labels, overwrite=overwrite)
    return writer.lost(labels)


def as_labels(labels: AnyLabels | Refinement | Sequence[Curve]) -> AnyLabels:
    """Take a refinement or curves as the labels of frame 0."""
    if isinstance(labels, AnyLabels):
        return labels
    if isinstance(labels, Refinement):
        return Labels.from_refinement(labels)
    return Labels.from_curves(labels)

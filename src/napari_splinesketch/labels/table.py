"""The native format: a CSV table with one row for each point of a curve."""

import csv
import io
import itertools
import os
import shutil
from array import array
from collections.abc import Iterable, Iterator
from functools import partial
from typing import TextIO

import numpy as np

from napari_splinesketch.labels.files import LabelsError, atomic
from napari_splinesketch.labels.geometry import width_growth
from napari_splinesketch.labels.rows import open_rows
from napari_splinesketch.labels.stream import AnyLabels, ByFrame, facts_of
from napari_splinesketch.labels.table_reader import (
    PIXELS,
    REQUIRED,
    REVIEW,
    UNITS,
    DisorderError,
    TableReader,
)
from napari_splinesketch.labels.types import Label, Labels


def write(path: str | os.PathLike[str], labels: AnyLabels, *, overwrite: bool = False) -> None:
    """Write labels as a table, whole or not at all."""
    with (
        atomic(path, overwrite=overwrite) as temporary,
        temporary.open("x", encoding="utf-8", newline="") as file,
    ):
        _write(file, labels)


def text(labels: Labels) -> str:
    """Give the whole table as text."""
    file = io.StringIO(newline="")
    _write(file, labels)
    return file.getvalue()


def join(
    path: str | os.PathLike[str],
    tables: Iterable[str | os.PathLike[str]],
    scale: tuple[float, float] | None,
    *,
    overwrite: bool = False,
) -> None:
    """Write the rows of many tables as one, without reading them into memory.

    Parameters
    ----------
    path
        The table to write.
    tables
        Tables as `write` leaves them, with the same columns and no body twice.
    scale
        The scale that all of them were written with.
    overwrite
        Replace an existing file.
    """
    header = text(Labels(scale=scale)).encode()
    with atomic(path, overwrite=overwrite) as temporary, temporary.open("xb") as file:
        file.write(header)
        for table in tables:
            with open(table, "rb") as part:
                if part.readline() != header:
                    raise LabelsError(table, "line 1", "other columns than expected")
                shutil.copyfileobj(part, file)


def _write(file: TextIO, labels: AnyLabels) -> None:
    table = csv.writer(file, lineterminator="\n")
    reviewed = facts_of(labels).reviewed
    table.writerow(PIXELS + (UNITS if labels.scale else ()) + (REVIEW if reviewed else ()))
    for label in labels.labels:
        table.writerows(_rows(label, labels, reviewed))


def losses(labels: AnyLabels) -> tuple[str, ...]:
    """Say what the table has no place for."""
    lost = []
    if labels.provenance:
        lost.append("CSV has no place for provenance (version, settings, image, date)")
    if labels.scale and not any(True for _ in labels.labels):
        lost.append("a CSV without curves cannot hold the scale")
    return tuple(lost)


def _rows(label: Label, labels: AnyLabels, reviewed: bool) -> Iterator[tuple[object, ...]]:
    size = len(label.points)
    columns: list[object] = [
        itertools.repeat(label.frame, size),
        itertools.repeat(label.curve, size),
        range(size),
        *label.points.T.tolist(),
        label.half_width.tolist(),
        label.sd.tolist(),
        label.arc_length.tolist(),
        itertools.repeat(label.status, size),
    ]
    if labels.scale:
        columns += (label.points * labels.scale).T.tolist()
        columns.append((label.half_width * width_growth(label.points, labels.scale)).tolist())
        columns.append(itertools.repeat(labels.units or "", size))
    if reviewed:
        columns.append(itertools.repeat(label.review, size))
    return zip(*columns, strict=True)  # pyright: ignore[reportArgumentType]


def read(path: str | os.PathLike[str]) -> Labels:
    """Read a table back.

    Columns may stand in any order and further ones are left alone. Rows of a curve follow one
    another, points numbered from 0. Lines are read one by one: beside the labels themselves, no
    more than one line and one curve are held.
    """
    with open_rows(path, REQUIRED) as rows:
        return TableReader(rows).labels()


def by_frame(path: str | os.PathLike[str]) -> ByFrame | None:
    """Read a table once for its frames and its scale, holding no more than the curves of one frame.

    Gives None where its frames are in no order.
    """
    frames = array("q")
    with open_rows(path, REQUIRED) as rows:
        reader = TableReader(rows)
        try:
            frames.extend(labels[0].frame for labels in reader.frames())
        except DisorderError:
            return None
        return ByFrame(np.array(frames), reader.head(), partial(read_frames, path))


def read_frames(path: str | os.PathLike[str]) -> Iterator[tuple[Label, ...]]:
    """Read a table frame by frame; its frames must be in their order."""
    with open_rows(path, REQUIRED) as rows:
        yield from TableReader(rows).frames()

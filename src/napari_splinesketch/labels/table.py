"""The native format: a CSV table with one row for each point of a curve."""

import csv
import itertools
import os
from collections.abc import Iterator

from napari_splinesketch.labels.files import atomic
from napari_splinesketch.labels.geometry import width_growth
from napari_splinesketch.labels.rows import open_rows
from napari_splinesketch.labels.table_reader import PIXELS, REQUIRED, UNITS, TableReader
from napari_splinesketch.labels.types import Label, Labels


def write(path: str | os.PathLike[str], labels: Labels, *, overwrite: bool = False) -> None:
    """Write labels as a table, whole or not at all."""
    with (
        atomic(path, overwrite=overwrite) as temporary,
        temporary.open("x", encoding="utf-8", newline="") as file,
    ):
        table = csv.writer(file, lineterminator="\n")
        table.writerow(PIXELS + (UNITS if labels.scale else ()))
        for label in labels.labels:
            table.writerows(_rows(label, labels))


def losses(labels: Labels) -> tuple[str, ...]:
    """Say what the table has no place for."""
    lost = []
    if labels.provenance:
        lost.append("CSV has no place for provenance (version, settings, image, date)")
    if labels.scale and not labels.labels:
        lost.append("a CSV without curves cannot hold the scale")
    return tuple(lost)


def _rows(label: Label, labels: Labels) -> Iterator[tuple[object, ...]]:
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
    return zip(*columns, strict=True)  # pyright: ignore[reportArgumentType]


def read(path: str | os.PathLike[str]) -> Labels:
    """Read a table back.

    Columns may stand in any order and further ones are left alone. Rows of a curve follow one
    another, points numbered from 0. Lines are read one by one: beside the labels themselves, no
    more than one line and one curve are held.
    """
    with open_rows(path, REQUIRED) as rows:
        return TableReader(rows).labels()

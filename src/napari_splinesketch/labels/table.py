"""The native format: a CSV table with one row for each point of a curve."""

import csv
import io
import itertools
import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from jaxtyping import Float

from napari_splinesketch.engine.types import Array
from napari_splinesketch.labels.csv_columns import Rows, read_curves
from napari_splinesketch.labels.files import LabelsError, atomic
from napari_splinesketch.labels.format import Format, Source, without_place
from napari_splinesketch.labels.geometry import width_growth
from napari_splinesketch.labels.stream import AnyLabels, facts_of
from napari_splinesketch.labels.types import Label, Labels

KINDS: dict[str, type | float] = {
    "frame": int,
    "curve": int,
    "point": int,
    "row": float,
    "col": float,
    "half_width": np.nan,
    "sd": np.inf,
    "status": str,
    "review": str,
    "locked": int,
    "y": float,
    "x": float,
    "units": str,
}
"""What is read; `arc_length` and `half_width_units` are for people."""
REQUIRED = ("curve", "row", "col")
BY = ("frame", "curve")
SAME = ("point", "status", "review", "locked")
PIXELS = ("frame", "curve", "point", "row", "col", "half_width", "sd", "arc_length", "status")
UNITS = ("y", "x", "half_width_units", "units")
Leading = Callable[[int, Label], Sequence[Iterable[object]]]
"""Gives further columns to stand before the others: of the label of that number, from 0."""
SCALE_TOLERANCE = 1e-6


def write(path: Path, labels: AnyLabels) -> None:
    """Write labels as a table."""
    with path.open("x", encoding="utf-8", newline="") as file:
        write_rows(file, labels)


def text(labels: Labels) -> str:
    """Give the whole table as text."""
    file = io.StringIO(newline="")
    write_rows(file, labels)
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


def write_rows(
    file: TextIO,
    labels: AnyLabels,
    names: tuple[str, ...] = (),
    leading: Leading = lambda number, label: (),
) -> None:
    """Write a table, with further columns of these names before all others."""
    table, facts = csv.writer(file, lineterminator="\n"), facts_of(labels)
    said = ("review",) * facts.reviewed + ("locked",) * facts.locked
    table.writerow(names + PIXELS + (UNITS if labels.scale else ()) + said)
    for number, label in enumerate(labels.labels):
        columns = [*leading(number, label), *_columns(label, labels)]
        words = {"review": label.review, "locked": int(label.locked)}
        columns += [itertools.repeat(words[name], len(label.points)) for name in said]
        table.writerows(zip(*columns, strict=True))


def _columns(label: Label, labels: AnyLabels) -> list[Iterable[object]]:
    size = len(label.points)
    columns: list[Iterable[object]] = [
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
    return columns


def losses(labels: AnyLabels) -> tuple[str, ...]:
    """Say what the table has no place for."""
    lost = without_place("CSV", labels, "provenance")
    if labels.scale and not any(True for _ in labels.labels):
        lost += ("a CSV without curves cannot hold the scale",)
    return lost


def read(source: Source) -> Iterator[Label]:
    """Read a table back; points are numbered from 0 where they are numbered."""
    scale = _Scale(source)
    for rows in read_curves(source, KINDS, REQUIRED, BY, SAME, watch=scale.add):
        yield _label(rows)
    source.place = "line 2"
    source.head = scale.head()


def _label(rows: Rows) -> Label:
    columns, (frame, curve) = rows.columns, rows.key(BY)
    half_width, sd = (
        columns.get(name, np.full(len(rows.lines), KINDS[name])) for name in ("half_width", "sd")
    )
    status: Any = columns["status"].item(0) if "status" in columns else "sketch"
    review: Any = columns["review"].item(0) if "review" in columns else "open"
    locked = columns["locked"].item(0) if "locked" in columns else 0
    if locked > 1:
        raise ValueError(f"curve {curve} of frame {frame}: locked is {locked}; expected 1 or 0")
    points = np.column_stack([columns["row"], columns["col"]])
    return Label(frame, curve, points, half_width, sd, status, review, bool(locked))


class _Scale:
    """The scale that the physical columns of a table tell."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self._units: str | None = None
        self._sizes: list[float | None] = [None, None]

    def add(self, rows: Rows) -> None:
        """Take the scale from some rows, or compare them with that of earlier ones."""
        if not {"y", "x", "units"} <= rows.columns.keys():
            return
        units = rows.columns["units"]
        self._units = units.item(0) if self._units is None else self._units
        for other in np.flatnonzero(units != self._units)[:1]:
            self._source.place = f"line {rows.lines[other]}"
            raise ValueError(f"units are {units[other]!r} here but {self._units!r} above")
        frame = rows.columns.get("frame", np.zeros(len(units)))
        first = frame == frame[0]
        for axis, (name, pixel) in enumerate((("y", "row"), ("x", "col"))):
            pixels, physical = rows.columns[pixel], rows.columns[name]
            size = self._sizes[axis]
            if size is None:
                size = self._sizes[axis] = _factor(pixels[first], physical[first])
            if size is None:  # the first frame lies on this axis: later ones tell
                continue
            expected = pixels * size
            agree = np.abs(physical - expected) <= SCALE_TOLERANCE * np.abs(expected) + 1e-300
            if not (size > 0 and agree.all()):
                self._source.place = f"line {rows.lines[np.argmin(agree)]}"
                raise ValueError(
                    f"{name} is not {pixel} times one scale; correct it or remove columns "
                    f"{', '.join(UNITS)}"
                )

    def head(self) -> Labels:
        """Give what was found; where one axis tells nothing, pixels are square."""
        y, x = self._sizes[0] or self._sizes[1], self._sizes[1] or self._sizes[0]
        return Labels((), (y, x), self._units or None) if y and x else Labels()


def _factor(pixels: Float[Array, " N"], physical: Float[Array, " N"]) -> float | None:
    """Find the shortest decimal number that maps `pixels` on `physical`, bit for bit.

    Where none does, as in tables that were rounded, the ratio at the largest coordinate.
    """
    largest = int(np.argmax(np.abs(pixels)))
    if pixels[largest] == 0:
        return None
    ratio = float(physical[largest] / pixels[largest])
    if not np.isfinite(ratio):
        return 0.0
    for digits in range(1, 18):
        candidate = float(f"{ratio:.{digits}g}")
        if np.array_equal(pixels * candidate, physical):
            return candidate
    for neighbour in (np.nextafter(ratio, 0), np.nextafter(ratio, np.inf)):
        if np.array_equal(pixels * neighbour, physical):
            return float(neighbour)
    return ratio


def claims(ending: str, head: bytes) -> bool:
    """Tell by its header whether a CSV is one of curves."""
    header = head.decode("utf-8-sig", errors="replace").partition("\n")[0]
    return set(REQUIRED) <= {name.strip().strip('"') for name in header.split(",")}


FORMAT = Format("labels CSV", (".csv",), read, write, losses, claims, by_frame=True)

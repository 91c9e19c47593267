"""The native format: a CSV table with one row for each point of a curve."""

import csv
import io
import itertools
import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, TextIO, cast

import numpy as np
from jaxtyping import Float

from napari_splinesketch.engine.types import Array
from napari_splinesketch.labels.csv_columns import Rows, read_rows, runs
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
    """Read a table back.

    Rows of a curve follow one another, points numbered from 0 where they are numbered. Beside the
    labels themselves, no more than some rows and one curve are held.
    """
    scale = _Scale(source)
    rest: list[_Piece] = []
    for rows in read_rows(source, KINDS, REQUIRED):
        scale.add(rows)
        numbers = [rows.columns[name] for name in ("frame", "curve") if name in rows.columns]
        for place in runs(*numbers):
            piece = _Piece(source, rows, place)
            if rest and piece.key != rest[0].key:
                yield _label(source, rest)
                rest = []
            if not rest:
                source.place = f"line {piece.lines[0]}"
                source.refuse_again(*piece.key)
            rest.append(piece)
            _check(source, rest)
    if rest:
        yield _label(source, rest)
    source.place = "line 2"
    source.head = scale.head()


class _Piece:
    """Rows of one curve that stand together."""

    def __init__(self, source: Source, rows: Rows, place: slice) -> None:
        self.lines = rows.lines[place]
        self.columns = {name: column[place] for name, column in rows.columns.items()}
        frame, curve = self.columns.get("frame"), self.columns["curve"]
        self.key = (0 if frame is None else int(frame[0])), int(curve[0])

    def numbers(self, name: str, unknown: float) -> Float[Array, " N"]:
        return self.columns.get(name, np.full(len(self.lines), unknown))


def _check(source: Source, pieces: list[_Piece]) -> None:
    """See that the last piece goes on as the first one began."""
    first, last = pieces[0], pieces[-1]
    before = sum(len(piece.lines) for piece in pieces[:-1])
    for name in ("point", "status", "review", "locked"):
        values = last.columns.get(name)
        if values is None:
            continue
        ordered = name == "point"
        expected = np.arange(before, before + len(values)) if ordered else first.columns[name][0]
        wrong = np.flatnonzero(values != expected)
        if len(wrong):
            source.place = f"line {last.lines[wrong[0]]}"
            if ordered:
                raise ValueError(
                    f"point is {values[wrong[0]]}; expected {before + wrong[0]}, counting from 0"
                )
            said = first.columns[name].tolist()[0]
            raise ValueError(f"{name} differs from {said!r} on line {first.lines[0]}")


def _label(source: Source, pieces: list[_Piece]) -> Label:
    source.place = f"line {pieces[0].lines[0]}"
    row, col, half_width, sd = (
        np.concatenate([piece.numbers(name, unknown) for piece in pieces])
        for name, unknown in (("row", 0), ("col", 0), ("half_width", np.nan), ("sd", np.inf))
    )
    columns: dict[str, Any] = pieces[0].columns
    status, review = (
        str(columns[name][0]) if name in columns else usual
        for name, usual in (("status", "sketch"), ("review", "open"))
    )
    locked = int(columns["locked"][0]) if "locked" in columns else 0
    if locked > 1:
        key = pieces[0].key
        raise ValueError(f"curve {key[1]} of frame {key[0]}: locked is {locked}; expected 1 or 0")
    points, words = np.column_stack([row, col]), (cast(Any, status), cast(Any, review))
    return Label(*pieces[0].key, points, half_width, sd, *words, bool(locked))


class _Scale:
    """The scale that the physical columns of a table tell."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self._units: str | None = None
        self._sizes: list[float | None] = [None, None]

    def add(self, rows: Rows) -> None:
        """Take the scale from some rows, or compare them with that of earlier ones."""
        if not all(name in rows.columns for name in ("y", "x", "units")):
            return
        units = rows.columns["units"]
        self._units = str(units[0]) if self._units is None else self._units
        other = np.flatnonzero(units != self._units)
        if len(other):
            self._source.place = f"line {rows.lines[other[0]]}"
            raise ValueError(f"units are {units[other[0]]!r} here but {self._units!r} above")
        frame = rows.columns.get("frame", np.zeros(len(units)))
        first = frame == frame[0]
        for axis, (name, pixel) in enumerate((("y", "row"), ("x", "col"))):
            pixels, physical = rows.columns[pixel], rows.columns[name]
            if self._sizes[axis] is None:
                self._sizes[axis] = _factor(pixels[first], physical[first])
            self._compare(rows, pixel, name, self._sizes[axis])

    def _compare(self, rows: Rows, pixel: str, name: str, factor: float | None) -> None:
        expected = rows.columns[pixel] * (factor or 0.0)
        tolerance = SCALE_TOLERANCE * np.abs(expected) + 1e-300
        agree = np.abs(rows.columns[name] - expected) <= tolerance
        if factor is None:  # the first frame lies on this axis: later ones tell
            agree = np.ones(len(expected), bool)
        if not np.all(agree) or (factor is not None and not factor > 0):
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

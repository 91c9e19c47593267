"""The native format: a CSV table with one row for each point of a curve."""

import csv
import io
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import chain, repeat
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from jaxtyping import Float

from napari_splinesketch.engine.types import Array
from napari_splinesketch.geometry import width_growth
from napari_splinesketch.labels.csv_columns import read_curves
from napari_splinesketch.labels.format import Format, Source
from napari_splinesketch.labels.types import AnyLabels, Facts, Label, Labels

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
    "y": np.nan,
    "x": np.nan,
    "units": str,
}
"""Columns that are read; `arc_length` and `half_width_units` are for people."""
REQUIRED = ("curve", "row", "col")
BY = ("frame", "curve")
COUNT = "point"
Columns = dict[str, Iterable[object]]
Leading = Callable[[int, Label], Columns]
"""Gives further columns to put before the others, for the label of that number, from 0."""
ANY = Label.from_sketch(np.zeros((2, 2)))
"""Has the columns of every label."""
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


def write_rows(
    file: TextIO, labels: AnyLabels, leading: Leading = lambda number, label: {}
) -> None:
    """Write a table, with further columns before all others."""
    table, facts = csv.writer(file, lineterminator="\n"), labels.facts
    table.writerow([*leading(0, ANY), *_columns(ANY, labels.head, facts)])
    for number, label in enumerate(labels.labels):
        columns = leading(number, label).values(), _columns(label, labels.head, facts).values()
        table.writerows(zip(*list(chain(*columns)), strict=False))  # repeated values are endless


def _columns(label: Label, head: Labels, facts: Facts) -> Columns:
    columns: Columns = {
        "frame": repeat(label.frame),
        "curve": repeat(label.curve),
        "point": range(len(label.points)),
        "row": label.points[:, 0].tolist(),
        "col": label.points[:, 1].tolist(),
        "half_width": label.half_width.tolist(),
        "sd": label.sd.tolist(),
        "arc_length": label.arc_length.tolist(),
        "status": repeat(label.status),
    }
    if head.scale:
        columns["y"], columns["x"] = (label.points * head.scale).T.tolist()
        width = label.half_width * width_growth(label.points, head.scale)
        columns |= {"half_width_units": width.tolist(), "units": repeat(head.units or "")}
    columns |= {"review": repeat(label.review)} if facts.reviewed else {}
    return columns | ({"locked": repeat(int(label.locked))} if facts.locked else {})


def read(source: Source) -> Iterator[Label]:
    """Read a table back; points, if they are numbered, count from 0."""
    scale = _Scale(source)
    for lines, columns in read_curves(source, KINDS, REQUIRED, BY, COUNT):
        if len(lines) < 2:
            where = f"curve {columns['curve']} of frame {columns.get('frame') or 0}"
            raise ValueError(f"{where}: one row; expected at least 2, which follow one another")
        scale.add(lines, columns)
        yield _label(columns)
    source.place = "line 2"
    source.head = scale.head()


def _label(columns: dict[str, Any]) -> Label:
    unknown = {name: np.full(len(columns["row"]), KINDS[name]) for name in ("half_width", "sd")}
    known = {"frame": 0, "status": "sketch", "review": "open", "locked": 0, **unknown}
    known |= {name: it for name, it in columns.items() if not isinstance(it, str) or it}
    if known["locked"] > 1:
        where = f"curve {known['curve']} of frame {known['frame']}"
        raise ValueError(f"{where}: locked is {known['locked']}; expected 1 or 0")
    points = np.column_stack([known["row"], known["col"]])
    along = points, known["half_width"], known["sd"]
    words = known["status"], known["review"], bool(known["locked"])
    return Label(known["frame"], known["curve"], *along, *words)


class _Scale:
    """The scale given by the physical columns of a table."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self._units: str | None = None
        self._sizes: list[float | None] = [None, None]

    def add(self, lines: Sequence[int], columns: dict[str, Any]) -> None:
        """Take the scale from a curve, or compare it with that of earlier ones."""
        if not {"y", "x", "units"} <= columns.keys() or np.isnan(columns["y"]).all():
            return
        if self._units is None:
            self._units = columns["units"]
        if columns["units"] != self._units:
            raise ValueError(f"units are {columns['units']!r} here but {self._units!r} above")
        for axis, (name, pixel) in enumerate((("y", "row"), ("x", "col"))):
            size = self._sizes[axis] = self._sizes[axis] or _factor(columns[pixel], columns[name])
            if size is None:  # the curve lies on this axis; later curves tell
                continue
            expected = columns[pixel] * size
            off = np.abs(columns[name] - expected)
            agree = off <= SCALE_TOLERANCE * np.abs(expected) + 1e-300
            if not (size > 0 and agree.all()):
                self._source.place = f"line {lines[int(np.argmin(agree))]}"
                raise ValueError(
                    f"{name} is not {pixel} times one scale; correct it or remove columns "
                    "y, x, half_width_units, units"
                )

    def head(self) -> Labels:
        """Give the scale; where one axis does not tell it, pixels are taken as square."""
        y, x = self._sizes[0] or self._sizes[1], self._sizes[1] or self._sizes[0]
        return Labels((), (y, x), self._units or None) if y and x else Labels()


def _factor(pixels: Float[Array, " N"], physical: Float[Array, " N"]) -> float | None:
    """Find the shortest decimal number that maps `pixels` on `physical`, bit for bit.

    If there is none, as in tables that were rounded, the ratio at the largest coordinate.
    """
    largest = int(np.argmax(np.abs(pixels)))
    if pixels[largest] == 0:
        return None
    ratio = float(physical[largest] / pixels[largest])
    if not np.isfinite(ratio):
        return 0.0
    candidates = [float(f"{ratio:.{digits}g}") for digits in range(1, 18)]
    candidates += [float(np.nextafter(ratio, 0)), float(np.nextafter(ratio, np.inf))]
    return next((each for each in candidates if np.array_equal(pixels * each, physical)), ratio)


def claims(ending: str, head: bytes) -> bool:
    """Whether a CSV is one of curves, by its header."""
    header = "".join(head.decode("utf-8-sig", errors="replace").splitlines()[:1])
    return set(REQUIRED) <= {name.strip().strip('"') for name in header.split(",")}


LOSSES = ("provenance", "empty")
FORMAT = Format("labels CSV", (".csv",), read, write, LOSSES, claims, by_frame=True)

"""The native format, a CSV table with one row for each point of a curve; and reading such tables.

Pandas is not used: it does not say on which line a field is wrong, and what it gains is lost again
when curves are made of its columns.
"""

import csv
import io
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import chain, groupby, repeat
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from jaxtyping import Float

from napari_splinesketch.engine.types import Array, InputError
from napari_splinesketch.files import counted
from napari_splinesketch.geometry import width_growth
from napari_splinesketch.labels.format import Format, LabelsError, Source, open_regular
from napari_splinesketch.labels.types import MAX_INTEGER, AnyLabels, Facts, Label, Labels

WHOLE = "a whole number from 0 to 2^63-1"
Kinds = Mapping[str, type | float]
"""Columns to read: `int` for whole numbers from 0, `float`, `str`; a number for numbers that may be
missing, which it stands in for."""
Rows = tuple[Sequence[int], dict[str, Any]]
"""A curve: the number of each row's line, from 1, and each requested column that is there. Floats
are given as values along the curve, others as the one value that all rows share."""
KINDS: Kinds = {
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


def write(path: Path, labels: AnyLabels, leading: Leading = lambda number, label: {}) -> None:
    """Write labels as a table, with further columns before all others."""
    with path.open("x", encoding="utf-8", newline="") as file:
        _write_rows(file, labels, leading)


def text(labels: Labels) -> str:
    """Give the whole table as text."""
    file = io.StringIO(newline="")
    _write_rows(file, labels, lambda number, label: {})
    return file.getvalue()


def _write_rows(file: TextIO, labels: AnyLabels, leading: Leading) -> None:
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
            raise InputError(f"{where}: one row; expected at least 2, which follow one another")
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
        raise InputError(f"{where}: locked is {known['locked']}; expected 1 or 0")
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
            raise InputError(f"units are {columns['units']!r} here but {self._units!r} above")
        for axis, (name, pixel) in enumerate((("y", "row"), ("x", "col"))):
            size = self._sizes[axis] = self._sizes[axis] or _factor(columns[pixel], columns[name])
            if size is None:  # the curve lies on this axis; later curves tell
                continue
            expected = columns[pixel] * size
            off = np.abs(columns[name] - expected)
            agree = off <= SCALE_TOLERANCE * np.abs(expected) + 1e-300
            if not (size > 0 and agree.all()):
                reason = f"{name} is not {pixel} times one scale; correct it or remove columns "
                line = lines[int(np.argmin(agree))]
                raise _wrong(self._source, line, f"{reason}y, x, half_width_units, units")

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


LOSSES = ("provenance", "empty")
COLUMN = r'(?=([^\r\n]*,)?[ \t]*"?{}"?[ \t]*([,\r\n]|\Z))'
"""A column of this name, somewhere in a header."""
MARK = r"\A(\xef\xbb\xbf)?" + "".join(map(COLUMN.format, REQUIRED))
FORMAT = Format("labels CSV", {".csv": MARK.encode()}, read, write, LOSSES, by_frame=True)


def read_curves(
    source: Source,
    kinds: Kinds,
    required: Sequence[str],
    by: Sequence[str],
    count: str,
    *,
    check: Callable[[Sequence[str]], None] = lambda header: None,
) -> Iterator[Rows]:
    """Read a table curve by curve; the rows of one follow one another.

    Columns may be in any order, and there may be others. What is empty and not required is given as
    an empty string. No more than one curve is held. Columns `by`, frame and number, distinguish
    curves, and `count` counts the rows of one from 0; `check` raises InputError for columns that it
    does not accept.
    """
    with open_regular(source.path) as raw, io.TextIOWrapper(raw, "utf-8-sig", newline="") as file:
        table, source.place = _table(source, file), "line 1"
        header = [name.strip() for name in next(table, (1, ()))[1]]
        _check_header(source, header, required)
        check(header)
        keys = [header.index(name) for name in by if name in header]
        for _, group in groupby(table, lambda row: [row[1][i] for i in keys]):
            lines, fields = zip(*group, strict=True)
            texts = dict(zip(header, zip(*fields, strict=True), strict=True))
            source.place, columns = f"line {lines[0]}", dict[str, Any]()
            for name in (name for name in kinds if name in texts and name != count):
                kind, rows = kinds[name], zip(lines, texts[name], strict=True)
                if kind in (int, str):
                    columns[name] = _shared(source, name, kind, rows, name in required)
                else:
                    columns[name] = np.array([_value(source, name, kind, *row) for row in rows])
            source.refuse_again(*(columns.get(name) or 0 for name in by))
            for number, (line, text) in enumerate(zip(lines, texts.get(count, ()), strict=False)):
                found = _value(source, count, int, line, text) if text else number
                if found != number:
                    reason = f"{count} is {found}; expected {number}, counting from 0"
                    raise _wrong(source, line, reason)
            yield lines, columns


def _shared(
    source: Source, name: str, kind: type | float, rows: Iterator[tuple[int, str]], needed: bool
) -> Any:
    """Give the one value of a curve's rows, each with its line; "" where there is none."""
    first, above = next(rows)
    value = _value(source, name, kind, first, above) if above or needed else ""
    for line, text in rows:
        if text != above:
            raise _wrong(source, line, f"{name} differs from {value!r} on line {first}")
    return value


def _wrong(source: Source, line: int, reason: str) -> LabelsError:
    return LabelsError(source.path, f"line {line}", reason)


def _value(source: Source, name: str, kind: type | float, line: int, text: str) -> Any:
    """Parse a field, and say what is wrong with it."""
    try:
        if kind is str:
            return text
        if kind is int:
            return whole(text)
        # Python takes 1_5 for 15.
        return float(text.replace("_", " ")) if text or kind is float else kind
    except ValueError:
        wanted = WHOLE if kind is int else "a number"
        raise _wrong(source, line, f"{name} is {text[:40]!r}; expected {wanted}") from None


def _table(source: Source, file: TextIO) -> Iterator[tuple[int, Sequence[str]]]:
    """Give the rows of a table, all of the same length, with the numbers of their lines."""
    table, size = csv.reader(file, strict=True, skipinitialspace=True), 0
    empty = 0  # the first row with nothing in it: spreadsheets keep some below a table
    try:
        for fields in table:
            if not any(fields):
                empty = empty or table.line_num
                continue
            size = size or len(fields)
            if empty or len(fields) != size:
                line, found = (empty, 0) if empty else (table.line_num, len(fields))
                raise _wrong(source, line, f"{counted(found, 'field')}; the header has {size}")
            yield table.line_num, fields
    except csv.Error as error:
        raise _wrong(source, table.line_num, f"not a line of a CSV table ({error})") from None
    except UnicodeDecodeError as error:
        source.place = f"line {table.line_num + 1} or below"
        reason = f"not a text file in UTF-8 ({error.reason}); save it as CSV UTF-8"
        raise source.error(reason) from None


def _check_header(source: Source, header: Sequence[str], required: Sequence[str]) -> None:
    missing = [name for name in required if name not in header]
    if missing:
        what = f"no column {', '.join(missing)}" if any(header) else "nothing is in it"
        columns = f"the columns {', '.join(required)}, separated by commas"
        raise source.error(f"{what}; expected a table of curves, with {columns}")
    # Spreadsheets keep empty columns beside a table.
    twice = sorted(name for name, count in Counter(header).items() if count > 1 and name)
    if twice:
        raise source.error(f"column {', '.join(twice)} occurs twice")


def whole(text: str) -> int:
    """Read a whole number as we write them, or as Pandas does in a column with empty fields."""
    text = text.removesuffix(".0")
    if text.isascii() and text.isdigit() and len(text) < 20 and int(text) <= MAX_INTEGER:
        return int(text)
    raise InputError(f"{text[:40]!r} is not {WHOLE}")

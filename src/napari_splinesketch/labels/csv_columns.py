"""CSV tables, some rows at a time as columns: what is wrong is blamed on its line."""

import csv
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from io import BytesIO, StringIO, TextIOWrapper
from itertools import pairwise
from typing import Any, TextIO

import numpy as np
from jaxtyping import Int, Shaped

from napari_splinesketch.engine.types import Array
from napari_splinesketch.labels.files import open_regular
from napari_splinesketch.labels.format import Source

BLOCK = 2**17
"""Characters that are parsed at a time."""
MAX_LINE = 2**16
MAX_INTEGER = 2**63 - 1
NAN = ["nan", "NaN"]
"""What pandas takes as not a number; what else Python does is left to the slower way."""
Kinds = Mapping[str, type | float]


@dataclass(frozen=True, eq=False)
class Rows:
    """Some rows of a table.

    Attributes
    ----------
    lines
        (N,) the number of each row's line, from 1.
    columns
        (N,) values of each column that was asked for and is there.
    """

    lines: Int[Array, " N"]
    columns: dict[str, Shaped[Array, " N"]]

    def key(self, by: Sequence[str]) -> tuple[int, ...]:
        """Give whole numbers of the first row, 0 where there is no such column."""
        return tuple(self.columns[name].item(0) if name in self.columns else 0 for name in by)

    def runs(self, by: Sequence[str]) -> Iterator["Rows"]:
        """Give the longest stretches in which some columns do not change."""
        changes = np.zeros(len(self.lines) - 1, bool)
        for column in (self.columns[name] for name in by if name in self.columns):
            changes |= column[1:] != column[:-1]
        for first, end in pairwise([0, *np.flatnonzero(changes) + 1, len(self.lines)]):
            columns = {name: column[first:end] for name, column in self.columns.items()}
            yield Rows(self.lines[first:end], columns)


def read_curves(
    source: Source,
    kinds: Kinds,
    required: Sequence[str],
    by: Sequence[str],
    same: Sequence[str],
    *,
    check: Callable[[list[str]], None] = lambda header: None,
    watch: Callable[[Rows], None] = lambda rows: None,
) -> Iterator[Rows]:
    """Read a table curve by curve; the rows of one follow one another.

    Columns may stand in any order, and there may be further ones. Beside what is given, no more
    than some rows and one curve are held.

    Parameters
    ----------
    source
        The file, in UTF-8 with or without a byte order mark.
    kinds
        The columns to read: `int` for whole numbers from 0, `float`, `str`; a number for numbers
        that may be missing, of which it takes the place.
    required
        Those that must be there.
    by
        Those that tell one curve from another: frame and number.
    same
        Those that do not change along a curve; the first one counts its rows instead, from 0.
    check
        Raises ValueError where it does not like the names of the columns.
    watch
        Is given all rows as they are read.
    """
    rest: list[Rows] = []
    for rows in _read_rows(source, kinds, required, check):
        watch(rows)
        for piece in rows.runs(by):
            if rest and piece.key(by) != rest[0].key(by):
                yield _whole(source, rest, by, same)
                rest = []
            rest.append(piece)
    if rest:
        yield _whole(source, rest, by, same)


def _whole(source: Source, pieces: list[Rows], by: Sequence[str], same: Sequence[str]) -> Rows:
    """Put the rows of a curve together, and blame the first that does not belong there."""
    lines = np.concatenate([piece.lines for piece in pieces])
    columns = {n: np.concatenate([piece.columns[n] for piece in pieces]) for n in pieces[0].columns}
    rows = Rows(lines, columns)
    source.place = f"line {lines[0]}"
    source.refuse_again(*rows.key(by))
    for name in (name for name in same if name in columns):
        values, counts = columns[name], name == same[0]
        expected = np.arange(len(lines)) if counts else values[0]
        for wrong in np.flatnonzero(values != expected)[:1]:
            source.place = f"line {lines[wrong]}"
            if counts:
                raise ValueError(f"{name} is {values[wrong]}; expected {wrong}, counting from 0")
            raise ValueError(f"{name} differs from {values.item(0)!r} on line {lines[0]}")
    return rows


def _read_rows(
    source: Source, kinds: Kinds, required: Sequence[str], check: Callable[[list[str]], None]
) -> Iterator[Rows]:
    with open_regular(source.path) as raw, TextIOWrapper(raw, "utf-8-sig", newline="") as file:
        line, source.place = 1, "line 1"
        header: list[str] = []
        for block in _blocks(source, file):
            source.place = f"line {line}"
            if not header:
                header, block = _header(source, block, required)
                check(header)
                line += 1
            known = {name: kind for name, kind in kinds.items() if name in header}
            rows = _fast(block, header, known, line) or _slow(source, block, header, known, line)
            if len(rows.lines):
                yield rows
            line += block.count("\n")
        if not header:
            _header(source, "", required)


def _blocks(source: Source, file: TextIO) -> Iterator[str]:
    """Give the text in pieces that end with a line."""
    line = 1
    try:
        while block := file.read(BLOCK):
            while not block.endswith("\n") or block.count('"') % 2:
                more = file.readline(MAX_LINE)
                if len(more) == MAX_LINE or len(block) > 2 * BLOCK:
                    place = f"line {line + block.count(chr(10))}"
                    raise source.error(f"longer than {MAX_LINE} characters", place)
                if not more:
                    break
                block += more
            yield block
            line += block.count("\n")
    except UnicodeDecodeError as error:
        place = f"line {line} or below"
        raise source.error(f"not a text file in UTF-8 ({error.reason})", place) from None


def _header(source: Source, block: str, required: Sequence[str]) -> tuple[list[str], str]:
    """Split a table's beginning into the names of its columns and the rest."""
    first, _, rest = block.partition("\n")
    if "\r" in first.removesuffix("\r"):
        raise source.error("lines end with CR alone; save it with line ends of Windows or Unix")
    header = next(csv.reader([first]), [])
    missing = [name for name in required if name not in header]
    if missing:
        raise source.error(
            f"no column {', '.join(missing)}; expected a table of curves, with the columns "
            f"{', '.join(required)}"
        )
    twice = sorted(name for name, count in Counter(header).items() if count > 1)
    if twice:
        raise source.error(f"column {', '.join(twice)} occurs twice")
    return header, rest


def _fast(block: str, header: list[str], kinds: Kinds, line: int) -> Rows | None:
    """Parse plain rows; None where something is unusual, and perhaps wrong."""
    import pandas as pd

    count = block.count("\n") + (not block.endswith("\n"))
    if not block or '"' in block or block.count(",") != count * (len(header) - 1):
        return None
    types: Any = {name: _type(kind) for name, kind in kinds.items()}
    try:
        table = pd.read_csv(
            BytesIO(block.encode()),
            header=None,
            names=header,
            usecols=list(kinds),
            index_col=False,
            dtype=types,
            keep_default_na=False,
            na_values={name: NAN for name, kind in kinds.items() if _type(kind) is np.float64},
            skip_blank_lines=False,
            **_exactly(),
        )
    except (ValueError, OverflowError):  # pandas' own errors are among them
        return None
    columns = {name: table[name].to_numpy() for name in kinds}
    whole = (columns[name] for name, kind in kinds.items() if kind is int)
    if len(table) != count or any(column.min() < 0 for column in whole):
        return None
    return Rows(np.arange(line, line + count), columns)


@cache
def _exactly() -> dict[str, Any]:
    """Have numbers read bit for bit, which pandas does by itself from 3.1 on."""
    from pandas import __version__

    release = tuple(map(int, re.findall(r"\d+", __version__)[:2]))
    return {} if release >= (3, 1) else {"float_precision": "round_trip"}


def _slow(source: Source, block: str, header: list[str], kinds: Kinds, line: int) -> Rows:
    """Parse any rows, field by field, and find what is wrong."""
    table = csv.reader(StringIO(block, newline=""), strict=True)
    lines: list[int] = []
    values: dict[str, list[Any]] = {name: [] for name in kinds}
    try:
        for fields in table:
            source.place = f"line {line + table.line_num - 1}"
            if len(fields) != len(header):
                raise source.error(f"{len(fields)} fields; the header has {len(header)}")
            for name, text in zip(header, fields, strict=True):
                if name in kinds:
                    values[name].append(_value(source, name, text, kinds[name]))
            lines.append(line + table.line_num - 1)
    except csv.Error as error:
        place = f"line {line + table.line_num - 1}"
        raise source.error(f"not a line of a CSV table ({error})", place) from None
    columns = {name: np.array(values[name], _type(kind)) for name, kind in kinds.items()}
    return Rows(np.array(lines, np.int64), columns)


def _type(kind: type | float) -> Any:
    return {int: np.int64, str: object}.get(kind, np.float64)


def _value(source: Source, name: str, text: str, kind: type | float) -> Any:
    if kind is int:
        if not (text.isascii() and text.isdigit() and len(text) < 20 and int(text) <= MAX_INTEGER):
            raise source.error(f"{name} is {text[:40]!r}; expected a whole number from 0 to 2^63-1")
        return int(text)
    if kind is str:
        return text
    if isinstance(kind, float) and not text:
        return kind
    try:
        return float(text)
    except ValueError:
        raise source.error(f"{name} is {text[:40]!r}; expected a number") from None

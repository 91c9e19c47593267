"""CSV tables curve by curve, as columns; an error names the line that it is on.

Pandas is not used: it does not say on which line a field is wrong, and what it gains is lost again
when curves are made of its columns.
"""

import csv
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from io import TextIOWrapper
from itertools import groupby
from typing import Any, TextIO

import numpy as np

from napari_splinesketch.files import counted
from napari_splinesketch.labels.format import Source, open_regular
from napari_splinesketch.labels.types import MAX_INTEGER

WHOLE = "a whole number from 0 to 2^63-1"
Kinds = Mapping[str, type | float]


Rows = tuple[Sequence[int], dict[str, Any]]
"""A curve: the number of each row's line, from 1, and each requested column that is there. Floats
are given as values along the curve, others as the one value that all rows share."""


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
    an empty string. No more than one curve is held.

    Parameters
    ----------
    source
        The file, in UTF-8 with or without a byte order mark.
    kinds
        The columns to read: `int` for whole numbers from 0, `float`, `str`; a number for numbers
        that may be missing, which it stands in for.
    required
        Columns that must be there.
    by
        Columns that distinguish curves: frame and number.
    count
        Column that counts the rows of a curve from 0.
    check
        Raises ValueError for names of columns that it does not accept.
    """
    with open_regular(source.path) as raw, TextIOWrapper(raw, "utf-8-sig", newline="") as file:
        table, source.place = _table(source, file), "line 1"
        _, header = next(table, (1, ()))
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
                    source.place = f"line {line}"
                    raise ValueError(f"{count} is {found}; expected {number}, counting from 0")
            yield lines, columns


def _shared(
    source: Source, name: str, kind: type | float, rows: Iterator[tuple[int, str]], needed: bool
) -> Any:
    """Give the one value of a curve's rows, each with its line; "" where there is none."""
    first, above = next(rows)
    value = _value(source, name, kind, first, above) if above or needed else ""
    for line, text in rows:
        if text != above:
            source.place = f"line {line}"
            raise ValueError(f"{name} differs from {value!r} on line {first}")
    return value


def _value(source: Source, name: str, kind: type | float, line: int, text: str) -> Any:
    """Parse a field, and say what is wrong with it."""
    try:
        if kind is str:
            return text
        if kind is int:
            return whole(text)
        return float(text) if text or kind is float else kind
    except ValueError:
        source.place = f"line {line}"
        wanted = WHOLE if kind is int else "a number"
        raise source.error(f"{name} is {text[:40]!r}; expected {wanted}") from None


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
                source.place = f"line {empty or table.line_num}"
                found = 0 if empty else len(fields)
                raise source.error(f"{counted(found, 'field')}; the header has {size}")
            yield table.line_num, fields
    except csv.Error as error:
        source.place = f"line {table.line_num}"
        raise source.error(f"not a line of a CSV table ({error})") from None
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
    twice = sorted(name for name, count in Counter(header).items() if count > 1)
    if twice:
        raise source.error(f"column {', '.join(twice)} occurs twice")


def whole(text: str) -> int:
    """Read a whole number as we write them, or as Pandas does in a column with empty fields."""
    text = text.removesuffix(".0")
    if text.isascii() and text.isdigit() and len(text) < 20 and int(text) <= MAX_INTEGER:
        return int(text)
    raise ValueError(f"{text[:40]!r} is not {WHOLE}")

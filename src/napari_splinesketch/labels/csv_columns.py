"""CSV tables curve by curve, as columns; an error names the line that it is on.

Pandas is not used: it does not say on which line a field is wrong, and what it gains is lost again
when curves are made of its columns.
"""

import csv
from array import array
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from io import TextIOWrapper
from itertools import groupby
from typing import Any, TextIO

import numpy as np

from napari_splinesketch.files import counted
from napari_splinesketch.labels.format import Source, open_regular
from napari_splinesketch.labels.types import MAX_INTEGER

MAX_LINE = 2**16
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

    Columns may be in any order, and there may be others. A field that is empty is as good as no
    column, unless it is required. No more than one curve is held.

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
        places = {name: header.index(name) for name in kinds if name in header}
        keys = [places[name] for name in by if name in places]
        fixed = [name for name in places if kinds[name] in (int, str) and name != count]
        along = [name for name in places if name not in (*fixed, count)]
        for _, rows in groupby(table, lambda row: [row[1][i] for i in keys]):
            lines, known, said = array("q"), dict[str, Any](), dict[str, str]()
            lists = {name: array("d") for name in along}
            for number, (line, fields) in enumerate(rows):
                source.place = f"line {line}"
                row = {name: fields[place] for name, place in places.items()}
                if not said:
                    said = {name: row[name] for name in fixed}
                    given = (n for n in fixed if said[n] or n in required or kinds[n] is str)
                    known = {name: _value(source, name, said[name], kinds[name]) for name in given}
                    source.refuse_again(*(known.get(name, 0) for name in by))
                for name in fixed:
                    if row[name] != said[name]:
                        above = f"{known.get(name, '')!r} on line {lines[0]}"
                        raise ValueError(f"{name} differs from {above}")
                for name, values in lists.items():
                    values.append(_value(source, name, row[name], kinds[name]))
                found = _value(source, count, row[count], int) if row.get(count) else number
                if found != number:
                    raise ValueError(f"{count} is {found}; expected {number}, counting from 0")
                lines.append(line)
            source.place = f"line {lines[0]}"
            yield lines, known | {name: np.array(values) for name, values in lists.items()}


def _table(source: Source, file: TextIO) -> Iterator[tuple[int, Sequence[str]]]:
    """Give the rows of a table, all of the same length, with the numbers of their lines."""
    table, size = csv.reader(_lines(source, file), strict=True, skipinitialspace=True), 0
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


def _lines(source: Source, file: TextIO) -> Iterator[str]:
    """Give the lines of a file; an error names its line."""
    line = 0
    try:
        while text := file.readline(MAX_LINE):
            line += 1
            if len(text) == MAX_LINE:
                source.place = f"line {line}"
                raise source.error(f"longer than {MAX_LINE} characters")
            yield text
    except UnicodeDecodeError as error:
        source.place = f"line {line + 1} or below"
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


def _value(source: Source, name: str, text: str, kind: type | float) -> Any:
    """Parse a field, and say what is wrong with it."""
    try:
        return _parser(kind)(text)
    except ValueError:
        wanted = WHOLE if kind is int else "a number"
        raise source.error(f"{name} is {text[:40]!r}; expected {wanted}") from None


@cache
def _parser(kind: type | float) -> Callable[[str], Any]:
    if isinstance(kind, type):
        return whole if kind is int else kind
    return lambda text: float(text) if text else kind


def whole(text: str) -> int:
    """Read a whole number as we write them, or as Pandas does in a column with empty fields."""
    text = text.removesuffix(".0")
    if text.isascii() and text.isdigit() and len(text) < 20 and int(text) <= MAX_INTEGER:
        return int(text)
    raise ValueError(f"{text[:40]!r} is not {WHOLE}")

"""Text files line by line and CSV tables row by row, each mistake with its line."""

import csv
import os
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

from napari_splinesketch.labels.files import LabelsError
from napari_splinesketch.labels.json_tree import Node, parse_json

MAX_LINE = 65_536
Row = dict[str, str]


class Lines:
    """The lines of a text file, none as long as `longest` characters."""

    def __init__(self, path: str | os.PathLike[str], file: TextIO, longest: int) -> None:
        self._path = path
        self._file = file
        self._longest = longest
        self.line = 0

    def __iter__(self) -> Iterator[str]:
        """Give the lines with their ends; `line` is the number of the latest, from 1."""
        while True:
            self.line += 1
            try:
                text = self._file.readline(self._longest)
            except UnicodeDecodeError as error:
                raise self.error(f"not a text file in UTF-8 ({error.reason})") from None
            if not text:
                return
            if len(text) == self._longest:
                raise self.error(f"longer than {len(text) - 1} characters: not a file of curves")
            yield text

    def error(self, reason: str, line: int | None = None) -> LabelsError:
        """Blame the latest line, or another one."""
        return LabelsError(self._path, f"line {line or self.line}", reason)

    def json(self, text: str) -> Node:
        """Parse JSON that stands in the latest line."""
        return parse_json(self._path, f"line {self.line}", text)


class Rows:
    """The rows of a CSV table, by the names of its header.

    Columns may stand in any order, and further ones than the required ones are allowed.
    """

    def __init__(self, lines: Lines, required: Sequence[str]) -> None:
        self._lines = lines
        self._table = csv.reader(lines, strict=True)
        self.header = self._next() or []
        missing = [name for name in required if name not in self.header]
        if missing:
            raise self.error(
                f"no column {', '.join(missing)}; a table of curves starts with the header "
                f"{','.join(required)}"
            )
        twice = sorted(name for name, count in Counter(self.header).items() if count > 1)
        if twice:
            raise self.error(f"column {', '.join(twice)} occurs twice")

    def __iter__(self) -> Iterator[Row]:
        """Give each row as a mapping from column to text."""
        while (fields := self._next()) is not None:
            if len(fields) != len(self.header):
                raise self.error(f"{len(fields)} fields; the header has {len(self.header)}")
            yield dict(zip(self.header, fields, strict=True))

    @property
    def line(self) -> int:
        """Number of the latest line, from 1."""
        return self._lines.line

    def error(self, reason: str, line: int | None = None) -> LabelsError:
        """Blame the latest line, or another one."""
        return self._lines.error(reason, line)

    def integer(self, row: Row, name: str) -> int:
        """Give a field that must be a whole number from 0."""
        text = row[name]
        if not (text.isascii() and text.isdigit() and len(text) < 20):
            raise self.error(f"{name} is {text[:40]!r}; expected a whole number from 0")
        return int(text)

    def number(self, row: Row, name: str) -> float:
        """Give a field that must be a number; NaN and infinity are."""
        try:
            return float(row[name])
        except ValueError:
            raise self.error(f"{name} is {row[name][:40]!r}; expected a number") from None

    def _next(self) -> list[str] | None:
        try:
            return next(self._table, None)
        except csv.Error as error:
            raise self.error(f"not a line of a CSV table ({error})") from None


@contextmanager
def open_lines(path: str | os.PathLike[str], longest: int = MAX_LINE) -> Iterator[Lines]:
    """Open a text file in UTF-8, with or without a byte order mark."""
    with Path(path).open(encoding="utf-8-sig", newline="") as file:
        yield Lines(path, file, longest)


@contextmanager
def open_rows(path: str | os.PathLike[str], required: Sequence[str]) -> Iterator[Rows]:
    """Open a CSV table whose header must name the `required` columns."""
    with open_lines(path) as lines:
        yield Rows(lines, required)

"""JSON files value by value, so that no more than one of a long array is held."""

import json
import os
from collections.abc import Iterator
from io import TextIOWrapper
from json.decoder import WHITESPACE  # pyright: ignore[reportAttributeAccessIssue]
from typing import Any, TextIO

from napari_splinesketch.labels.files import LabelsError, open_regular
from napari_splinesketch.labels.json_tree import DECODER, Node

MAX_VALUE = 2**24
"""Characters of one value, such as a feature; as objects they take up to 30 times as many bytes."""
CHUNK = 2**16
SURE = 16
"""A mistake so many characters before the end of the text at hand is none of a missing rest."""


def read_values(path: str | os.PathLike[str], array: str, kept: dict[str, Any]) -> Iterator[Node]:
    """Go through a file whose outermost value is an array, or an object with a long array.

    Parameters
    ----------
    path
        A file in UTF-8.
    array
        Member whose elements are given one by one, where it is an array.
    kept
        Names of members to keep, which get their values where they are there; of `array`, an
        empty list where its elements were given. What is not named is parsed and forgotten.

    Yields
    ------
    Node
        Each element of the array.
    """
    with open_regular(path) as raw, TextIOWrapper(raw, "utf-8-sig") as file:
        text = _Text(path, file)
        if text.coming() == "[":
            yield from _elements(text, path, "")
            kept[array] = []
        elif text.coming() != "{":
            Node(path, "", text.value()).members()
        else:
            for name in _members(text):
                if name == array and text.coming() == "[":
                    yield from _elements(text, path, name)
                    kept[name] = []
                else:
                    value = text.value()
                    if name in kept:
                        kept[name] = value
        if text.coming():
            raise text.error("Extra data")


def _elements(text: "_Text", path: str | os.PathLike[str], place: str) -> Iterator[Node]:
    for i, _ in enumerate(_between(text, "[", "]")):
        yield Node(path, f"{place}[{i}]", text.value())


def _members(text: "_Text") -> Iterator[str]:
    for _ in _between(text, "{", "}"):
        if text.coming() != '"':
            raise text.error("Expecting property name enclosed in double quotes")
        name = text.value()
        text.skip(":")
        yield name


def _between(text: "_Text", begin: str, end: str) -> Iterator[None]:
    """Stop before each of the things between brackets."""
    text.skip(begin)
    if text.coming() != end:
        yield
        while text.coming() == ",":
            text.skip(",")
            yield
    text.skip(end)


class _Text:
    """The text of a file from some place on, as much as is needed."""

    def __init__(self, path: str | os.PathLike[str], file: TextIO) -> None:
        self._path = path
        self._file = file
        self._held = ""
        self._at = 0
        self._line = self._column = 0

    def coming(self) -> str:
        """Give the next character that is no white space, nothing at the end."""
        while (at := WHITESPACE.match(self._held, self._at).end()) == len(self._held):
            self._at = at
            if not self._more():
                return ""
        self._at = at
        return self._held[at]

    def skip(self, char: str) -> None:
        """Go past a character that must come."""
        if self.coming() != char:
            raise self.error(f"Expecting {char!r}")
        self._at += 1

    def value(self) -> Any:
        """Parse the value that comes."""
        self.coming()
        while True:
            try:
                value, end = DECODER.raw_decode(self._held, self._at)
            except json.JSONDecodeError as error:
                unfinished = error.pos >= len(self._held) - SURE or "Untermin" in error.msg
                if not (unfinished and self._more()):
                    raise self.error(error.msg, error.pos) from None
            except RecursionError:
                raise self.error("nested too deeply") from None
            except ValueError as error:
                raise self.error(str(error)) from None
            else:
                # A number may go on behind what is held.
                if end < len(self._held) or not self._more():
                    self._at = end
                    return value

    def error(self, reason: str, at: int | None = None) -> LabelsError:
        """Blame a character, the one that comes where no other is named."""
        found = json.JSONDecodeError("", self._held, self._at if at is None else at)
        line, column = found.lineno + self._line, found.colno
        column += self._column if found.lineno == 1 else 0
        place = f"line {line}, column {column}"
        return LabelsError(self._path, place, f"not JSON ({reason})")

    def _more(self) -> bool:
        """Read on, as much again as waits to be parsed; False at the end."""
        waiting = len(self._held) - self._at
        if waiting > MAX_VALUE:
            raise self.error(f"a value of more than {MAX_VALUE} characters")
        try:
            read = self._file.read(max(CHUNK, waiting))
        except UnicodeDecodeError as error:
            reason = f"not a text file in UTF-8 ({error.reason})"
            raise LabelsError(self._path, "", reason) from None
        past, end = self._held[: self._at], self._held.rfind("\n", 0, self._at)
        if read:
            self._line += past.count("\n")
            self._column = len(past) - end - 1 if end >= 0 else self._column + len(past)
            self._held = self._held[self._at :] + read
            self._at -= len(past)
        return bool(read)

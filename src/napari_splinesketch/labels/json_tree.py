"""What JSON files hold: read with the place of every mistake, written strictly."""

import json
import math
import os
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any, NoReturn, TypeGuard

import numpy as np
from jaxtyping import Float

from napari_splinesketch.engine.types import Array
from napari_splinesketch.labels.files import LabelsError


def _refuse(name: str) -> NoReturn:
    raise ValueError(f"{name} is no number in JSON; use null")


DECODER = json.JSONDecoder(parse_constant=_refuse)


@dataclass(frozen=True)
class Node:
    """A value in a JSON file that knows its place.

    Attributes
    ----------
    path
        The file.
    place
        Where the value is, such as "data[3].x"; empty for the whole file.
    value
        What `json` read.
    """

    path: str | os.PathLike[str]
    place: str
    value: Any

    def error(self, reason: str) -> LabelsError:
        """Blame this value."""
        return LabelsError(self.path, self.place, reason)

    def __contains__(self, key: str) -> bool:
        """Tell whether an object has a member that is not null."""
        return isinstance(self.value, dict) and self.value.get(key) is not None

    def __getitem__(self, key: str) -> "Node":
        """Give a member of an object."""
        members = self.members()
        if key not in members:
            raise self.error(f"has no {key!r}")
        return Node(self.path, f"{self.place}.{key}".removeprefix("."), members[key])

    def __iter__(self) -> Iterator["Node"]:
        """Give the elements of an array."""
        if not isinstance(self.value, list):
            raise self.error(f"expected an array, not {self._kind()}")
        for i, element in enumerate(self.value):
            yield Node(self.path, f"{self.place}[{i}]", element)

    def members(self) -> dict[str, Any]:
        """Give an object as it is."""
        if not isinstance(self.value, dict):
            raise self.error(f"expected an object, not {self._kind()}")
        return self.value

    def text(self) -> str:
        """Give a string."""
        if not isinstance(self.value, str):
            raise self.error(f"expected a string, not {self._kind()}")
        return self.value

    def truth(self) -> bool:
        """Give true or false."""
        if not isinstance(self.value, bool):
            raise self.error(f"expected true or false, not {self._kind()}")
        return self.value

    def number(self) -> float:
        """Give a finite number."""
        if isinstance(self.value, bool) or not isinstance(self.value, int | float):
            raise self.error(f"expected a number, not {self._kind()}")
        try:
            number = float(self.value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            raise self.error("expected a finite number")
        return number

    def integer(self) -> int:
        """Give a whole number from 0."""
        number = self.number()
        if number != int(number) or not 0 <= number < 2**63:
            raise self.error(f"is {number:g}; expected a whole number from 0")
        return int(self.value)

    def numbers(self, unknown: float | None = None) -> Float[Array, " N"]:
        """Give an array of numbers; null stands for `unknown`, where that is given."""
        if not isinstance(self.value, list):
            raise self.error(f"expected an array, not {self._kind()}")
        if set(map(type, self.value)) <= {int, float}:
            with suppress(OverflowError):
                numbers = np.array(self.value, np.float64)
                if np.all(np.isfinite(numbers)):
                    return numbers
        # The way that finds what is wrong is much slower.
        return np.array(
            [
                unknown if unknown is not None and node.value is None else node.number()
                for node in self
            ],
            dtype=np.float64,
        )

    def places(self) -> Float[Array, "N 2"]:
        """Give an array of [x, y, ...], of which further numbers are left out."""
        value = self.value
        if isinstance(value, list) and set(map(type, value)) == {list}:
            sizes, kinds = set(map(len, value)), set(map(type, chain.from_iterable(value)))
            if len(sizes) == 1 and min(sizes) >= 2 and kinds <= {int, float}:
                with suppress(OverflowError):
                    places = np.array(value, np.float64)[:, :2]
                    if np.all(np.isfinite(places)):
                        return places
        places = [place.numbers() for place in self]
        for place, numbers in zip(self, places, strict=True):
            if len(numbers) < 2:
                raise place.error("expected [x, y]")
        return np.array([numbers[:2] for numbers in places]).reshape(-1, 2)

    def _kind(self) -> str:
        kinds = {dict: "an object", list: "an array", str: "a string", type(None): "null"}
        return kinds.get(type(self.value), "a number")


@dataclass(frozen=True)
class Members:
    """An object whose members are more than memory should hold.

    Attributes
    ----------
    read
        Gives them, anew each time.
    """

    read: Callable[[], Iterator[tuple[str, object]]]


def pieces(value: object, comma: str = ", ", colon: str = ": ") -> Iterator[str]:
    """Encode a value as JSON; iterators become arrays, and they and `Members` are not held.

    A number that is not finite is our mistake.
    """
    encode = json.JSONEncoder(ensure_ascii=False, allow_nan=False, separators=(comma, colon)).encode
    if not _is_read(value):
        yield encode(value)
    elif isinstance(value, Iterator):
        yield "["
        for i, element in enumerate(value):
            yield (comma if i else "") + encode(element)
        yield "]"
    else:
        members = value.read() if isinstance(value, Members) else value.items()
        yield "{"
        for i, (name, member) in enumerate(members):
            yield (comma if i else "") + encode(name) + colon
            yield from pieces(member, comma, colon)
        yield "}"


def _is_read(value: object) -> TypeGuard[Iterator | Members | dict]:
    """Tell whether something in a value is to be read while it is written."""
    if isinstance(value, dict):
        return any(map(_is_read, value.values()))
    return isinstance(value, Iterator | Members)


def held(value: object) -> Any:
    """Give a value with all that is in it, for libraries that write it themselves."""
    return json.loads("".join(pieces(value))) if _is_read(value) else value


def write_json(path: Path, value: object) -> None:
    """Write a JSON file in UTF-8, as `pieces` encodes it."""
    # Names of files may hold what is no text.
    with path.open("x", encoding="utf-8", errors="replace") as file:
        file.writelines(pieces(value, ",", ":"))
        file.write("\n")


def finite_or_null(values: Float[Array, " N"]) -> list[float | None]:
    """Give numbers for JSON, null where they are not finite."""
    return [value if math.isfinite(value) else None for value in values.tolist()]

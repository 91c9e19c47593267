"""JSON files: reading with the place of every error, strict writing, and our own members."""

import json
import math
import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any, NoReturn, TypeVar

import numpy as np
from jaxtyping import Float

from napari_splinesketch import __version__
from napari_splinesketch.engine.types import Array, InputError
from napari_splinesketch.labels.format import LabelsError, Source, blamed, checksum, open_regular
from napari_splinesketch.labels.types import Label, Labels

KINDS = {dict: "an object", list: "an array", str: "a string", bool: "true or false"}
KINDS |= {int: "a number", float: "a number", type(None): "null"}
"""Types as JSON calls them."""
T = TypeVar("T")


def _refuse(value: object) -> NoReturn:
    kind = type(value).__name__
    raise InputError(f"JSON holds no {kind}; give numbers, texts, lists and dicts")


encode = json.JSONEncoder(
    ensure_ascii=False, allow_nan=False, separators=(",", ":"), default=_refuse
).encode


@dataclass(frozen=True)
class Node:
    """A value in a JSON file, with its place."""

    path: str | os.PathLike[str]
    place: str
    """Where the value is, such as "data[3].x"; empty for the whole file."""
    value: Any
    """What `json` read."""

    def error(self, reason: str) -> LabelsError:
        """Make an error at this value."""
        return LabelsError(self.path, self.place, reason)

    def __contains__(self, key: str) -> bool:
        """Whether an object has a member that is not null."""
        return isinstance(self.value, dict) and self.value.get(key) is not None

    def __getitem__(self, key: str) -> "Node":
        members = self.expected(dict)
        if key not in members:
            raise self.error(f"has no {key!r}")
        return Node(self.path, f"{self.place}.{key}".removeprefix("."), members[key])

    def __iter__(self) -> Iterator["Node"]:
        for i, element in enumerate(self.expected(list)):
            yield Node(self.path, f"{self.place}[{i}]", element)

    def parsed(self) -> "Node":
        """Give what a text holds as JSON; any other value as it is."""
        with suppress(TypeError, ValueError, RecursionError):
            return replace(self, value=json.loads(self.value))
        return self

    def expected(self, kind: type[T]) -> T:
        """Give a value as it is, of one of the types of `KINDS`."""
        if not isinstance(self.value, kind):
            raise self.error(f"expected {KINDS[kind]}, not {KINDS[type(self.value)]}")
        return self.value

    def member(self, key: str, kind: type[T], default: Any) -> Any:
        """Give a member as it is, or a default."""
        return self[key].expected(kind) if key in self else default

    def number(self) -> float:
        """Give a finite number."""
        if isinstance(self.value, bool) or not isinstance(self.value, int | float):
            raise self.error(f"expected a number, not {KINDS[type(self.value)]}")
        with suppress(OverflowError):
            if math.isfinite(number := float(self.value)):
                return number
        raise self.error("expected a finite number")

    def integer(self) -> int:
        """Give a whole number from 0."""
        number = self.number()
        if number != int(number) or not 0 <= self.value < 2**63:
            raise self.error(f"is {number:g}; expected a whole number from 0")
        return int(self.value)

    def numbers(self, unknown: float | None = None) -> Float[Array, " N"]:
        """Give an array of numbers; null becomes `unknown`, where that is given."""
        clean = _clean(self.expected(list), self.value)
        if clean is not None:
            return clean
        # Finding the error takes much longer.
        known = unknown is not None
        each = (unknown if known and node.value is None else node.number() for node in self)
        return np.array(list(each), dtype=np.float64)

    def places(self) -> Float[Array, "N 2"]:
        """Give an array of [x, y, ...] without the further numbers."""
        value = self.value
        if isinstance(value, list) and set(map(type, value)) == {list}:
            clean = _clean(value, chain.from_iterable(value))
            if clean is not None and clean.shape[1] >= 2:
                return clean[:, :2]
        places = [place.numbers() for place in self]
        for place, numbers in zip(self, places, strict=True):
            if len(numbers) < 2:
                raise place.error("expected [x, y]")
        return np.array([numbers[:2] for numbers in places]).reshape(-1, 2)


def _clean(value: list[Any], numbers: Iterable[Any]) -> Float[Array, "*N"] | None:
    """Give an array of finite numbers, or None if one is not."""
    if set(map(type, numbers)) <= {int, float}:
        with suppress(OverflowError, ValueError):  # the latter if rows differ in length
            clean = np.array(value, np.float64)
            return clean if np.all(np.isfinite(clean)) else None
    return None


def read_json(path: Path, content: bytes | None = None) -> Node:
    """Read a file, or its content; of what is not JSON, an error names line and column."""
    try:
        with open_regular(path) as file:  # the bytes are not held any longer than it takes
            text = (file.read() if content is None else content).decode("utf-8-sig")
        return Node(path, "", json.loads(text))
    except UnicodeDecodeError as error:
        raise LabelsError(path, "", f"not a text file in UTF-8 ({error.reason})") from None
    except json.JSONDecodeError as error:
        place = f"line {error.lineno}, column {error.colno}"
        raise LabelsError(path, place, f"not JSON ({error.msg})") from None
    except (RecursionError, ValueError) as error:  # nested too deeply, or of too many digits
        raise LabelsError(path, "", f"not JSON ({error})") from None


def write_json(path: Path, root: dict[str, object]) -> None:
    """Write an object in UTF-8; members that are iterators become arrays, element by element.

    A number that is not finite is a bug.
    """
    # Names of files may hold bytes that are not text.
    with path.open("x", encoding="utf-8", errors="replace") as file:
        comma = "{"
        for name, value in root.items():
            file.write(f"{comma}{encode(name)}:")
            comma = ","
            if not isinstance(value, Iterator):
                file.write(encode(value))
                continue
            file.write("[")
            for i, element in enumerate(value):
                file.write(("," if i else "") + encode(element))
            file.write("]")
        file.write("}\n")


def head_of(head: Labels) -> dict[str, object]:
    """Give the members that describe all labels together."""
    return {
        "version": __version__,
        "scale": head.scale,
        "units": head.units,
        "shape": head.shape,
        "provenance": dict(head.provenance),
    }


def read_head(head: Node) -> Labels:
    """Read what `head_of` wrote, without labels; members may be missing."""
    scale, shape = (head.member(name, list, None) for name in ("scale", "shape"))
    units, provenance = head.member("units", str, None), head.member("provenance", dict, {})
    with blamed(head.error, Exception):  # there may be anything in them
        encode(provenance)  # it must be possible to write it again
        return Labels((), scale, units, shape, provenance)


def own_members(label: Label, unit: str = "") -> dict[str, object]:
    """Give our own members of a label; review and lock only where there is one."""
    members: dict[str, object] = {"status": label.status}
    for name, values in (("half_width", label.half_width), ("sd", label.sd)):
        known = (value if math.isfinite(value) else None for value in values.tolist())
        members[f"{name}{unit}"] = list(known)
    members["checksum"] = checksum(label)
    said = {"review": label.review} if label.review != "open" else {}
    return members | said | ({"locked": True} if label.locked else {})


def read_own(
    source: Source, own: Node, frame: int, curve: int, points: Float[Array, "N 2"], unit: str = ""
) -> Sequence[Label]:
    """Read what `own_members` gave; `Label` checks the words. None if the line was changed."""
    half_width = own[f"half_width{unit}"].numbers(unknown=np.nan)
    sd = own[f"sd{unit}"].numbers(unknown=np.inf)
    status, review = own["status"].expected(str), own.member("review", str, "open")
    locked = own.member("locked", bool, False)
    told = own["checksum"].numbers().tolist() if "checksum" in own else []
    line = Label.from_sketch(points, frame=frame, identity=curve)
    return source.own(line, told, half_width, sd, status, review, locked)

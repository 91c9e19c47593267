"""Options of a command, each declared once: as a field of the command's frozen dataclass."""

import argparse
import math
import re
from collections.abc import Callable, Iterable
from dataclasses import MISSING, field, fields
from pathlib import Path
from types import NoneType
from typing import Any, Literal, get_args, get_origin, get_type_hints

NUMBER = re.compile(r"[-+]?[\d.]+(e[-+]?\d+)?", re.IGNORECASE)
Allowed = tuple[str, Callable[[float], bool]]
"""Which numbers are allowed: in words, and a function that tells."""
POSITIVE: Allowed = "a number above 0", lambda number: 0 < number < math.inf
SHARE: Allowed = "a number from 0 to 1", lambda number: 0 <= number <= 1
COUNT: Allowed = "a number from 1 to 1000", lambda number: 1 <= number <= 1000


def opt(
    text: str = "", metavar: Any = None, *, default: Any = None, required: bool = False, **more: Any
) -> Any:
    """Declare an option by its help, which ends with the default.

    Without help it is a positional argument. `metavar` stands for its value in the help. `allowed`
    says which numbers it takes; `read=True` marks a file that is read, and `written` one that is
    written: how its name may end, () for any ending.
    """
    default = MISSING if required or not text else default
    return field(default=default, metadata={"help": text, "metavar": metavar, **more})


def flag_of(name: str) -> str:
    """Give an option's name on the command line."""
    return f"--{name.replace('_', '-')}"


def as_typed(reason: str, options: Any) -> str:
    """Let a reason that begins with the name of an option in Python name it as it was typed.

    `begins` of an option says how, where that is not its name.
    """
    for one in fields(options):
        begins = one.metadata.get("begins", f"{one.name} is ")
        if one.metadata["help"] and reason.startswith(begins):
            rest = reason.removeprefix(begins).replace(", or None to", ", or leave it out to")
            return f"{flag_of(one.name)} is {rest}"
    return reason


def add_options(parser: argparse.ArgumentParser, options: Any) -> None:
    """Add the options of a command to a parser."""
    hints = get_type_hints(options)
    for one in fields(options):
        kinds = get_args(hints[one.name])
        kind = kinds[0] if NoneType in kinds else hints[one.name]
        kind = named if kind is Path else kind
        text, metavar = one.metadata["help"], one.metadata["metavar"]
        if not text:
            parser.add_argument(one.name, metavar=metavar, type=kind)
            continue
        more: dict[str, Any] = {"type": kind, "metavar": metavar, "default": one.default}
        if kind is bool:
            more = {"action": "store_true"}
        elif get_origin(kind) is Literal:
            more |= {"type": str, "choices": kinds}
        elif get_origin(kind) is tuple:
            sizes = get_args(kind)
            more |= {"type": numbers} if ... in sizes else {"type": sizes[0], "nargs": len(sizes)}
        flags = ["-o", flag_of(one.name)] if one.name == "output" else [flag_of(one.name)]
        if kind is not bool and one.default not in (None, MISSING):
            values = one.default if isinstance(one.default, tuple) else (one.default,)
            text = f"{text} (default: {' '.join(map(str, values))})"
        parser.add_argument(*flags, help=text, required=one.default is MISSING, **more)


def named(text: str) -> Path:
    """Read a name of a file or folder; without one, Path would take the current folder."""
    if not text:
        raise argparse.ArgumentTypeError("the name is empty; is a variable not set?")
    return Path(text)


def numbers(text: str) -> tuple[float, ...]:
    """Read numbers that spaces separate."""
    try:
        return tuple(map(float, text.split() or [text]))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is no number") from None


def numbers_joined(arguments: Iterable[str], flag: str) -> list[str]:
    """Make one argument of the numbers after an option: names may follow, which are none."""
    joined = list[str]()
    for text in arguments:
        if joined[-2:-1] == [flag] and NUMBER.fullmatch(text):
            joined[-1] += f" {text}"
        else:
            joined.append(text)
    return joined


def given(options: type, parsed: argparse.Namespace) -> Any:
    """Build a command's options from the parsed arguments."""
    values = {one.name: getattr(parsed, one.name) for one in fields(options)}
    lists = {name: tuple(value) for name, value in values.items() if isinstance(value, list)}
    return options(**values | lists)

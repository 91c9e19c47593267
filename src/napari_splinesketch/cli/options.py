"""Options of a command, each declared once: as a field of the command's frozen dataclass."""

import argparse
import math
from dataclasses import MISSING, Field, dataclass, field, fields
from types import NoneType
from typing import Any, Literal, get_args, get_origin, get_type_hints


@dataclass(frozen=True)
class Opt:
    """What the command line adds to a field."""

    flag: str
    """Its name, with the dashes."""
    help: str = ""
    """What it is; {default} stands for the default. Without it, the field is a positional
    argument."""
    metavar: str | tuple[str, ...] | None = None
    """What stands for its value in the help."""
    above: float = -math.inf
    least: float = -math.inf
    most: float = math.inf
    """`above`, `least` and `most`: which numbers are allowed."""
    role: Literal["", "read", "written"] = ""
    """Whether it names a file that is read, or one that is written."""
    endings: tuple[str, ...] = ()
    """How the name of a file that is written may end; any where there is none."""

    def problem(self, value: float) -> str:
        """Say what is wrong with a number; nothing where it is allowed."""
        if self.above < value < math.inf and self.least <= value <= self.most:
            return ""
        if self.most < math.inf:
            return f"give a number from {self.least:g} to {self.most:g}"
        least = f"above {self.above:g}" if self.above > -math.inf else f"from {self.least:g}"
        return f"give a number {least}"


def opt(
    text: str = "", metavar: Any = None, *, default: Any = None, required: bool = False, **more: Any
) -> Any:
    """Declare an option, or a positional argument, with the arguments of `Opt`."""
    default = MISSING if required or not text else default
    return field(default=default, metadata={"help": text, "metavar": metavar, **more})


def declared(options: type) -> list[tuple[Field[Any], Opt]]:
    """Give every field with its declaration; positional arguments come first."""
    found = [
        (one, Opt(f"--{one.name.replace('_', '-')}", **one.metadata)) for one in fields(options)
    ]
    return sorted(found, key=lambda one: bool(one[1].help))


def check(options: object) -> None:
    """Refuse numbers that are not allowed, with a ValueError."""
    for one, opt in declared(type(options)):
        value = getattr(options, one.name)
        for number in value if isinstance(value, tuple) else (value,):
            if isinstance(number, (int, float)) and opt.problem(number):
                raise ValueError(f"{opt.flag} is {number}; {opt.problem(number)}")


def add_options(parser: argparse.ArgumentParser, options: type) -> None:
    """Add the options of a command to a parser."""
    hints = get_type_hints(options)
    for one, opt in declared(options):
        kinds = get_args(hints[one.name])
        kind = kinds[0] if NoneType in kinds else hints[one.name]
        if not opt.help:
            parser.add_argument(one.name, metavar=opt.metavar, type=kind)
            continue
        flags = ["-o", opt.flag] if one.name == "output" else [opt.flag]
        text = opt.help.replace("{default}", str(one.default)).replace("%", "%%")
        more: dict[str, Any] = {"dest": one.name, "help": text}
        if kind is bool:
            parser.add_argument(*flags, action="store_true", **more)
            continue
        if get_origin(kind) is Literal:
            more |= {"choices": get_args(kind)}
        elif get_origin(kind) is tuple:
            sizes = get_args(kind)
            count = "+" if sizes[-1] is ... else len(sizes)
            more |= {"nargs": count, "type": sizes[0], "metavar": opt.metavar}
        else:
            more |= {"type": kind, "metavar": opt.metavar}
        parser.add_argument(*flags, required=one.default is MISSING, default=one.default, **more)


def given(options: type, parsed: argparse.Namespace) -> Any:
    """Build a command's options from the parsed arguments."""
    values = {one.name: getattr(parsed, one.name) for one, _ in declared(options)}
    lists = {name: tuple(value) for name, value in values.items() if isinstance(value, list)}
    return options(**values | lists)

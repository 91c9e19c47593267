"""The error of every reader, and what readers and writers need of files."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from napari_splinesketch.files import atomic, checksum_of_file, printable, special

__all__ = ["LabelsError", "atomic", "blamed", "checksum_of_file", "open_regular", "printable"]


class LabelsError(ValueError):
    """A file that cannot be read as labels: which file, where in it, and why."""

    def __init__(self, path: str | os.PathLike[str], place: str, reason: str) -> None:
        """Say `place` as "line 3" or "record 2", and give the remedy in `reason`."""
        where = f", {place}" if place else ""
        super().__init__(printable(f"{os.fspath(path)}{where}: {reason}"))
        self.path = os.fspath(path)
        self.place = place
        self.reason = reason


@contextmanager
def blamed(error: Callable[[str], LabelsError]) -> Iterator[None]:
    """Turn a ValueError of the block, such as one of `Label`, into the error of a reader."""
    try:
        yield
    except LabelsError:
        raise
    except ValueError as reason:
        raise error(str(reason)) from None


def open_regular(path: str | os.PathLike[str]) -> BinaryIO:
    """Open a file to read its bytes; folders are refused, and pipes and devices without an end."""
    if kind := special(path):
        raise LabelsError(path, "", f"{kind}; expected a file, so save it as one first")
    return Path(path).open("rb")

"""The error of every reader; whole files or none."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from napari_splinesketch.files import atomic, checksum_of_file

__all__ = ["LabelsError", "atomic", "blamed", "checksum_of_file"]


class LabelsError(ValueError):
    """A file that cannot be read as labels: which file, where in it, and why."""

    def __init__(self, path: str | os.PathLike[str], place: str, reason: str) -> None:
        """Say `place` as "line 3" or "record 2", and give the remedy in `reason`."""
        where = f", {place}" if place else ""
        super().__init__(f"{os.fspath(path)}{where}: {reason}")
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

"""Whole files or none: atomic writing, and the error of every reader."""

import hashlib
import os
import secrets
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path


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


@contextmanager
def atomic(
    path: str | os.PathLike[str], *, overwrite: bool = False, durable: bool = True
) -> Iterator[Path]:
    """Give the path of a temporary file that becomes `path` when the block ends well.

    The temporary file lies in the same directory. Whatever happens, `path` is either as it was or
    complete.

    Parameters
    ----------
    path
        The file to write. A symbolic link is followed.
    overwrite
        Replace an existing file; otherwise it raises FileExistsError.
    durable
        Wait until it is on the disk, so that it is whole after a power cut too; takes milliseconds.
    """
    target = Path(path).resolve()
    _refuse_existing(target, overwrite)
    # The suffix is kept: some libraries choose the format by it.
    temporary = target.with_name(f".{secrets.token_hex(6)}.part{target.suffix}")
    try:
        yield temporary
        _refuse_existing(target, overwrite)
        if durable:
            _flush(temporary)
        os.replace(temporary, target)
    finally:
        temporary.unlink(missing_ok=True)


def _flush(path: Path) -> None:
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def _refuse_existing(path: Path, overwrite: bool) -> None:
    if path.exists() and not overwrite:
        raise FileExistsError(
            f"{path} exists already; choose another name or ask for it to be overwritten"
        )


def checksum_of_file(path: str | os.PathLike[str]) -> str:
    """SHA-256 of a file's bytes, in hexadecimal digits."""
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()

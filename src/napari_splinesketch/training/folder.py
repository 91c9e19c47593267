"""Whole folders or none."""

import json
import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

MANIFEST = "manifest.json"
FRAMES = "frames.csv"
FORMAT = "napari-splinesketch training set"
VERSION = 1


@contextmanager
def whole_folder(path: str | os.PathLike[str], *, overwrite: bool) -> Iterator[Path]:
    """Give a temporary folder that becomes `path` when the block ends well.

    Parameters
    ----------
    path
        The folder to make.
    overwrite
        Replace a training set of this name; another folder is never replaced.
    """
    target = Path(path).resolve()
    if not target.parent.is_dir():
        raise FileNotFoundError(f"{target.parent}: no such folder; make it first")
    _refuse(target, overwrite)
    temporary = target.with_name(f".{secrets.token_hex(6)}.part")
    temporary.mkdir()
    try:
        yield temporary
        _refuse(target, overwrite)
        if target.exists():
            old = target.with_name(f".{secrets.token_hex(6)}.old")
            target.rename(old)
            temporary.rename(target)
            shutil.rmtree(old)
        else:
            temporary.rename(target)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _refuse(target: Path, overwrite: bool) -> None:
    if not target.exists():
        return
    if not overwrite:
        raise FileExistsError(f"{target} exists already; choose another name or add --overwrite")
    if not _is_set(target):
        raise FileExistsError(f"{target} is no training set, and is not replaced")


def _is_set(folder: Path) -> bool:
    try:
        manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return isinstance(manifest, dict) and manifest.get("format") == FORMAT

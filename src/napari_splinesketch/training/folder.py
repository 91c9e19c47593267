"""Whole folders or none."""

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from napari_splinesketch.files import atomic_folder, owned

MANIFEST = "manifest.json"
FRAMES = "frames.csv"
FOLDERS = ("images", "splines", "masks", "ignore")
FORMAT = "napari-splinesketch training set"
VERSION = 1


@contextmanager
def whole_folder(path: str | os.PathLike[str], *, overwrite: bool) -> Iterator[Path]:
    """Give a temporary folder that becomes `path` when the block succeeds.

    No other process makes it in the meantime. `overwrite` replaces a training set of this name; a
    folder with anything else in it is never replaced.
    """
    target = Path(path)
    if not target.parent.is_dir():
        raise FileNotFoundError(f"{target.parent}: no such folder; make it first")
    if os.path.lexists(target):
        if not overwrite:
            raise FileExistsError(
                f"{target} exists already; choose another name or add --overwrite"
            )
        if not _is_set(target):
            raise FileExistsError(
                f"{target} is no training set, or has other files in it, and is not replaced"
            )
    with owned(target), atomic_folder(target, replaces=_is_set) as temporary:
        yield temporary


def _is_set(folder: Path) -> bool:
    """Tell whether a folder is a training set, and nothing else."""
    try:
        manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
        foreign = {path.name for path in folder.iterdir()} - {MANIFEST, FRAMES, *FOLDERS}
        foreign |= {
            path.name
            for part in FOLDERS
            for path in (folder / part).iterdir()
            if not path.name.startswith("frame-")
        }
    except (OSError, ValueError):
        return False
    return isinstance(manifest, dict) and manifest.get("format") == FORMAT and not foreign

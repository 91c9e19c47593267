"""Folders with all that is known of an image: each file whole or not, and one owner at a time."""

import hashlib
import os
import re
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from napari.layers import Image
from platformdirs import user_data_path

from napari_splinesketch.files import BusyError, atomic, owned
from napari_splinesketch.labels import LabelsError
from napari_splinesketch.plugin.autosave.session import (
    EVERY,
    Head,
    Session,
    head_text,
    page_text,
    read_head,
    read_page,
    read_patch,
    write_patch,
)
from napari_splinesketch.plugin.layers.pixels import Patch
from napari_splinesketch.plugin.model import State, by_frame

HEAD = "session.json"
FRAME = re.compile(r"frame-(\d{1,18}|every)\.(json|npz)")
OLD = ".old"
"""Added to the name of a folder that is not offered again."""
SUFFIX = ".splinesketch"
LOOKED_AT = 2**20
"""Most pixels of a frame that tell one image from another."""
LONGEST_NAME = 255
"""Of a file or folder, bytes; disks take no longer ones."""
LETTERS = 50
"""Of a layer's name, in a folder's: at most 200 bytes."""
DIGITS = 12
"""Of the checksum, in a folder's name."""


@dataclass(frozen=True, eq=False)
class Picture:
    """What tells an image from others, not yet read: reading may be slow and belongs in a thread.

    `path` is its file, None without one; `pixels` the array, the coarsest level of a multiscale
    one; `frames` says how many of its axes come before rows and columns.
    """

    name: str
    path: Path | None
    pixels: Any
    frames: int

    @classmethod
    def of(cls, image: Image) -> "Picture":
        """Take what is needed of a layer."""
        source = image.source.path
        pixels = image.data[-1] if image.multiscale else image.data  # pyright: ignore
        return cls(image.name, Path(source) if source else None, pixels, image.ndim - 2)

    def checksum(self) -> str:
        """Tell the image by shape, type and some pixels of its first, middle and last frame."""
        shape = tuple(map(int, self.pixels.shape))
        digest = hashlib.sha256(repr((shape, np.dtype(self.pixels.dtype).str)).encode())
        leading, (rows, columns) = shape[: self.frames], shape[self.frames : self.frames + 2]
        step = max(1, int(np.ceil(np.sqrt(rows * columns / LOOKED_AT))))
        count = int(np.prod(leading)) if leading else 1
        for frame in sorted({0, count // 2, count - 1}):
            index = tuple(int(i) for i in np.unravel_index(frame, leading)) if leading else ()
            every = slice(None, None, step)
            part = np.asarray(self.pixels[(*index, every, every)])
            digest.update(np.ascontiguousarray(part).tobytes())
        return digest.hexdigest()

    def describe(self, checksum: str) -> dict[str, object]:
        """Give what is written down of the image."""
        return {
            "name": self.name,
            "path": str(self.path) if self.path else None,
            "shape": [int(size) for size in self.pixels.shape],
            "sha256": checksum,
        }

    def folders(self, checksum: str, chosen: str = "") -> tuple[Path, ...]:
        """Give the folders where work on it lies; the first is for new work.

        That is where the user wants it, or beside the file, or with the user's own data where that
        is not possible. What lies in the others, because it was different once, is found as well;
        and without a file, whatever the layer was called then.
        """
        ending = f"{checksum[:DIGITS]}{SUFFIX}"
        # Of a layer's name, what any disk takes.
        plain = re.sub(r"[^\w-]+", " ", self.name)[:LETTERS].strip() or "image"
        known = self.path.name if self.path else plain
        name = f"{known}.{ending}"
        name = name if len(os.fsencode(name)) <= LONGEST_NAME else ending
        home = user_data_path("napari-splinesketch") / "sessions"
        parents = [home]
        if self.path is not None:
            beside = self.path.parent / name
            writable = os.access(beside if beside.is_dir() else beside.parent, os.W_OK)
            parents.insert(0 if writable else 1, self.path.parent)
        if chosen:
            parents.insert(0, Path(chosen).expanduser())
        found = {parent / name: None for parent in parents}
        for parent in parents:
            if parent == home or self.path is None:
                found |= dict.fromkeys(sorted(parent.glob(f"*{ending}")))
        return tuple(found)


class Folder:
    """Writes sessions into a folder, which must exist and is its own: only what has changed.

    Nobody else writes there until `release`, or until the process ends. Where another window owns
    the folder, BusyError says which.
    """

    def __init__(self, path: Path):
        self.path = path
        self.stamp, self._layer = "", ""
        self._hold = ExitStack()
        try:
            self._hold.enter_context(owned(path))
        except BusyError as error:
            who = str(error).partition(";")[0]
            raise BusyError(f"{who}: it is open in another window; close it there") from None
        # What lies there and is not known to be right is written anew, or goes.
        self._written: dict[str, object] = {
            file.name: "" for file in path.iterdir() if FRAME.fullmatch(file.name)
        }

    @classmethod
    def fresh(cls, parent: Path) -> "Folder":
        """Make a folder in another one, with a number that nobody has."""
        parent.mkdir(parents=True, exist_ok=True)
        number = 1
        while True:
            path = parent / str(number)
            try:
                path.mkdir()
            except FileExistsError:
                number += 1
            else:
                return cls(path)

    def holds(self, pictures: Mapping[int, Patch]) -> None:
        """Take note of reconstructions that were read from it: they need not be written again."""
        self._written |= {_name(frame, "npz"): patch for frame, patch in pictures.items()}

    def release(self) -> None:
        """Let others write there; leave no folder behind that holds nothing."""
        self._hold.close()
        if not self.stamp and self.path.is_dir() and not any(self.path.iterdir()):
            self.path.rmdir()

    def write(self, session: Session) -> None:
        """Bring the files in step with a session; the head counts them once they are written.

        Where nothing has changed, nothing is written.

        Pictures, which take longest, come last; one that no longer fits its frame goes first.
        """
        records = by_frame(session.state.records)
        deleted = by_frame(session.state.deleted)
        frames = sorted({*session.drawn, *records, *deleted})
        patches = {_name(f, "npz"): p for f, p in session.state.patches.items() if f in frames}
        pages = {_name(f): page_text(f, session, records, deleted) for f in frames}
        before, self._layer = {**self._written, HEAD: self._layer}, ""  # until all is written
        for name, written in tuple(self._written.items()):
            if name.endswith(".npz") and patches.get(name) is not written:
                self._remove(name)
        for name, text in pages.items():
            if self._written.get(name) != text:
                _write(self.path / name, text)
                self._written[name] = text
        for name in set(self._written).difference(pages, patches):
            self._remove(name)
        if {**self._written, HEAD: session.layer} != before:
            self.stamp = head_text(session)
            _write(self.path / HEAD, self.stamp)
        for name, patch in patches.items():
            if name not in self._written:
                write_patch(self.path / name, patch)
                self._written[name] = patch
        self._layer = session.layer

    def _remove(self, name: str) -> None:
        (self.path / name).unlink(missing_ok=True)
        del self._written[name]


def _write(path: Path, text: str) -> None:
    with atomic(path, overwrite=True) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")


def _name(frame: int, ending: str = "json") -> str:
    return f"frame-{'every' if frame == EVERY else f'{frame:09d}'}.{ending}"


def summary(path: Path) -> Head | None:
    """Say what a folder holds; None where there is nothing, LabelsError where it cannot be read."""
    try:
        head = read_head(path / HEAD)
    except FileNotFoundError:
        return None
    return head if head.sketches or head.curves else None


def read(path: Path, frames: int, size: tuple[int, int]) -> tuple[Session, tuple[str, ...]]:
    """Read a session, and say in one sentence each what could not be read.

    A damaged file costs its own frame, not the others. The image has so many frames of (H, W) px.
    """
    head = read_head(path / HEAD)
    drawn: dict[int, Any] = {}
    problems, records, deleted = [], [], []
    patches, seconds, notes = {}, {}, {}
    for file in sorted(path.iterdir()):
        found = FRAME.fullmatch(file.name)
        if not found or found[2] != "json":
            continue
        frame = EVERY if found[1] == "every" else int(found[1])
        try:
            if frame >= frames:
                raise LabelsError(file, "", f"is beyond the {frames} frames of the image")
            page = read_page(file)
            drawn[frame] = page.sketches
            if frame == EVERY:
                continue
            records += [one.record(frame) for one in page.records]
            deleted += [one.record(frame) for one in page.deleted]
            if page.seconds is not None:
                seconds[frame] = page.seconds
            if page.notes:
                notes[frame] = page.notes
            patch = read_patch(file.with_suffix(".npz"), size)
            if patch is not None:
                patches[frame] = patch
        except (OSError, LabelsError) as error:
            problems.append(str(error))
    state = State(
        records=tuple(records),
        deleted=tuple(deleted),
        patches=patches,
        seconds=seconds,
        notes=notes,
    )
    return Session(head.layer, head.image, drawn, state), tuple(problems)


def put_aside(path: Path) -> None:
    """Rename a folder, so that it is not offered again."""
    folder = Folder(path)
    number, name = 1, path.with_name(f"{path.name}{OLD}")
    while name.exists():
        number += 1
        name = path.with_name(f"{path.name}-{number}{OLD}")
    path.rename(name)
    folder.release()

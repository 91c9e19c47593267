"""Folders with all that is known of an image: each file whole or not, and one owner at a time."""

import hashlib
import os
import re
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from napari.layers import Image
from platformdirs import user_data_path

from napari_splinesketch.files import BusyError, atomic, owned
from napari_splinesketch.labels import LabelsError
from napari_splinesketch.plugin.layers.pixels import Patch
from napari_splinesketch.plugin.model import Record, State
from napari_splinesketch.plugin.sessions import (
    EVERY,
    HEAD,
    Head,
    Session,
    head_text,
    pages_of,
    read_head,
    read_page,
    read_patch,
    write_patch,
)

FRAME = re.compile(r"frame-(\d{1,18}|every)\.(json|npz)")
OLD = ".old"
"""Added to the name of a folder that is not offered again."""
SUFFIX = ".splinesketch"
LOOKED_AT = 2**20
"""Most pixels of a frame that tell one image from another."""
LONGEST_NAME = 255
"""Of a file or folder, bytes; disks take no longer ones."""
LETTERS, DIGITS = 50, 12
"""Of a layer's name and of the checksum, in a folder's name."""


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
        every = slice(None, None, max(1, int(np.ceil(np.sqrt(rows * columns / LOOKED_AT)))))
        total = int(np.prod(leading, dtype=int))
        for frame in sorted({0, total // 2, total - 1}):
            index = tuple(int(i) for i in np.unravel_index(frame, leading)) if leading else ()
            part = np.asarray(self.pixels[(*index, every, every)])
            digest.update(np.ascontiguousarray(part).tobytes())
        return digest.hexdigest()

    def describe(self, checksum: str) -> dict[str, object]:
        """Give what is written down of the image."""
        path, shape = str(self.path) if self.path else None, [int(n) for n in self.pixels.shape]
        return {"name": self.name, "path": path, "shape": shape, "sha256": checksum}

    def folders(self, checksum: str, chosen: str = "") -> tuple[Path, list[Path]]:
        """Give the folder for new work on it, and those that have some, whatever they are called.

        New work goes where the user wants it, or beside the file, or with the user's own data where
        that is not possible.
        """
        ending = f"{checksum[:DIGITS]}{SUFFIX}"
        # Of a layer's name, what any disk takes.
        plain = re.sub(r"[^\w-]+", " ", self.name)[:LETTERS].strip() or "image"
        name = f"{self.path.name if self.path else plain}.{ending}"
        name = name if len(os.fsencode(name)) <= LONGEST_NAME else ending
        parents = [user_data_path("napari-splinesketch") / "sessions"]
        if self.path is not None:
            beside = self.path.parent / name
            writable = os.access(beside if beside.is_dir() else beside.parent, os.W_OK)
            parents.insert(0 if writable else 1, self.path.parent)
        if chosen:
            parents.insert(0, Path(chosen).expanduser())
        found = [path for parent in parents for path in sorted(parent.glob(f"*{ending}"))]
        return parents[0] / name, list(dict.fromkeys(filter(Path.is_dir, found)))


class Folder:
    """Writes sessions into a folder, which must exist and is its own: only what has changed.

    Nobody else writes there until `release`, or until the process ends. Where another window owns
    the folder, BusyError says which.
    """

    def __init__(self, path: Path):
        self.path, self.stamp, self._layer = path, "", ""
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
        number = 0
        while True:
            number += 1
            with suppress(FileExistsError):
                (parent / str(number)).mkdir()
                return cls(parent / str(number))

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

        Pictures, which take longest, come last; one that no longer fits its frame goes first.
        """
        texts = {_name(frame): text for frame, text in pages_of(session).items()}
        patches = {_name(frame, "npz"): p for frame, p in session.state.patches.items()}
        patches = {name: p for name, p in patches.items() if f"{name[:-3]}json" in texts}
        wanted: dict[str, Any] = texts | patches
        fresh = {name for name, what in wanted.items() if self._written.get(name) != what}
        gone = set(self._written).difference(wanted)
        if not (fresh or gone) and self._layer == session.layer:
            return
        self._layer = ""  # until all is written
        for name in [name for name in fresh.intersection(patches) if name in self._written]:
            self._remove(name)
        for name in fresh.intersection(texts):
            _write(self.path / name, texts[name])
            self._written[name] = texts[name]
        for name in gone:
            self._remove(name)
        self.stamp = head_text(session)
        _write(self.path / HEAD, self.stamp)
        for name in fresh.intersection(patches):
            write_patch(self.path / name, patches[name])
            self._written[name] = patches[name]
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
        head = read_head(path)
    except FileNotFoundError:
        return None
    return head if head.sketches or head.curves else None


def read(path: Path, frames: int, size: tuple[int, int]) -> tuple[Session, tuple[str, ...]]:
    """Read a session, and say in one sentence each what could not be read.

    A damaged file costs its own frame, not the others. The image has so many frames of (H, W) px.
    """
    head = read_head(path)
    drawn: dict[int, Any] = {}
    problems, records, deleted = list[str](), list[Record](), list[Record]()
    patches, notes = dict[int, Patch](), dict[int, tuple[str, ...]]()
    for file in sorted(path.glob("*.json")):
        if (found := FRAME.fullmatch(file.name)) is None:
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
            notes |= {frame: page.notes} if page.notes else {}
            if (picture := file.with_suffix(".npz")).exists():
                patches[frame] = read_patch(picture, size)
        except (OSError, LabelsError) as error:
            problems.append(str(error))
    state = State(tuple(records), (), tuple(deleted), patches, notes)
    return Session(head.layer, head.image, drawn, state), tuple(problems)


def stamp(path: Path) -> str:
    """Give the head of a folder as it is written, or nothing."""
    try:
        return (path / HEAD).read_text(encoding="utf-8").removesuffix("\n")
    except OSError:
        return ""


def put_aside(path: Path) -> None:
    """Rename a folder, so that it is not offered again."""
    folder = Folder(path)
    names = (path.with_name(f"{path.name}{f'-{n}' if n > 1 else ''}{OLD}") for n in count(1))
    path.rename(next(name for name in names if not name.exists()))
    folder.release()

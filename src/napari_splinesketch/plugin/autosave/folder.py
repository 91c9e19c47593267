"""A folder with all that is known of one image: each file whole or not, and one owner at a time."""

import re
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from napari_splinesketch.files import BusyError, atomic, owned
from napari_splinesketch.labels import LabelsError
from napari_splinesketch.plugin.autosave.session import (
    EVERY,
    Head,
    Page,
    Session,
    head_text,
    page_text,
    read_head,
    read_page,
    read_patch,
    record_text,
    write_patch,
)
from napari_splinesketch.plugin.layers.pixels import Patch
from napari_splinesketch.plugin.model import Record

HEAD = "session.json"
ENDINGS = "json", "npz"
FRAME = re.compile(rf"frame-(\d{{1,18}}|every)\.({'|'.join(ENDINGS)})")
OLD = ".old"
"""Added to the name of a folder that is not offered again."""


class Folder:
    """Writes sessions into a folder that it owns: only frames that have changed.

    Nobody else writes there until `release`, or until the process ends.

    Parameters
    ----------
    path
        The folder; it must exist.

    Raises
    ------
    BusyError
        Where another window owns the folder.
    """

    def __init__(self, path: Path):
        self.path = path
        self.stamp = ""
        self._known: dict[int, tuple[Record, str]] = {}
        self._hold = ExitStack()
        try:
            self._hold.enter_context(owned(path))
        except BusyError as error:
            who = str(error).partition(";")[0]
            raise BusyError(f"{who}: it is open in another window; close it there") from None
        names = [found for file in path.iterdir() if (found := FRAME.fullmatch(file.name))]
        frames = {ending: {_frame(n[1]) for n in names if n[2] == ending} for ending in ENDINGS}
        # What lies there and is not known to be right is written anew, or goes.
        self._written = dict.fromkeys(frames["json"], "")
        self._pictures: dict[int, object] = dict.fromkeys(frames["npz"], "")

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
        self._pictures |= pictures

    def release(self) -> None:
        """Let others write there; leave no folder behind that holds nothing."""
        self._hold.close()
        if not self.stamp and self.path.is_dir() and not any(self.path.iterdir()):
            self.path.rmdir()

    def write(self, session: Session) -> None:
        """Bring the files in step with a session; the head counts them once they are written.

        Pictures, which take longest, come last; one that no longer fits its frame goes first.
        """
        pages = session.pages
        for frame, patch in tuple(self._pictures.items()):
            if frame not in pages or pages[frame].patch is not patch:
                (self.path / _name(frame, "npz")).unlink(missing_ok=True)
                del self._pictures[frame]
        fresh: dict[int, tuple[Record, str]] = {}
        for frame, page in pages.items():
            records, deleted = (self._coded(some, fresh) for some in (page.records, page.deleted))
            text = page_text(frame, page, records, deleted)
            if self._written.get(frame) != text:
                _write(self.path / _name(frame), text)
                self._written[frame] = text
        self._known = fresh
        for frame in set(self._written) - set(pages):
            (self.path / _name(frame)).unlink(missing_ok=True)
            del self._written[frame]
        self.stamp = head_text(session)
        _write(self.path / HEAD, self.stamp)
        for frame, page in pages.items():
            if page.patch is not None and frame not in self._pictures:
                write_patch(self.path / _name(frame, "npz"), page.patch)
                self._pictures[frame] = page.patch

    def _coded(self, records: Sequence[Record], fresh: dict[int, tuple[Record, str]]) -> list[str]:
        """Give the texts of records; they never change, and so are made once."""
        for one in records:
            fresh[id(one)] = self._known.get(id(one)) or (one, record_text(one))
        return [fresh[id(one)][1] for one in records]


def _write(path: Path, text: str) -> None:
    with atomic(path, overwrite=True) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")


def _name(frame: int, ending: str = "json") -> str:
    return f"frame-{'every' if frame == EVERY else f'{frame:09d}'}.{ending}"


def _frame(name: str) -> int:
    return EVERY if name == "every" else int(name)


def summary(path: Path) -> Head | None:
    """Say what a folder holds; None where there is nothing to go on with.

    Raises
    ------
    LabelsError
        Where there is something, but it cannot be read.
    """
    try:
        head = read_head(path / HEAD)
    except FileNotFoundError:
        return None
    return head if head.sketches or head.curves else None


def read(path: Path, frames: int, size: tuple[int, int]) -> tuple[Session, tuple[str, ...]]:
    """Read a session, and say in one sentence each what could not be read.

    A damaged file costs its own frame, not the others.

    Parameters
    ----------
    path
        The folder.
    frames
        How many the image has.
    size
        (H, W) of the image, px.
    """
    head = read_head(path / HEAD)
    pages: dict[int, Page] = {}
    problems = []
    for file in sorted(path.iterdir()):
        found = FRAME.fullmatch(file.name)
        if not found or found[2] != "json":
            continue
        frame = _frame(found[1])
        try:
            if frame >= frames:
                raise LabelsError(file, "", f"is beyond the {frames} frames of the image")
            pages[frame] = read_page(file, frame)
            patch = read_patch(path / _name(frame, "npz"), size)
            pages[frame] = replace(pages[frame], patch=patch)
        except (OSError, LabelsError) as error:
            problems.append(str(error))
    return Session(head.layer, head.image, pages), tuple(problems)


def put_aside(path: Path) -> None:
    """Rename a folder, so that it is not offered again."""
    folder = Folder(path)
    number, name = 1, path.with_name(f"{path.name}{OLD}")
    while name.exists():
        number += 1
        name = path.with_name(f"{path.name}-{number}{OLD}")
    path.rename(name)
    folder.release()

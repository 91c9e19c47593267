"""A folder with all that is known of one image: a file for each frame, written whole or not."""

import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path

from napari_splinesketch import __version__
from napari_splinesketch.labels import LabelsError
from napari_splinesketch.labels.files import atomic, blamed
from napari_splinesketch.labels.json_tree import Node, read_json
from napari_splinesketch.plugin.adapter.film import Patch
from napari_splinesketch.plugin.autosave.coding import (
    Shape,
    record_from,
    record_to_json,
    shape_from,
    shape_to_json,
)
from napari_splinesketch.plugin.autosave.patches import read_patch, write_patch
from napari_splinesketch.plugin.records import Record

FORMAT = 1
HEAD = "session.json"
FRAME = re.compile(r"frame-(\d{1,18}|every)\.json")
PICTURE = "npz"
EVERY = -1
"""The frame of sketches that belong to all of them."""


@dataclass(frozen=True, eq=False)
class Page:
    """What is known of one frame.

    Attributes
    ----------
    shapes
        What the user drew, in the order of its layer.
    records, deleted
        Its curves.
    seconds
        How long the engine took; None where it is not known.
    notes
        What the scene needed.
    patch
        The reconstruction, if there is one.
    """

    shapes: tuple[Shape, ...] = ()
    records: tuple[Record, ...] = ()
    deleted: tuple[Record, ...] = ()
    seconds: float | None = None
    notes: tuple[str, ...] = ()
    patch: Patch | None = None


@dataclass(frozen=True, eq=False)
class Session:
    """What is known of an image.

    Attributes
    ----------
    layer
        Name of the layer of sketches.
    image
        What the image was: values for JSON.
    pages
        By frame; `EVERY` for sketches that belong to all frames.
    """

    layer: str
    image: Mapping[str, object] = field(default_factory=dict)
    pages: Mapping[int, Page] = field(default_factory=dict)


@dataclass(frozen=True)
class Summary:
    """What a folder holds, for the question whether to go on with it.

    Attributes
    ----------
    layer
        Name of the layer of sketches.
    sketches, curves, frames
        How many.
    saved
        When it was written.
    sha256
        Checksum of the image.
    """

    layer: str
    sketches: int
    curves: int
    frames: int
    saved: datetime
    sha256: str


class Folder:
    """Writes sessions into a folder: only frames that have changed, each file whole.

    Parameters
    ----------
    path
        The folder; made when it is first written to.
    pictures
        Reconstructions that it holds already, by frame.
    """

    def __init__(self, path: Path, pictures: Mapping[int, Patch] | None = None):
        self.path = path
        self._pictures = dict(pictures or {})
        self._written: dict[int, str] = {}
        self._known: dict[int, tuple[Record, str]] = {}

    def write(self, session: Session) -> None:
        """Bring the files in step with a session; the head counts them once they are written.

        Pictures, which take longest, come last; one that no longer fits its frame goes first.
        """
        self.path.mkdir(parents=True, exist_ok=True)
        pages = session.pages
        for frame, patch in tuple(self._pictures.items()):
            if frame not in pages or pages[frame].patch is not patch:
                (self.path / _name(frame, PICTURE)).unlink(missing_ok=True)
                del self._pictures[frame]
        fresh: dict[int, tuple[Record, str]] = {}
        for frame, page in session.pages.items():
            text = self._page(frame, page, fresh)
            if self._written.get(frame) != text:
                _write(self.path / _name(frame), text)
                self._written[frame] = text
        self._known = fresh
        for frame in set(self._written) - set(session.pages):
            (self.path / _name(frame)).unlink(missing_ok=True)
            del self._written[frame]
        _write(self.path / HEAD, _head(session))
        for frame, page in pages.items():
            if page.patch is not None and frame not in self._pictures:
                write_patch(self.path / _name(frame, PICTURE), page.patch)
                self._pictures[frame] = page.patch

    def _page(self, frame: int, page: Page, fresh: dict[int, tuple[Record, str]]) -> str:
        def coded(records: Sequence[Record]) -> str:
            texts = []
            for record in records:
                # Records never change: what was coded once need not be coded again.
                known = self._known.get(id(record)) or (record, record_to_json(record))
                fresh[id(record)] = known
                texts.append(known[1])
            return f"[{','.join(texts)}]"

        shapes = ",".join(map(shape_to_json, page.shapes))
        seconds = json.dumps(page.seconds)
        return (
            f'{{"frame":{frame},"sketches":[{shapes}],"records":{coded(page.records)},'
            f'"deleted":{coded(page.deleted)},"seconds":{seconds},"notes":{json.dumps(page.notes)}}}'
        )


def _head(session: Session) -> str:
    pages = session.pages.values()
    values = {
        "software": f"napari-splinesketch {__version__}",
        "format": FORMAT,
        "image": dict(session.image),
        "layer": session.layer,
        "saved": datetime.now(UTC).isoformat(),
        "sketches": sum(len(page.shapes) for page in pages),
        "curves": sum(len(page.records) for page in pages),
        "frames": sum(bool(page.shapes or page.records) for page in pages),
    }
    return json.dumps(values, ensure_ascii=False)


def _write(path: Path, text: str) -> None:
    with atomic(path, overwrite=True) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")


def _name(frame: int, ending: str = "json") -> str:
    return f"frame-{'every' if frame == EVERY else f'{frame:09d}'}.{ending}"


def summary(path: Path) -> Summary | None:
    """Say what a folder holds; None where there is nothing to go on with.

    Raises
    ------
    LabelsError
        Where there is something, but it cannot be read.
    """
    try:
        head = read_json(path / HEAD)
    except FileNotFoundError:
        return None
    with blamed(head.error):
        found = Summary(
            head["layer"].text(),
            head["sketches"].integer(),
            head["curves"].integer(),
            head["frames"].integer(),
            datetime.fromisoformat(head["saved"].text()),
            head["image"]["sha256"].text(),
        )
        if found.saved.tzinfo is None:
            raise head["saved"].error("has no time zone")
    if head["format"].integer() > FORMAT:
        raise head["format"].error("was written by a newer version; update napari-splinesketch")
    return found if found.sketches or found.curves else None


def read(path: Path) -> tuple[Session, tuple[str, ...]]:
    """Read a session, and say in one sentence each what could not be read.

    A damaged file costs its own frame, not the others.
    """
    head = read_json(path / HEAD)
    pages: dict[int, Page] = {}
    problems = []
    for file in sorted(path.iterdir()):
        found = FRAME.fullmatch(file.name)
        if found:
            frame = EVERY if found[1] == "every" else int(found[1])
            try:
                pages[frame] = _page_from(read_json(file), frame)
                patch = read_patch(path / _name(frame, PICTURE))
                pages[frame] = replace(pages[frame], patch=patch)
            except (OSError, LabelsError) as error:
                problems.append(str(error))
    return Session(head["layer"].text(), head["image"].members(), pages), tuple(problems)


def _page_from(node: Node, frame: int) -> Page:
    of_all = max(frame, 0)
    seconds = node["seconds"].number() if "seconds" in node else None
    page = Page(
        tuple(shape_from(one) for one in node["sketches"]),
        tuple(record_from(one, of_all) for one in node["records"]),
        tuple(record_from(one, of_all) for one in node["deleted"]),
        seconds if seconds is None or math.isfinite(seconds) else None,
        tuple(note.text() for note in node["notes"]),
    )
    ids = [record.id for record in page.records]
    if len(set(ids)) < len(ids):
        raise node["records"].error("has a curve twice")
    return page

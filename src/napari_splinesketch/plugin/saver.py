"""Writes work down while it is done, and finds what was written before."""

import hashlib
import logging
import os
import re
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from napari.layers import Image, Layer, Shapes
from platformdirs import user_data_path
from psygnal import Signal
from qtpy.compat import isalive
from qtpy.QtCore import QObject
from superqt.utils import qthrottled

from napari_splinesketch.labels import LabelsError
from napari_splinesketch.plugin import sessions
from napari_splinesketch.plugin.choices import PLACED, listen
from napari_splinesketch.plugin.engine import Job
from napari_splinesketch.plugin.keeper import NOTHING, Keeper
from napari_splinesketch.plugin.layers.drawn import shapes_in
from napari_splinesketch.plugin.layers.slot import is_result
from napari_splinesketch.plugin.sessions import Folder, Head, Session, Shape

DELAY_MS = 700
"""From a change to its being written, at least; more changes meanwhile go together."""
AGAIN_MS = 5000
"""After a write that failed, until it is tried again."""
LOOKED_AT = 2**20
"""Most pixels of a frame that tell one image from another."""
LONGEST_NAME = 255
"""Of a file or folder, bytes; disks take no longer ones."""
LETTERS, DIGITS = 50, 12
"""Of a layer's name and of the checksum, in a folder's name."""
_log = logging.getLogger(__name__)
_left: WeakKeyDictionary[Image, WeakKeyDictionary[Shapes, Folder]] = WeakKeyDictionary()
"""Where layers are written that nobody looks after: their dock is closed, or they were removed."""
Pair = tuple[Image, Shapes]
Order = tuple[Folder, Session, Path]
"""What is to be written, and where its folder is made if there is none yet."""


@dataclass(eq=False)
class Seen:
    """An image as its sessions name it, where its folder is, and the sessions that were found.

    All are empty while a job still looks.
    """

    job: Job | None = None
    about: dict[str, object] = field(default_factory=dict)
    folder: Path | None = None
    found: dict[Path, Head] = field(default_factory=dict)


class Saver(QObject):
    """Saves sketches and curves of all images in the window on every change, in a thread.

    It ends with its parent.
    """

    found = Signal(description="There is work to go on with, or none any more, or elsewhere")

    def __init__(self, keeper: Keeper, parent: QObject | None = None):
        super().__init__(parent)
        self._keeper = keeper
        self._seen: dict[Image, Seen] = {}
        self._folders: dict[Pair, Folder] = {}
        self._writing: Job | None = None
        self._problems = {"look": "", "write": ""}
        self._choice = keeper.settings.save_work, keeper.settings.work_folder
        self._soon = qthrottled(self._save, DELAY_MS, leading=False)
        changes, layers = keeper.changes, keeper.viewer.layers.events
        self._end: Callable[[], None] | None = listen(
            (changes.layers, self._follow),
            (changes.layers, self.found.emit),
            (changes.curves, self._follow),
            (changes.settings, self._on_settings),
            (layers, self._on_event),
            (layers.removing, self._on_removing),
            (layers.removed, lambda event: self._let_go(event.value)),
        )
        self._follow()

    @property
    def place(self) -> Path | None:
        """Where work on the chosen layers is saved; None while that is not known, or not wanted."""
        image, sketches = self._keeper.choices.image, self._keeper.choices.sketches
        folder = self._folders.get((image, sketches)) if image and sketches else None
        if folder and folder.path and image in self._seen:
            return folder.path.parent
        return self._seen[image].folder if image in self._seen else None

    @property
    def problem(self) -> str:
        """Why something is not saved, or could not be found, or nothing."""
        return " ".join(filter(None, self._problems.values()))

    def offers(self) -> Mapping[Path, Head]:
        """Give the work that was found for the chosen image, the latest first."""
        image = self._keeper.choices.image
        found = self._seen[image].found if image in self._seen else {}
        mine = {folder.path for folder in self._folders.values()}
        others = [pair for pair in found.items() if pair[0] not in mine]
        return dict(sorted(others, key=lambda pair: pair[1].saved, reverse=True))

    def take(self, path: Path, pair: Pair, folder: Folder) -> None:
        """Go on with what was found, which is in these layers now, in a folder."""
        self._folders[pair] = folder
        self._forget(path)

    def decline(self) -> None:
        """Do not offer again what was found; the files stay, under another name."""
        for path in self.offers():
            names = (path.with_name(f"{path.name}{-n or ''}{sessions.OLD}") for n in count())
            try:
                folder = Folder(path)
                path.rename(next(name for name in names if not name.exists()))
                folder.release()
            except OSError as error:
                self._problems["look"] = f"Saved work could not be put aside: {error}."
            self._forget(path)

    def flush(self) -> None:
        """Write now what is still to be written, and wait until it is."""
        self._soon.cancel()
        looks = [self._seen[image].job for image, _ in self._pairs() if image in self._seen]
        for job in (*looks, self._writing):
            if job:
                job.wait()
        orders = [] if self._writing else self._orders()
        if orders:
            self._on_written(_write(orders))

    def close(self) -> None:
        """Write what is still to be written, listen no more, and leave the folders to others."""
        if self._end:
            self.flush()
            self._soon.cancel()
            self._end()
            self._end = None
            self._let_go(*self._keeper.viewer.layers)

    def _let_go(self, *layers: Layer) -> None:
        """Leave the folders of some layers to others, and know nothing of them any more."""
        for image, sketches in [pair for pair in self._folders if not set(pair).isdisjoint(layers)]:
            folder = self._folders.pop((image, sketches))
            folder.release()
            _left.setdefault(image, WeakKeyDictionary())[sketches] = folder
        self._seen = {image: seen for image, seen in self._seen.items() if image not in layers}

    def _forget(self, path: Path) -> None:
        for seen in self._seen.values():
            seen.found.pop(path, None)
        self.found.emit()

    def _pairs(self) -> set[Pair]:
        """Give all that there is to save."""
        choices = self._keeper.choices
        pairs = {(work.image, work.sketches) for work in self._keeper.works} | {*self._folders}
        image, sketches = choices.image, choices.sketches
        if image is not None and sketches is not None and sketches.nshapes:
            pairs.add((image, sketches))
        return {pair for pair in pairs if set(pair) <= set(self._keeper.viewer.layers)}

    def _on_event(self, event: Any) -> None:
        """Hear of any layer of the user's: one that is not chosen may be written too."""
        if event.type in PLACED and not is_result(event.sources[0]):
            self._follow()

    def _follow(self) -> None:
        """Look at the chosen image, unless that was done, and write what has changed, soon."""
        for image, layer in self._pairs() - self._folders.keys():  # another may be chosen soon
            folder = _left.get(image, {}).pop(layer, Folder())
            try:
                folder.hold()
            except OSError:
                _log.info("Another window has taken over %s", folder.path)
                folder = Folder()
            self._folders[image, layer] = folder
        image, (wanted, chosen) = self._keeper.choices.image, self._choice
        if wanted and image is not None and image not in self._seen:
            source, data = image.source.path, image.data
            pixels = data[-1] if image.multiscale else data  # pyright: ignore
            about = image.name, Path(source) if source else None, pixels, image.ndim - 2
            job = Job(lambda _: _look(chosen, *about))
            self._seen[image] = Seen(job)
            job.done.connect(partial(self._on_looked, image))
            said = f"{image.name} could not be read, and work on it is not saved: "
            job.failed.connect(lambda why: self._on_looked(image, (None, f"{said}{why}.")))
            job.start()
        self._soon()

    def _tell(self, about: str, problem: str) -> None:
        self._problems[about] = problem
        # An answer may come after Qt has deleted the window and all that is in it.
        if isalive(self):
            self.found.emit()

    def _on_looked(self, image: Image, answer: tuple[Seen | None, str]) -> None:
        """Take in what was found; an image that could not be read is tried with the next edit."""
        seen, problem = answer
        if image in self._seen and image in self._keeper.viewer.layers:
            del self._seen[image]
            if seen:
                self._seen[image] = seen
                self._soon()
            self._tell("look", problem)

    def _on_settings(self) -> None:
        settings = self._keeper.settings
        if self._choice != (settings.save_work, settings.work_folder):
            # Elsewhere from now on, or no more: what is saved stays where it is.
            self.flush()
            self._choice = settings.save_work, settings.work_folder
            self._let_go(*self._keeper.viewer.layers)
            _left.clear()
            self._follow()
            self.found.emit()

    def _on_removing(self, event: Any) -> None:
        if any(self._keeper.viewer.layers[event.index] in pair for pair in self._pairs()):
            self.flush()

    def _save(self) -> None:
        """Take what there is, and write what of it has changed in a thread."""
        if self._writing:
            self._soon()
        elif orders := self._orders():
            self._writing = Job(lambda _: _write(orders))
            self._writing.done.connect(self._on_written)
            self._writing.failed.connect(self._on_written)
            self._writing.start()

    def _orders(self) -> list[Order]:
        """Take a snapshot of what there is; what of it has changed, its folder knows."""
        orders = []
        for image, layer in self._pairs() & self._folders.keys():
            folder, seen = self._folders[image, layer], self._seen.get(image)
            if seen is None or seen.folder is None:
                continue
            work = self._keeper.work_on(image, layer)
            state = work.state if work else NOTHING
            drawn: dict[int, list[Shape]] = defaultdict(list)
            read, every = shapes_in(self._keeper.viewer, layer, image), layer.ndim < image.ndim
            for kind, (frame, line) in zip(layer.shape_type, read, strict=True):
                drawn[sessions.EVERY if every else frame].append(Shape(kind, line))
            if folder.path or drawn or state.records:
                session = Session(layer.name, seen.about, dict(drawn), state)
                orders.append((folder, session, seen.folder))
        return orders

    def _on_written(self, problem: str) -> None:
        self._writing = None
        self._soon.setTimeout(AGAIN_MS if problem else DELAY_MS)
        if problem:
            self._soon()
        if problem != self._problems["write"]:
            self._tell("write", problem)


def _look(chosen: str, name: str, path: Path | None, pixels: Any, frames: int) -> tuple[Seen, str]:
    """Find out which image it is, in a thread, and what is written of it; and what is not read."""
    checksum = _checksum(pixels, frames)
    source, shape = str(path) if path else None, [int(n) for n in pixels.shape]
    about = {"name": name, "path": source, "shape": shape, "sha256": checksum}
    home, folders = _folders(name, path, checksum, chosen)
    seen, problem = Seen(None, about, home), ""
    for folder in (inner for outer in folders for inner in sorted(outer.iterdir())):
        try:
            wanted = folder.is_dir() and folder.suffix != sessions.OLD
            held = sessions.summary(folder) if wanted else None
        except (OSError, LabelsError) as error:
            problem = f"Saved work could not be read, and stays where it is: {error}."
            continue
        if held and held.sha256 == checksum:
            seen.found[folder] = held
    return seen, problem


def _checksum(pixels: Any, frames: int) -> str:
    """Tell an image by shape, type and some pixels of its first, middle and last frame."""
    shape = tuple(map(int, pixels.shape))
    digest = hashlib.sha256(repr((shape, np.dtype(pixels.dtype).str)).encode())
    leading, (rows, columns) = shape[:frames], shape[frames : frames + 2]
    every = slice(None, None, max(1, int(np.ceil(np.sqrt(rows * columns / LOOKED_AT)))))
    total = int(np.prod(leading, dtype=int))
    for frame in sorted({0, total // 2, total - 1}):
        index = tuple(int(i) for i in np.unravel_index(frame, leading)) if leading else ()
        digest.update(np.ascontiguousarray(pixels[(*index, every, every)]).tobytes())
    return digest.hexdigest()


def _folders(name: str, path: Path | None, checksum: str, chosen: str) -> tuple[Path, list[Path]]:
    """Give the folder for new work on an image, and those with some, whatever they are called.

    New work goes where the user wants it, or beside the file, or with the user's own data where
    that is not possible.
    """
    ending = f"{checksum[:DIGITS]}.splinesketch"
    # Of a layer's name, what any disk takes.
    plain = re.sub(r"[^\w-]+", " ", name)[:LETTERS].strip() or "image"
    called = f"{path.name if path else plain}.{ending}"
    called = called if len(os.fsencode(called)) <= LONGEST_NAME else ending
    parents = [user_data_path("napari-splinesketch") / "sessions"]
    if path is not None:
        beside = path.parent / called
        writable = os.access(beside if beside.is_dir() else path.parent, os.W_OK)
        parents.insert(0 if writable else 1, path.parent)
    if chosen:
        parents.insert(0, Path(chosen).expanduser())
    found = [folder for parent in parents for folder in sorted(parent.glob(f"*{ending}"))]
    return parents[0] / called, list(dict.fromkeys(filter(Path.is_dir, found)))


def _write(orders: Sequence[Order]) -> str:
    """Write what was ordered, in a thread; says what went wrong."""
    problems = []
    for folder, session, parent in orders:
        try:
            folder.make(parent)
            folder.write(session)
        except OSError as error:
            _log.warning("The work could not be saved", exc_info=True)
            problems.append(f"The work could not be saved: {error}.")
    return " ".join(dict.fromkeys(problems))

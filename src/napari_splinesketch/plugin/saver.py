"""Saves work while it is done, and finds what was saved before."""

import hashlib
import logging
import os
import re
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from napari.layers import Image, Shapes
from platformdirs import user_data_path
from psygnal import Signal
from qtpy.compat import isalive
from qtpy.QtCore import QObject
from superqt.utils import qthrottled

from napari_splinesketch.files import owned
from napari_splinesketch.labels import LabelsError
from napari_splinesketch.plugin import sessions
from napari_splinesketch.plugin.choices import PLACED, listen
from napari_splinesketch.plugin.engine import Job
from napari_splinesketch.plugin.keeper import Keeper
from napari_splinesketch.plugin.layers.drawn import shapes_in
from napari_splinesketch.plugin.layers.results import Work
from napari_splinesketch.plugin.layers.slot import is_result
from napari_splinesketch.plugin.sessions import Folder, Head, Session, Shape

DELAY_MS = 700
"""From a change to its being written, at least; more changes meanwhile go together."""
AGAIN_MS = 5000
"""After something that failed, until it is tried again."""
LOOKED_AT = 2**20
"""Most pixels of a frame that tell one image from another."""
LONGEST_NAME = 255
"""Of a file or folder, bytes; disks take no longer ones."""
LETTERS, DIGITS = 50, 12
"""Of a layer's name and of the checksum, in a folder's name."""
_log = logging.getLogger(__name__)
_folders: WeakKeyDictionary[Image, WeakKeyDictionary[Shapes, Folder]] = WeakKeyDictionary()
"""Where an image's work through a layer of sketches is saved, whichever dock looks after it."""


@dataclass(eq=False)
class Seen:
    """An image as its sessions name it, where new ones go, those that were found; what was not."""

    about: dict[str, object]
    home: Path
    found: dict[Path, Head]
    problem: str = ""


Answer = tuple[Seen | None, str]
"""What was found out about an image, and why something is not known, or not written."""


class Saver(QObject):
    """Saves sketches and curves of all images in the window on every change, in threads.

    An image has a thread of its own, that others need not wait for: one that finds out which image
    it is, and later those that write its work. It ends with its parent.
    """

    found = Signal(description="There is work to go on with, or none any more, or elsewhere")

    def __init__(self, keeper: Keeper, parent: QObject | None = None):
        super().__init__(parent)
        self._keeper = keeper
        self._seen: dict[Image, Seen] = {}
        self._jobs: dict[Image, Job] = {}
        self._problems: dict[Image, str] = {}
        self._choice = keeper.settings.save_work, keeper.settings.work_folder
        self._soon = qthrottled(self._go_on, DELAY_MS, leading=False)
        changes, layers = keeper.changes, keeper.viewer.layers.events
        self._end: Callable[[], None] | None = listen(
            (changes.layers, self._follow),
            (changes.layers, self.found.emit),
            (changes.curves, self._follow),
            (changes.settings, self._on_settings),
            (layers, self._on_event),
            (layers.removing, self._on_removing),
            (layers.removed, self._on_removed),
        )
        self._follow()

    @property
    def place(self) -> Path | None:
        """Where work on the chosen layers is saved; None while that is not known, or not wanted."""
        image, work = self._keeper.choices.image, self._keeper.work
        if image not in self._seen:
            return None
        path = self.folder(work).path if work else None
        return path.parent if path else self._seen[image].home

    @property
    def problem(self) -> str:
        """Why something is not saved, or could not be found, or nothing."""
        found = (seen.problem for seen in self._seen.values())
        return " ".join(filter(None, (*found, *self._problems.values())))

    def folder(self, work: Work) -> Folder:
        """Say where work is saved; without a path, as long as there is nothing to save."""
        return _folders.setdefault(work.image, WeakKeyDictionary()).setdefault(
            work.sketches, Folder()
        )

    def offers(self) -> Mapping[Path, Head]:
        """Give the work that was found for the chosen image, the latest first."""
        image = self._keeper.choices.image
        found = self._seen[image].found if image in self._seen else {}
        mine = {self.folder(work).path for work in self._keeper.works}
        others = [pair for pair in found.items() if pair[0] not in mine]
        return dict(sorted(others, key=lambda pair: pair[1].saved, reverse=True))

    def take(self, path: Path, work: Work, folder: Folder) -> None:
        """Go on, in a folder, with what was found and is in the window now."""
        _folders.setdefault(work.image, WeakKeyDictionary())[work.sketches] = folder
        self._forget(path)

    def decline(self) -> None:
        """Do not offer again what was found; the files stay, under another name."""
        for path in self.offers():
            names = (path.with_name(f"{path.name}{-n or ''}{sessions.OLD}") for n in count())
            try:
                with owned(path):
                    path.rename(next(name for name in names if not name.exists()))
            except OSError as error:
                said = f"Saved work could not be put aside: {error}."
                for seen in self._seen.values():
                    seen.problem = said if path in seen.found else seen.problem
            self._forget(path)

    def flush(self) -> None:
        """Write now what is still to be written, and wait until it is."""
        self._soon.cancel()
        works = [work for work in self._works() if work.records or work.sketches.nshapes]
        for image in dict.fromkeys(work.image for work in works):
            for _ in ("look", "write") if image not in self._seen else ("write",):
                if image in self._jobs:
                    self._jobs[image].wait()
                if task := self._task(image):
                    self._on_done(image, task())

    def close(self) -> None:
        """Write what is still to be written, listen no more, and leave the folders to others."""
        if self._end:
            self.flush()
            self._soon.cancel()
            self._end()
            self._end = None
            self._release(self._keeper.works)

    def _release(self, works: Sequence[Work]) -> None:
        for work in works:
            self.folder(work).release()

    def _forget(self, path: Path) -> None:
        for seen in self._seen.values():
            seen.found.pop(path, None)
        self.found.emit()

    def _on_event(self, event: Any) -> None:
        """Hear of any layer of the user's: one that is not chosen may be written too."""
        if event.type in PLACED and not is_result(event.sources[0]):
            self._follow()

    def _follow(self) -> None:
        """Look at an image that is not known yet, and write what has changed, soon."""
        if self._keeper.choices.image in {*self._seen, *self._jobs}:
            self._soon()
        else:
            self._go_on()

    def _on_settings(self) -> None:
        choice = self._keeper.settings.save_work, self._keeper.settings.work_folder
        if self._choice != choice:
            # Elsewhere from now on, or no more: what is saved stays where it is.
            self.flush()
            self._release(self._keeper.works)
            self._choice = choice
            self._seen.clear()
            for work in self._keeper.works:
                _folders[work.image].clear()
            self._follow()
            self.found.emit()

    def _on_removing(self, event: Any) -> None:
        layer = self._keeper.viewer.layers[event.index]
        going = [work for work in self._keeper.works if layer in (work.image, work.sketches)]
        if going:
            self.flush()
            self._release(going)

    def _on_removed(self, event: Any) -> None:
        if isinstance(event.value, Image):
            self._seen.pop(event.value, None)
            self._problems.pop(event.value, None)

    def _works(self) -> list[Work]:
        there = set(self._keeper.viewer.layers)
        return [work for work in self._keeper.works if {work.image, work.sketches} <= there]

    def _go_on(self) -> None:
        """Find out in threads what is not known yet, or write what has changed."""
        for image in {self._keeper.choices.image, *(work.image for work in self._works())} - {None}:
            if image in self._jobs:
                self._soon()
            elif task := self._task(image):
                job = self._jobs[image] = Job(lambda _, task=task: task())
                job.done.connect(partial(self._on_done, image))
                job.start()

    def _task(self, image: Image) -> Callable[[], Answer] | None:
        """Take a snapshot of what is to be found out about an image, or written of it."""
        (wanted, chosen), seen = self._choice, self._seen.get(image)
        if seen is None:
            path = Path(image.source.path) if image.source.path else None
            pixels = image.data[-1] if image.multiscale else image.data  # pyright: ignore
            look = partial(_look, chosen, image.name, path, pixels, image.ndim - 2)
            return look if wanted else None
        orders = list[tuple[Folder, Session]]()
        for work in self._works():
            folder, layer = self.folder(work), work.sketches
            if work.image is not image:
                continue
            drawn: dict[int, list[Shape]] = defaultdict(list)
            viewer, every = self._keeper.viewer, layer.ndim < image.ndim
            read = shapes_in(viewer, layer, image)
            for shape, (frame, line) in zip(layer.shape_type, read, strict=True):
                drawn[sessions.EVERY if every else frame].append(Shape(shape, line))
            if folder.path or drawn or work.records:
                orders.append((folder, Session(layer.name, seen.about, dict(drawn), work.state)))
        return partial(_write, orders, seen.home) if orders else None

    def _on_done(self, image: Image, answer: Answer) -> None:
        """Take in what was found, and what went wrong; try that again later."""
        seen, problem = answer
        self._jobs.pop(image, None)
        # An answer may come after Qt has deleted the window and all that is in it.
        if image not in self._keeper.viewer.layers or not isalive(self):
            return
        changed = seen is not None or problem != self._problems.get(image, "")
        self._problems[image] = problem
        if seen is not None:
            self._seen[image] = seen
        if self._end is not None:
            failing = any(self._problems.values())
            self._soon.setTimeout(AGAIN_MS if failing else DELAY_MS)
            if seen or failing:
                self._soon()
            if changed:
                self.found.emit()


def _write(orders: Sequence[tuple[Folder, Session]], parent: Path) -> Answer:
    """Write what was ordered, into new folders where there are none; to be called in a thread."""
    problems: dict[str, None] = {}
    for folder, session in orders:
        try:
            folder.write(session, parent)
        except Exception as error:
            _log.warning("The work could not be saved", exc_info=True)
            problems[f"The work could not be saved: {error}."] = None
    return None, " ".join(problems)


def _look(chosen: str, name: str, path: Path | None, pixels: Any, frames: int) -> Answer:
    """Find out which image it is, and what is saved of it; to be called in a thread."""
    try:
        checksum = _checksum(pixels, frames)
        home, folders = _places(name, path, checksum, chosen)
        inside = [inner for outer in folders for inner in sorted(outer.iterdir())]
    except Exception as error:
        return None, f"{name} could not be read, and work on it is not saved: {error}."
    source, shape = str(path) if path else None, [int(n) for n in pixels.shape]
    about = {"name": name, "path": source, "shape": shape, "sha256": checksum}
    seen = Seen(about, home, {})
    for folder in inside:
        try:
            wanted = folder.is_dir() and folder.suffix != sessions.OLD
            held = sessions.summary(folder) if wanted else None
        except (OSError, LabelsError) as error:
            seen.problem = f"Saved work could not be read, and stays where it is: {error}."
            continue
        if held and held.sha256 == checksum:
            seen.found[folder] = held
    return seen, ""


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


def _places(name: str, path: Path | None, checksum: str, chosen: str) -> tuple[Path, list[Path]]:
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

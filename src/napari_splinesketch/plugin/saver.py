"""Writes work down while it is done, and finds what was written before."""

import hashlib
import logging
import os
import re
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
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
from qtpy.QtCore import QObject, QTimer

from napari_splinesketch.labels import LabelsError
from napari_splinesketch.plugin import sessions
from napari_splinesketch.plugin.choices import listen
from napari_splinesketch.plugin.engine import Job
from napari_splinesketch.plugin.keeper import NOTHING, Keeper
from napari_splinesketch.plugin.layers.drawn import shapes_in
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
_left: WeakKeyDictionary[Shapes, tuple[Path, int]] = WeakKeyDictionary()
"""Where layers were written that a closed dock has left in the window, and when."""
Pair = tuple[Image, Shapes]


@dataclass(frozen=True, eq=False)
class Offer:
    """Work that was found, and where."""

    folder: Path
    summary: Head


@dataclass(eq=False)
class Seen:
    """What is written down of an image, and the folder with one more for each layer of sketches.

    There is none while a job still looks, and none of either if the image could not be read.
    """

    job: Job | None = None
    about: dict[str, object] = field(default_factory=dict)
    folder: Path | None = None
    offers: list[Offer] = field(default_factory=list)


@dataclass(eq=False)
class Kept:
    """One layer of sketches on one image, and the folder that it is written to.

    `known` is written, or on its way. What is `resuming` is being brought back: nothing is written
    before all of it is there.
    """

    folder: Folder | None = None
    known: object = None
    resuming: bool = False


Order = tuple[Kept, Session, Path]
"""What is to be written, and where a folder is made if there is none yet."""


class Saver(QObject):
    """Saves sketches and curves of all images in the window on every change, in a thread.

    It ends with its parent.
    """

    found = Signal()
    """There is work to go on with, or none any more; or it is saved elsewhere."""

    def __init__(self, keeper: Keeper, parent: QObject | None = None):
        super().__init__(parent)
        self._keeper = keeper
        self._seen: dict[Image, Seen] = {}
        self._kept: dict[Pair, Kept] = {}
        self._writing: Job | None = None
        self._problems = {"look": "", "write": ""}
        self._choice = keeper.settings.saving
        self._timer = QTimer(self)
        self._timer.setSingleShot(True)
        self._timer.timeout.connect(self._save)
        changes, layers = keeper.changes, keeper.viewer.layers.events
        self._end: Callable[[], None] | None = listen(
            (changes.layers, self._on_choice),
            (changes.edited, self._follow),
            (changes.curves, self._wait),
            (changes.settings, self._on_settings),
            (layers.removing, self._on_removing),
            (layers.removed, self._on_removed),
        )
        self._on_choice()

    @property
    def place(self) -> Path | None:
        """Where work on the chosen layers is saved; None while that is not known, or not wanted."""
        image, sketches = self._keeper.choices.image, self._keeper.choices.sketches
        if image is None or image not in self._seen:
            return None
        kept = self._kept.get((image, sketches)) if sketches else None
        return kept.folder.path.parent if kept and kept.folder else self._seen[image].folder

    @property
    def problem(self) -> str:
        """Why something is not saved, or could not be found, or nothing."""
        return " ".join(filter(None, self._problems.values()))

    def offers(self) -> list[Offer]:
        """Give the work that was found for the chosen image, the latest first."""
        image = self._keeper.choices.image
        found = self._seen[image].offers if image in self._seen else []
        mine = {kept.folder.path for kept in self._kept.values() if kept.folder}
        others = [offer for offer in found if offer.folder not in mine]
        return sorted(others, key=lambda offer: offer.summary.saved, reverse=True)

    def take(self, offer: Offer, pair: Pair, folder: Folder | None) -> Kept:
        """Go on with what was found, in these layers, there or in a folder of its own.

        Nothing is written until it is `resuming` no more.
        """
        kept = self._keep(pair)
        kept.folder, kept.resuming = folder, True
        self._forget(offer)
        return kept

    def decline(self) -> None:
        """Do not offer again what was found; the files stay, under another name."""
        for offer in self.offers():
            try:
                _put_aside(offer.folder)
            except OSError as error:
                self._problems["look"] = f"Saved work could not be put aside: {error}."
            self._forget(offer)

    def flush(self) -> None:
        """Write now what is still to be written, and wait until it is."""
        self._timer.stop()
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
            self._timer.stop()
            self._end()
            self._end = None
            self._let_go()

    def _let_go(self) -> None:
        for pair in tuple(self._kept):
            self._drop(pair)
        self._seen.clear()

    def _forget(self, offer: Offer) -> None:
        for seen in self._seen.values():
            if offer in seen.offers:
                seen.offers.remove(offer)
        self.found.emit()

    def _keep(self, pair: Pair) -> Kept:
        """Give what is written of a pair, from now on at the latest."""
        if pair in self._kept:
            return self._kept[pair]
        kept = self._kept[pair] = Kept()
        path, when = _left.pop(pair[1], (None, 0))
        if path and sessions.stamp(path) == when:
            try:
                kept.folder = Folder(path)
            except OSError:
                _log.info("Another window has taken over %s", path)
        pair[1].events.data.connect(self._follow)
        return kept

    def _drop(self, pair: Pair) -> None:
        """Let go of a pair, and of its folder."""
        folder = self._kept.pop(pair).folder
        if not any(layer is pair[1] for _, layer in self._kept):
            pair[1].events.data.disconnect(self._follow)
        if folder:
            when = sessions.stamp(folder.path)
            if when and pair[1] in self._keeper.viewer.layers:
                _left[pair[1]] = folder.path, when
            folder.release()

    def _pairs(self) -> set[Pair]:
        """Give all that there is to save."""
        choices = self._keeper.choices
        pairs = {(work.image, work.sketches) for work in self._keeper.works} | {*self._kept}
        image, sketches = choices.image, choices.sketches
        if image is not None and sketches is not None and sketches.nshapes:
            pairs.add((image, sketches))
        return {pair for pair in pairs if set(pair) <= set(self._keeper.viewer.layers)}

    def _on_choice(self) -> None:
        self._follow()
        self.found.emit()

    def _follow(self, event: object = None) -> None:
        """Look at the chosen image, unless that was done, and write what has changed, soon."""
        for pair in self._pairs():  # another one may be chosen before it is written
            self._keep(pair)
        image, (wanted, folder) = self._keeper.choices.image, self._choice
        if wanted and image is not None and image not in self._seen:
            source, data = image.source.path, image.data
            pixels = data[-1] if image.multiscale else data  # pyright: ignore
            about = image.name, Path(source) if source else None, pixels, image.ndim - 2
            job = Job(lambda _: _look(folder, *about))
            self._seen[image] = Seen(job)
            job.done.connect(partial(self._on_looked, image))
            job.failed.connect(partial(self._on_not_looked, image))
            job.start()
        self._wait()

    def _tell(self, about: str, problem: str) -> None:
        self._problems[about] = problem
        # An answer may come after Qt has deleted the window and all that is in it.
        if isalive(self):
            self.found.emit()

    def _on_looked(self, image: Image, answer: tuple[Seen, str]) -> None:
        if image in self._seen and image in self._keeper.viewer.layers:
            self._seen[image], problem = answer
            self._tell("look", problem)
            self._wait()

    def _on_not_looked(self, image: Image, problem: str) -> None:
        """The image could not be read: it is tried again with the next edit."""
        self._seen.pop(image, None)
        said = f"{image.name} could not be read, and work on it is not saved: {problem}."
        self._tell("look", said)

    def _on_settings(self) -> None:
        if self._choice != self._keeper.settings.saving:
            # Elsewhere from now on, or no more: what is saved stays where it is.
            self.flush()
            self._choice = self._keeper.settings.saving
            layers = {layer for _, layer in self._kept}
            self._let_go()
            for layer in layers:
                _left.pop(layer, None)
            self._on_choice()

    def _on_removing(self, event: Any) -> None:
        if any(self._keeper.viewer.layers[event.index] in pair for pair in self._pairs()):
            self.flush()

    def _on_removed(self, event: Any) -> None:
        for pair in tuple(self._kept):
            if event.value in pair:
                self._drop(pair)
        self._seen.pop(event.value, None)

    def _wait(self, milliseconds: int | None = None) -> None:
        if isalive(self._timer) and not self._timer.isActive():
            self._timer.start(DELAY_MS if milliseconds is None else milliseconds)

    def _save(self) -> None:
        """Take what has changed, and write it in a thread."""
        if self._writing:
            self._wait()
        elif orders := self._orders():
            self._writing = Job(lambda _: _write(orders))
            self._writing.done.connect(self._on_written)
            self._writing.failed.connect(self._on_written)
            self._writing.start()

    def _orders(self) -> list[Order]:
        """Take a snapshot of what has changed; give what writes it."""
        orders = []
        for image, layer in self._pairs():
            kept, seen = self._keep((image, layer)), self._seen.get(image)
            if seen is None or seen.folder is None or kept.resuming:
                continue
            work = self._keeper.work_on(image, layer)
            state = work.state if work else NOTHING
            drawn: dict[int, list[Shape]] = defaultdict(list)
            read = shapes_in(self._keeper.viewer, layer, image)
            for kind, (frame, line) in zip(layer.shape_type, read, strict=True):
                drawn[sessions.EVERY if layer.ndim < image.ndim else frame].append(
                    Shape(kind, line)
                )
            prints = [(f, s.kind, s.points.tobytes()) for f in drawn for s in drawn[f]]
            known = layer.name, state, prints
            if kept.known != known and (kept.folder or drawn or state.records):
                kept.known = known
                session = Session(layer.name, seen.about, dict(drawn), state)
                orders.append((kept, session, seen.folder))
        return orders

    def _on_written(self, problem: str) -> None:
        self._writing = None
        if problem:  # all of it is written again
            for kept in self._kept.values():
                kept.known = None
            self._wait(AGAIN_MS)
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
            seen.offers.append(Offer(folder, held))
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


def _put_aside(path: Path) -> None:
    """Rename a folder, so that it is not offered again."""
    folder = Folder(path)
    names = (path.with_name(f"{path.name}{-n or ''}{sessions.OLD}") for n in count())
    path.rename(next(name for name in names if not name.exists()))
    folder.release()


def _write(orders: Sequence[Order]) -> str:
    """Write what was ordered, in a thread; says what went wrong."""
    problems = []
    for kept, session, parent in orders:
        try:
            kept.folder = kept.folder or Folder.fresh(parent)
            kept.folder.write(session)
        except OSError as error:
            _log.warning("The work could not be saved", exc_info=True)
            problems.append(f"The work could not be saved: {error}.")
    return " ".join(dict.fromkeys(problems))

"""Writes work down while it is done, and finds what was written before."""

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from napari.layers import Image, Shapes
from psygnal import Signal
from qtpy.QtCore import QObject, QTimer

from napari_splinesketch.engine.types import OnProgress
from napari_splinesketch.labels import LabelsError
from napari_splinesketch.plugin.autosave.folder import Folder, Page, Session, Summary, summary
from napari_splinesketch.plugin.autosave.pages import Drawn, pages_of, shapes_in
from napari_splinesketch.plugin.autosave.place import Picture
from napari_splinesketch.plugin.jobs import Job
from napari_splinesketch.plugin.keeper import Keeper
from napari_splinesketch.plugin.state import State

DELAY_MS = 700
"""From a change to its being written, at least; more changes meanwhile go together."""
OLD = ".old"
"""Added to the name of a folder that is not offered again."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Known:
    """An image whose checksum is known.

    Attributes
    ----------
    picture
        The image.
    checksum
        Of its pixels.
    folder
        Where work on it is kept, one folder for each layer of sketches.
    """

    picture: Picture
    checksum: str
    folder: Path


@dataclass(frozen=True, eq=False)
class Offer:
    """Work that was found.

    Attributes
    ----------
    folder
        Where it is.
    summary
        What it is.
    """

    folder: Path
    summary: Summary


Pair = tuple[Image, Shapes]


class Saver(QObject):
    """Saves the chosen image's sketches and curves on every change, in a thread.

    Parameters
    ----------
    keeper
        Whose work is saved.
    parent
        The Qt object that it ends with.
    """

    found = Signal()
    """There is work to go on with, or none any more."""

    def __init__(self, keeper: Keeper, parent: QObject | None = None):
        super().__init__(parent)
        self.problem = ""
        self._keeper = keeper
        self._known: dict[Image, Known | None] = {}
        self._offers: dict[Image, list[Offer]] = {}
        self._folders: dict[Pair, Folder] = {}
        self._saved: dict[Pair, State] = {}
        self._drawn: dict[Pair, Drawn] = {}
        self._edited: set[Pair] = set()
        self._busy = False
        self._timer = QTimer(self)
        self._timer.setSingleShot(True)
        self._timer.setInterval(DELAY_MS)
        self._timer.timeout.connect(self._save)
        keeper.choices.changed.connect(self._on_choice)
        keeper.choices.edited.connect(self._on_edit)
        keeper.changed.connect(self._on_change)
        self._on_choice()

    def offers(self) -> list[Offer]:
        """Give the work that was found for the chosen image, the latest first."""
        image = self._keeper.choices.image
        found = self._offers.get(image, []) if image else []
        return sorted(found, key=lambda offer: offer.summary.saved, reverse=True)

    def take(self, offer: Offer, pair: Pair, pages: Mapping[int, Page], *, whole: bool) -> None:
        """Go on with what was found: where it was, unless part of it could not be read."""
        if whole:
            pictures = {frame: page.patch for frame, page in pages.items() if page.patch}
            self._folders[pair] = Folder(offer.folder, pictures)
        self._forget(offer)

    def decline(self) -> None:
        """Do not offer again what was found; the files stay, under another name."""
        for offer in self.offers():
            try:
                _put_aside(offer.folder)
            except OSError as error:
                self.problem = f"Saved work could not be put aside: {error}"
            self._forget(offer)

    def flush(self) -> None:
        """Write now what is still to be written."""
        if self._timer.isActive():
            self._timer.stop()
            self._save()

    def close(self) -> None:
        """Write what is still to be written, and listen no more."""
        self.flush()
        self._timer.stop()
        for signal, slot in (
            (self._keeper.choices.changed, self._on_choice),
            (self._keeper.choices.edited, self._on_edit),
            (self._keeper.changed, self._on_change),
        ):
            signal.disconnect(slot, missing_ok=True)

    def _forget(self, offer: Offer) -> None:
        for offers in self._offers.values():
            if offer in offers:
                offers.remove(offer)
        self.found.emit()

    def _pair(self) -> Pair | None:
        choices = self._keeper.choices
        image, sketches = choices.image, choices.sketches
        return (image, sketches) if image is not None and sketches is not None else None

    def _on_choice(self) -> None:
        image = self._keeper.choices.image
        if image is not None and image not in self._known:
            self._known[image] = None
            self._start(partial(_look, Picture.of(image)), partial(self._on_looked, image))
        self.found.emit()

    def _on_looked(self, image: Image, answer: tuple[Known, list[Offer], str]) -> None:
        self._known[image], self._offers[image], problem = answer
        self.problem = problem or self.problem
        self.found.emit()
        if self._edited:
            self._timer.start()

    def _on_edit(self) -> None:
        pair = self._pair()
        if pair is not None and (pair in self._folders or pair[1].nshapes):
            self._edited.add(pair)
            self._wait()

    def _on_change(self) -> None:
        pair, work = self._pair(), self._keeper.work
        if pair is not None and work is not None and self._saved.get(pair) is not work.state:
            self._wait()

    def _wait(self) -> None:
        if not self._timer.isActive():
            self._timer.start()

    def _save(self) -> None:
        """Take what has changed, and write it in a thread."""
        pair, work = self._pair(), self._keeper.work
        changed = set(self._edited)
        if pair is not None and work is not None and self._saved.get(pair) is not work.state:
            changed.add(pair)
        changed = {one for one in changed if self._known.get(one[0])}
        if self._busy:
            self._timer.start()
        elif changed:
            self._busy = True
            orders = [order for one in changed if (order := self._order(one)) is not None]
            self._start(partial(_write, orders), self._on_written)

    def _order(self, pair: Pair) -> Callable[[], None] | None:
        """Take a snapshot of an image's work; gives what writes it, unless it is as it was."""
        image, layer = pair
        known = self._known[image]
        assert known is not None
        drawn = self._drawn.get(pair)
        if drawn is None or pair in self._edited:
            drawn = shapes_in(self._keeper.viewer, layer, image)
        work = self._keeper.work if pair == self._pair() else None
        state = work.state if work else self._saved.get(pair, State())
        before = self._drawn.get(pair), self._saved.get(pair)
        self._edited.discard(pair)
        self._drawn[pair], self._saved[pair] = drawn, state
        if before[1] is state and _same(before[0], drawn):
            return None
        if pair not in self._folders:
            taken = {folder.path for folder in self._folders.values()}
            self._folders[pair] = Folder(_free(known.folder, taken))
        about = known.picture.describe(known.checksum)
        return partial(_write_one, self._folders[pair], layer.name, about, drawn, state)

    def _on_written(self, problem: str) -> None:
        self._busy = False
        if problem:  # all is written again with the next change
            self._saved.clear()
            self._drawn.clear()
        if problem != self.problem:
            self.problem = problem
            self.found.emit()
        if self._edited:
            self._wait()

    def _on_failed(self, problem: str) -> None:
        self._on_written(f"The work could not be saved: {problem}")

    def _start(self, work: Callable[[OnProgress], Any], done: Callable[[Any], None]) -> None:
        job = Job(work, parent=self)
        job.done.connect(done)
        job.failed.connect(self._on_failed)
        job.start()


def _look(picture: Picture, _: OnProgress) -> tuple[Known, list[Offer], str]:
    """Find out which image it is, and what is written of it."""
    checksum = picture.checksum()
    folder = picture.folder(checksum)
    offers, problem = [], ""
    for path in sorted(folder.iterdir()) if folder.is_dir() else ():
        try:
            held = summary(path) if path.is_dir() and path.suffix != OLD else None
        except (OSError, LabelsError) as error:
            problem = f"Saved work could not be read, and stays where it is: {error}"
            continue
        if held and held.sha256 == checksum:
            offers.append(Offer(path, held))
    return Known(picture, checksum, folder), offers, problem


def _write(orders: list[Callable[[], None]], _: OnProgress) -> str:
    """Carry out orders; says what went wrong."""
    for order in orders:
        try:
            order()
        except OSError as error:
            _log.warning("The work could not be saved", exc_info=True)
            return f"The work could not be saved: {error}"
    return ""


def _write_one(
    folder: Folder, layer: str, image: Mapping[str, object], drawn: Drawn, state: State
) -> None:
    folder.write(Session(layer, image, pages_of(drawn, state)))


def _free(folder: Path, taken: set[Path]) -> Path:
    """Give a folder that nobody uses."""
    number = 1
    while (path := folder / str(number)) in taken or path.exists():
        number += 1
    return path


def _put_aside(folder: Path) -> None:
    number, name = 1, folder.with_name(f"{folder.name}{OLD}")
    while name.exists():
        number += 1
        name = folder.with_name(f"{folder.name}-{number}{OLD}")
    folder.rename(name)


def _same(a: Drawn | None, b: Drawn) -> bool:
    if a is None or a.keys() != b.keys():
        return False
    pairs = ((one, other) for frame in b for one, other in zip(a[frame], b[frame], strict=False))
    return all(len(a[f]) == len(b[f]) for f in b) and all(
        one.kind == other.kind
        and one.points.shape == other.points.shape
        and (one.points == other.points).all()
        for one, other in pairs
    )

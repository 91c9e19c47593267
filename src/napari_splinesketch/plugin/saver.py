"""Saves work while it is done, finds what was saved before, and brings it back."""

import hashlib
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from glob import escape
from itertools import chain, count
from pathlib import Path
from typing import Any, Self
from weakref import WeakKeyDictionary

import numpy as np
from napari.layers import Image
from platformdirs import user_data_path
from superqt.utils import qthrottled

from napari_splinesketch.engine.types import InputError
from napari_splinesketch.files import LONGEST_NAME, logged, owned, reason_of
from napari_splinesketch.labels import LabelsError
from napari_splinesketch.plugin import engine, sessions, words
from napari_splinesketch.plugin.choices import PLACED, listen
from napari_splinesketch.plugin.controller import Controller
from napari_splinesketch.plugin.files import beside, lay, read_with, records_of
from napari_splinesketch.plugin.layers import pictures, results
from napari_splinesketch.plugin.layers.drawn import add_shapes, empty_layer, line_style, shapes_in
from napari_splinesketch.plugin.layers.space import frame_count, in_stack, size_of
from napari_splinesketch.plugin.model import Record, State
from napari_splinesketch.plugin.sessions import EVERY, Folder, Head, Session, Shape

DELAY_MS = 700  # from a change to its being written, at least; more changes meanwhile go together
AGAIN_MS = 5000  # after something that failed, until it is tried again
LOOKED_AT = 2**20  # most pixels of a frame that tell one image from another: few may be alike
OLD = ".old"  # added to the name of a folder that is not offered again
LETTERS, DIGITS = 50, 12  # of a layer's name and of the checksum, in a folder's name


@dataclass(eq=False)
class Home:
    """Where work on an image is saved, and what was found there and elsewhere."""

    about: Mapping[str, object] = field(default_factory=dict)  # what sessions say of the image
    found: dict[Path, Head] = field(default_factory=dict)  # what was saved of it
    unread: str = ""  # why something that was saved could not be read
    place: Path | None = None  # of new sessions, once the image was looked at
    pixels: Any = None  # those that were looked at: with others, it is another image
    unsaved: str = ""  # why not all is written
    job: engine.Job | None = None  # who looks or writes now, in a thread

    def _look(self, name: str, path: Path | None, levels: Any, frames: int, chosen: str) -> None:
        """Find out which image it is, where its work goes, and what is saved of it."""
        (checksum, first), self.unread = _checksums(levels[-1], frames), ""
        fine = next((x for x in levels if np.prod(x.shape[frames : frames + 2]) <= LOOKED_AT), None)
        finer = first if fine is None or fine is levels[-1] else _checksums(fine, frames)[1]
        ending = f"{checksum[:DIGITS]}.splinesketch"
        # Of a layer's name, what any disk takes.
        plain = re.sub(r"[^\w-]+", " ", name)[:LETTERS].strip() or "image"
        called = f"{path.name if path else plain}.{ending}"
        called = called if len(os.fsencode(called)) <= LONGEST_NAME else ending
        parents = [user_data_path("napari-splinesketch") / "sessions"]
        if path is not None:
            folder = beside(path)
            there = folder / called
            writable = os.access(there if there.exists() else folder, os.W_OK)
            parents.insert(0 if writable else 1, folder)
        if chosen:
            parents.insert(0, Path(chosen).expanduser())
        # A film of pictures may have been opened as their folder, or by its first picture, and any
        # image by a link; work on a part of a Zarr used to be saved in it.
        where = [path, *path.parents[:2], Path(os.path.realpath(path)).parent] if path else []
        places = {*parents, *where}
        # A film that was still being written then has other pixels now, but the same first frame.
        own = [f"{escape(path.name)}.*.splinesketch/*"] if path and frames else []
        globs = (each.glob(name) for each in places for name in (f"*{ending}/*", *own))
        found = dict[Path, Head]()
        for folder in sorted({*chain.from_iterable(globs)}):
            try:
                head = None if folder.suffix == OLD else sessions.summary(folder)
            except (OSError, LabelsError) as error:
                self.unread = f"Saved work could not be read, and stays where it is: {error}."
            else:
                known = head.image if head else {}
                named = checksum if folder.parent.name.endswith(ending) else ""
                same = known.get("sha256", named) == checksum or known.get("first") == first
                if head and same and known.get("finer", finer) == finer:
                    found[folder] = head
        source, shape = str(path) if path else None, [int(n) for n in levels[-1].shape]
        prints = {"sha256": checksum, "first": first, "finer": finer}
        self.about = {"name": name, "path": source, "shape": shape, **prints}
        self.found, self.place, self.pixels = found, parents[0] / called, levels[-1]

    def save(self, image: Sequence[Any], orders: Sequence[tuple[Folder, Session]]) -> Self:
        """Look at the image, if its pixels are new, and write what was ordered; in a thread."""
        try:
            if self.pixels is not image[2][-1]:
                self._look(*image)
        except Exception as error:
            why = reason_of(error)
            self.unsaved = f"{image[0]} could not be read, and work on it is not saved: {why}."
            return self
        problems: dict[str, None] = {}
        for folder, session in orders:
            try:
                folder.write(replace(session, image=self.about), self.place)
            except Exception as error:
                logged("The work could not be saved", error)
                problems[f"The work could not be saved: {reason_of(error)}."] = None
        self.unsaved = " ".join(problems)
        return self


class Saver:
    """Saves sketches and curves on every change, those of each image in a thread of its own."""

    def __init__(self, controller: Controller):
        self._controller = controller
        self._homes: WeakKeyDictionary[Image, Home] = WeakKeyDictionary()
        self._settings = controller.settings
        for work in controller.works:  # of a dock that was closed
            work.folder = work.folder.again()
        self._soon = qthrottled(self._save, DELAY_MS, leading=False)
        changes, layers = controller.changes, controller.viewer.layers.events
        self._end: Callable[[], None] | None = listen(
            (changes.layers, self._soon),
            (changes.curves, self._soon),
            (changes.settings, self._on_settings),
            (layers, self._on_event),
            (layers.removing, self._on_removing),
        )
        self._soon()

    @property
    def _home(self) -> Home:
        image = self._controller.image
        return self._homes.setdefault(image, Home()) if image else Home()

    @property
    def place(self) -> Path | None:
        """Where work on the chosen layers is saved; None where it is not, or not known by now."""
        home, work = self._home, self._controller.work
        if not (self._settings.save_work and home.place) or home.unsaved:
            return None
        return work.folder.path.parent if work and work.folder.path else home.place

    @property
    def problem(self) -> str:
        """Why something is not saved, or could not be found, or nothing."""
        layers = self._controller.viewer.layers
        homes = [home for image, home in self._homes.items() if image in layers]
        return " ".join(filter(None, chain.from_iterable((h.unsaved, h.unread) for h in homes)))

    @property
    def _others(self) -> dict[Path, Head]:
        mine = {work.folder.path for work in self._controller.works}
        return {path: head for path, head in self._home.found.items() if path not in mine}

    def offers(self) -> Mapping[Path, Head]:
        """Give the work that was found for the chosen image, the latest first.

        Of work that went on in another folder, only what it has become is offered.
        """
        known = [work.folder for work in self._controller.works], self._home.found.values()
        gone_on = {version for each in chain(*known) for version in each.after}
        others = [pair for pair in self._others.items() if pair[1].saved not in gone_on]
        return dict(sorted(others, key=lambda pair: pair[1].saved, reverse=True))

    def resume(self) -> None:
        """Bring back all that is offered for the chosen image: one layer of sketches for each."""
        controller, image, offers = self._controller, self._controller.image, self.offers()
        if image is None or not offers or controller.progress:
            return
        frames, size, problems = frame_count(image), size_of(image), list[str]()

        def read(_: object) -> list[tuple[Folder, Session] | None]:
            return [sessions.reopen(path, frames, size, problems) for path in offers]

        def show(found: list[tuple[Folder, Session] | None]) -> None:
            there = filter(None, reversed(found))
            every = chain.from_iterable(self._restore(image, *one, problems) for one in there)
            controller.drawing.start(image, every, over)

        def over() -> None:
            said = f"Some of it was not resumed (kept on disk): {' '.join(problems)}"
            controller.finish(said if problems else "", "failed")
            controller.changes.saved.emit()

        controller.start(read, show, "Reading the saved work")

    def _restore(
        self, image: Image, folder: Folder, session: Session, problems: list[str]
    ) -> Iterator[object]:
        """Bring one session back, once all of it is there; otherwise its files stay as they are."""
        controller, drawn = self._controller, session.drawn
        flat = {shape.frame for shape in drawn} == {EVERY}
        layer = empty_layer(image, session.layer, flat=flat)
        data = [s.points if s.frame == EVERY else in_stack(image, s.frame, s.points) for s in drawn]
        try:
            style = line_style(size_of(image))
            yield from add_shapes(layer, data, [s.kind for s in drawn], **style)
            if image not in controller.viewer.layers:
                raise InputError("the image was removed")
            left = [w for w in pictures.OWNERS.values() if w.image is image]
            for work in [w for w in left if folder.path and w.folder.path == folder.path]:
                work.begin(layer)  # of lines that were removed: its results are there
                controller.works.append(work)
                controller.attend(work)
            controller.viewer.layers.append(layer)
            controller.image, controller.sketches = image, layer
            if session.state.records or session.state.deleted:
                controller.apply("", session.state)
        except Exception as error:
            logged("Saved work could not be brought back", error)
            problems.append(f"{session.layer}: {reason_of(error)}.")
            folder.release()
        else:
            controller.work_on(image, layer).folder = folder

    def decline(self) -> None:
        """Do not offer again what was found; the files stay, under another name."""
        for path in self._others:
            names = (path.with_name(f"{path.name}{-n or ''}{OLD}") for n in count())
            try:
                with owned(path):
                    path.rename(next(name for name in names if not name.exists()))
            except OSError as error:
                self._controller.say(f"Saved work could not be put aside: {error}.")
            del self._home.found[path]
        self._controller.changes.saved.emit()

    @property
    def brought(self) -> int:
        """How many curves the chosen layer brought from a file of labels, and nobody took up."""
        work = self._controller.work
        if work is None or work.records:
            return 0
        return sum(label.status != "sketch" for label in read_with(work.sketches).labels)

    def take_up(self) -> None:
        """Go on with the curves that the chosen layer brought; its lines are their sketches."""
        controller, work = self._controller, self._controller.work
        if not (work and self.brought and not controller.progress):
            return
        lay(work.sketches, work.image)
        labels, frames = read_with(work.sketches), frame_count(work.image)

        def show(found: tuple[tuple[Record, ...], list[str]]) -> None:
            records, notes = found
            over = partial(controller.finish, words.together(notes))
            state = State(records, work.state.suggestions)
            controller.apply("Continue with labels", state, over, work)

        controller.start(lambda _: records_of(labels, frames), show, "Reading the labels", on=work)

    def flush(self) -> None:
        """Write now what is still to be written, and wait until it is."""
        self._soon.cancel()
        for image in {work.image: None for work in self._controller.works if work.begun}:
            home = self._homes.setdefault(image, Home())
            if home.job:
                home.job.wait()
            if task := self._task(image, home):
                self._on_done(home, task())

    def close(self) -> None:
        """Write what is still to be written, listen no more, and leave the folders to others."""
        if self._end:
            self._leave(self._controller.works)
            self._soon.cancel()
            self._end()
            self._end = None

    def _leave(self, works: Sequence[results.Work]) -> None:
        self.flush()
        for work in works:
            work.folder.release()

    def _on_event(self, event: Any) -> None:
        """Hear of any layer of the user's, chosen or not; what is pasted comes with features."""
        if event.type in (*PLACED, "features") and not pictures.is_result(event.sources[0]):
            self._soon()

    def _on_settings(self) -> None:
        before, now = self._settings, self._controller.settings
        if (before.save_work, before.work_folder) != (now.save_work, now.work_folder):
            self.flush()
            self._settings = now
            # Other windows may go on where nothing is saved any more.
            change = Folder.again if now.save_work else Folder.release
            if before.work_folder != now.work_folder:
                self._homes.clear()
                change = Folder.moved  # what is saved stays where it is
            for work in self._controller.works:
                work.folder = change(work.folder)
            self._soon()
            self._controller.changes.saved.emit()

    def _on_removing(self, event: Any) -> None:
        layer = self._controller.viewer.layers[event.index]
        if going := [w for w in self._controller.works if layer in (w.image, w.sketches)]:
            self._leave(going)
        for work in going:
            path, head = work.folder.path, work.folder.head
            if path and head and (head.sketches or head.curves):
                self._homes[work.image].found[path] = head

    def _save(self) -> None:
        images = {work.image for work in self._controller.works}
        for image in {self._controller.image, *images} - {None}:
            home = self._homes.setdefault(image, Home())
            if home.job:
                self._soon()
            elif task := self._task(image, home):
                home.job = engine.Job(lambda _, task=task: task())
                home.job.done.connect(partial(self._on_done, home))
                home.job.start()

    def _task(self, image: Image, home: Home) -> Callable[[], Home] | None:
        """Take a snapshot of what is to be found out about an image, and written of it."""
        works = [work for work in self._controller.works if work.image is image and work.begun]
        levels: Any = image.data if image.multiscale else [image.data]
        if not self._settings.save_work or (home.pixels is levels[-1] and not works):
            return None
        path = Path(image.source.path).absolute() if image.source.path else None
        about = image.name, path, levels, image.ndim - 2, self._settings.work_folder
        orders = [(work.folder, _session(work)) for work in works]
        # The thread changes a copy: the window learns all of it when it is done.
        return partial(replace(home).save, about, orders)

    def _on_done(self, home: Home, now: Home) -> None:
        """Tell of what was found, and of what went wrong; try that again later."""
        vars(home).update(vars(now), job=None)
        if self._end is not None:
            self._soon.setTimeout(AGAIN_MS if home.unsaved else DELAY_MS)
            if home.unsaved:
                self._soon()
            self._controller.changes.saved.emit()


def _session(work: results.Work) -> Session:
    image, layer = work.image, work.sketches
    shapes = zip(layer.shape_type, shapes_in(work.viewer, layer, image), strict=True)
    every = layer.ndim < image.ndim
    drawn = [Shape(kind, line, EVERY if every else frame) for kind, (frame, line) in shapes]
    return Session(layer.name, drawn=drawn, state=work.state)


def _checksums(pixels: Any, frames: int) -> tuple[str, str]:
    """Tell an image by shape, type and some pixels of its first, middle and last frame.

    And by those of its first frame alone.
    """
    shape = tuple(map(int, pixels.shape))
    leading, (rows, columns) = shape[:frames], shape[frames : frames + 2]
    every = slice(None, None, max(1, int(np.ceil(np.sqrt(rows * columns / LOOKED_AT)))))
    total = int(np.prod(leading, dtype=int))
    places = (np.unravel_index(frame, leading) for frame in sorted({0, total // 2, total - 1}))
    read = [np.ascontiguousarray(pixels[(*map(int, at), every, every)]) for at in places]

    def checksum(shape: tuple[int, ...], read: Sequence[np.ndarray]) -> str:
        # The type as it is read: arrays of other libraries have types of their own.
        digest = hashlib.sha256(repr((shape, read[0].dtype.str)).encode())
        for frame in read:
            digest.update(frame.tobytes())
        return digest.hexdigest()

    return checksum(shape, read), checksum(shape[frames:], read[:1])

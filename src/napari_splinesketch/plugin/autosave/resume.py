"""Work that was written down, brought back into the window."""

import logging
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from napari.layers import Image

from napari_splinesketch.engine.types import OnProgress
from napari_splinesketch.files import BusyError
from napari_splinesketch.labels import LabelsError
from napari_splinesketch.plugin.autosave.folder import Folder, read
from napari_splinesketch.plugin.autosave.pages import state_of
from napari_splinesketch.plugin.autosave.saver import Offer, Saver
from napari_splinesketch.plugin.autosave.session import EVERY, Session
from napari_splinesketch.plugin.controller import Controller
from napari_splinesketch.plugin.keeper import Notice
from napari_splinesketch.plugin.layers.drawn import add_shapes, empty_layer, line_style
from napari_splinesketch.plugin.layers.labels import read_with, records_of
from napari_splinesketch.plugin.layers.space import frame_count, in_stack, size_of
from napari_splinesketch.plugin.model import State

_log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Found:
    """A session that was read, and the folder that it goes on in; None for a new one."""

    offer: Offer
    session: Session
    folder: Folder | None


def resume(controller: Controller, saver: Saver) -> None:
    """Bring back all that is offered for the chosen image: one layer of sketches for each."""
    image, offers = controller.choices.image, saver.offers()
    if image is not None and offers and not controller.progress:
        done = partial(_restore_all, controller, saver, image)
        work = partial(_read_all, offers, frame_count(image), size_of(image))
        controller.start(work, done, "Reading the saved work")


def _read_all(
    offers: list[Offer], frames: int, size: tuple[int, int], _: OnProgress
) -> tuple[list[Found], list[str]]:
    """Read what nobody else works on, and say what could not be read."""
    all_found, problems = [], []
    for offer in offers:
        folder = None
        try:
            folder = _own(offer.folder)
            session, said = read(offer.folder, frames, size)
        except (OSError, LabelsError) as error:
            problems.append(f"{error}.")
            if folder:
                folder.release()
            continue
        problems += said
        if said and folder:
            # What could not be read is not written over: the rest goes on in a new folder.
            folder.release()
            folder = None
        elif folder:
            folder.holds({f: page.patch for f, page in session.pages.items() if page.patch})
        all_found.append(Found(offer, session, folder))
    return all_found, problems


def _own(path: Path) -> Folder | None:
    """Take a folder over; None where it cannot be written to: the work goes on in a new one."""
    try:
        return Folder(path)
    except BusyError:
        raise
    except OSError:
        return None


def _restore_all(
    controller: Controller, saver: Saver, image: Image, answer: tuple[list[Found], list[str]]
) -> None:
    all_found, problems = answer
    steps = (
        step
        for found in reversed(all_found)
        for step in _restore(controller, saver, image, found, problems)
    )

    def over() -> None:
        text = f"Not all is resumed, and stays where it is: {' '.join(problems)}"
        controller.finish(Notice("failed", text) if problems else Notice())

    controller.drawing.start(image, steps, over)


def _restore(
    controller: Controller, saver: Saver, image: Image, found: Found, problems: list[str]
) -> Iterator[None]:
    """Bring one session back; where that goes wrong its files stay as they are."""
    session, folder = found.session, found.folder
    if image not in controller.viewer.layers:
        if folder:
            folder.release()
        return
    drawn = [(frame, shape) for frame, page in session.pages.items() for shape in page.shapes]
    flat = image.ndim > 2 and bool(drawn) and all(frame == EVERY for frame, _ in drawn)
    layer = empty_layer(image, session.layer, flat=flat)
    kept = saver.take(found.offer, (image, layer), folder)
    try:
        controller.viewer.layers.append(layer)
        yield
        style = line_style(size_of(image))
        points = [s.points if f == EVERY else in_stack(image, f, s.points) for f, s in drawn]
        for _ in add_shapes(layer, points, [shape.kind for _, shape in drawn], **style):
            yield
            if not {image, layer} <= set(controller.viewer.layers):
                return
        state = state_of(session.pages)
        if state.records and {image, layer} <= set(controller.viewer.layers):
            controller.begin(image, layer)
            controller.choices.image, controller.choices.sketches = image, layer
            controller.amend(state)
    except Exception as error:
        _log.exception("Saved work could not be brought back")
        problems.append(f"{found.offer.folder}: {type(error).__name__}: {error}.")
        if kept.folder:
            kept.folder.release()
            kept.folder = None
    kept.resuming = False


def read_curves(controller: Controller) -> int:
    """How many curves the chosen layer brought along from a file of labels, and nobody took up."""
    layer, work = controller.choices.sketches, controller.work
    if controller.choices.image is None or layer is None or (work and work.records):
        return 0
    return sum(label.status != "sketch" for label in read_with(layer).labels)


def take_up(controller: Controller) -> None:
    """Go on with the curves that the chosen layer brought along; its lines are their sketches."""
    image, layer = controller.choices.image, controller.choices.sketches
    if image is None or layer is None or controller.progress or not read_curves(controller):
        return
    records, beyond = records_of(read_with(layer), frame_count(image))
    controller.begin(image, layer)
    controller.apply("Continue with labels", State(records=records))
    if beyond:
        controller.say(f"{beyond} curves are beyond the last frame, and stay in the file.")

"""The question whether to go on with work that was saved, and how it comes back into the window."""

import logging
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from itertools import chain
from pathlib import Path

from napari.layers import Image
from qtpy.QtWidgets import QFrame

from napari_splinesketch.engine.types import OnProgress
from napari_splinesketch.plugin import words
from napari_splinesketch.plugin.controller import Controller
from napari_splinesketch.plugin.files import read_with, records_of
from napari_splinesketch.plugin.keeper import Notice
from napari_splinesketch.plugin.layers.drawn import add_shapes, empty_layer, line_style
from napari_splinesketch.plugin.layers.space import frame_count, in_stack, size_of
from napari_splinesketch.plugin.model import State
from napari_splinesketch.plugin.saver import Saver
from napari_splinesketch.plugin.sessions import EVERY, Folder, Head, Session, reopen
from napari_splinesketch.plugin.widgets import Button, TextLabel, stack

RESUME_TIP = "Bring the saved lines and curves back, in a layer of their own"
IGNORE_TIP = "Do not ask again; the saved work stays on the disk"
LABELS_TIP = "Take these curves up as results, as they were judged"
Found = tuple[Path, Session | None, Folder, tuple[str, ...]]
"""Where a session was read, the folder that it goes on in, and what could not be read."""

_log = logging.getLogger(__name__)


class OfferBox(QFrame):
    """Says what was found, with a button to go on and one to ignore it; hidden otherwise."""

    def __init__(self, controller: Controller, saver: Saver):
        super().__init__()
        self._controller, self._saver = controller, saver
        self.setFrameShape(QFrame.Shape.StyledPanel)
        self.said, self.problem = TextLabel(), TextLabel()
        self.resume = Button("Resume", RESUME_TIP, lambda: resume(controller, saver))
        self.decline = Button("Ignore saved work", IGNORE_TIP, saver.decline)
        self.labels = Button("", LABELS_TIP, lambda: take_up(controller))
        stack(self, self.said, (self.resume, self.decline), self.labels, self.problem, margin=4)
        changes = controller.changes
        for signal in (saver.found, changes.layers, changes.curves, changes.busy):
            signal.connect(self.show_state)
        self.destroyed.connect(lambda: saver.found.disconnect(self.show_state, missing_ok=True))
        self.show_state()

    def show_state(self) -> None:
        """Show what is offered now."""
        offers, curves = self._saver.offers(), read_curves(self._controller)
        for each in (self.resume, self.labels):
            each.setEnabled(self._controller.progress is None)
        for each in (self.resume, self.decline):
            each.setVisible(bool(offers))
        self.said.say(describe(offers))
        self.labels.setText(f"Continue with these {words.count(curves, 'curve')}")
        self.labels.setVisible(bool(curves))
        self.problem.say(words.notice("failed", self._saver.problem))
        self.setVisible(bool(curves or offers or self._saver.problem))


def describe(offers: Mapping[Path, Head]) -> str:
    """Say what was saved, and when the latest of it; rich text."""
    heads = list(offers.values())
    if not heads:
        return ""
    sketches, curves = sum(held.sketches for held in heads), sum(held.curves for held in heads)
    layers = f" in {len(heads)} layers" if len(heads) > 1 else ""
    frames = max(held.frames for held in heads)
    said = f"{words.count(sketches, 'sketch')} and {words.count(curves, 'curve')}"
    where = f" in {frames} frames" if frames > 1 else ""
    return f"<b>Saved work</b>{layers} ({_when(heads[0].saved)}): {said}{where}."


def _when(saved: datetime) -> str:
    minutes = int((datetime.now(UTC) - saved).total_seconds() / 60)
    if 0 <= minutes < 90:
        return "just now" if minutes < 2 else f"{minutes} minutes ago"
    return saved.astimezone().strftime("%d %B %Y, %H:%M")


def resume(controller: Controller, saver: Saver) -> None:
    """Bring back all that is offered for the chosen image: one layer of sketches for each."""
    image, offers = controller.choices.image, tuple(saver.offers())
    if image is None or not offers or controller.progress:
        return
    frames, size = frame_count(image), size_of(image)

    def read(_: OnProgress) -> list[Found]:
        return [(path, *reopen(path, frames, size)) for path in offers]

    def show(found: list[Found]) -> None:
        problems = [problem for *_, said in found for problem in said]
        every = (_restore(controller, saver, image, one, problems) for one in reversed(found))

        def over() -> None:
            text = f"Not all is resumed, and stays where it is: {' '.join(problems)}"
            controller.finish(Notice("failed", text) if problems else Notice())

        controller.drawing.start(image, chain.from_iterable(every), over)

    controller.start(read, show, "Reading the saved work")


def _restore(
    controller: Controller, saver: Saver, image: Image, found: Found, problems: list[str]
) -> Iterator[None]:
    """Bring one session back, once all of it is there; otherwise its files stay as they are."""
    path, session, folder, _ = found
    if session is None:
        return
    drawn = [(frame, shape) for frame, shapes in session.drawn.items() for shape in shapes]
    flat = image.ndim > 2 and bool(drawn) and all(frame == EVERY for frame, _ in drawn)
    points = [s.points if f == EVERY else in_stack(image, f, s.points) for f, s in drawn]
    kinds, there = [s.kind for _, s in drawn], False
    layer = empty_layer(image, session.layer, flat=flat, visible=False)
    try:
        for _ in add_shapes(layer, points, kinds, **line_style(size_of(image))):
            yield
        if image in controller.viewer.layers:
            controller.viewer.layers.append(layer)
            controller.choices.image, controller.choices.sketches = image, layer
            if session.state.records:
                controller.apply("", session.state)
            saver.take(path, controller.work_on(image, layer), folder)
            there = True
    except Exception as error:
        _log.exception("Saved work could not be brought back")
        problems.append(f"{path}: {type(error).__name__}: {error}.")
    if there:
        yield  # to draw it first takes napari as long as to add it
    else:
        folder.release()
    layer.visible = True


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
    controller.apply("Continue with labels", State(records=records))
    if beyond:
        controller.say(f"{beyond} curves are beyond the last frame, and stay in the file.")

"""Work that was written down, brought back into the window."""

from collections.abc import Iterator
from functools import partial

from napari.layers import Image

from napari_splinesketch.engine.types import OnProgress
from napari_splinesketch.plugin.adapter.sketches import line_style
from napari_splinesketch.plugin.autosave.folder import EVERY, Session, read
from napari_splinesketch.plugin.autosave.pages import layer_for, state_of, vertices
from napari_splinesketch.plugin.autosave.saver import Offer, Saver
from napari_splinesketch.plugin.controller import Controller
from napari_splinesketch.plugin.gently import add_shapes, step_through
from napari_splinesketch.plugin.keeper import Notice

Found = list[tuple[Offer, Session, tuple[str, ...]]]


def resume(controller: Controller, saver: Saver) -> None:
    """Bring back all that is offered for the chosen image: one layer of sketches for each."""
    image, offers = controller.choices.image, saver.offers()
    if image is not None and offers and not controller.progress:
        done = partial(_restore_all, controller, saver, image)
        controller.start(partial(_read_all, offers), done, "Reading the saved work")


def _read_all(offers: list[Offer], _: OnProgress) -> Found:
    return [(offer, *read(offer.folder)) for offer in offers]


def _restore_all(controller: Controller, saver: Saver, image: Image, found: Found) -> None:
    problems = [text for _, _, said in found for text in said]
    text = f"Not all could be read, and stays where it is: {' '.join(problems)}" if problems else ""
    steps = (step for one in reversed(found) for step in _restore(controller, saver, image, one))
    step_through(steps, partial(controller.finish, Notice("failed" if text else "none", text)))


def _restore(
    controller: Controller,
    saver: Saver,
    image: Image,
    found: tuple[Offer, Session, tuple[str, ...]],
) -> Iterator[None]:
    offer, session, problems = found
    if image not in controller.viewer.layers:
        return
    drawn = [(frame, shape) for frame, page in session.pages.items() for shape in page.shapes]
    flat = image.ndim > 2 and bool(drawn) and all(frame == EVERY for frame, _ in drawn)
    layer = layer_for(image, session.layer, flat)
    saver.take(offer, (image, layer), session.pages, whole=not problems)
    controller.viewer.layers.append(layer)
    yield
    style = line_style(image.level_shapes[0][image.ndim - 2 : image.ndim])
    points = [shape.points if flat else vertices(image, frame, shape) for frame, shape in drawn]
    for _ in add_shapes(layer, points, [shape.kind for _, shape in drawn], **style):
        yield
    state = state_of(session.pages)
    if state.records and layer in controller.viewer.layers:
        controller.begin(image, layer)
        controller.choices.sketches = layer
        controller.apply("Resume saved work", state)

"""Suggesting sketches of the frame in view, and others as the slider moves."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from napari.layers import Image, Shapes
from qtpy.QtCore import QTimer
from superqt.utils import qdebounced

from napari_splinesketch.plugin import engine, words
from napari_splinesketch.plugin.engine import Job
from napari_splinesketch.plugin.keeper import Notice, Work
from napari_splinesketch.plugin.layers.drawn import (
    BREATH_MS,
    begin_drawing,
    drawn_in,
    new_sketch_layer,
)
from napari_splinesketch.plugin.layers.pixels import block_around
from napari_splinesketch.plugin.layers.space import plane_problem, size_of
from napari_splinesketch.plugin.model import Line, State
from napari_splinesketch.plugin.plan import OPEN

if TYPE_CHECKING:
    from napari_splinesketch.plugin.controller import Controller

SAME = 0.02
"""Lines no further apart are the same, px: layers hold single precision."""
PREVIEW_AFTER_MS = 60
"""Suggestions follow the slider when it has stood still for so long."""
SUGGEST = "Suggest lines"
"""The name of the step."""


class _Suggested(NamedTuple):
    """What chose the last suggestions, and chooses others when the slider moves."""

    work: Work
    frame: int
    choose: engine.Choose


class Suggestions:
    """Lines over bodies that nobody has drawn.

    The `sensitivity` is from 0, only what stands out, to 1, also what is faint or short.
    """

    def __init__(self, controller: Controller):
        self.sensitivity = 0.5
        self._controller = controller
        self._last: _Suggested | None = None
        self._choosing: Job | None = None
        self._soon = qdebounced(self._choose, PREVIEW_AFTER_MS)

    def problem(self) -> str:
        """Why no lines can be suggested, or nothing."""
        image = self._controller.choices.image
        if self._controller.progress:
            return "Something is running"
        return plane_problem(self._controller.viewer, image) if image is not None else OPEN

    def suggest(self) -> None:
        """Suggest lines in the frame in view, in the place of those that were not taken up."""
        controller = self._controller
        image, layer = controller.choices.image, controller.choices.sketches
        if self.problem() or image is None:
            return
        if layer is None:
            # To add a layer and to draw it first takes napari 0.1 s each: the window lives between.
            layer = new_sketch_layer(controller.viewer, image, visible=False)
            QTimer.singleShot(BREATH_MS, partial(begin_drawing, layer))
        work, frame = controller.begin(image, layer), controller.frame
        corners = np.array([[0.0, 0.0], np.subtract(size_of(image), 1)])
        known = self._known(work, layer, image, frame, work.state.suggested(frame, ()))
        block = block_around(image, frame, [corners])
        look = partial(engine.suggest, block, known, self.sensitivity, controller.how(image))
        controller.start(look, partial(self._on_suggested, work, frame), "Suggesting", on=work)

    def change_sensitivity(self, value: float) -> None:
        """Suggest other lines in the place of the last ones, soon."""
        self.sensitivity = value
        if self._last is not None:
            self._soon()

    def _known(
        self, work: Work, layer: Shapes, image: Image, frame: int, cleared: State
    ) -> Sequence[Line]:
        """Lines over the bodies that need no suggestion: drawn by hand, or refined."""
        drawn = drawn_in(self._controller.viewer, layer, image, frame).lines
        gone = [one.line for one in set(work.state.suggestions).difference(cleared.suggestions)]
        groups = {n: np.stack([x for x in gone if len(x) == n]) for n in set(map(len, gone))}

        def suggested(line: Line) -> bool:
            apart = np.abs(groups[len(line)] - line) if len(line) in groups else np.ones((1, 1, 1))
            return bool((apart.max(axis=(1, 2)) < SAME).any())

        mine = [line for line in drawn if not suggested(line)]
        return [*mine, *(r.curve.points for r in work.records if r.frame == frame)]

    def _on_suggested(
        self, work: Work, frame: int, found: tuple[engine.Choose, tuple[Line, ...]]
    ) -> None:
        controller, (choose, lines) = self._controller, found
        if work is not controller.work:
            controller.finish(Notice("cancelled", "Other layers are chosen: nothing was drawn."))
            return
        self._last = _Suggested(work, frame, choose)
        over = partial(controller.finish, Notice("done", words.suggested(len(lines))))
        state = work.state.suggested(frame, lines)
        if state.suggestions != work.state.suggestions:
            controller.apply(SUGGEST, state, over)
        else:
            over()

    def _choose(self) -> None:
        """Choose lines for another sensitivity, from what was found before."""
        last, controller, sensitivity = self._last, self._controller, self.sensitivity
        if last is None or last.work is not controller.work or controller.progress:
            return
        if self._choosing is not None:
            self._soon()
            return
        self._choosing = Job(lambda _: last.choose(sensitivity))
        self._choosing.done.connect(partial(self._on_chosen, last, sensitivity))
        self._choosing.failed.connect(lambda _: setattr(self, "_choosing", None))
        self._choosing.start()

    def _on_chosen(self, last: _Suggested, sensitivity: float, lines: tuple[Line, ...]) -> None:
        self._choosing = None
        controller, work = self._controller, last.work
        if work is not controller.work or controller.progress or last is not self._last:
            return
        if sensitivity != self.sensitivity:
            self._soon()
        state = work.state.suggested(last.frame, lines)
        if work.history.done == SUGGEST:
            controller.amend(state)
        else:
            controller.apply(SUGGEST, state)
        controller.tell(Notice("done", words.suggested(len(lines))))

"""Suggesting sketches, and carrying curves from frame to frame."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Float
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
from napari_splinesketch.plugin.layers.space import frame_count, go_to_frame, plane_problem, size_of
from napari_splinesketch.plugin.model import Line, State
from napari_splinesketch.plugin.plan import OPEN
from napari_splinesketch.plugin.tracks import (
    Progressing,
    bodies_at,
    corrected_at,
    curves_by_frame,
    given_by_frame,
    taken_in,
    usable,
)
from napari_splinesketch.tracking import Body

if TYPE_CHECKING:
    from napari_splinesketch.plugin.controller import Controller

SAME = 0.02
"""Lines no further apart are the same, px: layers hold single precision."""
PREVIEW_AFTER_MS = 60
"""Suggestions follow the slider when it has stood still for so long."""
SUGGEST = "Suggest lines"
"""The name of the step."""
NOT_CORRECTED = "Correct a curve of this frame first: draw a line over it and refine, or edit it"


class Suggested(NamedTuple):
    """What chose the last suggestions, and chooses others when the slider moves."""

    work: Work
    frame: int
    choose: engine.Choose


class Films:
    """What the dock offers beside refining one frame.

    The `sensitivity` of suggestions: 0 gives only what stands out, 1 also what is faint or short.
    """

    def __init__(self, controller: Controller):
        self.sensitivity = 0.5
        self._controller = controller
        self._suggested: Suggested | None = None
        self._choosing: Job | None = None
        self._soon = qdebounced(self._choose, PREVIEW_AFTER_MS)

    def problem(self) -> str:
        """Why no lines can be suggested, or nothing."""
        image = self._controller.choices.image
        if self._controller.progress:
            return "Something is running"
        return plane_problem(self._controller.viewer, image) if image is not None else OPEN

    def tracking_problem(self, way: int) -> str:
        """Why there is nothing to carry on (1) or back (-1), or nothing."""
        image = self._controller.choices.image
        problem = self.problem()
        if problem or image is None:
            return problem
        frame = self._controller.frame
        if not 0 <= frame + way < frame_count(image):
            return "This is the last frame" if way > 0 else "This is the first frame"
        work = self._controller.work
        here = [r for r in work.records if r.frame == frame] if work else []
        if not any(map(usable, here)):
            return "There are no curves in this frame: refine it first"
        return ""

    def suggest(self) -> None:
        """Suggest lines in the frame in view, in the place of those that were not taken up."""
        controller = self._controller
        image = controller.choices.image
        if self.problem() or image is None:
            return
        layer = controller.choices.sketches
        if layer is None:
            # To add a layer and to draw it first takes napari 0.1 s each: the window lives between.
            layer = new_sketch_layer(controller.viewer, image, visible=False)
            QTimer.singleShot(BREATH_MS, partial(begin_drawing, layer))
        work = controller.begin(image, layer)
        frame = controller.frame
        corners = np.array([[0.0, 0.0], np.subtract(size_of(image), 1)])
        known = self._known(work, layer, image, frame, work.state.suggested(frame, ()))
        block = block_around(image, frame, [corners])
        look = partial(engine.suggest, block, known, self.sensitivity, controller.how(image))
        controller.start(look, partial(self._on_suggested, work, frame), "Suggesting", on=work)

    def change_sensitivity(self, value: float) -> None:
        """Suggest other lines in the place of the last ones, soon."""
        self.sensitivity = value
        if self._suggested is not None:
            self._soon()

    def _choose(self) -> None:
        """Choose lines for another sensitivity, from what was found before."""
        last, controller = self._suggested, self._controller
        if last is None or last.work is not controller.work or controller.progress:
            return
        if self._choosing is not None:
            self._soon()
            return
        sensitivity = self.sensitivity
        self._choosing = Job(lambda _: last.choose(sensitivity))
        self._choosing.done.connect(partial(self._on_chosen, last, sensitivity))
        self._choosing.failed.connect(lambda _: setattr(self, "_choosing", None))
        self._choosing.start()

    def _on_chosen(self, last: Suggested, sensitivity: float, lines: tuple[Line, ...]) -> None:
        self._choosing = None
        controller, work = self._controller, last.work
        if work is not controller.work or controller.progress or last is not self._suggested:
            return
        if sensitivity != self.sensitivity:
            self._soon()
        state = work.state.suggested(last.frame, lines)
        if work.history.done == SUGGEST:
            controller.amend(state)
        else:
            controller.apply(SUGGEST, state)
        controller.tell(Notice("done", _suggested(len(lines))))

    def track(self, way: int, most: int | None = None) -> None:
        """Carry the curves on (1) or back (-1), to the end or over some frames."""
        image, work = self._controller.choices.image, self._controller.work
        if image is not None and work is not None and not self.tracking_problem(way):
            here = self._controller.frame
            frames = range(here + way, frame_count(image) if way > 0 else -1, way)[:most]
            self._start(work, bodies_at(work.state, here, way), [frames])

    def around_problem(self) -> str:
        """Why there is nothing to fit again around the frame in view, or nothing."""
        return self.problem() or ("" if self._corrected() else NOT_CORRECTED)

    def around(self) -> None:
        """Carry corrected curves of the frame in view both ways, until nothing changes."""
        image, work = self._controller.choices.image, self._controller.work
        if image is not None and work is not None and not self.around_problem():
            here = self._controller.frame
            ways = range(here + 1, frame_count(image)), range(here - 1, -1, -1)
            self._start(work, self._corrected(), ways, corrected=here)

    def _corrected(self) -> tuple[Body, ...]:
        controller = self._controller
        if controller.work is None:
            return ()
        return corrected_at(controller.work.state, controller.frame, controller.selection)

    def _start(
        self,
        work: Work,
        bodies: tuple[Body, ...],
        ways: Sequence[Sequence[int]],
        corrected: int | None = None,
    ) -> None:
        controller, state = self._controller, work.state
        going = Progressing(ways[0], corrected)
        carry = partial(
            engine.track,
            ways,
            bodies,
            partial(block_around, work.image),
            given_by_frame(state),
            controller.how(work.image),
            None if corrected is None else curves_by_frame(state),
            going.results.append,
        )
        controller.start(
            carry,
            lambda _: self._on_tracked(work, going),
            "Tracking",
            see=lambda progress: self._take(work, going),
            cancelled=going.cancelled,
            on=work,
        )

    def _known(
        self, work: Work, layer: Shapes, image: Image, frame: int, cleared: State
    ) -> Sequence[Line]:
        """Lines over the bodies that need no suggestion: drawn by hand, or refined."""
        drawn = drawn_in(self._controller.viewer, layer, image, frame).lines
        gone = [one.line for one in set(work.state.suggestions).difference(cleared.suggestions)]
        groups = {n: np.stack([x for x in gone if len(x) == n]) for n in set(map(len, gone))}
        mine = [line for line in drawn if not _among(line, groups.get(len(line)))]
        curves = [r.curve.points for r in work.records if r.frame == frame]
        return [*mine, *curves]

    def _on_suggested(
        self, work: Work, frame: int, found: tuple[engine.Choose, tuple[Line, ...]]
    ) -> None:
        controller = self._controller
        if work is not controller.work:
            controller.finish(Notice("cancelled", "Other layers are chosen: nothing was drawn."))
            return
        choose, lines = found
        self._suggested = Suggested(work, frame, choose)
        over = partial(controller.finish, Notice("done", _suggested(len(lines))))
        if lines or work.state.suggested(frame, ()).suggestions != work.state.suggestions:
            controller.apply(SUGGEST, work.state.suggested(frame, lines), over)
        else:
            over()

    def _take(self, work: Work, going: Progressing) -> None:
        """Take over the frames that are done by now."""
        controller = self._controller
        done = going.new()
        if not done or work is not controller.work:
            return
        state = work.state
        for one in done:
            state = taken_in(state, one)
        if going.begun:
            controller.amend(state)
        else:
            going.begun = True
            controller.apply(going.name, state)

    def _on_tracked(self, work: Work, going: Progressing) -> None:
        self._take(work, going)
        controller = self._controller
        notice = Notice("done", going.said())
        if work is not controller.work:
            controller.finish(notice)
            return
        if going.single is not None:
            numbers = {number for _, number in controller.selection}
            go_to_frame(controller.viewer, work.image, going.single)
            there = [key for key in work.state.by_key if key[0] == going.single]
            controller.select(key for key in there if key[1] in numbers)
        controller.show(work, partial(controller.finish, notice))


def _among(line: Line, others: Float[np.ndarray, "L N 2"] | None) -> bool:
    """Whether a line is one of others with as many points, up to the precision of layers."""
    return others is not None and bool((np.abs(others - line).max(axis=(1, 2)) < SAME).any())


def _suggested(number: int) -> str:
    """Say how many lines were suggested."""
    if not number:
        return "No further body stands out. Move the slider to the right to find fainter ones."
    said = words.count(number, "line")
    return f"Suggested {said}. Correct or delete what is wrong, then refine."

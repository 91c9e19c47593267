"""Suggesting sketches, and carrying curves from frame to frame."""

from collections.abc import Sequence
from functools import partial

import numpy as np
from jaxtyping import Float
from napari.layers import Image, Shapes
from qtpy.QtCore import QTimer

from napari_splinesketch.plugin import engine, words
from napari_splinesketch.plugin.actions import Action
from napari_splinesketch.plugin.adapter.pixels import block_around
from napari_splinesketch.plugin.adapter.sketches import (
    begin_drawing,
    drawn_in,
    new_sketch_layer,
)
from napari_splinesketch.plugin.adapter.space import (
    current_frame,
    frame_count,
    go_to_frame,
    plane_problem,
)
from napari_splinesketch.plugin.controller import Controller
from napari_splinesketch.plugin.gently import BREATH_MS
from napari_splinesketch.plugin.keeper import Notice
from napari_splinesketch.plugin.records import Line
from napari_splinesketch.plugin.request import OPEN
from napari_splinesketch.plugin.state import State
from napari_splinesketch.plugin.tracks import Progressing, bodies_at, given_in, taken_in
from napari_splinesketch.plugin.work import Work

SUGGEST_TIP = (
    "Draw a line over each body that stands out in this frame: lines like your own, to be\n"
    "mended, deleted or taken back before you refine"
)


SAME = 0.02
"""Lines no further apart are the same, px: layers hold single precision."""


class Films:
    """What the dock offers beside refining one frame.

    Parameters
    ----------
    controller
        Owns the state.

    Attributes
    ----------
    sensitivity
        Of suggestions: 0 gives only what stands out, 1 also what is faint or short.
    """

    def __init__(self, controller: Controller):
        self.sensitivity = 0.5
        self._controller = controller
        controller.actions.add(
            Action("suggest", "Suggest", "W", self.suggest, "Suggest lines in this frame"),
            Action(
                "next_frame", "Next frame", "Q", self.next_frame, "Carry the curves one frame on"
            ),
            Action("track", "Track to the end", "", self.track, "Carry the curves to the end"),
        )

    def frames(self) -> int:
        """How many frames the chosen image has; 0 without one."""
        image = self._controller.choices.image
        return frame_count(image) if image is not None else 0

    def problem(self) -> str:
        """Why no lines can be suggested, or nothing."""
        controller = self._controller
        image = controller.choices.image
        if controller.progress:
            return "Something is running"
        return plane_problem(controller.viewer, image) if image is not None else OPEN

    def tracking_problem(self) -> str:
        """Why there is nothing to carry over, or nothing."""
        image = self._controller.choices.image
        problem = self.problem()
        if problem or image is None:
            return problem
        frame = current_frame(self._controller.viewer, image)
        if frame + 1 >= frame_count(image):
            return "This is the last frame"
        work = self._controller.work
        if work is None or not bodies_at(work.state, frame):
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
        frame = current_frame(controller.viewer, image)
        height, width = image.level_shapes[0][image.ndim - 2 : image.ndim]
        corners = np.array([[0.0, 0.0], [height - 1, width - 1]])
        cleared = work.state.suggested(frame, ())
        task = engine.SuggestTask(
            block_around(image, frame, [corners]),
            tuple(self._known(work, layer, image, frame, cleared)),
            self.sensitivity,
            controller.settings.polarity,
            controller.half_width_in(image),
        )
        done = partial(self._on_suggested, work, frame)
        controller.start(partial(engine.suggest, task), done, "Suggesting", on=work)

    def next_frame(self) -> None:
        """Carry the curves to the next frame, and show it."""
        self._track(1)

    def track(self) -> None:
        """Carry the curves to the last frame."""
        self._track(self.frames())

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

    def _on_suggested(self, work: Work, frame: int, lines: tuple[Line, ...]) -> None:
        controller = self._controller
        if work is not controller.work:
            controller.finish(Notice("cancelled", "Other layers are chosen: nothing was drawn."))
            return
        said = words.count(len(lines), "line")
        text = f"Suggested {said}. Mend or delete what is wrong, then refine."
        if not lines:
            text = "No further body stands out. More sensitivity may find fainter ones."
        over = partial(controller.finish, Notice("done", text))
        if lines or work.state.suggested(frame, ()).suggestions != work.state.suggestions:
            controller.apply(f"Suggest {said}", work.state.suggested(frame, lines), over)
        else:
            over()

    def _track(self, most: int) -> None:
        controller = self._controller
        image, work = controller.choices.image, controller.work
        if self.tracking_problem() or image is None or work is None:
            return
        first = current_frame(controller.viewer, image) + 1
        frames = range(first, min(first + most, frame_count(image)))
        state = work.state
        task = engine.TrackTask(
            frames,
            bodies_at(state, first - 1),
            partial(block_around, image),
            {frame: given_in(state, frame) for frame in frames},
            controller.preset,
            controller.settings.polarity,
            controller.half_width_in(image),
        )
        going = Progressing(frames, len(task.bodies))
        controller.start(
            partial(engine.track, task),
            partial(self._on_tracked, work, task, going),
            "Tracking",
            see=lambda progress: self._take(work, task, going),
            cancelled=going.cancelled,
            on=work,
        )

    def _take(self, work: Work, task: engine.TrackTask, going: Progressing) -> None:
        """Take over the frames that are done by now."""
        controller = self._controller
        done = going.new(task.results)
        if not done or work is not controller.work:
            return
        state = work.state
        for one in done:
            state = taken_in(state, one)
        if going.begun:
            controller.amend(state)
        else:
            going.begun = True
            controller.apply(f"Track to frame {task.frames[-1]}", state)

    def _on_tracked(
        self, work: Work, task: engine.TrackTask, going: Progressing, error: str
    ) -> None:
        self._take(work, task, going)
        controller = self._controller
        notice = Notice("failed" if error else "done", going.said(error))
        if work is not controller.work:
            controller.finish(notice)
            return
        if len(task.frames) == 1 and not error:
            go_to_frame(controller.viewer, work.image, task.frames[0])
        controller.when_shown(partial(controller.finish, notice))


def _among(line: Line, others: Float[np.ndarray, "L N 2"] | None) -> bool:
    """Whether a line is one of others with as many points, up to the precision of layers."""
    return others is not None and bool((np.abs(others - line).max(axis=(1, 2)) < SAME).any())

"""Carrying curves from frame to frame: what is known of a film, and what tracking makes of it."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from napari_splinesketch.engine.types import Curve
from napari_splinesketch.plugin import engine, words
from napari_splinesketch.plugin.keeper import Notice, Work
from napari_splinesketch.plugin.layers.pixels import block_around
from napari_splinesketch.plugin.layers.space import frame_count, go_to_frame
from napari_splinesketch.plugin.model import Key, Record, State, by_frame, key_of
from napari_splinesketch.tracking import Body, Given, Tracked
from napari_splinesketch.tracking.bodies import MEMORY
from napari_splinesketch.tracking.follow import DIVIDED, LEFT, PATIENCE

if TYPE_CHECKING:
    from napari_splinesketch.plugin.controller import Controller

NOT_CORRECTED = "Correct a curve of this frame first: draw a line over it and refine, or edit it"
NUMBERS = 6
"""Most bodies that are named."""
ENDS = {LEFT: "Left the image", DIVIDED: "Divided"}
"""What is said of bodies that end, by how the reason begins; of others that they are lost."""


class Films:
    """What the dock offers beside refining one frame."""

    def __init__(self, controller: Controller):
        self._controller = controller

    def tracking_problem(self, way: int) -> str:
        """Why there is nothing to carry on (1) or back (-1), or nothing."""
        controller, image = self._controller, self._controller.choices.image
        problem = controller.suggestions.problem()
        if problem or image is None:
            return problem
        if not 0 <= controller.frame + way < frame_count(image):
            return "This is the last frame" if way > 0 else "This is the first frame"
        if not any(map(usable, controller.records(controller.frame))):
            return "There are no curves in this frame: refine it first"
        return ""

    def track(self, way: int, most: int | None = None) -> None:
        """Carry the curves on (1) or back (-1), to the end or over some frames."""
        image, work = self._controller.choices.image, self._controller.work
        if image is not None and work is not None and not self.tracking_problem(way):
            here = self._controller.frame
            frames = range(here + way, frame_count(image) if way > 0 else -1, way)[:most]
            self._start(work, bodies_at(work.state, here, way), [frames])

    def around_problem(self) -> str:
        """Why there is nothing to fit again around the frame in view, or nothing."""
        problem = self._controller.suggestions.problem()
        return problem or ("" if self._corrected() else NOT_CORRECTED)

    def around(self) -> None:
        """Carry corrected curves of the frame in view both ways, until nothing changes."""
        image, work = self._controller.choices.image, self._controller.work
        if image is not None and work is not None and not self.around_problem():
            here = self._controller.frame
            ways = range(here + 1, frame_count(image)), range(here - 1, -1, -1)
            self._start(work, self._corrected(), ways, corrected=here)

    def _corrected(self) -> tuple[Body, ...]:
        c = self._controller
        return corrected_at(c.state, c.frame, c.selection)

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


def bodies_at(state: State, frame: int, way: int = 1) -> tuple[Body, ...]:
    """Give the bodies that are known in a frame or not long before on that way.

    What comes before tells how they move; one that is not in the frame itself is out of sight
    there, unless it was deleted.
    """
    ways: dict[int, list[tuple[int, Curve]]] = {}
    for record in filter(usable, sorted(state.records, key=lambda r: way * r.frame)):
        if 0 <= way * (frame - record.frame) < PATIENCE:
            ways.setdefault(record.id, []).append((record.frame, record.curve))
    ended = {r.id for r in (*state.deleted, *state.records) if r.frame == frame}
    return tuple(
        Body(number, tuple(seen[-MEMORY:]), abs(frame - seen[-1][0]))
        for number, seen in ways.items()
        if seen[-1][0] == frame or number not in ended
    )


def corrected_at(state: State, frame: int, selected: Collection[Key]) -> tuple[Body, ...]:
    """Give the bodies that the user has corrected in a frame and that are in others as well.

    Of the selected curves, if any of them is in the frame.
    """
    beside = {r.id for r in state.records if abs(r.frame - frame) == 1 and not _decided(r)}
    mine = [
        r
        for r in state.records
        if r.frame == frame and (r.drawn or r.edited) and usable(r) and r.id in beside
    ]
    chosen = [r for r in mine if key_of(r) in selected] or mine
    return tuple(Body(r.id, ((frame, r.curve),)) for r in chosen)


def curves_by_frame(state: State) -> dict[int, dict[int, Curve]]:
    """Give all curves that may stay as they are, by frame and number."""
    return {
        frame: {r.id: r.curve for r in here if usable(r)}
        for frame, here in by_frame(state.records).items()
    }


def given_by_frame(state: State) -> dict[int, Given]:
    """Give what stays as it is: what the user has accepted, locked, drawn or changed."""
    return {
        frame: Given(
            {r.id: r.curve for r in here if _decided(r) and usable(r)},
            whole=all(r.review == "accepted" or r.locked for r in here),
        )
        for frame, here in by_frame(state.records).items()
    }


def taken_in(state: State, tracked: Tracked) -> State:
    """Put a tracked frame into what is known; what was decided meanwhile stays."""
    view, refinement = tracked.view, tracked.refinement
    if view is None or refinement is None:
        return state
    frame = tracked.frame
    decided = {r.id for r in state.records if r.frame == frame and _decided(r)}
    deleted = {r.id for r in state.deleted if r.frame == frame}
    fresh = [
        Record(number, frame, sketch, curve, drawn=False)
        for number, sketch, curve in zip(tracked.ids, tracked.sketches, tracked.curves, strict=True)
        if number not in decided | deleted
    ]
    return state.refined(frame, fresh, engine.refined_of(view, refinement, tracked.curves))


def usable(record: Record) -> bool:
    """Whether a curve can be carried on."""
    return record.curve.status != "failed" and record.review != "rejected"


def _decided(record: Record) -> bool:
    """Whether the user has decided on a curve, or made it herself."""
    return record.review == "accepted" or record.locked or record.drawn or record.edited


class Progressing:
    """How far tracking has come over some `frames`, and what became of the bodies.

    Where curves were `corrected` in a frame, those around it are fitted again. It has `begun` once
    any frame has been taken over; `results` are those that are still to be.
    """

    def __init__(self, frames: Sequence[int], corrected: int | None = None):
        self.begun, self.results = False, list[Tracked]()
        self._frames, self._corrected = frames, corrected
        self._taken: list[Tracked] = []

    @property
    def name(self) -> str:
        """Name of the step."""
        if self._corrected is not None:
            return f"Refit around frame {self._corrected}"
        return f"Track to frame {self._frames[-1]}"

    @property
    def single(self) -> int | None:
        """The frame, where there is but one to go to."""
        return self._frames[0] if len(self._frames) == 1 and self._corrected is None else None

    def new(self) -> list[Tracked]:
        """Give the results that have come since the last call; of those before little is kept."""
        fresh = [self.results.pop(0) for _ in range(len(self.results))]
        # The pictures of a long film would fill the memory.
        self._taken += [replace(one, view=None, refinement=None) for one in fresh]
        return fresh

    def cancelled(self) -> str:
        """Say what became of it when the user has cancelled."""
        kept = len(self._taken)
        if not kept:
            return "Nothing was changed."
        return f"{words.count(kept, 'frame')} tracked by then {'stays' if kept == 1 else 'stay'}."

    def said(self) -> str:
        """Say what came of it."""
        if self._corrected is not None:
            frames = sorted(one.frame for one in self._taken)
            span = f", from {frames[0]} to {frames[-1]}" if frames else ""
            fitted = words.count(len(frames), "frame")
            return f"Refitted {fitted} around frame {self._corrected}{span}."
        if not self._taken:
            return "Nothing was tracked."
        last = self._taken[-1]
        arrived = words.count(len(last.ids) + len(last.given), "curve")
        text = [f"Tracked to frame {last.frame}: {arrived} there.", *self._ended()]
        entered = [one.frame for one in self._taken for _ in one.entered]
        if entered:
            said = words.count(len(entered), "body").replace("bodys", "bodies")
            where = _some([str(frame) for frame in entered])
            text.append(f"{said} came into view, without a curve: frame {where}.")
        drifting = sum(len(one.drifting) for one in self._taken)
        if drifting:
            text.append(f"{words.count(drifting, 'curve')} to check for drift.")
        bad = [one for one in self._taken if one.error]
        text += [f"Frame {one.frame} could not be refined: {one.error}" for one in bad[:1]]
        return " ".join(text)

    def _ended(self) -> list[str]:
        """Name the bodies that are not followed to the end, by what became of them."""
        ended: dict[str, list[str]] = {}
        for one in self._taken:
            for number in one.lost:
                why = one.missing.get(number, "")
                kind = next((said for begin, said in ENDS.items() if why.startswith(begin)), "Lost")
                ended.setdefault(kind, []).append(f"{number} (frame {one.frame})")
        return [f"{kind}: {_some(named)}." for kind, named in ended.items()]


def _some(named: Sequence[str]) -> str:
    more = f" and {len(named) - NUMBERS} more" if len(named) > NUMBERS else ""
    return ", ".join(named[:NUMBERS]) + more

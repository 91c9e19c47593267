"""What the dock offers beside refining one frame: suggested lines, and curves of a whole film."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any
from weakref import ref

import numpy as np
from superqt.utils import qdebounced

from napari_splinesketch import tracking
from napari_splinesketch.engine.types import Curve
from napari_splinesketch.plugin import engine, model, words
from napari_splinesketch.plugin.layers import drawn, space
from napari_splinesketch.plugin.layers.results import Work
from napari_splinesketch.plugin.model import Record, State, by_frame, key_of
from napari_splinesketch.tracking import Body, Given, Tracked, follow
from napari_splinesketch.tracking.bodies import INFERRED, MEMORY
from napari_splinesketch.tracking.follow import PATIENCE
from napari_splinesketch.tracking.window import UNDECIDED

if TYPE_CHECKING:
    from napari_splinesketch.plugin.controller import Controller

NOT_REFINED = "There are no curves in this frame: refine it first"
NOT_CORRECTED = "Correct a curve of this frame first: draw a line over it and refine, or edit it"
NOT_TRACKED = (
    "The frames beside have no tracked curve of what you drew or corrected here: curves that are\n"
    "yours stay as they are. Draw lines over those there, and refine them"
)
NOT_FOUND = "a later tracking did not find it here"
PREVIEW_AFTER_MS = 60  # suggestions follow the slider when it has stood still for so long


class Suggestions:
    """Lines over bodies that nobody has drawn."""

    def __init__(self, controller: Controller):
        self.sensitivity = 0.5  # from 0, only what stands out, to 1, also what is faint or short
        self._controller = controller
        # Work and frame of the last lines, whether bodies were described, and what is there to
        # choose from when the slider moves.
        self._last: Any = None
        self._soon = qdebounced(self._choose, PREVIEW_AFTER_MS)

    def suggest(self) -> None:
        """Suggest lines in the frame in view, in the place of those that were not taken up."""
        c = self._controller
        image, layer = c.image, c.sketches
        if image is None:
            return
        work = c.work_on(image, layer or drawn.new_sketch_layer(c.viewer, image))
        frame = c.frame
        # Drawn by hand or refined: these bodies need no suggestion.
        left = work.state.suggested(frame, ()).suggestions
        old = work.positions(work.state.suggestions.keys() - left)
        pairs = zip(c.drawn.lines, c.drawn.numbers, strict=True)
        mine = [line for line, position in pairs if position not in old]
        corners = np.array([[0.0, 0.0], np.subtract(space.size_of(image), 1)])
        block, how = space.block_around(image, frame, [corners]), c.how(image)
        given = how.half_width is not None or how.polarity != "auto"
        look = partial(engine.suggest, block, mine, c.records(frame), how)
        c.start(look, partial(self._on_suggested, work, frame, given), "Suggesting", on=work)

    def change_sensitivity(self, value: float) -> None:
        """Suggest other lines in the place of the last ones, soon, or when nothing runs."""
        self.sensitivity = value
        self._soon()

    def _on_suggested(self, work: Work, frame: int, given: bool, found: engine.Suggestions) -> None:
        self._last = ref(work), frame, given, found  # which has the pixels of its image
        # What was deleted here may be suggested again now.
        gone = {one for one in work.touched() if one[0] == frame}
        work.suggested = {one: line for one, line in work.suggested.items() if one not in gone}
        self._put(self._controller.finish, first=True)

    def _choose(self) -> None:
        c = self._controller
        if c.progress:
            self._soon()
        elif c.work and self._last and self._last[:2] == (ref(c.work), c.frame):
            self._put(c.tell)
        else:
            c.tell(words.NEXT_TIME)

    def _put(self, tell: Callable[[str], None], *, first: bool = False) -> None:
        """Draw the lines that are chosen now, choices in a row as one step, and tell of them."""
        known, frame, given, found = self._last
        work: Work = known()
        where = f" in frame {space.times_of(work.image).place(frame)}"
        step = "Suggest lines" + where * (space.frame_count(work.image) > 1)
        chosen = found.choose(self.sensitivity)
        # What the user has moved or deleted does not come back.
        refused = [np.frombuffer(line).reshape(-1, 2) for t, line in work.touched() if t == frame]
        new = model.new_among(chosen, refused)
        fresh = [line for line, wanted in zip(chosen, new, strict=True) if wanted]
        # As they are read again, or nobody would know that they have become curves.
        chosen = work.as_read(frame, fresh)
        state, refined = (work.state.suggested(frame, some) for some in (chosen, ()))

        def over() -> None:
            there = work.positions(state.suggestions.keys() - refined.suggestions)
            if there:
                drawn.bring_into_view(work.sketches, work.viewer, work.image)
            tell(words.suggested(len(there), self.sensitivity, given=given))

        if state.suggestions.keys() != work.state.suggestions.keys():
            what = step if first or work.history.done != step else ""
            self._controller.apply(what, state, over, work)
        else:
            over()


def tracking_problem(c: Controller, way: int) -> str:
    """Why there is nothing to carry on (1) or back (-1), or nothing."""
    if problem := c.problem:
        return problem
    if c.frame == space.times_of(c.image).of(c.frame)[min(-way, 0)]:
        return "This is the last frame" if way > 0 else "This is the first frame"
    here = c.records(c.frame)
    none = "All curves of this frame are rejected or failed: redraw one" if here else NOT_REFINED
    return "" if any(record.usable for record in here) else none


def track(c: Controller, way: int, most: int | None = None) -> None:
    """Carry the curves on (1) or back (-1), to the end or over some frames."""
    if c.work is not None:
        times = space.times_of(c.work.image).of(c.frame)
        state, now = at_times(c.state, times), times.index(c.frame)
        begin = now if most else confirmed(state, now, way)
        frames = range(begin + way, len(times) if way > 0 else -1, way)
        going = Tracking(c, c.work, times, frames[:most])
        carry = partial(follow, early=going.results.append)
        going.start(carry, bodies_at(state, begin, way))


def at_times(state: State, times: range) -> State:
    """Number the curves of some frames by their times, and leave out all others."""
    if times == range(len(times)):
        return state

    def numbered(records: Sequence[Record]) -> tuple[Record, ...]:
        there = [(r, times.index(r.frame)) for r in records if r.frame in times]
        # To copy all curves of a film takes too long.
        return tuple([r if r.frame == time else replace(r, frame=time) for r, time in there])

    return replace(state, records=numbered(state.records), deleted=numbered(state.deleted))


def confirmed(state: State, frame: int, way: int = 1) -> int:
    """Give the last frame on the way to one that a tracking which was cancelled had decided on."""
    known = by_frame(state.records)
    at = frame
    while any(UNDECIDED in r.curve.reasons and not r.settled for r in known.get(at, ())):
        at -= way
    return at if any(r.usable for r in known.get(at, ())) else frame


def around_problem(c: Controller) -> str:
    """Why there is nothing to fit again around the frame in view, or nothing."""
    if (problem := c.problem) or _corrected(c)[-1]:
        return problem
    return NOT_TRACKED if any(r.by_hand for r in c.records(c.frame)) else NOT_CORRECTED


def _corrected(c: Controller) -> tuple[range, State, int, tuple[Body, ...]]:
    """Give all times, the state at them, the one in view, and the bodies corrected there.

    They are known beside it; of selected curves, if any.
    """
    times = space.times_of(c.image).of(c.frame)
    state, now = at_times(c.state, times), times.index(c.frame)
    beside = {r.id for r in state.records if abs(r.frame - now) == 1 and not r.settled}
    here = [r for r in state.records if r.frame == now and r.id in beside]
    mine = [record for record in here if record.usable and record.by_hand]
    chosen = [record for record in mine if (c.frame, record.id) in c.selection] or mine
    return times, state, now, tuple(Body(r.id, ((now, r.curve),)) for r in chosen)


def around(c: Controller) -> None:
    """Carry corrected curves of the frame in view both ways, until nothing changes."""
    if c.work is not None:
        times, state, at, bodies = _corrected(c)
        known = by_frame(state.records)
        curves = {t: {r.id: r.curve for r in known[t] if r.usable} for t in known}
        carry = partial(tracking.around, there=lambda frame: curves.get(frame, {}))
        ways = range(at + 1, len(times)), range(at - 1, -1, -1)
        Tracking(c, c.work, times, ways, corrected=at).start(carry, bodies)


@dataclass(eq=False)
class Tracking:
    """Curves carried over frames, or fitted again around one, taken over as they come."""

    controller: Controller
    work: Work
    times: range  # frames of the image, as tracking counts them
    frames: Sequence[Any]  # their numbers; those of both ways around a frame that was `corrected`
    corrected: int | None = None
    results: list[Tracked] = field(default_factory=list)  # still to be taken over
    _taken: dict[int, Tracked] = field(default_factory=dict)  # the last of each frame
    _numbers: set[int] = field(default_factory=set)  # of the bodies that were carried so far

    def start(self, carry: Callable[..., Any], bodies: tuple[Body, ...]) -> None:
        """Begin, by one of the ways of `tracking`."""
        c, image = self.controller, self.work.image
        self._numbers.update(body.id for body in bodies)
        known = by_frame(at_times(self.work.state, self.times).records)

        def given(frame: int) -> Given:
            here = known.get(frame, [])
            # What a file brings is carried on from, and fitted again only around a correction.
            stays = [r for r in here if r.settled or (r.from_file and self.corrected is None)]
            mine = {r.id: r.curve for r in stays if r.usable}
            return Given(mine, whole=bool(here) and all(r.decided for r in here))

        run = partial(carry, self.frames, bodies, given=given)

        def block(time: int, lines: Sequence[model.Line]) -> space.Block:
            return space.block_around(image, self.times[time], lines)

        run = partial(engine.track, run, block, c.how(image), self.results.append)
        c.start(run, self.over, "Tracking", self.take, self.cancelled, on=self.work)

    def take(self, progress: object = None) -> None:
        """Take over the frames that are done by now."""
        controller, work = self.controller, self.work
        done = [self.results.pop(0) for _ in range(len(self.results))]
        if done:
            what = f"Refit around frame {self.corrected}"
            if self.corrected is None:
                what = f"Track to frame {self.frames[-1]}"
            again = bool(self._taken) and work.history.done == what  # nothing done in between
            state, there = work.state, {self.times[one.frame] for one in done}
            apart = [r for r in state.records if r.frame not in there]
            # To look through all curves of a long film for each frame takes too long.
            state = replace(state, records=tuple([r for r in state.records if r.frame in there]))
            for one in done:
                before = self._taken.get(one.frame)
                taken = replace(one, frame=self.times[one.frame])
                self._numbers.update(one.ids, one.given)
                carried = self._numbers if self.corrected is None and not one.error else ()
                state = taken_in(state, taken, before.ids if before else (), carried)
                # Not what was deleted there; and the pictures of a long film would fill the memory.
                curves = {n: c for n, c in one.by_id.items() if (taken.frame, n) in state.by_key}
                drifting = one.drifting & curves.keys()
                known = replace(one, by_id=curves, drifting=drifting, view=None, refinement=None)
                self._taken[one.frame] = known
            state = state.with_records(*apart)
            controller.apply("" if again else what, state, work=work)

    def over(self, outcome: object = None) -> None:
        """Take over the rest, and say what came of it; go to the frame where it is a single one."""
        self.take()
        controller, work = self.controller, self.work
        bad = any(one.error for one in self._taken.values())  # napari may fail over it, too
        single = len(self.frames) == 1 and self.corrected is None and not bad
        # Not away from a line that is being drawn: napari fails over it, or puts it over there.
        if work is controller.work and single and not controller.unfinished:
            numbers = {number for _, number in controller.selection}
            frame = self.times[self.frames[0]]
            space.go_to_frame(controller.viewer, work.image, frame)
            there = [key for key in work.state.by_key if key[0] == frame]
            controller.select(key for key in there if key[1] in numbers)
        last = [self.times[frame] for frame in self._taken][-1:]
        there = sum(r.frame in last and r.review != "rejected" for r in work.state.records)
        said = words.tracked([*self._taken.values()], self.corrected, there)
        controller.show(work, partial(controller.finish, said))

    def cancelled(self) -> str:
        """Keep what is done when the user has cancelled, and say what."""
        self.take()
        return words.kept([*self._taken.values()])


def bodies_at(state: State, frame: int, way: int = 1) -> tuple[Body, ...]:
    """Give the bodies that are known in a frame, or before on that way and out of sight there."""
    ways: dict[int, list[tuple[int, Curve]]] = {}
    # Where nothing shows the body, only what the user has said something of.
    known = [
        record
        for record in state.records
        if INFERRED not in record.curve.reasons or record.settled or record.review != "open"
    ]
    for record in sorted(known, key=lambda r: way * r.frame):
        if record.usable and 0 <= way * (frame - record.frame) < PATIENCE:
            ways.setdefault(record.id, []).append((record.frame, record.curve))
    ended = {r.id for r in (*state.deleted, *known) if r.frame == frame}
    return tuple(
        Body(number, tuple(seen[-MEMORY:]), abs(frame - seen[-1][0]))
        for number, seen in ways.items()
        if seen[-1][0] == frame or number not in ended
    )


def taken_in(
    state: State, tracked: Tracked, before: Collection[int] = (), carried: Collection[int] = ()
) -> State:
    """Put a tracked frame into what is known; what was decided meanwhile stays.

    Of the curves that this tracking had put there `before`, those that are in it no more go, and
    those that were rejected since stay, too. Of an earlier tracking they are in doubt where a body
    that was `carried` is not found.
    """
    view, refinement, frame = tracked.view, tracked.refinement, tracked.frame
    here = [record for record in state.records if record.frame == frame]
    left = {r.id for r in here if r.settled or (r.id in before and r.review != "open")}
    left |= {r.id for r in state.deleted if r.frame == frame}
    new = {n: curve for n, curve in tracked.by_id.items() if n not in left}
    read = {r.id: replace(r, review="open") for r in here if r.from_file}
    fresh = [
        replace(read.get(n) or Record(n, frame, tracked.sketches[n], c, drawn=False), curve=c)
        for n, c in new.items()
    ]
    gone = {(frame, number) for number in set(before).difference(tracked.ids, left)}
    there = tuple([record for record in state.records if key_of(record) not in gone])
    stale = set(carried).difference(tracked.ids, tracked.given, left, before)
    doubted = [_doubted(r) for r in here if r.id in stale and r.usable]
    state = replace(state, records=there).with_records(*doubted)
    if view is None or refinement is None:
        return state.with_records(*fresh)
    return state.refined(frame, fresh, engine.taken(refinement, view.place, tracked.curves))


def _doubted(record: Record) -> Record:
    reasons = dict.fromkeys((NOT_FOUND, *record.curve.reasons))
    return replace(record, curve=replace(record.curve, status="check", reasons=tuple(reasons)))

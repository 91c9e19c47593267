"""Frame after frame: carry the bodies over, refine, doubt, look again; around a correction too."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import takewhile
from reprlib import repr as short
from typing import Any

import numpy as np

from napari_splinesketch.engine.checks import checked_image
from napari_splinesketch.engine.settings import PRESETS, PresetName
from napari_splinesketch.engine.types import (
    Curve,
    InputError,
    OnProgress,
    Polarity,
    Progress,
    Refinement,
    says_stop,
)
from napari_splinesketch.files import reason_of
from napari_splinesketch.tracking.bodies import Body, Given, Line, Read, Refine, Tracked, View
from napari_splinesketch.tracking.drift import ShownPlaces, distance, misleads, near_others
from napari_splinesketch.tracking.events import DIVIDED, LEFT, Entering, Parts
from napari_splinesketch.tracking.search import AT_ONCE, Search
from napari_splinesketch.tracking.window import Window

NOTHING = "nothing like it is there"
PATIENCE = 40
"""Frames for which a body that cannot be trusted is looked for, with the frames around them."""
OUTSIDE = 0.5
"""Share of a body beyond the image's border with which it has left."""
SAME = 0.5
"""Half-widths between a curve and the one that was there, mean, within which they are one."""
ENOUGH = 2
"""Frames in succession in which all curves are what they were: beyond, nothing changes."""


def follow(
    frames: Sequence[int],
    start: Iterable[Body],
    read: Read,
    *,
    refine: Refine | None = None,
    preset: PresetName = "balanced",
    given: Callable[[int], Given] = lambda frame: Given(),
    on_progress: OnProgress | None = None,
    smooth: bool = True,
    pictures: bool = True,
    contrast: float | None = None,
    early: Callable[[Tracked], object] | None = None,
) -> Iterator[Tracked]:
    """Track bodies through frames, giving each frame as it is done.

    Parameters
    ----------
    frames
        Numbers of the frames to go to, in that order: forwards or backwards.
    start
        The bodies as they are known before, such as `Body(0, ((frame, curve),))`; those without a
        curve that has a length take no part.
    read
        Called as `read(frame, lines)`: gives the pixels of the frame (H, W), or a `View` of them or
        of the part around these lines.
    refine
        Refines sketches; None takes the engine.
    preset
        "balanced" or "paper".
    given
        What stays as it is in a frame: it is not refined again, and tracking goes on from there.
    on_progress
        Called with a `Progress` now and then; returning False ends the tracking, without the
        frame that is being worked on.
    smooth
        Whether a frame in doubt is held back until later ones tell what is there; otherwise each
        frame is decided by itself.
    pictures
        Whether reconstruction and background of the frames are wanted; without them, frames that
        are held back need less memory.
    contrast
        Contrast of the bodies in the frames before; None where it is not known.
    early
        Called with each frame that is held back, as it is by then and without its pictures;
        curves that are not decided yet say so.

    Yields
    ------
    Tracked
        One for each frame; a frame that cannot be read or refined does not stop the others.
    """
    if preset not in PRESETS:
        raise InputError(f"preset is {preset!r}; choose one of {', '.join(PRESETS)}")
    bodies = {}
    for body in start:
        if not isinstance(body, Body):
            raise InputError(f"start has {short(body)}; give bodies: Body(0, ((frame, curve),))")
        if body.id in bodies:
            raise InputError(f"start has two bodies {body.id}; give each its own number")
        if body.seen and body.length > 0:
            bodies[body.id] = body
    if refine is None:
        from napari_splinesketch.engine.refine import refine
    search = partial(Search, refine=refine, preset=preset, shown=ShownPlaces())
    step = _Step(read, search, smooth, pictures, contrast)
    window, done = Window(search, pictures), 0

    def report(progress: Progress) -> bool:
        fraction = (done + progress.fraction) / len(frames)
        told = Progress(f"frame {frame}: {progress.stage}", fraction)
        if on_progress and says_stop(on_progress(told)):
            raise CancelledError
        return True

    for frame in frames:
        try:
            report(Progress("reading the image", 0.0))
            kept = given(frame)
            result = step(frame, bodies, kept, report)
            known = window.push(result, kept.curves, bodies) if smooth else {}
        except CancelledError:
            yield from window.rest(decide=False)
            return
        bodies, done = after(bodies, result, kept) | known, done + 1
        if smooth:
            yield from window.ready()
            if early and (held := window.latest()):
                early(held)
        else:
            yield result
    yield from window.rest()


def after(bodies: Mapping[int, Body], result: Tracked, given: Given) -> dict[int, Body]:
    """Give the bodies as they are known after a frame."""
    known = dict(bodies)
    leading = {i: c for i, c in given.curves.items() if given.leads or i in bodies}
    for number, curve in leading.items():
        known[number] = known.get(number, Body(number, ())).with_curve(result.frame, curve)
    near = near_others({**given.curves, **result.by_id})
    for number, curve in result.by_id.items():
        body = known[number]
        if number in result.drifting:
            known[number] = body.missed()
        elif not (near[number] and misleads(body, result.frame, curve)):
            known[number] = body.with_curve(result.frame, curve)
    for number in result.missing:
        known[number] = known[number].missed()
    return {number: body for number, body in known.items() if number not in result.lost}


@dataclass(eq=False)
class _Step:
    """Places all bodies in one frame."""

    read: Read
    search: Callable[..., Search]
    smooth: bool
    pictures: bool
    contrast: float | None
    """Usual contrast of the frames before."""
    polarity: Polarity = "auto"
    """That of the last frame that has shown bodies."""
    parts: Mapping[int, Parts] = field(default_factory=dict)
    """Those of the last frame."""
    entering: Entering = field(default_factory=Entering)

    def __call__(
        self, frame: int, bodies: Mapping[int, Body], given: Given, report: OnProgress
    ) -> Tracked:
        kept = tuple(given.curves)
        wanted = [body for body in bodies.values() if body.id not in given.curves]
        if given.whole or not wanted:
            missing = {body.id: "the frame stays as it is" for body in wanted}
            return Tracked(frame, given=kept, missing=missing)
        predicted = {body.id: body.predicted(frame) for body in wanted}
        try:
            read = self.read(frame, [there.line for there in predicted.values()])
            view = read if isinstance(read, View) else View(read)
            view = replace(view, pixels=checked_image(view.pixels))
            inside = [body for body in wanted if _inside(view, predicted[body.id].line)]
            usual = {"contrast": self.contrast, "polarity": self.polarity, "smooth": self.smooth}
            search = self.search(view, predicted, given.curves, report=report, **usual)
            found = search(inside) if inside else {}
        except CancelledError:
            raise
        except Exception as error:  # one bad frame must not stop the others
            return Tracked(frame, given=kept, error=reason_of(error))
        if search.refinement and any(one.trusted for one in found.values()):
            self.contrast = abs(search.refinement.model.contrast)
            self.polarity = search.refinement.model.polarity
        gone = {body.id: LEFT for body in wanted if body not in inside}
        judged = self._judged(frame, inside, search, gone)
        here = (*given.curves.values(), *judged.curves)
        refinement = search.refinement
        if refinement and not self.pictures:
            none = np.empty((0, 0))
            refinement = Refinement((), none, none, refinement.model, refinement.seconds)
        return replace(
            judged,
            given=kept,
            entered=self.entering(view, self.polarity, bodies, here) if self.smooth else (),
            refinement=refinement,
            view=view,
            contrast=self.contrast,
        )

    def _judged(
        self, frame: int, bodies: Sequence[Body], search: Search, gone: Mapping[int, str]
    ) -> Tracked:
        """Sort what was found into trusted, drifting, missing and lost."""
        found, before, self.parts = search.found, self.parts, search.parts
        divided = {
            number: f"{DIVIDED} of {one:.0f} and {other:.0f} px"
            for number, (one, other, gap) in search.parts.items()
            if number in before and gap > before[number][-1]  # they move away from each other
        }
        missing, lost, patience = dict(gone), set(gone), PATIENCE if self.smooth else AT_ONCE
        curves, drifting = dict[int, Curve](), set[int]()
        for body in bodies:
            one, curve = found[body.id], found[body.id].curve
            given_up = body.id in divided or (body.misses >= patience and not one.trusted)
            if given_up:
                lost.add(body.id)
            if given_up or one.empty:
                missing[body.id] = divided.get(body.id) or "; ".join(one.said) or NOTHING
                continue
            if one.said:
                drifting.add(body.id)
                reasons = [why for why in curve.reasons if "same body" not in why]
                curve = replace(curve, status="check", reasons=(*one.said, *reasons))
            curves[body.id] = curve
        sketches = {i: found[i].sketch for i in curves}
        return Tracked(frame, curves, sketches, frozenset(drifting), missing, frozenset(lost))


def _inside(view: View, line: Line) -> bool:
    points = view.place.to_block(line)
    outside = ((points < 0) | (points > np.array(view.pixels.shape) - 1)).any(1)
    return float(outside.mean()) <= OUTSIDE


def around(
    ways: Sequence[Sequence[int]],
    start: Sequence[Body],
    read: Read,
    there: Callable[[int], Mapping[int, Curve]],
    *,
    given: Callable[[int], Given],
    on_progress: OnProgress | None = None,
    **options: Any,
) -> Iterator[Tracked]:
    """Carry corrected curves on, each way until they are where they were before.

    `ways` are the frames after and before the corrected one, the nearest first. All bodies but
    those of `start` stay as they are. `there` gives all curves of a frame as they were, by number;
    beyond a frame without any, nothing is carried, nor over what the user has decided, as `given`
    says. The rest is as `follow` has it. Gives each frame in which a curve has changed, or has to
    be changed for one beyond.
    """
    names = {body.id for body in start}

    def kept(frame: int) -> Given:
        others = {i: c for i, c in there(frame).items() if i not in names}
        return Given({**others, **given(frame).curves}, leads=False)

    def is_same(result: Tracked) -> bool:
        """Whether all bodies are where they were, from head to tail."""
        found, before = result.by_id, there(result.frame)
        return all(
            i in found
            and i in before
            and distance(found[i].points, before[i].points) < SAME * before[i].typical_half_width
            for i in names - set(result.given)
        )

    carried = [
        [*takewhile(lambda t: there(t) and not names <= set(given(t).curves), way)] for way in ways
    ]
    before, total = 0, sum(map(len, carried))

    def report(progress: Progress) -> bool | None:
        share = (before + progress.fraction * len(frames)) / total
        return on_progress(replace(progress, fraction=share)) if on_progress else None

    for frames in carried:
        same: list[Tracked] = []
        for result in follow(frames, start, read, given=kept, on_progress=report, **options):
            if is_same(result):
                same.append(result)
                if len(same) == ENOUGH:
                    break
            else:
                yield from (*same, result)
                same = []
        before += len(frames)

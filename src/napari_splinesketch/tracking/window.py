"""What one frame cannot tell, the frames around it can: stretches in doubt, seen from both ends.

Where bodies lie on each other and the fit is unsure, or where one is out of sight, frames are held
back until it is clear again. Then each frame in between is gone through again for it, backwards, by
what the frames before and after predict, and what it does not show is inferred.
A film in which nothing of the kind happens passes through frame by frame.
"""

from collections import defaultdict, deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain

import numpy as np

from napari_splinesketch.engine.spline import fit_knots
from napari_splinesketch.engine.types import Curve
from napari_splinesketch.geometry import with_width
from napari_splinesketch.tracking import motion, surface
from napari_splinesketch.tracking.bodies import INFERRED, Body, Tracked, View, lines_of
from napari_splinesketch.tracking.drift import distance, folds, near_others
from napari_splinesketch.tracking.motion import Predicted
from napari_splinesketch.tracking.search import Search
from napari_splinesketch.tracking.surface import Seen

LONGEST = 45
"""Frames that are held back at most; then they are given as they are."""
ALONG = 0.3
"""Share of a body that may run along another without being taken for it."""
CLEAR = 2
"""Frames in which a body must be clear of others and of doubts before a stretch is over."""
SIDE = 5
"""Frames after one that predict a body there."""
FEWEST_SEEN = 4
"""Frames of a body that must be known before others tell anything."""
SURE = 1.0
"""Half-widths from where it is predicted within which a curve is not fitted again."""
FEWEST = 8
"""Knots of an inferred curve."""
UNDECIDED = "other frames have not confirmed it yet"


@dataclass(eq=False)
class _Stretch:
    """A body that is in doubt, and what was known of it before."""

    anchor: Body
    frames: int = 0
    """Of the stretch so far, all of them held back ..."""
    trusted: int = 0
    """... for which it has been clear of doubts again ..."""
    clear: int = 0
    """... and of other bodies as well."""


class Window:
    """Holds back the frames that are not decided yet."""

    def __init__(self, search: Callable[..., Search], pictures: bool):
        self._search, self._pictures = search, pictures
        self._held: list[Tracked] = []
        self._views: list[dict[int, View]] = []
        """What is kept of each frame for the bodies that are in doubt there."""
        self._open: dict[int, _Stretch] = {}
        self._seen = defaultdict[int, deque[Seen]](partial(deque, maxlen=surface.KNOWN))

    def push(
        self, result: Tracked, given: Mapping[int, Curve], before: Mapping[int, Body]
    ) -> dict[int, Body]:
        """Take the next frame, with the curves that were there and the bodies as known before it.

        Gives bodies of which more is known now than that frame tells.
        """
        self._held.append(result)
        self._note(result, given, before)
        self._keep(result, before)
        over = {i for i, s in self._open.items() if s.clear >= CLEAR or s.frames > LONGEST}
        return self._decided(over)

    def _keep(self, result: Tracked, before: Mapping[int, Body]) -> None:
        """Keep the pixels around the bodies in doubt; all of them where pictures are wanted."""
        curves, kept = result.by_id, {}
        if view := result.view:
            for i in self._open:
                lines = [curves[i].points] if i in curves else []
                lines += [before[i].predicted(result.frame).line] if i in before else []
                kept[i] = view if self._pictures else view.around(lines)
        self._views.append(kept)
        if not self._pictures:
            self._held[-1] = replace(result, view=None)

    def _decided(self, names: set[int]) -> dict[int, Body]:
        """End stretches; those of bodies that are clear again are put right, backwards."""
        over = {i: self._open.pop(i) for i in names}
        return {i: self._bridged(i, s) for i, s in over.items() if s.trusted >= CLEAR}

    def ready(self, *, end: bool = False) -> Iterator[Tracked]:
        """Give the frames that nothing is to be learned about any more; at the `end`, all."""
        count = len(self._held) - max((s.frames for s in self._open.values()), default=0)
        while count:
            first, later = self._held[0], self._held[1:count]
            noisy = {
                i: curve
                for i, curve in first.by_id.items()
                if np.median(curve.sd) > surface.NOISY and len(self._seen[i]) >= FEWEST_SEEN
            }
            if noisy and len(later) < surface.REACH and not end:
                break
            steadied = {
                i: surface.steadied(c, first.frame, [*self._seen[i], *self._after(i, later)])
                for i, c in noisy.items()
            }
            for i, curve in first.by_id.items():
                if INFERRED not in curve.reasons:
                    self._seen[i].append((first.frame, curve))
            count -= 1
            del self._held[0], self._views[0]
            yield replace(first, by_id={**first.by_id, **steadied})

    def _after(self, name: int, later: list[Tracked]) -> list[Seen]:
        """What is known of a body in the frames after one."""
        known = [(r.frame, r.by_id.get(name)) for r in later[: surface.REACH]]
        return [(t, c) for t, c in known if c and INFERRED not in c.reasons]

    def latest(self) -> Tracked | None:
        """The last frame as it is by now, without its pictures, if it is held back."""
        if not self._held:
            return None
        return replace(self._as_is(len(self._held) - 1), refinement=None, view=None)

    def rest(self, *, decide: bool = True) -> Iterator[Tracked]:
        """Give all that are left, decided as well as may be, or as they are."""
        if decide:
            self._decided(set(self._open))
        else:
            self._held = [self._as_is(k) for k in range(len(self._held))]
        self._open.clear()
        return self.ready(end=True)

    def _as_is(self, at: int) -> Tracked:
        """A frame that is held back; its curves that are not decided say so."""
        result = self._held[at]
        doubted = {
            i: replace(curve, status="check", reasons=(UNDECIDED, *curve.reasons))
            for i, curve in result.by_id.items()
            if i in self._open and at >= len(self._held) - self._open[i].frames
        }
        return replace(result, by_id={**result.by_id, **doubted})

    def _note(
        self, result: Tracked, given: Mapping[int, Curve], before: Mapping[int, Body]
    ) -> None:
        """Open and prolong the stretches of the bodies that are in doubt."""
        curves = result.by_id
        near = near_others({**given, **curves})
        doubted = {i for i in chain(result.drifting, result.missing) if i in before}
        along = near_others({**given, **curves}, ALONG)
        unsure = {i for i, c in curves.items() if along[i] or (near[i] and c.status != "good")}
        opening = (doubted | unsure) - set(self._open)
        opening |= {j for i in opening for j in near.get(i, ()) if j in before and j in curves}
        for i in opening - set(self._open) - set(given):
            self._open[i] = _Stretch(before[i])
        for i in set(given) | result.lost:
            self._open.pop(i, None)
        for i, stretch in self._open.items():
            trusted = i in curves and i not in doubted
            stretch.frames += 1
            stretch.trusted = stretch.trusted + 1 if trusted else 0
            stretch.clear = stretch.clear + 1 if trusted and not near.get(i) else 0

    def _bridged(self, name: int, stretch: _Stretch) -> Body:
        """Go through the frames of a stretch again, and give the body as it is known then."""
        body, end = stretch.anchor, len(self._held) - CLEAR
        found = [(r.frame, r.by_id[name]) for r in self._held[end:]]
        for k in reversed(range(len(self._held) - stretch.frames, end)):
            result = self._held[k]
            if result.error:
                continue
            there = motion.between(lines_of(body.seen), lines_of(found[:SIDE][::-1]), result.frame)
            curve = self._again(result, self._views[k].get(name), body, there)
            self._held[k] = replace(
                result,
                by_id={**result.by_id, name: curve},
                sketches={**result.sketches, name: there.line},
                drifting=result.drifting - {name},
                missing={i: why for i, why in result.missing.items() if i != name},
            )
            if INFERRED not in curve.reasons:
                found.insert(0, (result.frame, curve))
        for seen in found:
            body = body.with_curve(*seen)
        return body

    def _again(self, result: Tracked, view: View | None, body: Body, predicted: Predicted) -> Curve:
        """The curve of one frame in the light of those around: where it is predicted, if any."""
        others = {i: c for i, c in result.by_id.items() if i != body.id}
        there = None if body.id in result.drifting else result.by_id.get(body.id)
        if (
            there
            and distance(there.points, predicted.line) < SURE * body.half_width
            and not body.lacks(there)
        ):
            return there
        if view and result.refinement:
            part, where = view.around([predicted.line]), {body.id: predicted}
            search = self._search(part, where, others, contrast=result.contrast)
            for one in search.held([body]).values():
                likely = predicted.agrees(one.curve.points, body.half_width)
                if likely and not (one.empty or folds(body, one.curve)):
                    return one.curve
        return there or inferred(body.seen[-1][1], predicted)


def inferred(like: Curve, predicted: Predicted) -> Curve:
    """A curve that no image shows."""
    return replace(
        like,
        knots=with_width(fit_knots(predicted.line, FEWEST), like.half_width),
        points=predicted.line,
        sd=np.full(len(predicted.line), predicted.sd),
        status="check",
        reasons=(INFERRED,),
        residual=float("nan"),
    )

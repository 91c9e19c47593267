"""What one frame cannot tell, the frames around it can: stretches in doubt, seen from both ends.

Where bodies lie on each other and the fit is unsure, or where one is out of sight, frames are held
back until all of them are clear again. Then each frame in between is gone through again, backwards,
by what the frames before and after predict, and what it does not show is inferred.
A film in which nothing of the kind happens passes through frame by frame.
"""

from collections import defaultdict, deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain

import numpy as np

from napari_splinesketch.engine.settings import PresetName
from napari_splinesketch.engine.spline import fit_knots
from napari_splinesketch.engine.types import Curve
from napari_splinesketch.tracking import motion, surface
from napari_splinesketch.tracking.bodies import INFERRED, Body, lines_of
from napari_splinesketch.tracking.drift import ShownPlaces, distance, folds, near_others
from napari_splinesketch.tracking.motion import Predicted
from napari_splinesketch.tracking.search import Search
from napari_splinesketch.tracking.surface import Seen
from napari_splinesketch.tracking.types import Refine, Tracked, View, joined

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
    first: int
    """Number of the first frame of the stretch, in the order of their coming."""
    doubted: tuple[Body, int]
    """The same for the last time that doubts began."""
    partners: set[int] = field(default_factory=set)
    """Bodies that it may have been taken for."""
    trusted: int = 0
    """Frames for which it has been clear of doubts again ..."""
    clear: int = 0
    """... and of other bodies as well."""


class Window:
    """Holds back the frames that are not decided yet."""

    def __init__(self, refine: Refine, preset: PresetName, pictures: bool, shown: ShownPlaces):
        self._shown = shown
        self._refine, self._pictures = refine, pictures
        self._preset: PresetName = preset
        self._held: list[Tracked] = []
        self._views: list[dict[int, View]] = []
        """What is kept of each frame for the bodies that are in doubt there."""
        self._begin = 0
        self._open: dict[int, _Stretch] = {}
        self._seen = defaultdict[int, deque[Seen]](partial(deque, maxlen=surface.KNOWN))

    def push(
        self, result: Tracked, given: Mapping[int, Curve], before: Mapping[int, Body]
    ) -> dict[int, Body]:
        """Take the next frame, with the curves that were there and the bodies as known before it.

        Gives bodies of which more is known now than that frame tells.
        """
        self._held.append(result)
        number = self._begin + len(self._held) - 1
        self._note(result, given, before, number)
        self._keep(result, before)
        known: dict[int, Body] = {}
        for group in self._groups():
            over = number - min(self._open[i].first for i in group) >= LONGEST
            known |= self._close(group, over)
        return known

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

    def _close(self, group: set[int], over: bool) -> dict[int, Body]:
        """Decide on the stretches of a group that are over, or all if there is no more time."""
        if not over and any(self._open[i].clear < CLEAR for i in group):
            return {}
        back = {i for i in group if self._open[i].trusted >= CLEAR}
        known = self._decided({i: self._open[i] for i in back}) if back else {}
        first = min(self._open[i].first for i in group)
        for i in group:
            stretch = self._open.pop(i)
            if i not in back and stretch.doubted[1] > first:
                self._open[i] = _Stretch(*stretch.doubted, stretch.doubted)
        return known

    def ready(self, *, end: bool = False) -> Iterator[Tracked]:
        """Give the frames that nothing is to be learned about any more; at the `end`, all."""
        until = min((s.first for s in self._open.values()), default=None)
        count = len(self._held) if until is None else max(until - self._begin, 0)
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
            self._begin += 1
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
            for group in self._groups():
                self._close(group, over=True)
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
            if i in self._open and self._open[i].first <= self._begin + at
        }
        return replace(result, by_id={**result.by_id, **doubted})

    def _note(
        self,
        result: Tracked,
        given: Mapping[int, Curve],
        before: Mapping[int, Body],
        number: int,
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
            if before[i].seen:
                self._open[i] = _Stretch(before[i], number, (before[i], number))
        for i in set(given) | result.lost:
            self._open.pop(i, None)
        for i, stretch in self._open.items():
            stretch.partners |= near.get(i, set())
            trusted = i in curves and i not in doubted
            if stretch.trusted and not trusted:
                stretch.doubted = before[i], number
            stretch.trusted = stretch.trusted + 1 if trusted else 0
            stretch.clear = stretch.clear + 1 if trusted and not near.get(i) else 0

    def _groups(self) -> list[set[int]]:
        """The open stretches, those together that may have been taken for each other."""
        groups: list[set[int]] = []
        for i, stretch in self._open.items():
            joined = {i} | (stretch.partners & set(self._open))
            apart = [g for g in groups if not g & joined]
            for g in groups:
                joined |= g if g & joined else set()
            groups = [*apart, joined]
        return groups

    def _decided(self, stretches: Mapping[int, _Stretch]) -> dict[int, Body]:
        """Go through the frames of some stretches again, backwards, and put them right."""
        first = min(s.first for s in stretches.values()) - self._begin
        end = len(self._held) - CLEAR
        names = sorted(stretches)
        anchors = {i: stretches[i].anchor for i in names}
        found = {i: [(r.frame, r.by_id[i]) for r in self._held[end:]] for i in names}
        for k in range(end - 1, first - 1, -1):
            result = self._held[k]
            here = {i: b for i, b in anchors.items() if stretches[i].first <= self._begin + k}
            predicted = {
                i: motion.between(
                    lines_of(body.seen), lines_of(found[i][:SIDE][::-1]), result.frame
                )
                for i, body in here.items()
            }
            views = [self._views[k][i] for i in here if i in self._views[k]]
            self._held[k] = self._again(result, views, here, predicted)
            for i in here:
                if INFERRED not in (curve := self._held[k].by_id[i]).reasons:
                    found[i].insert(0, (result.frame, curve))
        for i in names:
            for seen in found[i]:
                anchors[i] = anchors[i].with_curve(*seen)
        return anchors

    def _again(
        self,
        result: Tracked,
        views: Sequence[View],
        bodies: Mapping[int, Body],
        predicted: Mapping[int, Predicted],
    ) -> Tracked:
        """One frame in the light of those around it: curves where they are predicted, if any."""
        there = {i: c for i, c in result.by_id.items() if i in bodies and i not in result.drifting}
        others = {i: c for i, c in result.by_id.items() if i not in bodies}
        sure = {
            i: c
            for i, c in there.items()
            if distance(c.points, predicted[i].line) < SURE * bodies[i].half_width
            and not bodies[i].lacks(c)
        }
        rest = [body for i, body in bodies.items() if i not in sure]
        chosen = {i: inferred(bodies[i].seen[-1][1], predicted[i]) for i in bodies} | there
        if rest and views and result.refinement:
            contrast = abs(result.refinement.model.contrast)
            near = joined(views).around([predicted[body.id].line for body in rest])
            search = Search(
                near, predicted, others | sure, self._refine, self._preset, lambda p: None,
                contrast, shown=self._shown,
            )  # fmt: skip
            for i, one in search.held(rest).items():
                likely = predicted[i].agrees(one.curve.points, bodies[i].half_width)
                if likely and not (one.empty or folds(bodies[i], one.curve)):
                    chosen[i] = one.curve
        return replace(
            result,
            by_id={**others, **chosen},
            sketches={**result.sketches, **{i: there.line for i, there in predicted.items()}},
            drifting=result.drifting - set(predicted),
            missing={i: why for i, why in result.missing.items() if i not in predicted},
        )


def inferred(like: Curve, predicted: Predicted) -> Curve:
    """A curve that no image shows."""
    knots = np.column_stack(
        [
            fit_knots(predicted.line, FEWEST),
            np.interp(np.linspace(0, 99, FEWEST), np.arange(100), like.half_width),
        ]
    )
    return replace(
        like,
        knots=knots,
        points=predicted.line,
        sd=np.full(len(predicted.line), predicted.sd),
        status="check",
        reasons=(INFERRED,),
        residual=float("nan"),
    )

"""Placing the bodies of one frame: first where they are expected, then wherever they may be."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import binary_closing, binary_dilation, binary_erosion, binary_opening
from scipy.optimize import linear_sum_assignment

from napari_splinesketch.engine.look.band import band
from napari_splinesketch.engine.settings import Hold, PresetName, Settings
from napari_splinesketch.engine.spline import arc_length, resample
from napari_splinesketch.engine.types import Curve, OnProgress, Polarity, Progress, Refinement
from napari_splinesketch.grids import slices
from napari_splinesketch.tracking import drift
from napari_splinesketch.tracking.bodies import INFERRED, Body, Line, Refine, View, curve_inferred
from napari_splinesketch.tracking.events import Parts, parts
from napari_splinesketch.tracking.motion import Predicted

LOCAL = Settings(traced=False)
"""Without a search through the traces: the nearest body is the one."""
POINTS = 12
"""Of the line along which a body is searched for."""
SURE = 0.8
"""Half-widths: where a body is known so well, it is not searched for."""
PARTLY = 3.0
"""The same of a body that something hides in part: a search finds the rest of it at best."""
LOOSE, STRICT = 3.0, 0.5
"""Errors of a prediction go together along a body: each of about ten knots is to be believed by
the square root of that less, or the curve lags behind its body; and by so much across it where a
curve that is free to leave its body does, or where something hides a part of it."""
COVERED = 1.0
"""Half-widths around the stretches that something hides in which the image is not asked, beside
those of the body itself."""
LEAST, MOST = 0.5, 0.8
"""Share of a curve that the image must show, and below which the rest is said to be inferred ..."""
UNSEEN = 0.04
"""... or, where something seems to hide it, the share that is not shown above which it is."""
AT_ONCE = 2
"""Frames in which a body is missed after which only what stands out in the image is tried again:
other attempts hardly ever find it."""
REACH, LENGTH = 0.6, 0.5
"""How far a body may have gone that is looked for among suggestions, as a share of its length, or
as far as its prediction may be off; and what a px of difference in length costs, in px."""
ASTRAY = 2.0
"""Errors of a prediction by which a body may be elsewhere."""
TAKEN = 2.0
"""A suggestion that lies so near to a placed curve is taken, px."""


@dataclass(frozen=True, eq=False)
class Found:
    """Where a body was found: px of the image, with what speaks against it."""

    sketch: Line
    curve: Curve
    said: tuple[str, ...]
    empty: bool
    """Whether hardly anything is there."""

    @property
    def trusted(self) -> bool:
        """Whether nothing speaks against it."""
        return not self.score

    @property
    def score(self) -> int:
        """How much speaks against it."""
        return len(self.said) + 3 * self.empty


@dataclass(eq=False)
class Search:
    """Places bodies in one frame, those in doubt again and otherwise.

    Where each body is predicted, and the curves that stay as they are, are given by number; the
    usual contrast, the polarity, and where bodies have been shown, are those of the frames before.
    With `smooth`, a body whose place is known well is fitted there without a search, and parts of
    bodies that divide are looked for.
    """

    view: View
    predicted: Mapping[int, Predicted]
    given: Mapping[int, Curve]
    refine: Refine
    preset: PresetName
    report: OnProgress = field(default=lambda progress: None)
    contrast: float | None = None
    polarity: Polarity = "auto"
    smooth: bool = True
    shown: drift.ShownPlaces = field(default_factory=drift.ShownPlaces)
    found: dict[int, Found] = field(default_factory=dict, init=False)
    """The best of each body, by number."""
    parts: dict[int, Parts] = field(default_factory=dict, init=False)
    """Of bodies that may have divided, by number."""
    refinement: Refinement | None = field(default=None, init=False)
    """What the engine said."""
    _progress: float = field(default=0.0, init=False)

    @cached_property
    def _expected(self) -> dict[int, Line]:
        return {i: resample(there.line, POINTS) for i, there in self.predicted.items()}

    def __call__(self, bodies: Sequence[Body]) -> dict[int, Found]:
        """Place the bodies; gives what was found by number."""
        found = self.held([b for b in bodies if self.smooth and self._known(b)])
        rest = [body for body in bodies if body.id not in found]
        self._attempt(rest, self._expected, self.preset)
        for number, preset in enumerate((self.preset, LOCAL, self.preset), start=1):
            doubted = [b for b in bodies if not found[b.id].trusted]
            doubted = [b for b in doubted if b.misses <= AT_ONCE or (number == 3 and b.misses % 2)]
            # The first attempt was the same if there was nobody else to get out of the way.
            if doubted and (number > 1 or doubted != rest):
                lines = self._as_suggested(doubted) if number == 3 else self._expected
                self._attempt(doubted, lines, preset)
        for body in bodies if self.smooth else ():
            line = found[body.id].curve.points
            inside = binary_erosion(self._seen(line), iterations=_points(body, line))
            self.shown.add(line[np.asarray(inside, bool)], body.half_width)
            if found[body.id].trusted and not curve_inferred(found[body.id].curve):
                self.shown.learn(body.id, float(self._unseen(body, line).mean()))
        return found

    def _known(self, body: Body) -> bool:
        """Whether it is known where a body is, or a part of it that is not hidden."""
        near = PARTLY if curve_inferred(body.seen[-1][1]) else SURE
        return self.predicted[body.id].sd < near * body.half_width

    def _astray(self, body: Body) -> float:
        """How far off the prediction of a body may be, px; 0 where nothing tells it."""
        sd = self.predicted[body.id].sd
        return ASTRAY * sd if np.isfinite(sd) else 0.0

    def held(self, bodies: Sequence[Body]) -> dict[int, Found]:
        """Fit bodies to where they are predicted, with how surely, without any search."""
        lines, found = {b.id: self.predicted[b.id].line for b in bodies}, self.found
        if self.preset == "paper":
            return found
        unit = 1 / self.view.place.size  # px of the view in one of the image

        def hold(body: Body, across: float) -> Hold:
            sd = self.predicted[body.id].sd
            return Hold(*(unit * x for x in (across * sd, LOOSE * sd + 1, body.length_sd)))

        loose = Settings(hold=tuple(hold(b, LOOSE) for b in bodies))
        self._attempt(bodies, lines, loose)
        hidden = {
            b.id
            for b in bodies  # that have been fitted as if they were whole
            if b.lacks(curve := found[b.id].curve) or self._partly(b, curve.points)
        }
        again = [b for b in bodies if b.id in hidden or not found[b.id].trusted]
        holds = tuple(hold(b, LOOSE if found[b.id].trusted else STRICT) for b in again)
        self._attempt(again, lines, Settings(hold=holds), hidden)
        return found

    def _partly(self, body: Body, line: Line) -> bool:
        """Whether the image shows less of a body than it usually does."""
        return self._unseen(body, line).mean() > self.shown.faint.get(body.id, 0.0) + UNSEEN

    def _unseen(self, body: Body, line: Line) -> Bool[np.ndarray, " P"]:
        """Where the image does not show a body for its width, or for half of that at an end."""
        seen = np.asarray(binary_closing(self._seen(line)), bool)
        width = _points(body, line)
        beyond = np.pad(~seen, width, constant_values=True)
        unseen = np.asarray(binary_opening(beyond, iterations=width), bool)[width:-width]
        return unseen & ~self.shown.at(line)

    def _uncovered(self, view: View, bodies: Sequence[Body], lines: Mapping[int, Line]) -> View:
        """The view without the pixels where bodies should be, but the image does not show them."""
        pixels = view.pixels.astype(float)
        for body in bodies:
            line = lines[body.id]
            width = _points(body, line)
            near = np.asarray(binary_dilation(self._unseen(body, line), iterations=width), bool)
            for run in np.ma.clump_masked(np.ma.array(near, mask=near)):
                at = view.place.to_block(line[run])
                reach = (1 + COVERED) / view.place.size * body.half_width
                rows, columns, mask = band(at, reach, pixels.shape)
                pixels[rows, columns][mask] = np.nan
        return replace(view, pixels=pixels)

    def _as_suggested(self, bodies: Sequence[Body]) -> dict[int, Line]:
        """What the image itself suggests for bodies in doubt."""
        from napari_splinesketch.engine.find.suggest import suggest

        to_image = self.view.place.to_image
        lines = [to_image(line) for line in suggest(self.view.pixels, polarity=self.polarity)]
        placed = [curve.points for curve in self.given.values()]
        placed += [one.curve.points for one in self.found.values() if one.trusted]
        reach = [max(REACH * body.length, self._astray(body)) for body in bodies]
        return place(bodies, self._expected, lines, placed, reach)

    def _attempt(
        self,
        bodies: Sequence[Body],
        lines: Mapping[int, Line],
        preset: PresetName | Settings,
        hidden: Collection[int] = (),
    ) -> None:
        """Refine the lines of some bodies among the others; keep what is better than before.

        Of bodies that are `hidden` in part, the image is not asked where it does not show them, and
        their curves replace others against which as much speaks.
        """
        bodies = [body for body in bodies if body.id in lines]
        if not bodies:
            return
        tried, found = {body.id for body in bodies}, self.found
        others = {i: one.curve for i, one in found.items() if i not in tried and one.trusted}
        fixed = {**self.given, **others}
        wanted = [lines[b.id] for b in bodies]
        view = self.view.around(wanted) if self.refinement else self.view
        covered = [b for b in bodies if b.id in hidden]
        shown = self._uncovered(view, covered, lines) if covered else view
        refinement = self.refine(
            shown.pixels,
            [view.place.to_block(line) for line in wanted],
            preset,
            fixed=[view.place.curve_to_block(curve) for curve in fixed.values()],
            on_progress=self._report,
        )
        curves = [view.place.curve_to_image(curve) for curve in refinement.curves]
        everyone = [*curves, *fixed.values()]
        shared, beside = drift.on_one_body(everyone), drift.near_each(everyone)
        names = [*(body.id for body in bodies), *fixed]
        seen = drift.seeing(view, refinement, self.contrast)
        if not self.refinement:
            self._seen = seen
        held = isinstance(preset, Settings) and preset.hold is not None
        kept = False
        for i, (body, curve) in enumerate(zip(bodies, curves, strict=True)):
            far = self._astray(body)
            said = drift.doubts(body, curve, self._expected[body.id], far, self.smooth)
            there = float(seen(curve.points).mean())
            rest = [everyone[j] for j in beside[i]]
            if self.smooth:
                crossed = not drift.apart_from(curve.points, rest).all()
                if crossed and body.id not in hidden and drift.explains_less(body, curve):
                    said.append("it crosses others and explains the image less well than before")
                if there < MOST and (
                    torn := parts(body, curve, [c for c in everyone if c is not curve], seen)
                ):
                    self.parts[body.id] = torn
            partly = held and LEAST < there < MOST
            if partly or (body.id in hidden and self._partly(body, curve.points)):
                reasons = (*curve.reasons, f"part of it is {INFERRED}")
                curve = replace(curve, status="check", reasons=reasons)
            if i in shared and not (held and drift.lies_on(lines[body.id], everyone[shared[i]])):
                said.append(f"it lies on the same body as curve {names[shared[i]]}")
            if body.misses and there < MOST:
                said.append("too little of it is seen to know it again")
            empty = curve.status == "failed" or there <= LEAST
            one = Found(lines[body.id], curve, tuple(said), empty)
            if body.id not in found or one.score < found[body.id].score + (body.id in hidden):
                found[body.id] = one
                kept = True
        if kept:
            if before := self.refinement:
                pictures = _Pasted(before, refinement, self.view.place.to_block(view.place.origin))
                seconds = before.seconds + refinement.seconds
                refinement = Refinement.lazy(before.curves, pictures, before.model, seconds)
            self.refinement = refinement

    def _report(self, progress: Progress) -> bool | None:
        self._progress = max(self._progress, progress.fraction)  # attempts begin at 0 again
        return self.report(replace(progress, fraction=self._progress))


def _points(body: Body, line: Line) -> int:
    """How many points of a line lie within a half-width, where that is known; at least one."""
    count = body.half_width / body.length * len(line)
    return max(round(count), 1) if np.isfinite(count) else 1


class _Pasted:
    """The pictures of a frame, with later ones of a part of it; made when they are first read."""

    def __init__(self, old: Refinement, new: Refinement, corner: Float[np.ndarray, "2"]) -> None:
        self._old, self._new, self.shape = old, new, old.shape
        low = np.rint(corner).astype(int)
        self._part = slices(low, low + new.shape)

    def _joined(self, name: str) -> Float[np.ndarray, "H W"]:
        picture = getattr(self._old, name).astype(np.float32)
        picture[self._part] = getattr(self._new, name)
        return picture

    reconstruction = property(lambda self: self._joined("reconstruction"))
    background = property(lambda self: self._joined("background"))


def place(
    bodies: Sequence[Body],
    expected: Mapping[int, Line],
    suggestions: Sequence[Line],
    placed: Sequence[Line],
    reach: Sequence[float],
) -> dict[int, Line]:
    """Give bodies in doubt the suggestions that none of those placed has, the nearest to each.

    `reach` is how far each may be from where it is expected, px.
    """
    free = [x for x in suggestions if not any(drift.mostly_on(x, on, TAKEN) for on in placed)]
    pairs = list(product(bodies, free))
    lines = [drift.turned(line, expected[body.id]) for body, line in pairs]
    far = [
        drift.distance(line, expected[body.id]) + LENGTH * abs(arc_length(line)[-1] - body.length)
        for (body, _), line in zip(pairs, lines, strict=True)
    ]
    cost = np.array(far).reshape(len(bodies), len(free))
    most = np.reshape(reach, (-1, 1))
    rows, columns = linear_sum_assignment(np.minimum(cost, most))
    found = zip(rows.tolist(), columns.tolist(), strict=True)
    return {bodies[i].id: lines[i * len(free) + k] for i, k in found if cost[i, k] < reach[i]}

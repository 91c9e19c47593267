"""Find before polish: which body each sketch means."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from napari_splinesketch.engine import constants as const
from napari_splinesketch.engine import spline
from napari_splinesketch.engine.find import choice, hollow, paths, scoring, strip
from napari_splinesketch.engine.find.choice import Candidates
from napari_splinesketch.engine.find.tracing import TraceGraph, trace, without_specks
from napari_splinesketch.engine.look.band import band
from napari_splinesketch.engine.look.ridges import WIDTHS
from napari_splinesketch.engine.look.scene import Scene
from napari_splinesketch.engine.look.sketched import (
    Around,
    first_high,
    half_width_across,
    reach_of,
    ridge_profile,
)
from napari_splinesketch.engine.settings import Settings
from napari_splinesketch.engine.types import Array, Line


@dataclass(frozen=True, eq=False)
class Start:
    """Where the fit of one body begins."""

    line: Line
    """The path that was found, or the sketch where there is none."""
    found: bool
    """Whether a body was found."""
    sketch: Line
    """What was drawn, or the clicks that a careful stroke is taken for."""
    rung: int
    """Index in WIDTHS of the half-width at which the path was found."""
    half_width: float
    """Of the body, px."""
    contrast: float
    """Of the body, as a share of the scene's."""
    known: Float[Array, " F"]
    """What is known of the path, in the order of `scoring.FEATURES`."""
    margin: float = np.inf
    """What it would cost if this sketch meant another path."""
    goes_on: tuple[bool, bool] = (False, False)
    """Whether a body goes on beyond its first and beyond its last point; where such a curve ends is
    known from the sketch alone."""
    whole: bool = False
    """Whether the line is known to reach from tip to tip."""


def find(
    seen: Scene,
    sketches: list[Line],
    fixed: list[Line],
    settings: Settings,
    tick: Callable[[float], None],
) -> tuple[Scene, list[Start]]:
    """Find the path of every sketch; `fixed` are centrelines that have their bodies already.

    `tick` is called with the share of the sketches whose paths are known; it may raise `Stopped`.

    Returns
    -------
    The scene, in units of the contrast of the bodies that were found; and a start for each sketch.
    """
    seen = sized(seen, sketches)
    sketches = [
        as_clicks(sketch, seen.evidence(rung), WIDTHS[rung])
        for sketch, rung in zip(sketches, seen.rungs, strict=True)
    ]
    graph, candidates = candidates_of(seen, sketches, settings, tick)
    taken, usual = _along(graph, fixed, seen.half_width), usual_length(sketches)
    starts: dict[int, Start] = {}
    for members in choice.interacting(candidates):
        mine = [candidates[i] for i in members]
        sets, costs = choice.sets(graph, mine, seen.half_width, usual, taken)
        for i, paths_of in zip(members, sets.T, strict=True):
            margin = choice.margin(candidates[i], paths_of, costs, seen.half_width)
            starts[i] = _start(seen, sketches[i], candidates[i], int(paths_of[0]), margin)
    seen.ridges.keep(evidence={start.rung for start in starts.values()})
    return _rescaled(seen, [starts[i] for i in range(len(sketches))])


def sized(seen: Scene, sketches: list[Line]) -> Scene:
    """The scene with bodies of quite another half-width than is usual, where they clearly are.

    What is highest around a sketch may be another body, and a wide one is hit by more sketches: a
    path of the other half-width has to cost much less than one of the usual, and no ridges along it
    may be higher that are narrower. A line between two ends may pass wider bodies before its own:
    what is narrower and near it must cost no more.
    """
    rungs = list(seen.rungs)
    for i, (sketch, usual) in enumerate(zip(sketches, seen.rungs, strict=True)):
        nearby, *others = seen.others[i] or (usual,)
        if len(sketch) == 2 and nearby < usual:
            usual = min((usual, nearby), key=lambda rung: _cheapest(seen, sketch, rung)[0])
            rungs[i] = usual
        others = [rung for rung in others if abs(rung - usual) > 1]
        least = _cheapest(seen, sketch, usual)[0] if others else 0.0
        least = min(const.OTHER_COST * least, least - const.CLEAR_MARGIN)
        for rung in others if least > 0 else []:
            cost, path = _cheapest(seen, sketch, rung)
            if cost >= least:
                continue
            profile = ridge_profile(seen.ridges, path, WIDTHS[rung], range(rung + 1), seen.sign)
            if first_high(profile) >= rung - 1:
                rungs[i], least = rung, cost
    return replace(seen, rungs=tuple(rungs))


def as_clicks(sketch: Line, evidence: Float[Array, "H W"], half_width: float) -> Line:
    """A line drawn in one stroke as clicks, if it was drawn with care: along a body, to its ends.

    Where the body goes on beyond both ends, the line may have been scaled: it stays as it is, like
    one that lies on no body, and one that winds too much for so many clicks.
    """
    length = float(spline.arc_length(sketch)[-1])
    most = min(const.CLICKED[-1], int(length / const.CLICKED_APART_PX))
    if scoring.clicked(sketch) or not const.CLICKED[0] <= most < len(sketch):
        return sketch
    near, hit = scoring.close(half_width), scoring.hit(half_width, length)
    (path,) = strip.paths_along(evidence, sketch, half_width, near)
    places = spline.resample(path, const.SCORE_SAMPLES).T
    off = spline.apart(spline.resample(sketch, const.SCORE_SAMPLES), path)
    beyond = np.linalg.norm(path[[0, -1]] - sketch[[0, -1]], axis=1)
    careful = (
        np.sqrt((off**2).mean()) <= const.MOVED_HITS * hit
        and beyond.min() <= max(const.STROKE_BEYOND * length, hit)
        and scoring.unseen(scoring.seen_at(evidence, places)) <= const.UNSEEN_MOST
    )
    count = min(const.VERTICES_MOST, most)
    while careful and count <= most:
        clicks = spline.steadied(sketch, count)
        off = spline.apart(sketch, spline.resample(clicks, int(length) + 2))
        if off.max() < scoring.hit(half_width):
            return clicks
        count *= 2
    return sketch


def signs(scenes: Sequence[tuple[list[int], Scene]], sketches: list[Line]) -> list[int]:
    """1 for a bright body and -1 for a dark one, for each sketch of an image.

    Where what is around a clicked or a straight one does not tell, it means what costs clearly
    less, and the more the other bodies are alike, the more clearly. Strokes may lie far beside
    their bodies, where something of the other polarity is: where what is around most sketches does
    not tell, they all mean what costs less for them together.
    """
    look = {
        i: (seen, both)
        for members, seen in scenes
        for i, both in zip(members, seen.around, strict=True)
    }
    found = [look[i][0].sign for i in range(len(sketches))]
    told = [abs(look[i][1][0].vote) for i in range(len(sketches))]
    unclear = {i for i, vote in enumerate(told) if vote <= const.CLEAR_VOTE}
    strokes = {i for i, x in enumerate(sketches) if len(x) > 2 and not scoring.clicked(x)}
    clear = [sign for i, sign in enumerate(found) if i not in unclear]
    odds = np.log((1 + clear.count(-1)) / (1 + clear.count(1)))
    groups = [{i} for i in unclear - strokes]
    if np.median(told) <= const.CLEAR_VOTE:
        groups.append(strokes)
    for group in groups:
        more = odds + sum(_dearer(*look[i], sketches[i]) for i in sorted(group))
        for i in unclear & group if abs(more) > const.CLEAR_MARGIN else ():
            found[i] = 1 if more < 0 else -1
    return found


def _dearer(seen: Scene, both: tuple[Around, Around], sketch: Line) -> float:
    """What a path along a sketch costs more as a bright body's than as a dark one's."""
    bright, dark = (
        min(_cheapest(seen, sketch, rung, sign)[0] for rung in {one.rung, one.nearby})
        for one, sign in zip(both, (1, -1), strict=True)
    )
    return bright - dark


def least_cost(scenes: Sequence[tuple[list[int], Scene]], sketches: list[Line]) -> float:
    """What the sketches of an image cost at least, if its bodies look as its scenes say."""
    return sum(
        _cheapest(seen, sketches[i], rung)[0]
        for members, seen in scenes
        for i, rung in zip(members, seen.rungs, strict=True)
    )


def _cheapest(seen: Scene, sketch: Line, rung: int, sign: int | None = None) -> tuple[float, Line]:
    """Cost of a path along a sketch, and the path, for a body of the half-width WIDTHS[rung]."""
    evidence, half_width = seen.evidence(rung, sign), WIDTHS[rung]
    lines = _own(evidence, sketch, half_width)
    cost = scoring.cost(_known(lines, sketch, half_width, evidence))
    return float(cost.min()), lines[int(cost.argmin())]


def _own(evidence: Float[Array, "H W"], sketch: Line, half_width: float) -> list[Line]:
    """Paths along a sketch; of one of two points also between them, and last a clicked one itself.

    A clicked one is taken at its word: they are close to it.
    """
    clicked, near = scoring.clicked(sketch), reach_of(sketch, half_width)
    if clicked:
        near = min(near, scoring.close(half_width))
    found = strip.paths_along(evidence, sketch, half_width, near, between_ends=len(sketch) == 2)
    return found + [sketch] * clicked


def usual_length(sketches: list[Line]) -> float:
    """Of the bodies, as far as the sketches tell, px."""
    return float(np.median([spline.arc_length(s)[-1] for s in sketches]))


def candidates_of(
    seen: Scene, sketches: list[Line], settings: Settings, tick: Callable[[float], None]
) -> tuple[TraceGraph, list[Candidates]]:
    """Pieces of body near the sketches, and paths that each sketch may mean; see `find`."""
    graph = trace(_mask(seen, sketches), seen.half_width, usual_length(sketches))
    unseen = {rung: _unseen(graph, seen.evidence(rung)) for rung in set(seen.rungs)}
    candidates = []
    for i, rung in enumerate(seen.rungs):
        tick(i / len(sketches))
        candidates.append(_candidates(seen, graph, sketches, i, unseen[rung], settings))
    return graph, candidates


def believed(seen: Scene, sketches: list[Line]) -> list[Start]:
    """The sketches as they are, where they are known to lie on their bodies."""
    unknown = np.zeros(len(scoring.FEATURES))
    return [
        Start(sketch, True, sketch, rung, WIDTHS[rung], 1.0, unknown, whole=True)
        for sketch, rung in zip(sketches, seen.rungs, strict=True)
    ]


def _mask(seen: Scene, sketches: list[Line]) -> Bool[Array, "H W"]:
    """Pixels that are body, near the sketches and seen at the half-width of each."""
    mask = np.zeros(seen.valid.shape, dtype=bool)
    for sketch, rung in zip(sketches, seen.rungs, strict=True):
        rows, columns, inside = band(sketch, _reach(sketch, WIDTHS[rung]), seen.normal.shape)
        evidence = seen.evidence(rung)[rows, columns]
        mask[rows, columns] |= inside & (evidence > const.BODY_EVIDENCE)
    return without_specks(mask, seen.half_width)


def _reach(sketch: Line, half_width: float) -> float:
    straight = np.linalg.norm(np.diff(sketch, axis=0), axis=1).max()
    reach = max(const.GRAPH_REACH * reach_of(sketch, half_width), const.GRAPH_BOW * straight)
    return float(reach + const.GRAPH_REACH_HW * half_width)


def _candidates(
    seen: Scene,
    graph: TraceGraph,
    sketches: list[Line],
    number: int,
    unseen: Float[Array, " E"],
    settings: Settings,
) -> Candidates:
    """Paths that one sketch may mean: of the graph, along the sketch, and a clicked one itself."""
    sketch, rung = sketches[number], seen.rungs[number]
    half_width, evidence = WIDTHS[rung], seen.evidence(rung)
    traced, along = _through_graph(graph, sketch, half_width, unseen, evidence, settings)
    clicked, reach = scoring.clicked(sketch), reach_of(sketch, half_width)
    own = _own(evidence, sketch, half_width)
    smooth = const.PATH_SMOOTH_HW * half_width
    lines = spline.smoothed([*traced, *own], smooth)
    known = _known(lines, sketch, half_width, evidence)
    if clicked and scoring.cost(known).min() > const.KEPT_SKETCH - const.CLEAR_MARGIN:
        far = spline.smoothed(strip.paths_along(evidence, sketch, half_width, reach), smooth)
        if scoring.moved(sketch, far[0], half_width):
            own = [*far, *own]
            lines = [*lines[: len(traced)], *far, *lines[len(traced) :]]
            known = _known(lines, sketch, half_width, evidence)
    cost = scoring.cost(known)
    along = np.concatenate([along, [_along(graph, [line], half_width) for line in own]])
    rungs = [rung] * len(lines)
    likely = lines[int(cost.argmin())]
    if clicked:
        cost[-1] = min(cost[-1], const.KEPT_SKETCH)
    for wide, line in hollow.middles(seen, sketches, number, likely):
        more = _known([line], sketch, WIDTHS[wide], seen.evidence(wide))
        lines, rungs = [*lines, line], [*rungs, wide]
        known = np.concatenate([known, more])
        cost = np.append(cost, scoring.cost(more) + const.HOLLOW_COST * clicked)
        # It explains both of its rims.
        near = half_width if clicked else const.HOLLOW_RIM_HW * WIDTHS[wide]
        along = np.concatenate([along, [_along(graph, [line], near)]])
    order = np.argsort(cost, kind="stable")
    order = order[cost[order] < cost[order[0]] + const.PLAUSIBLE]
    explains = 0.0 if clicked else const.EXPLAINED_GAIN
    pieces = np.flatnonzero(along[order].any(0))
    return Candidates(
        tuple(lines[i] for i in order),
        cost[order],
        known[order],
        pieces,
        along[np.ix_(order, pieces)],
        tuple(rungs[i] for i in order),
        explains,
    )


def _through_graph(
    graph: TraceGraph,
    sketch: Line,
    half_width: float,
    unseen: Float[Array, " E"],
    evidence: Float[Array, "H W"],
    settings: Settings,
) -> tuple[list[Line], Bool[Array, "C E"]]:
    """Paths through the graph that a sketch may mean, and which pieces each one runs along."""
    routes = list[paths.Route]()
    if settings.traced:
        reach = _reach(sketch, half_width)
        tolerance = float(scoring.tolerance(sketch, half_width).min())
        routes = paths.routes_of_sketch(graph, unseen, sketch, half_width, reach, tolerance)
    if not routes:
        return [], np.zeros((0, len(graph.pieces)), dtype=bool)
    sampled, total = paths.sampled(graph, routes, const.SCORE_SAMPLES_ROUGH)
    cost = scoring.cost(scoring.features(sampled, total, sketch, half_width, evidence))
    best = np.argsort(cost, kind="stable")[: const.ROUTES_KEPT]
    best = best[cost[best] < cost[best[0]] + const.PLAUSIBLE]
    along = np.zeros((len(best), len(graph.pieces)), dtype=bool)
    for row, i in zip(along, best, strict=True):
        row[np.array(routes[i]) >> 1] = True
    return [paths.polyline(graph, routes[i]) for i in best], along


def _known(
    lines: list[Line], sketch: Line, half_width: float, evidence: Float[Array, "H W"]
) -> Float[Array, "C F"]:
    """(C, F) features of lines for a sketch, each sampled at SCORE_SAMPLES points."""
    sampled, length = spline.resample_each(lines, [const.SCORE_SAMPLES] * len(lines))
    return scoring.features(np.array(sampled), length, sketch, half_width, evidence)


def _unseen(graph: TraceGraph, evidence: Float[Array, "H W"]) -> Float[Array, " E"]:
    """(E,) share of each piece without evidence."""
    if not graph.pieces:
        return np.zeros(0)
    count = np.array([len(piece) for piece in graph.pieces])
    along = evidence[tuple(np.concatenate(graph.pieces).astype(int).T)]
    total = np.add.reduceat(along, np.cumsum(count) - count)
    return 1 - np.minimum(total / count / const.SURE_EVIDENCE, 1)


def _along(graph: TraceGraph, lines: list[Line], half_width: float) -> Bool[Array, " E"]:
    """(E,) which pieces lie along some lines."""
    along = np.zeros(len(graph.pieces), dtype=bool)
    if not lines:
        return along
    points = np.concatenate([spline.resample(x, 2 + int(spline.arc_length(x)[-1])) for x in lines])
    near = const.ON_BODY_HW * half_width
    beside = spline.around(graph.middles, points, near)
    along[beside] = spline.apart(graph.middles[beside], points, near) < near
    return along


def _start(seen: Scene, sketch: Line, mine: Candidates, path: int, margin: float) -> Start:
    """The start of a fit on a path: half-width and contrast are measured along it.

    `margin` is what it would cost if the sketch meant another one.
    """
    line, known, rung = mine.lines[path], mine.known[path], mine.rungs[path]
    if (
        known[scoring.FEATURES.index("unseen")] > const.UNSEEN_MOST
        or mine.cost[path] > const.IMPOSSIBLE
    ):
        return Start(sketch, False, sketch, rung, WIDTHS[rung], 1.0, known, margin)
    if scoring.clicked(sketch) and seen.background_kind != "textured":
        line = _shown(seen, line, rung)
    near = range(max(rung - 1, 0), min(rung + 2, len(WIDTHS)))
    profile = ridge_profile(seen.ridges, line, WIDTHS[rung], near, seen.sign)
    own = min(max(first_high(profile), rung - 1), near[-1])
    contrast = profile[own] / const.CREST / abs(seen.contrast)
    # From a thin beginning fewer neighbours are in reach; from a wide one the fit may not arrive.
    widest = WIDTHS[max(own, rung)]
    half_width = min(widest, half_width_across(seen.normal, line, widest))
    sampled = spline.resample(line, const.SCORE_SAMPLES)
    at = sampled.T[:, :, None]
    goes_on = scoring.goes_on(seen.evidence(rung), at, WIDTHS[rung])[:, 0]
    goes_on &= np.linalg.norm(line[0] - line[-1]) > 2 * WIDTHS[rung]  # a ring ends where it begins
    first, last = goes_on.tolist()
    return Start(line, True, sketch, rung, half_width, contrast, known, margin, (first, last))


def _shown(seen: Scene, line: Line, rung: int) -> Line:
    """A line without what lies beyond its body's ends, where the image is as dark as beside it."""
    s = spline.arc_length(line)
    step = max(const.STRIP_STEP_HW * WIDTHS[rung], const.STRIP_STEP_PX)
    at = spline.resample(line, max(12, round(float(s[-1]) / step) + 1)).T
    bright = scoring.seen_at(seen.normal, at)
    bright *= const.SHOWN / max(float(np.median(bright)), 1e-9)
    there = np.maximum(scoring.seen_at(seen.evidence(rung), at), bright.clip(0, 1))
    part = np.array(strip.ends(there, 0)) / (len(there) - 1)
    first, last = part * s[-1]
    return line[(s >= first) & (s <= last)]


def extra_costs(seen: Scene, start: Start, line: Line) -> dict[str, float]:
    """What a line costs a sketch beyond its path, for each of `scoring.FEATURES`."""
    evidence, half_width = seen.evidence(start.rung), WIDTHS[start.rung]
    known = _known([line], start.sketch, half_width, evidence)[0]
    more = (known - start.known) * const.PATH_WEIGHTS
    return dict(zip(scoring.FEATURES, more.tolist(), strict=True))


def _rescaled(seen: Scene, starts: list[Start]) -> tuple[Scene, list[Start]]:
    """The same, with intensities in units of the contrast of the bodies that were found."""
    mine = [s for s in starts if s.found]
    unit = float(np.median([s.contrast for s in mine])) if mine else 0.0
    if not 0 < unit < np.inf:
        return seen, starts
    seen = replace(
        seen,
        normal=(seen.normal / unit).astype(np.float32),
        contrast=seen.contrast * unit,
        noise=max(seen.noise / unit, 0.01),
        half_width=float(np.median([s.half_width for s in mine])),
    )
    return seen, [
        replace(s, contrast=float(np.clip(s.contrast / unit, *const.CONTRASTS))) for s in starts
    ]

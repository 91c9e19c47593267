"""Find before polish: which way through the traces each sketch means."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import ndimage
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from napari_splinesketch.engine import choice, fitting, spline, tracing
from napari_splinesketch.engine.scene import Scene
from napari_splinesketch.engine.settings import Settings
from napari_splinesketch.engine.types import Array

PATH_WEIGHT = 1.0
"""Of a path's own cost against one fully unexplained pixel, when sets of paths are compared."""
CLOSE = 3.0
"""Sets whose scores are closer than this cannot be told apart ..."""
DIFFERENT = 0.7
"""... where their curves are further apart than this, half-widths."""
SMOOTH = 1.5
"""Of traced paths, half-widths: the skeleton zigzags where bodies cross."""
EXPLAINED = 1.0
"""Pieces nearer than this many half-widths to a fixed curve are explained already."""
MOST_UNSKETCHED = 2
"""Bodies without a sketch that are looked for beside those of one cluster, at most."""

Line = Float[Array, "N 2"]


@dataclass(frozen=True, eq=False)
class Start:
    """Where the fit of one sketch begins.

    Attributes
    ----------
    line
        (N, 2) the traced path, or the sketch where there is none.
    traced
        Whether a path was found.
    ambiguous
        Whether another path explains the image about as well.
    body
        What was fitted along the line already, if anything.
    """

    line: Line
    traced: bool
    ambiguous: bool = False
    body: fitting.Body | None = None


@dataclass(frozen=True, eq=False)
class Cluster:
    """Sketches whose paths may share pieces, and the sets of paths worth a comparison.

    Attributes
    ----------
    members
        Numbers of the sketches.
    paths
        Candidates of each of them, then of bodies beside them that have no sketch.
    sets
        One path for each, best first.
    """

    members: tuple[int, ...]
    paths: list[choice.Paths]
    sets: list[tuple[int, ...]]


@dataclass(frozen=True, eq=False)
class Comparison:
    """How sets of paths are compared.

    Attributes
    ----------
    image
        (H, W) the normalised image, blurred.
    weight
        Pixels of the image that each pixel looked at stands for.
    fit
        Fits lines to that image, each within its replica of the scene, beside fixed curves given
        as (replica, number): the fitted bodies, then the fixed ones.
    """

    image: Float[Array, "H W"]
    weight: float
    fit: Callable[[list[Line], Int[Array, " n"], list[tuple[int, int]]], list[fitting.Body]]


@dataclass(frozen=True, eq=False)
class Found:
    """Where the fits begin.

    Attributes
    ----------
    starts
        One for each sketch, then one for each body beside them that nobody sketched.
    clusters
        Which of them have to be fitted together.
    """

    starts: list[Start]
    clusters: list[tuple[int, ...]]


def find(
    seen: Scene,
    sketches: list[Line],
    fixed: list[Line],
    settings: Settings,
    comparison: Comparison | None,
    tick: Callable[[float], None],
) -> Found:
    """A start for every sketch, and for what lies across them without one.

    Parameters
    ----------
    seen
        The image.
    sketches
        (N, 2) polylines.
    fixed
        Centrelines that explain their pieces already.
    settings
        How widely to look.
    comparison
        How sets of paths are compared; None takes the likeliest as they are.
    tick
        Called with the share of the sketches whose paths are known; may raise `Stopped`.
    """
    w = seen.half_width
    graph = tracing.trace(seen.mask, w)
    candidates = []
    for i, sketch in enumerate(sketches):
        tick(i / len(sketches))
        candidates.append(choice.candidate_paths(graph, sketch, w, settings.weigh, settings.paths))
    candidates = choice.without_excess(candidates, w)
    explained = _explained(graph, fixed, w)
    clusters = [
        _cluster(graph, members, [candidates[i] for i in members], w, settings, explained)
        for members in _interacting(candidates, sketches, w)
    ]
    trials = [
        Trial(number, _starts(c, row, [sketches[i] for i in c.members], w))
        for number, c in enumerate(clusters)
        for row in c.sets
    ]
    if comparison:
        trials = _fitted(trials, fixed, comparison, w)
    starts: list[Start] = [None] * len(sketches)  # type: ignore[list-item]
    together = []
    for number, cluster in enumerate(clusters):
        mine = [t for t in trials if t.cluster == number]
        drawn = [sketches[i] for i in cluster.members]
        best = mine[0].starts
        if comparison and len(mine) > 1:
            best = _best(mine, drawn, w, comparison)
        for i, start in zip(cluster.members, best, strict=False):
            starts[i] = start
        beside = best[len(drawn) :]
        together.append((*cluster.members, *range(len(starts), len(starts) + len(beside))))
        starts += beside
    return Found(starts, together)


def _cluster(
    graph: tracing.TraceGraph,
    members: tuple[int, ...],
    paths: list[choice.Paths],
    half_width: float,
    settings: Settings,
    explained: Bool[Array, " E"],
) -> Cluster:
    """The sets of paths of some sketches, with a body without a sketch where one lies across."""
    number = len(members)
    # One or two bodies leave less to be compared than three.
    keep = min(settings.sets, -(-settings.sets * (number + 1) // 4))

    def choose():
        return choice.choose_sets(graph, paths, half_width, settings.beam, keep, explained, number)

    sets = choose()
    for _ in range(MOST_UNSKETCHED):
        covered = _covered(paths, _nearest(paths, sets, number), len(explained))
        beside = choice.unexplained_beside(graph, covered, explained, half_width)
        if not beside.any():
            break
        near = beside | covered
        weigh = settings.weigh // 4
        paths.append(
            choice.unsketched_paths(graph, near, beside, half_width, weigh, settings.paths)
        )
        sets = choose()
    return Cluster(members, paths, sets)


def _nearest(
    paths: list[choice.Paths], sets: list[tuple[int, ...]], sketched: int
) -> tuple[int, ...]:
    """The set whose paths suit their sketches best, whatever it leaves unexplained."""

    def cost(row: tuple[int, ...]) -> float:
        pairs = zip(paths[:sketched], row, strict=False)
        return sum(p.cost[i] for p, i in pairs if i >= 0)

    return min(sets, key=cost)


def _covered(paths: list[choice.Paths], row: tuple[int, ...], pieces: int) -> Bool[Array, " E"]:
    """The pieces that a set of paths runs along."""
    covered = np.zeros(pieces, dtype=bool)
    for candidates, path in zip(paths, row, strict=True):
        if path >= 0:
            covered |= candidates.covers[path]
    return covered


@dataclass(frozen=True, eq=False)
class Trial:
    """One set of paths for one cluster: those of its sketches, then those without one.

    Attributes
    ----------
    cluster
        Its number.
    starts
        Where the fits begin.
    still
        Fixed curves that lie across.
    """

    cluster: int
    starts: list[Start]
    still: list[fitting.Body] = field(default_factory=list)

    @property
    def bodies(self) -> list[fitting.Body]:
        """The fitted starts."""
        return [s.body for s in self.starts if s.body is not None]


def _starts(
    cluster: Cluster, row: tuple[int, ...], sketches: list[Line], half_width: float
) -> list[Start]:
    number = len(sketches)
    starts = [
        _start(paths, path, sketch, half_width)
        for paths, path, sketch in zip(cluster.paths[:number], row, sketches, strict=False)
    ]
    beside = zip(cluster.paths[number:], row[number:], strict=True)
    lines = [paths.points[path] for paths, path in beside if path > 0]
    return starts + [Start(smoothed(line, SMOOTH * half_width), True) for line in lines]


def _start(paths: choice.Paths, path: int, sketch: Line, half_width: float) -> Start:
    if path < 0:
        return Start(sketch, False)
    return Start(smoothed(paths.points[path], SMOOTH * half_width), True)


def smoothed(line: Line, sigma: float) -> Line:
    """A polyline resampled every px and smoothed along its length; its ends stay."""
    dense = spline.resample(line, max(8, int(spline.arc_length(line)[-1]) + 1))
    before, after = 2 * dense[:1] - dense[:0:-1], 2 * dense[-1:] - dense[-2::-1]
    extended = np.concatenate([before, dense, after])
    return ndimage.gaussian_filter1d(extended, sigma, axis=0)[len(before) : -len(after)]


def _fitted(
    trials: list[Trial], fixed: list[Line], comparison: Comparison, half_width: float
) -> list[Trial]:
    """The trials with every path fitted, each trial a replica of the scene."""
    lines = [s.line for t in trials for s in t.starts]
    replica = np.repeat(np.arange(len(trials)), [len(t.starts) for t in trials])
    across: dict[int, list[int]] = {}
    for t in trials:
        met = across.setdefault(t.cluster, [])
        met += [k for k in _met(fixed, t.starts, half_width) if k not in met]
    still = [(r, k) for r, t in enumerate(trials) for k in across[t.cluster]]
    bodies = comparison.fit(lines, replica, still)
    fitted, fixed_bodies = iter(bodies[: len(lines)]), iter(bodies[len(lines) :])
    return [
        Trial(
            t.cluster,
            [replace(s, body=next(fitted)) for s in t.starts],
            [next(fixed_bodies) for _ in across[t.cluster]],
        )
        for t in trials
    ]


def _met(fixed: list[Line], starts: list[Start], half_width: float) -> list[int]:
    """Fixed curves whose surroundings overlap with those of some paths."""
    if not fixed or not starts:
        return []
    points = np.concatenate([s.line for s in starts])
    low, high = points.min(0) - 4 * half_width, points.max(0) + 4 * half_width
    return [k for k, f in enumerate(fixed) if (f.max(0) > low).all() and (f.min(0) < high).all()]


def _best(
    trials: list[Trial], sketches: list[Line], half_width: float, comparison: Comparison
) -> list[Start]:
    """The trial that explains the image best, and where another one does about as well."""
    pixels = np.unique(np.concatenate([b.pixels for t in trials for b in (*t.bodies, *t.still)]))
    values = comparison.image.ravel()[pixels]
    scores = []
    for trial in trials:
        misfit = ((values - fitting.render_at(pixels, [*trial.bodies, *trial.still])) ** 2).sum()
        costs = [
            choice.path_cost(b.points(), s, half_width)
            for b, s in zip(trial.bodies, sketches, strict=False)
        ]
        beside = trial.bodies[len(sketches) :]
        costs += [choice.unsketched_cost(b.points(), half_width) for b in beside]
        scores.append(comparison.weight * misfit + PATH_WEIGHT * sum(costs))
    order = np.argsort(scores)
    best = trials[order[0]]
    rivals = [trials[r].bodies for r in order[1:] if scores[r] < scores[order[0]] + CLOSE]
    apart = DIFFERENT * half_width
    number = len(sketches)
    return [
        replace(start, ambiguous=any(_differ(body, row[k]) > apart for row in rivals))
        for k, (start, body) in enumerate(zip(best.starts[:number], best.bodies, strict=False))
    ] + best.starts[number:]


def _differ(a: fitting.Body, b: fitting.Body) -> float:
    """Mean distance of the points of one curve from another, the larger of the two ways, px."""
    apart = np.linalg.norm(a.points()[:, None] - b.points()[None], axis=2)
    return float(max(apart.min(0).mean(), apart.min(1).mean()))


def _explained(
    graph: tracing.TraceGraph, fixed: list[Line], half_width: float
) -> Bool[Array, " E"]:
    """Which pieces lie along a fixed curve."""
    done = np.zeros(len(graph.pieces), dtype=bool)
    if not fixed or not len(done):
        return done
    middles = np.array([p[len(p) // 2] for p in graph.pieces])
    for line in fixed:
        apart = np.linalg.norm(middles[:, None] - line[None, ::2], axis=2).min(1)
        done |= apart < EXPLAINED * half_width
    return done


def _interacting(
    candidates: list[choice.Paths], sketches: list[Line], half_width: float
) -> list[tuple[int, ...]]:
    """Groups of sketches whose likely paths share pieces or pass close to each other."""
    likely = np.array(
        [p.covers[p.cost < p.cost[:1].sum() + choice.PLAUSIBLE].any(0) for p in candidates]
    )
    covers = csr_array(likely.astype(np.int32))
    linked = (covers @ covers.T).tolil()
    reach = 4 * half_width
    boxes = np.array([(s.min(0) - reach, s.max(0) + reach) for s in sketches])
    for i in np.flatnonzero(~likely.any(1)):
        touching = (boxes[i, 0] <= boxes[:, 1]).all(1) & (boxes[i, 1] >= boxes[:, 0]).all(1)
        linked[i, np.flatnonzero(touching)] = 1
    count, label = connected_components(linked, directed=False)
    return [tuple(np.flatnonzero(label == k).tolist()) for k in range(count)]

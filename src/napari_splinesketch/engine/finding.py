"""Find before polish: which way through the traces each sketch means."""

from collections.abc import Callable
from dataclasses import dataclass, replace

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
CLOSE = 5.0
"""Sets whose scores are closer than this cannot be told apart ..."""
DIFFERENT = 0.7
"""... where their curves are further apart than this, half-widths."""
SMOOTH = 1.5
"""Of traced paths, half-widths: the skeleton zigzags where bodies cross."""
EXPLAINED = 1.0
"""Pieces nearer than this many half-widths to a fixed curve are explained already."""

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
    """Sketches whose paths may share pieces, and the sets of paths worth a comparison."""

    members: tuple[int, ...]
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
        Fits lines to that image, each within its replica of the scene.
    """

    image: Float[Array, "H W"]
    weight: float
    fit: Callable[[list[Line], Int[Array, " n"]], list[fitting.Body]]


def find(
    seen: Scene,
    sketches: list[Line],
    fixed: list[Line],
    settings: Settings,
    comparison: Comparison | None,
    tick: Callable[[float], None],
) -> tuple[list[Start], list[tuple[int, ...]]]:
    """A start for every sketch, and which sketches have to be fitted together.

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
    graph = tracing.trace(tracing.body_mask(seen.normal, w), w)
    candidates = []
    for i, sketch in enumerate(sketches):
        tick(i / len(sketches))
        candidates.append(choice.candidate_paths(graph, sketch, w, settings.weigh, settings.paths))
    candidates = choice.without_excess(candidates, w)
    explained = _explained(graph, fixed, w)
    clusters = []
    for members in _interacting(candidates, sketches, w):
        paths = [candidates[i] for i in members]
        sets = choice.choose_sets(graph, paths, w, settings.beam, settings.sets, explained)
        clusters.append(Cluster(members, sets))
    trials = [
        Trial(
            number,
            row,
            [_start(candidates[i], p, sketches[i], w) for i, p in zip(c.members, row, strict=True)],
        )
        for number, c in enumerate(clusters)
        for row in c.sets
    ]
    if comparison:
        trials = _fitted(trials, comparison)
    starts: list[Start] = [None] * len(sketches)  # type: ignore[list-item]
    for number, cluster in enumerate(clusters):
        mine = [t for t in trials if t.cluster == number]
        drawn = [sketches[i] for i in cluster.members]
        best = mine[0].starts
        if comparison and len(mine) > 1:
            best = _best(mine, drawn, w, comparison)
        for i, start in zip(cluster.members, best, strict=True):
            starts[i] = start
    return starts, [c.members for c in clusters]


@dataclass(frozen=True, eq=False)
class Trial:
    """One set of paths for one cluster."""

    cluster: int
    paths: tuple[int, ...]
    starts: list[Start]

    @property
    def bodies(self) -> list[fitting.Body]:
        """The fitted starts."""
        return [s.body for s in self.starts if s.body is not None]


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


def _fitted(trials: list[Trial], comparison: Comparison) -> list[Trial]:
    """The trials with every path fitted, each trial a replica of the scene."""
    lines = [s.line for t in trials for s in t.starts]
    replica = np.repeat(np.arange(len(trials)), [len(t.starts) for t in trials])
    bodies = iter(comparison.fit(lines, replica))
    return [replace(t, starts=[replace(s, body=next(bodies)) for s in t.starts]) for t in trials]


def _best(
    trials: list[Trial], sketches: list[Line], half_width: float, comparison: Comparison
) -> list[Start]:
    """The trial that explains the image best, and where another one does about as well."""
    pixels = np.unique(np.concatenate([b.pixels for t in trials for b in t.bodies]))
    values = comparison.image.ravel()[pixels]
    scores = []
    for trial in trials:
        misfit = ((values - fitting.render_at(pixels, trial.bodies)) ** 2).sum()
        costs = [
            choice.path_cost(b.points(), s, half_width)
            for b, s in zip(trial.bodies, sketches, strict=True)
        ]
        scores.append(comparison.weight * misfit + PATH_WEIGHT * sum(costs))
    order = np.argsort(scores)
    best = trials[order[0]]
    rivals = [trials[r].bodies for r in order[1:] if scores[r] < scores[order[0]] + CLOSE]
    apart = DIFFERENT * half_width
    return [
        replace(start, ambiguous=any(_differ(body, row[k]) > apart for row in rivals))
        for k, (start, body) in enumerate(zip(best.starts, best.bodies, strict=True))
    ]


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

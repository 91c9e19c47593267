"""Find before polish: which way through the traces each sketch means."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float, Int
from scipy import ndimage

from napari_splinesketch.engine import choice, fitting, smooth_paths, spline, tracing
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
        candidates.append(
            smooth_paths.candidate_paths(graph, sketch, w, settings.weigh, settings.paths)
        )
    candidates = smooth_paths.without_excess(candidates, w)
    explained = choice.explained_by(graph, fixed, w)
    clusters = [
        choice.make_cluster(
            graph, members, [candidates[i] for i in members], w, settings, explained
        )
        for members in choice.interacting(candidates, sketches, w)
    ]
    trials = [
        Trial(number, _starts(c, row, [sketches[i] for i in c.members], w))
        for number, c in enumerate(clusters)
        for row in c.sets
    ]
    if comparison:
        compared = [len(c.members) <= choice.MOST_COMPARED for c in clusters]
        left = [t for t in trials if not compared[t.cluster]]
        trials = left + _fitted([t for t in trials if compared[t.cluster]], fixed, comparison, w)
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
    cluster: choice.Cluster, row: tuple[int, ...], sketches: list[Line], half_width: float
) -> list[Start]:
    number = len(sketches)
    starts = [
        _start(paths, path, sketch, half_width)
        for paths, path, sketch in zip(cluster.paths[:number], row, sketches, strict=False)
    ]
    beside = zip(cluster.paths[number:], row[number:], strict=True)
    lines = [paths.points[path] for paths, path in beside if path > 0]
    return starts + [Start(smoothed(line, SMOOTH * half_width), True) for line in lines]


def _start(paths: smooth_paths.Paths, path: int, sketch: Line, half_width: float) -> Start:
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
    if not trials:
        return trials
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
            smooth_paths.path_cost(b.points(), s, half_width)
            for b, s in zip(trial.bodies, sketches, strict=False)
        ]
        beside = trial.bodies[len(sketches) :]
        costs += [smooth_paths.unsketched_cost(b.points(), half_width) for b in beside]
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

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
MIXED = 3
"""So many of the best sets are improved by taking single curves from others."""
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
    scoring = _Scoring(trials, sketches, half_width, comparison)
    scored = sorted((scoring.score(m), m) for m in scoring.mixtures())
    least, best = scored[0]
    starts = [trials[t].starts[k] for k, t in enumerate(best[:-1])]
    rivals = [m for score, m in scored[1:] if score < least + CLOSE]
    apart = DIFFERENT * half_width

    def ambiguous(k: int, start: Start) -> bool:
        others = {m[k] for m in rivals} - {best[k]}
        return any(_differ(start.body, trials[t].starts[k].body) > apart for t in others)

    marked = [replace(s, ambiguous=ambiguous(k, s)) for k, s in enumerate(starts)]
    return marked + trials[best[-1]].starts[len(sketches) :]


class _Scoring:
    """How well mixtures of trials explain the image.

    A mixture says for each sketch which trial's curve is taken, and last which trial's bodies
    without a sketch.
    """

    def __init__(
        self,
        trials: list[Trial],
        sketches: list[Line],
        half_width: float,
        comparison: Comparison,
    ):
        self._count, self._number = len(trials), len(sketches)
        every = [b for t in trials for b in (*t.bodies, *t.still)]
        pixels = np.unique(np.concatenate([b.pixels for b in every]))
        self._image = comparison.image.ravel()[pixels]
        self._overlap = float(np.median([b["overlap"] for b in every]))
        self._weight = comparison.weight
        size = len(trials), self._number + 2, len(pixels)
        self._total, self._most = np.zeros((2, *size), np.float32)
        self._cost = np.zeros(size[:2])
        for t, trial in enumerate(trials):
            slots = np.minimum(np.arange(len(trial.bodies)), self._number)
            for k, body in zip(slots, trial.bodies, strict=True):
                self._draw(t, k, pixels, body)
                if k < self._number:
                    cost = smooth_paths.path_cost(body.points(), sketches[k], half_width)
                else:
                    cost = smooth_paths.unsketched_cost(body.points(), half_width)
                self._cost[t, k] += PATH_WEIGHT * cost
            for body in trial.still:
                self._draw(t, self._number + 1, pixels, body)

    def _draw(self, trial: int, slot: int, pixels: Int[Array, " P"], body: fitting.Body) -> None:
        at = np.searchsorted(pixels, body.pixels)
        self._total[trial, slot, at] += body.own
        self._most[trial, slot, at] = np.maximum(self._most[trial, slot, at], body.own)

    def score(self, mixture: tuple[int, ...]) -> float:
        """Unexplained pixels and what the paths cost."""
        chosen = [*mixture, mixture[0]], np.arange(self._number + 2)
        total, most = self._total[chosen].sum(0), self._most[chosen].max(0)
        drawn = self._overlap * most + (1 - self._overlap) * total
        misfit = ((self._image - drawn) ** 2).sum()
        return float(self._weight * misfit + self._cost[chosen].sum())

    def mixtures(self) -> set[tuple[int, ...]]:
        """Every trial by itself, and what becomes of the best when single curves are exchanged."""
        known = {(t,) * (self._number + 1): 0.0 for t in range(self._count)}
        known = {m: self.score(m) for m in known}
        for begin in sorted(known, key=known.__getitem__)[:MIXED]:
            now, better = begin, True
            while better:
                tried = {
                    (*now[:k], t, *now[k + 1 :])
                    for k in range(len(now))
                    for t in range(self._count)
                }
                for m in tried - known.keys():
                    known[m] = self.score(m)
                best = min(tried, key=known.__getitem__)
                better = known[best] < known[now] - 1e-6
                now = best if better else now
        return set(known)


def _differ(a: fitting.Body, b: fitting.Body) -> float:
    """Mean distance of the points of one curve from another, the larger of the two ways, px."""
    apart = np.linalg.norm(a.points()[:, None] - b.points()[None], axis=2)
    return float(max(apart.min(0).mean(), apart.min(1).mean()))

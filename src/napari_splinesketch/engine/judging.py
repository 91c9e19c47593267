"""Which set of paths explains the image best, when curves of several sets are mixed."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from napari_splinesketch.engine import fitting, smooth_paths
from napari_splinesketch.engine.doubt import NO_RIVAL
from napari_splinesketch.engine.trials import Comparison, Start, Trial
from napari_splinesketch.engine.types import Array

PATH_WEIGHT = 1.0
"""Of a path's own cost against one fully unexplained pixel, when sets of paths are compared."""
DIFFERENT = 0.7
"""Curves further apart than this, half-widths, are not the same."""
MIXED = 3
"""So many of the best sets are improved by taking single curves from others."""

Line = Float[Array, "N 2"]


def best_starts(
    trials: list[Trial], sketches: list[Line], half_width: float, comparison: Comparison
) -> list[Start]:
    """The mixture of trials that explains the image best, and how contested its curves are."""
    scores = _Mixer(trials, sketches, half_width, comparison).mixtures()
    scored = sorted((score, mixture) for mixture, score in scores.items())
    least, best = scored[0]
    apart = DIFFERENT * half_width

    def margin(k: int) -> float:
        same = {best[k]}
        for score, mixture in scored[1:]:
            t = mixture[k]
            if t not in same and _differ(trials[best[k]].bodies[k], trials[t].bodies[k]) > apart:
                return min(score - least, NO_RIVAL)
            same.add(t)
        return NO_RIVAL

    mixed = [replace(trials[t].starts[k], margin=margin(k)) for k, t in enumerate(best[:-1])]
    return mixed + trials[best[-1]].starts[len(sketches) :]


class _Mixer:
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

    def mixtures(self) -> dict[tuple[int, ...], float]:
        """Scores of every trial by itself, and of the best when single curves are exchanged."""
        pure = [(t,) * (self._number + 1) for t in range(self._count)]
        known = {m: self.score(m) for m in pure}
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
        return known


def _differ(a: fitting.Body, b: fitting.Body) -> float:
    """Mean distance of the points of one curve from another, the larger of the two ways, px."""
    apart = np.linalg.norm(a.points()[:, None] - b.points()[None], axis=2)
    return float(max(apart.min(0).mean(), apart.min(1).mean()))

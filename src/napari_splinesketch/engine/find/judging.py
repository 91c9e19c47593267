"""Which set of paths explains the image best, when curves of several sets are mixed."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import distance

from napari_splinesketch.engine.find import smooth_paths
from napari_splinesketch.engine.find.trials import Comparison, Start, Trial
from napari_splinesketch.engine.fit import fitting
from napari_splinesketch.engine.judge.doubt import NO_RIVAL
from napari_splinesketch.engine.types import Array

PATH_WEIGHT = 1.0
"""Of a path's own cost against one fully unexplained pixel, when sets of paths are compared."""
DIFFERENT = 0.7
"""Curves further apart than this, half-widths, are not the same."""
MIXED = 3
"""So many of the best sets are improved by taking single curves from others."""
FEW = 12
CLEAR = 2.0
ELSEWHERE = 0.7
"""So many points tell where a curve lies: elsewhere when so many half-widths from the others with
so much of it."""

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
        self._pixels, self._image = pixels, comparison.image.ravel()[pixels]
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
        self._rivals = [b for t in trials for b in t.bodies[: self._number]]
        lines = np.array([b.points() for b in self._rivals])
        self._price = [smooth_paths.unsketched_cost(line, half_width) for line in lines]
        self._far = _apart(lines).reshape(-1, *size[:1], self._number, FEW) > CLEAR * half_width

    def _draw(self, trial: int, slot: int, pixels: Int[Array, " P"], body: fitting.Body) -> None:
        at = np.searchsorted(pixels, body.pixels)
        self._total[trial, slot, at] += body.own
        self._most[trial, slot, at] = np.maximum(self._most[trial, slot, at], body.own)

    def score(self, mixture: tuple[int, ...]) -> float:
        """Unexplained pixels and what the paths cost.

        What a sketch's curve explains elsewhere, in another trial, a body without a sketch may
        explain too; otherwise whatever is strong in the image would draw curves to it.
        """
        chosen = [*mixture, mixture[0]], np.arange(self._number + 2)
        total, most = self._total[chosen].sum(0), self._most[chosen].max(0)
        drawn = self._overlap * most + (1 - self._overlap) * total
        squares = (self._image - drawn) ** 2
        far = self._far[:, mixture[:-1], np.arange(self._number)].all(1).mean(1)
        gain = 0.0
        for rival in np.flatnonzero(far > ELSEWHERE):
            body = self._rivals[rival]
            at = np.searchsorted(self._pixels, body.pixels)
            both = np.maximum(most[at], body.own), total[at] + body.own
            drawn = self._overlap * both[0] + (1 - self._overlap) * both[1]
            explained = squares[at].sum() - ((self._image[at] - drawn) ** 2).sum()
            gain = max(gain, self._weight * explained - self._price[rival])
        return float(self._weight * squares.sum() + self._cost[chosen].sum() - gain)

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


def _apart(lines: Float[Array, "R P 2"]) -> Float[Array, "R R F"]:
    """How far a few points of each curve are from each curve, px."""
    count = len(lines)
    few, more = (lines[:, :: lines.shape[1] // f].reshape(-1, 2) for f in (FEW, 2 * FEW))
    apart = distance.cdist(few, more).reshape(count, FEW, count, -1)
    return apart.min(3).transpose(0, 2, 1)


def _differ(a: fitting.Body, b: fitting.Body) -> float:
    """Mean distance of the points of one curve from another, the larger of the two ways, px."""
    apart = np.linalg.norm(a.points()[:, None] - b.points()[None], axis=2)
    return float(max(apart.min(0).mean(), apart.min(1).mean()))

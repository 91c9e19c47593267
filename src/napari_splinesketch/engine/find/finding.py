"""Find before polish: which way through the traces each sketch means."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy import ndimage

from napari_splinesketch.engine import spline
from napari_splinesketch.engine.find import choice, smooth_paths, tracing
from napari_splinesketch.engine.find.judging import best_starts
from napari_splinesketch.engine.find.trials import Comparison, Start, Trial, fitted
from napari_splinesketch.engine.look.scene import Scene
from napari_splinesketch.engine.settings import Settings
from napari_splinesketch.engine.types import Array

SMOOTH = 1.5
"""Of traced paths, half-widths: the skeleton zigzags where bodies cross."""

Line = Float[Array, "N 2"]


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
    likeliest = np.array([p.covers[:1].any(0) for p in candidates])
    claims = likeliest.sum(0)
    clusters = []
    for members in choice.interacting(candidates, sketches, w):
        # A path on a body that another sketch means would look good: nothing else is drawn there.
        elsewhere = claims > likeliest[list(members)].sum(0)
        paths = [candidates[i] for i in members]
        clusters.append(
            choice.make_cluster(graph, members, paths, w, settings, explained | elsewhere)
        )
    trials = [
        Trial(number, _starts(c, row, [sketches[i] for i in c.members], w))
        for number, c in enumerate(clusters)
        for row in c.sets
    ]
    if comparison:
        compared = [len(c.members) <= choice.MOST_COMPARED for c in clusters]
        left = [t for t in trials if not compared[t.cluster]]
        trials = left + fitted([t for t in trials if compared[t.cluster]], fixed, comparison, w)
    starts: list[Start] = [None] * len(sketches)  # type: ignore[list-item]
    together = []
    for number, cluster in enumerate(clusters):
        mine = [t for t in trials if t.cluster == number]
        drawn = [sketches[i] for i in cluster.members]
        best = mine[0].starts
        if comparison and len(mine) > 1:
            best = best_starts(mine, drawn, w, comparison)
        for i, start in zip(cluster.members, best, strict=False):
            starts[i] = start
        beside = best[len(drawn) :]
        together.append((*cluster.members, *range(len(starts), len(starts) + len(beside))))
        starts += beside
    return Found(starts, together)


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

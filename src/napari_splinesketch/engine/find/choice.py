"""Which of their candidate paths the sketches mean, chosen for all of them together."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from napari_splinesketch.engine.find.tracing import TraceGraph
from napari_splinesketch.engine.types import Array

SHARED, EXPLAINS = 14.5, 8.0
"""Cost of a path that runs along another's for all of a usual length, and what one earns that runs
along no other's: fitted by tests/benchmarks/path_weights.py."""
TAKEN = 25.0
"""Cost of a path that runs along a fixed curve for all of a usual length."""
FREE_SHARED = 4.5
"""Pieces shorter than this many half-widths may be shared for a tenth of that: bodies cross."""
PLAUSIBLE = 14.0
"""Paths that cost more than the best one of their sketch by this are not looked at."""
BEAM = 128
"""Sets of paths kept while sketch after sketch is added."""
EXPLAINED = 1.0
"""Pieces nearer than this many half-widths to a curve lie on its body."""
NO_RIVAL = 100.0
"""Margin of a curve that no other path contests."""
ELSEWHERE = 1.5
"""Half-widths between two curves that are not the same, on average."""

Line = Float[Array, "N 2"]


@dataclass(frozen=True, eq=False)
class Candidates:
    """Paths that one sketch may mean, cheapest first.

    Attributes
    ----------
    lines
        (N, 2) each.
    cost
        (C,) of each path alone.
    unseen
        (C,) share of each without evidence.
    covers
        (C, E) which pieces of the graph it runs along.
    """

    lines: tuple[Line, ...]
    cost: Float[Array, " C"]
    unseen: Float[Array, " C"]
    covers: Bool[Array, "C E"]


@dataclass(frozen=True)
class Chosen:
    """The path of one sketch.

    Attributes
    ----------
    path
        Its number among the candidates.
    margin
        By how much the best set with another path here is worse.
    """

    path: int
    margin: float


def interacting(candidates: list[Candidates]) -> list[list[int]]:
    """Groups of sketches whose plausible paths share pieces of the graph."""
    likely = np.array([c.covers.any(0) for c in candidates]).astype(np.int32)
    linked = csr_array(likely) @ csr_array(likely).T
    count, label = connected_components(linked, directed=False)
    return [np.flatnonzero(label == k).tolist() for k in range(count)]


def choose(
    graph: TraceGraph,
    candidates: list[Candidates],
    half_width: float,
    usual: float,
    taken: Bool[Array, " E"],
) -> list[Chosen]:
    """The cheapest set of one path for each of some sketches: see `sets`."""
    paths, cost = sets(graph, candidates, half_width, usual, taken)
    apart = ELSEWHERE * half_width
    return [
        Chosen(int(column[0]), _margin(mine.lines, column, cost, apart))
        for mine, column in zip(candidates, paths.T, strict=True)
    ]


def prices(
    graph: TraceGraph, half_width: float, usual: float
) -> tuple[Float[Array, " E"], Float[Array, " E"]]:
    """(E,) length of each piece, and what counts of it where paths share it, in usual lengths."""
    free = graph.bridges | (graph.lengths < FREE_SHARED * half_width)
    return graph.lengths / usual, np.where(free, 0.1, 1.0) * graph.lengths / usual


def sets(
    graph: TraceGraph,
    candidates: list[Candidates],
    half_width: float,
    usual: float,
    taken: Bool[Array, " E"],
) -> tuple[Int[Array, "S n"], Float[Array, " S"]]:
    """The cheapest sets of one path for each of some sketches, and their costs.

    Beside the paths' own costs a set pays for pieces of the graph that two of them run along.

    Parameters
    ----------
    graph
        Pieces of skeleton.
    candidates
        Of each sketch.
    half_width, usual
        Of the bodies, and their usual length, px.
    taken
        (E,) pieces that lie along a fixed curve.
    """
    used = np.flatnonzero(np.any([c.covers.any(0) for c in candidates], axis=0))
    length, price = (x[used] for x in prices(graph, half_width, usual))
    keep = TAKEN * length * (taken[used] & ~graph.bridges[used])
    earned = EXPLAINS * length
    rows = np.zeros((1, 0), dtype=int)
    covered = np.zeros((1, len(used)), np.float32)
    total = np.zeros(1)
    order = sorted(range(len(candidates)), key=lambda i: (len(candidates[i].cost), i))
    for i in order:
        mine = candidates[i]
        covers = mine.covers[:, used].astype(np.float32)
        own = mine.cost + covers @ (keep - earned * ~taken[used])
        again = (covered * (SHARED * price + earned)) @ covers.T
        extended = total[:, None] + own[None] + again
        best = np.argsort(extended, axis=None, kind="stable")[:BEAM]
        which, path = np.unravel_index(best, extended.shape)
        rows = np.concatenate([rows[which], path[:, None]], 1)
        covered = np.minimum(covered[which] + covers[path], 1)
        total = extended[which, path]
    return rows[:, np.argsort(order)], total


def _margin(lines, paths, total, apart: float) -> float:
    """By how much the best set is better than the best with a path elsewhere."""
    known: dict[int, bool] = {}
    for path, cost in zip(paths.tolist(), total.tolist(), strict=True):
        if path not in known:
            known[path] = _distance(lines[path], lines[paths[0]]) > apart
        if known[path]:
            return float(cost - total[0])
    return NO_RIVAL


def _distance(a: Line, b: Line) -> float:
    """Mean distance of the points of one path from another, the larger of the two ways, px."""
    few = (np.linspace(0, len(x) - 1, 40).astype(int) for x in (a, b))
    a, b = (x[i] for x, i in zip((a, b), few, strict=True))
    apart = np.linalg.norm(a[:, None] - b[None], axis=2)
    return float(max(apart.min(0).mean(), apart.min(1).mean()))

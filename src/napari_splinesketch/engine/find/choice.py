"""Which of their candidate paths the sketches mean, chosen for all of them together."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.cluster.hierarchy import DisjointSet

from napari_splinesketch.engine import spline
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
OTHER_PX = 1.5
"""Paths that are nearer to each other than this, px, or than a half-width, are the same."""
EXPLAINED = 1.0
"""Pieces nearer than this many half-widths to a curve lie on its body."""

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
    known
        (C, F) what is known of each, in the order of `scoring.FEATURES`.
    covers
        (C, E) which pieces of the graph it runs along.
    rungs
        Index of each one's half-width in `ridges.WIDTHS`.
    explains
        What one earns that runs along no other's, for all of a usual length: nothing where the
        sketch itself tells where its body is.
    """

    lines: tuple[Line, ...]
    cost: Float[Array, " C"]
    known: Float[Array, "C F"]
    covers: Bool[Array, "C E"]
    rungs: tuple[int, ...]
    explains: float = EXPLAINS


def interacting(candidates: list[Candidates]) -> list[list[int]]:
    """Groups of sketches whose plausible paths share pieces of the graph."""
    likely = np.array([c.covers.any(0) for c in candidates])
    mine, piece = likely.nonzero()
    groups = DisjointSet(range(len(candidates)))
    for pair in set(zip(likely.argmax(0)[piece].tolist(), mine.tolist(), strict=True)):
        groups.merge(*pair)
    return sorted(sorted(group) for group in groups.subsets())


def prices(
    graph: TraceGraph, half_width: float, usual: float
) -> tuple[Float[Array, " E"], Float[Array, " E"]]:
    """(E,) length of each piece, and what counts of it where paths share it, in usual lengths."""
    free = graph.bridges | (graph.lengths < FREE_SHARED * half_width)
    return graph.lengths / usual, np.where(free, 0.1, 1.0) * graph.lengths / usual


def eagerness(count: int) -> float:
    """Share of EXPLAINS that each of so many sketches earns that are chosen together.

    The fewer they are, the likelier are bodies without a sketch beside them, along which no path
    ought to run on.
    """
    return count / (count + 1)


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
    rows = np.zeros((1, 0), dtype=int)
    covered = np.zeros((1, len(used)), np.float32)
    total = np.zeros(1)
    order = sorted(range(len(candidates)), key=lambda i: (len(candidates[i].cost), i))
    for i in order:
        mine = candidates[i]
        covers = mine.covers[:, used].astype(np.float32)
        earned = mine.explains * eagerness(len(candidates)) * length
        own = mine.cost + covers @ (keep - earned * ~taken[used])
        again = (covered * (SHARED * price + earned)) @ covers.T
        extended = total[:, None] + own[None] + again
        best = np.argsort(extended, axis=None, kind="stable")[:BEAM]
        which, path = np.unravel_index(best, extended.shape)
        rows = np.concatenate([rows[which], path[:, None]], 1)
        covered = np.minimum(covered[which] + covers[path], 1)
        total = extended[which, path]
    return rows[:, np.argsort(order)], total


def margin(
    candidates: Candidates, chosen: Int[Array, " S"], costs: Float[Array, " S"], half_width: float
) -> float:
    """By how much the cheapest set costs more in which one sketch takes another path.

    Another one is farther from the first, on average, than a half-width. `chosen` are the paths
    that the sketch takes in sets of rising `costs`.
    """
    first, same = candidates.lines[chosen[0]], {int(chosen[0])}
    near = max(half_width, OTHER_PX)
    for path, cost in zip(chosen.tolist(), costs.tolist(), strict=True):
        if path not in same:
            other = candidates.lines[path]
            both = (first, other), (other, first)
            if any(spline.apart(*pair).mean() > near for pair in both):
                return cost - float(costs[0])
            same.add(path)
    return np.inf

"""Which of their candidate paths the sketches mean, chosen for all of them together."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.cluster.hierarchy import DisjointSet

from napari_splinesketch.engine import constants as const
from napari_splinesketch.engine import spline
from napari_splinesketch.engine.find.tracing import TraceGraph
from napari_splinesketch.engine.types import Array, Line


@dataclass(frozen=True, eq=False)
class Candidates:
    """Paths that one sketch may mean, cheapest first."""

    lines: tuple[Line, ...]
    """(N, 2) each."""
    cost: Float[Array, " C"]
    """Of each path alone."""
    known: Float[Array, "C F"]
    """What is known of each, in the order of `scoring.FEATURES`."""
    pieces: Int[Array, " P"]
    """Numbers of the graph's pieces that any of them runs along, rising."""
    covers: Bool[Array, "C P"]
    """Which of these each one runs along."""
    rungs: tuple[int, ...]
    """Index of each one's half-width in `ridges.WIDTHS`."""
    explains: float = const.EXPLAINED_GAIN
    """Gain of a path along no other's for a usual length; 0 for a clicked sketch, which says itself
    where its body is."""

    def along(self, pieces: Int[Array, " E"]) -> Float[Array, "C E"]:
        """(C, E) 1 where a path runs along one of some pieces, which rise and hold all of its."""
        found = np.zeros((len(self.cost), len(pieces)), np.float32)
        found[:, np.searchsorted(pieces, self.pieces)] = self.covers
        return found


def interacting(candidates: list[Candidates]) -> list[list[int]]:
    """Groups of sketches whose plausible paths share pieces of the graph."""
    groups, first = DisjointSet(range(len(candidates))), dict[int, int]()
    for i, mine in enumerate(candidates):
        for piece in mine.pieces.tolist():
            groups.merge(i, first.setdefault(piece, i))
    return sorted(sorted(group) for group in groups.subsets())


def prices(
    graph: TraceGraph, half_width: float, usual: float
) -> tuple[Float[Array, " E"], Float[Array, " E"]]:
    """(E,) length of each piece, and what counts of it where paths share it, in usual lengths."""
    free = graph.bridges | (graph.lengths < const.CROSSING_HW * half_width)
    return graph.lengths / usual, np.where(free, 0.1, 1.0) * graph.lengths / usual


def eagerness(count: int) -> float:
    """Share of EXPLAINED_GAIN that each of `count` sketches earns that are chosen together.

    The fewer there are, the likelier it is that bodies beside them have no sketch; no path should
    run on along those.
    """
    return count / (count + 1)


def sets(
    graph: TraceGraph,
    candidates: list[Candidates],
    half_width: float,
    usual: float,
    taken: Bool[Array, " E"],
) -> tuple[Int[Array, "S n"], Float[Array, " S"]]:
    """The cheapest ways of choosing one path for each sketch, and what they cost.

    Beside the paths' own costs a set pays for pieces of the graph that two of them run along, or
    one of them and a fixed curve: those are `taken`. Bodies are usually as long as `usual`, px.
    """
    used = np.unique(np.concatenate([c.pieces for c in candidates]))
    length, price = (x[used] for x in prices(graph, half_width, usual))
    keep = const.FIXED_COST * length * (taken[used] & ~graph.bridges[used])
    rows = np.zeros((1, 0), dtype=int)
    covered = np.zeros((1, len(used)), np.float32)
    total = np.zeros(1)
    order = sorted(range(len(candidates)), key=lambda i: (len(candidates[i].cost), i))
    for i in order:
        mine = candidates[i]
        covers = mine.along(used)
        earned = mine.explains * eagerness(len(candidates)) * length
        own = mine.cost + covers @ (keep - earned * ~taken[used])
        again = (covered * (const.SHARED_COST * price + earned)) @ covers.T
        extended = total[:, None] + own[None] + again
        best = np.argsort(extended, axis=None, kind="stable")[: const.BEAM]
        which, path = np.unravel_index(best, extended.shape)
        rows = np.concatenate([rows[which], path[:, None]], 1)
        covered = np.minimum(covered[which] + covers[path], 1)
        total = extended[which, path]
    return rows[:, np.argsort(order)], total


def margin(
    candidates: Candidates, chosen: Int[Array, " S"], costs: Float[Array, " S"], half_width: float
) -> float:
    """What the cheapest set costs more in which this sketch takes another path.

    Paths within a half-width of each other, on average, are the same. `chosen` are the paths that
    the sketch takes in sets of rising `costs`.
    """
    first, same = candidates.lines[chosen[0]], {int(chosen[0])}
    near = max(half_width, const.SAME_PATH_PX)
    for path, cost in zip(chosen.tolist(), costs.tolist(), strict=True):
        if path not in same:
            other = candidates.lines[path]
            both = (first, other), (other, first)
            if any(spline.apart(*pair).mean() > near for pair in both):
                return cost - float(costs[0])
            same.add(path)
    return np.inf

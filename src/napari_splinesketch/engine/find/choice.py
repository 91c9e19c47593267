"""Which of their candidate paths the sketches mean, chosen for all of them together."""

from dataclasses import dataclass
from itertools import zip_longest

import numpy as np
from jaxtyping import Bool, Float
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from napari_splinesketch.engine.find import smooth_paths
from napari_splinesketch.engine.find.smooth_paths import Paths
from napari_splinesketch.engine.find.tracing import TraceGraph
from napari_splinesketch.engine.settings import Settings
from napari_splinesketch.engine.types import Array

SHARED = 0.5
EAGERNESS = (1.0, 0.4)
"""Shares of UNCOVERED with which sets are looked for: the eager way explains the image, the other
one stays with the sketches; which was right the comparison tells."""
FREE_SHARED = 4.5
"""Pieces shorter than this many half-widths may be shared for little."""
PLAUSIBLE = 40.0
"""Sets that cost more than the best by this are not looked at."""
DISTINCT = 6.0
"""Half-widths of skeleton by which a curve must differ for a set to be another one."""
EXPLAINED = 1.0
"""Pieces nearer than this many half-widths to a fixed curve are explained already."""
MOST_COMPARED = 12
"""Sets of paths for more sketches than this are not compared: they differ in too few of them."""
MOST_UNSKETCHED = 2
"""Bodies without a sketch that are looked for beside those of one cluster, at most."""

Line = Float[Array, "N 2"]


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
    paths: list[Paths]
    sets: list[tuple[int, ...]]


def interacting(
    candidates: list[Paths], sketches: list[Line], half_width: float
) -> list[tuple[int, ...]]:
    """Groups of sketches whose likely paths share pieces or pass close to each other."""
    likely = np.array([p.covers[p.cost < p.cost[:1].sum() + PLAUSIBLE].any(0) for p in candidates])
    covers = csr_array(likely.astype(np.int32))
    linked = (covers @ covers.T).tolil()
    reach = 4 * half_width
    boxes = np.array([(s.min(0) - reach, s.max(0) + reach) for s in sketches])
    for i in np.flatnonzero(~likely.any(1)):
        touching = (boxes[i, 0] <= boxes[:, 1]).all(1) & (boxes[i, 1] >= boxes[:, 0]).all(1)
        linked[i, np.flatnonzero(touching)] = 1
    count, label = connected_components(linked, directed=False)
    return [tuple(np.flatnonzero(label == k).tolist()) for k in range(count)]


def make_cluster(
    graph: TraceGraph,
    members: tuple[int, ...],
    paths: list[Paths],
    half_width: float,
    settings: Settings,
    explained: Bool[Array, " E"],
) -> Cluster:
    """The sets of paths of some sketches, with a body without a sketch where one lies across."""
    number = len(members)
    # One or two bodies leave less to be compared than three.
    keep = min(settings.sets, -(-settings.sets * (number + 1) // 4))
    keep = keep if number <= MOST_COMPARED else 1

    def choose():
        return choose_sets(graph, paths, half_width, settings.beam, keep, explained, number)

    sets = choose()
    for _ in range(MOST_UNSKETCHED):
        covered = _covered(paths, _nearest(paths, sets, number), len(explained))
        beside = _unexplained_beside(graph, covered, explained, half_width)
        if not beside.any():
            break
        near = beside | covered
        weigh = settings.weigh // 4
        paths.append(
            smooth_paths.unsketched_paths(graph, near, beside, half_width, weigh, settings.paths)
        )
        sets = choose()
    return Cluster(members, paths, sets)


def _nearest(paths: list[Paths], sets: list[tuple[int, ...]], sketched: int) -> tuple[int, ...]:
    """The set whose paths suit their sketches best, whatever it leaves unexplained."""

    def cost(row: tuple[int, ...]) -> float:
        pairs = zip(paths[:sketched], row, strict=False)
        return sum(p.cost[i] for p, i in pairs if i >= 0)

    return min(sets, key=cost)


def _covered(paths: list[Paths], row: tuple[int, ...], pieces: int) -> Bool[Array, " E"]:
    """The pieces that a set of paths runs along."""
    covered = np.zeros(pieces, dtype=bool)
    for candidates, path in zip(paths, row, strict=True):
        if path >= 0:
            covered |= candidates.covers[path]
    return covered


def explained_by(graph: TraceGraph, fixed: list[Line], half_width: float) -> Bool[Array, " E"]:
    """Which pieces lie along a fixed curve."""
    done = np.zeros(len(graph.pieces), dtype=bool)
    if not fixed or not len(done):
        return done
    for line in fixed:
        apart = np.linalg.norm(graph.middles[:, None] - line[None, ::2], axis=2).min(1)
        done |= apart < EXPLAINED * half_width
    return done


def choose_sets(
    graph: TraceGraph,
    candidates: list[Paths],
    half_width: float,
    beam: int,
    keep: int,
    explained: Bool[Array, " E"],
    sketched: int | None = None,
) -> list[tuple[int, ...]]:
    """The best distinct sets of one path per body (-1 where there is none), cheapest first.

    Beside the paths' own costs a set pays for pieces of skeleton that it explains twice, and
    earns what it explains; `explained` pieces are explained already. Sets that cost far more
    than the best, or whose first `sketched` paths differ from a better one's by no more than the
    end of a body, are left out.
    """
    rows = [
        _beam(graph, candidates, half_width, beam, explained, smooth_paths.UNCOVERED * share)
        for share in EAGERNESS
    ]
    mixed = [row for pair in zip_longest(*rows) for row in pair if row is not None]
    return _distinct(graph.lengths, candidates[:sketched], mixed, DISTINCT * half_width, keep)


def _beam(
    graph: TraceGraph,
    candidates: list[Paths],
    half_width: float,
    beam: int,
    explained: Bool[Array, " E"],
    earned: float,
) -> list[tuple[int, ...]]:
    """Sets by what they cost less what they earn a px that they explain, cheapest first."""
    scale = smooth_paths.UNIT / half_width
    used = np.flatnonzero(np.any([p.covers.any(0) for p in candidates], axis=0))
    lengths = graph.lengths[used]
    reward = lengths * scale * earned
    shared = np.maximum(lengths - FREE_SHARED * half_width, 0.1 * lengths) * scale * SHARED
    chosen = np.zeros((1, 0), dtype=int)
    covered = explained[None, used].astype(float)
    cost = np.zeros(1)
    for paths in candidates:
        if not len(paths.cost):
            chosen = np.pad(chosen, ((0, 0), (0, 1)), constant_values=-1)
            continue
        mine = np.flatnonzero(paths.covers[:, used].any(0))
        covers = paths.covers[:, used[mine]].astype(float)
        before = covered[:, mine]
        gain = ((1 - before) * reward[mine]) @ covers.T
        again = (before * shared[mine]) @ covers.T
        extended = cost[:, None] + paths.cost[None] - gain + again
        best = np.argsort(extended, axis=None)[:beam]
        which, path = np.unravel_index(best, extended.shape)
        chosen = np.concatenate([chosen[which], path[:, None]], 1)
        covered = covered[which]
        covered[:, mine] = np.maximum(covered[:, mine], covers[path])
        cost = extended[which, path]
    return [tuple(row) for row in chosen[cost <= cost[0] + PLAUSIBLE].tolist()]


def _distinct(
    lengths: Float[Array, " E"],
    candidates: list[Paths],
    chosen: list[tuple[int, ...]],
    apart: float,
    keep: int,
) -> list[tuple[int, ...]]:
    """The first sets that differ from one another by pieces longer than `apart` together."""
    kept: list[tuple[int, ...]] = []
    for row in chosen:
        differ = (
            max(
                (
                    float(lengths[paths.covers[i] != paths.covers[j]].sum())
                    for paths, i, j in zip(candidates, row, other, strict=False)
                    if i >= 0
                ),
                default=0.0,
            )
            for other in kept
        )
        if all(d > apart for d in differ):
            kept.append(row)
        if len(kept) == keep:
            break
    return kept


def _unexplained_beside(
    graph: TraceGraph,
    covered: Bool[Array, " E"],
    explained: Bool[Array, " E"],
    half_width: float,
) -> Bool[Array, " E"]:
    """The pieces that hang on covered ones and that nothing explains, if they are worth a body."""
    rest = ~(covered | explained)
    beside = np.zeros(len(rest), dtype=bool)
    touched = np.zeros(len(graph.nodes), dtype=bool)
    touched[graph.ends[covered]] = True
    while True:
        more = rest & touched[graph.ends].any(1) & ~beside
        if not more.any() or graph.lengths[beside].sum() > graph.lengths[covered].sum():
            break
        beside |= more
        touched[graph.ends[more]] = True
    worth = (
        graph.lengths[beside].sum() * smooth_paths.UNIT / half_width * smooth_paths.UNCOVERED
        > smooth_paths.UNSKETCHED
    )
    return beside if worth else np.zeros_like(beside)

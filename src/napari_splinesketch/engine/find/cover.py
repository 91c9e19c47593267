"""The fewest, smoothest paths of plausible length that explain a graph of traces."""

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import LinearConstraint, milp
from scipy.sparse import csc_array, csr_array, eye_array, hstack
from scipy.sparse.csgraph import connected_components

from napari_splinesketch.engine.find.paths import Route, polyline, routes_near
from napari_splinesketch.engine.find.scoring import bends
from napari_splinesketch.engine.find.tracing import TraceGraph
from napari_splinesketch.engine.spline import arc_length, resample
from napari_splinesketch.engine.types import Array

BODY = 8.0
BENDING = 4.0
KINK = 40.0
SHARPEST = 0.3
SHORT = 0.5
LONG = 0.8
TWICE = 0.6
SHARED = 0.1
"""Costs in half-widths of skeleton left unexplained: of a body; of bending; of curvature beyond
`SHARPEST` (times the half-width); of each half-width of length missing or too many; of explaining
skeleton twice, and of doing so where bodies cross."""
PLAUSIBLE = (0.75, 1.3)
"""Lengths that cost nothing, in usual lengths of the bodies."""
LONGEST = 2.2
"""No path is longer, in usual lengths."""
UNUSUAL = 400.0
"""No path is longer where the usual length is not known, half-widths."""
CLEARLY = 0.5
"""Only chains that ask for an explanation more than this tell the usual length."""
ENOUGH = 2
"""More bodies than this tell the usual length."""
SHORTEST = 8.0
"""Chains shorter than this many half-widths tell nothing of the usual length."""
ROUTES = 300
"""Most paths looked at from each node and side."""
ALL_ROUTES = 20_000
"""The same from all nodes of one connected part."""
SAMPLES = 24
FINEST, SMOOTH = 1.0, 1.2
"""Bends are measured over so many half-widths at least, on paths smoothed over so many samples."""
GAP = 0.02
"""Share by which a set of paths may be worse than the best one."""
SECONDS = 1.0
"""Longest search for the best set in one connected part of the graph."""


def explain(
    graph: TraceGraph, weight: Float[Array, " E"], half_width: float, body: float = BODY
) -> list[Float[Array, "N 2"]]:
    """Choose the paths that explain the graph best.

    Parameters
    ----------
    graph
        Pieces of skeleton.
    weight
        (E,) how much each piece asks for an explanation, 0 to 1.
    half_width
        Typical half-width of the bodies, px.
    body
        What a body costs, in half-widths of skeleton; the more, the fewer are found.
    """
    parts = _parts(graph)
    usual = usual_length(graph, parts, weight, half_width)
    found = _explained(graph, parts, weight, half_width, body, usual)
    if usual is None and len(found) > ENOUGH:
        usual = float(np.median([arc_length(line)[-1] for line in found]))
        found = _explained(graph, parts, weight, half_width, body, usual)
    return found


def _explained(
    graph: TraceGraph,
    parts: list[Int[Array, " E"]],
    weight: Float[Array, " E"],
    half_width: float,
    body: float,
    usual: float | None,
) -> list[Float[Array, "N 2"]]:
    """Choose the paths of every part, given the usual length of the bodies, if it is known."""
    longest = LONGEST * usual if usual else UNUSUAL * half_width
    found = []
    for pieces in parts:
        routes = _routes(graph, pieces, longest)
        if routes:
            lines = [polyline(graph, route) for route in routes]
            cost = body + _cost(lines, half_width, usual)
            best = _best_set(graph, pieces, routes, cost, weight, half_width)
            found += [lines[i] for i in best]
    return found


def usual_length(
    graph: TraceGraph, parts: list[Int[Array, " E"]], weight: Float[Array, " E"], half_width: float
) -> float | None:
    """Usual length of the chains that touch no other, px; None where there are too few.

    The length that half of all chains' length is in chains longer than: specks do not count.
    """
    lengths = [
        float(graph.lengths[pieces].sum())
        for pieces in parts
        if np.average(weight[pieces], weights=graph.lengths[pieces]) > CLEARLY
        if graph.tips[graph.ends[pieces]].sum() == 2 and not graph.bridges[pieces].any()
        if len(np.unique(graph.ends[pieces])) == len(pieces) + 1
    ]
    lengths = np.sort([length for length in lengths if length > SHORTEST * half_width])
    if len(lengths) <= ENOUGH:
        return None
    return float(lengths[np.searchsorted(np.cumsum(lengths), lengths.sum() / 2)])


def _parts(graph: TraceGraph) -> list[Int[Array, " E"]]:
    """Numbers of the pieces of each connected part."""
    count = len(graph.nodes)
    if not count:
        return []
    first, second = graph.ends.T
    links = csr_array((np.ones(len(first)), (first, second)), shape=(count, count))
    label = connected_components(links, directed=False)[1][first]
    order = np.argsort(label, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(label[order])) + 1)


def _routes(graph: TraceGraph, pieces: Int[Array, " E"], longest: float) -> list[Route]:
    """Paths of one part that begin and end with a piece of body, each once."""
    near = np.zeros(len(graph.pieces), dtype=bool)
    near[pieces] = True
    nodes = np.unique(graph.ends[pieces]).tolist()
    most = min(ROUTES * len(nodes), ALL_ROUTES)
    found: dict[frozenset[int], Route] = {}
    for route in routes_near(graph, near, graph.lengths, nodes, None, longest, most):
        if not graph.bridges[route[0] >> 1]:
            found.setdefault(frozenset(step >> 1 for step in route), route)
    return list(found.values())


def _cost(
    lines: list[Float[Array, "N 2"]], half_width: float, usual: float | None
) -> Float[Array, " R"]:
    """What each path costs for its bends and its length, in half-widths."""
    drawn = np.array([resample(line, SAMPLES) for line in lines])
    total = np.array([arc_length(line)[-1] for line in lines])
    spacing = np.maximum(total / (SAMPLES - 1), FINEST * half_width)
    bending, sharpest = bends(drawn, spacing, half_width, SMOOTH)
    cost = BENDING * bending + KINK * np.maximum(sharpest - SHARPEST, 0)
    if usual:
        low, high = (factor * usual for factor in PLAUSIBLE)
        excess = SHORT * np.maximum(low - total, 0) + LONG * np.maximum(total - high, 0)
        cost = cost + excess / half_width
    return cost


def _best_set(
    graph: TraceGraph,
    pieces: Int[Array, " E"],
    routes: list[Route],
    cost: Float[Array, " R"],
    weight: Float[Array, " E"],
    half_width: float,
) -> list[int]:
    """The cheapest set of paths: a mixed-integer program of covering every piece once."""
    row = {piece: i for i, piece in enumerate(pieces.tolist())}
    size = len(pieces)
    entries = [(row[p], k) for k, route in enumerate(routes) for p in {s >> 1 for s in route}]
    at, of = np.array(entries).T
    covers = csc_array((np.ones(len(at)), (at, of)), shape=(size, len(routes)))
    lengths = graph.lengths[pieces] / half_width
    missed = lengths * np.where(graph.bridges[pieces], SHARED, weight[pieces])
    again = lengths * np.where(graph.bridges[pieces], SHARED, TWICE)
    result = milp(
        np.concatenate([cost, missed, again]),
        integrality=np.concatenate([np.ones(len(routes)), np.zeros(2 * size)]),
        constraints=LinearConstraint(
            csc_array(hstack([covers, eye_array(size), -eye_array(size)])), 1, 1
        ),
        options={"time_limit": SECONDS, "mip_rel_gap": GAP},
    )
    if result.x is None:
        return []
    return np.flatnonzero(result.x[: len(routes)] > 0.5).tolist()

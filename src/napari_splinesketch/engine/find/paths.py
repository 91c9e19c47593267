"""Paths through the graph of traces, those nearest to a sketch first."""

import heapq
from collections.abc import Iterator
from functools import cache
from itertools import chain, count

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

from napari_splinesketch.engine import constants as const
from napari_splinesketch.engine import spline
from napari_splinesketch.engine.find.tracing import TraceGraph
from napari_splinesketch.engine.types import Array, Line

Route = tuple[int, ...]
"""Steps: twice the number of a piece, and one more where it is entered at its second node."""


def routes_of_sketch(
    graph: TraceGraph,
    unseen: Float[Array, " E"],
    sketch: Line,
    half_width: float,
    reach: float,
    tolerance: float,
) -> list[Route]:
    """Routes that a sketch may mean, over pieces within `reach` px of it.

    `unseen` is the share of each piece without evidence, and `tolerance` how far sketches usually
    are from their bodies, px.
    """
    length = float(spline.arc_length(sketch)[-1])
    line = spline.resample(sketch, max(20, int(length / (2 * half_width))))
    tree = KDTree(line)
    nodes = spline.around(graph.nodes, line, reach)
    away, at = np.full(len(graph.nodes), np.inf), np.zeros(len(graph.nodes), dtype=int)
    away[nodes], at[nodes] = tree.query(graph.nodes[nodes], distance_upper_bound=reach)
    near = np.flatnonzero(np.logical_and(*(away < reach)[graph.ends.T]))
    apart = tree.query(graph.middles[near])[0]
    weight = const.ROUTE_LENGTH + const.ROUTE_UNSEEN * unseen[near] + (apart / tolerance) ** 2 / 8
    weight *= graph.lengths[near] / half_width
    nodes = np.unique(graph.ends[near])
    ahead = const.ROUTE_LENGTH * length / half_width * (1 - at[nodes] / (len(line) - 1))
    from_start = np.linalg.norm(graph.nodes[nodes] - line[0], axis=1) - 2 * graph.tips[nodes]
    likely = nodes[np.argsort(from_start, kind="stable")[: const.ROUTE_STARTS]].tolist()
    cost = dict(zip(near.tolist(), weight.tolist(), strict=True))
    rest = dict(zip(nodes.tolist(), ahead.tolist(), strict=True))
    return list(_routes_near(graph, cost, likely, rest, 3 * length + 2 * reach))


def _routes_near(
    graph: TraceGraph,
    cost: dict[int, float],
    likely: list[int],
    ahead: dict[int, float],
    longest: float,
) -> Iterator[Route]:
    """Routes without repeated pieces and without sharp turns, cheapest first from each node.

    Of those over the same pieces the first. `cost` is that of each piece that is near, `ahead` the
    least cost from each of their nodes to where a path ought to end; no route is longer than
    `longest` px.
    """
    ends, lengths, headings, bridges = graph.lists
    leaving: dict[int, list[tuple]] = {}
    for bit, (piece, price) in enumerate(cost.items()):
        for side in (0, 1):
            at, beyond = ends[piece][side], ends[piece][1 - side]
            step = 2 * piece + side, 1 << bit, price, lengths[piece], beyond, ahead[beyond]
            leaving.setdefault(at, []).append((*step, bridges[piece]))

    @cache
    def moves(came: int | None, at: int) -> list[tuple]:
        """Steps from a node, if `came` was the last that had a direction; what they cost."""
        found = []
        for step, piece, price, further, beyond, rest, bridge in leaving.get(at, ()):
            if came is not None and not bridge:
                a, b = headings[came >> 1][1 - (came & 1)], headings[step >> 1][step & 1]
                if -(a[0] * b[0] + a[1] * b[1]) < const.SHARPEST_TURN:
                    continue
            then = came if bridge else step, beyond
            found.append((step, piece, price, further, rest, then, not bridge))
        return found

    number, found = count(), set[int]()
    for start in likely:
        heap: list = [(0.0, next(number), (), (None, start), 0, 0.0, 0.0, False)]
        for _ in range(1 + const.ROUTES_MOST // len(likely)):
            if not heap:
                break
            _, _, route, here, used, spent, length, ends_here = heapq.heappop(heap)
            if ends_here and used not in found:
                found.add(used)
                yield route
            for step, piece, price, further, rest, then, directed in moves(*here):
                reached = length + further
                if not used & piece and reached <= longest:
                    paid = spent + price
                    item = (*route, step), then, used | piece, paid, reached, directed
                    heapq.heappush(heap, (paid + rest, next(number), *item))


def sampled(
    graph: TraceGraph, routes: list[Route], samples: int
) -> tuple[Float[Array, "R S 2"], Float[Array, " R"]]:
    """Every route resampled to `samples` points, and its length."""
    count = np.fromiter(map(len, routes), int, len(routes))
    steps = np.fromiter(chain.from_iterable(routes), int, count.sum())
    last = np.cumsum(count)
    # As complex numbers: row and column are interpolated at once, all routes one after the other.
    nodes, middles = (points.view(complex).ravel() for points in (graph.nodes, graph.middles))
    nodes = nodes[graph.ends].ravel()
    points = np.stack([nodes.take(steps), middles.take(steps >> 1), nodes.take(steps ^ 1)], axis=1)
    further = np.repeat(graph.lengths.take(steps >> 1)[:, None] / 2, 3, axis=1)
    further[:, 0] = 0.0
    further[last - count, 0] = 1.0
    s = further.cumsum()
    start, end = s[3 * (last - count)], s[3 * last - 1]
    target = start[:, None] + (end - start)[:, None] * np.linspace(0, 1, samples)
    found = np.interp(target, s, points.ravel())
    return found.view(float).reshape(*target.shape, 2), end - start


def polyline(graph: TraceGraph, route: Route) -> Line:
    """Points of a route."""
    parts = [graph.pieces[step >> 1][:: 1 - 2 * (step & 1)] for step in route]
    return np.concatenate([parts[0], *(p[1:] for p in parts[1:])])

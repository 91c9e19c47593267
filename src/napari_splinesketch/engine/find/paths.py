"""Paths through the graph of traces, those nearest to a sketch first."""

import heapq
from collections.abc import Iterator
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
    if not len(graph.pieces):
        return []
    line = spline.resample(sketch, max(20, int(length / (2 * half_width))))
    tree = KDTree(line)
    around = (graph.nodes > line.min(0) - reach) & (graph.nodes < line.max(0) + reach)
    nodes = np.flatnonzero(around.all(1))
    away, at = np.full(len(around), np.inf), np.zeros(len(around), dtype=int)
    away[nodes], at[nodes] = tree.query(graph.nodes[nodes], distance_upper_bound=reach)
    near = np.flatnonzero((away < reach)[graph.ends].all(1))
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
    for piece, price in cost.items():
        for side in (0, 1):
            at, beyond = ends[piece][side], ends[piece][1 - side]
            back, out = headings[piece][side], headings[piece][1 - side]
            step = 2 * piece + side, beyond, 1 << piece, price, lengths[piece]
            more = (None, None) if bridges[piece] else (back, out)
            leaving.setdefault(at, []).append((*step, *more))
    number, found = count(), set[int]()
    for start in likely:
        heap: list = [(0.0, next(number), (), start, 0, 0.0, 0.0, None, False)]
        for _ in range(1 + const.ROUTES_MOST // len(likely)):
            if not heap:
                break
            _, _, route, at, used, spent, length, heading, ends_here = heapq.heappop(heap)
            if ends_here and used not in found:
                found.add(used)
                yield route
            for step, beyond, piece, price, further, back, out in leaving.get(at, ()):
                reached = length + further
                if used & piece or reached > longest:
                    continue
                paid = spent + price
                if heading and back:
                    straight = -(heading[0] * back[0] + heading[1] * back[1])
                    if straight < const.SHARPEST_TURN:
                        continue
                    paid += const.ROUTE_TURN * (1 - straight)
                item = (*route, step), beyond, used | piece, paid, reached, out or heading
                heapq.heappush(heap, (paid + ahead[beyond], next(number), *item, back is not None))


def sampled(
    graph: TraceGraph, routes: list[Route], samples: int
) -> tuple[Float[Array, "R S 2"], Float[Array, " R"]]:
    """Every route resampled to `samples` points, and its length."""
    count = np.fromiter(map(len, routes), int, len(routes))
    there = np.arange(count.max()) < count[:, None]
    steps = np.zeros(there.shape, dtype=int)
    steps[there] = np.fromiter(chain.from_iterable(routes), int, count.sum())
    pieces, sides = steps >> 1, steps & 1
    points = np.empty((len(routes), 2 * there.shape[1] + 1, 2))
    points[:, 0] = graph.nodes[graph.ends[pieces[:, 0], sides[:, 0]]]
    points[:, 1::2] = graph.middles[pieces]
    points[:, 2::2] = graph.nodes[graph.ends[pieces, 1 - sides]]
    half = np.where(there, graph.lengths[pieces] / 2, 0.0)
    s = np.zeros(points.shape[:2])
    np.cumsum(np.repeat(half, 2, axis=1), 1, out=s[:, 1:])
    total = s[:, -1]
    target = total[:, None] * np.linspace(0, 1, samples)
    # One search in all rows: each is longer than what lies before it.
    row = np.arange(len(routes))[:, None]
    before = row * (1 + total.max())
    at = np.searchsorted((s[:, 1:] + before).ravel(), (target + before).ravel())
    at = (at.reshape(target.shape) - row * (s.shape[1] - 1)).clip(0, s.shape[1] - 2)
    at += row * s.shape[1]
    left, right = s.take(at), s.take(at + 1)
    part = ((target - left) / np.maximum(right - left, 1e-9))[:, :, None].clip(0, 1)
    points = points.reshape(-1, 2)
    return points.take(at, 0) * (1 - part) + points.take(at + 1, 0) * part, total


def polyline(graph: TraceGraph, route: Route) -> Line:
    """Points of a route."""
    parts = [graph.pieces[step >> 1][:: 1 - 2 * (step & 1)] for step in route]
    return np.concatenate([parts[0], *(p[1:] for p in parts[1:])])

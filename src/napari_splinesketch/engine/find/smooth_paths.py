"""Smooth paths through the graph of traces: the ways that a body may run."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import chain, islice

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import distance

from napari_splinesketch.engine.find.tracing import TraceGraph
from napari_splinesketch.engine.spline import arc_length, resample
from napari_splinesketch.engine.types import Array

UNIT = 3.0
"""Costs are in px for bodies of this half-width; others are scaled to it."""
REACH = (10.0, 0.4)
"""How far from its sketch a body is looked for: half-widths, share of the sketch's length."""
TURN = np.cos(np.deg2rad(110))
"""Sharpest turn at a node, as a cosine."""
STARTS = 12
"""Most nodes that the paths of one sketch start from."""
SAMPLES = 20
END_CAP = 25.0
BENDING = 16.0
KINK = 30.0
FINEST = 1.0
"""Half-widths over which a body turns, at least; within less, the skeleton's pixels do."""
SHORT = 0.5
UNCOVERED = 1.0
UNSKETCHED = 30.0
"""What a body without a sketch costs, so that none is made up for a speck."""
ENOUGH_BODIES = 4
USUAL_LENGTH = 1.25
"""With so many sketches, lengths beyond this many times the median earn nothing."""


Route = tuple[int, ...]
"""Steps: twice the number of a piece, and one more where it is entered at its second node."""
Way = tuple[Route, int]
"""A route, and the set of its pieces as the bits of a number."""


@dataclass(frozen=True, eq=False)
class Paths:
    """Candidate paths of one sketch, cheapest first.

    Attributes
    ----------
    points
        Polylines, oriented as the sketch.
    cost
        (C,) of each path alone.
    length
        (C,) px.
    covers
        (C, E) which pieces of the graph it runs along.
    """

    points: tuple[Float[Array, "N 2"], ...]
    cost: Float[Array, " C"]
    length: Float[Array, " C"]
    covers: Bool[Array, "C E"]


def candidate_paths(
    graph: TraceGraph, sketch: Float[Array, "N 2"], half_width: float, weigh: int, keep: int
) -> Paths:
    """Smooth paths near a sketch, weighed by distance, ends, bending and length.

    At most `weigh` are looked at, and the best `keep` returned.
    """
    length = arc_length(sketch)[-1]
    reach = REACH[0] * half_width + REACH[1] * length
    line = resample(sketch, SAMPLES)
    around = ((graph.nodes > line.min(0) - reach) & (graph.nodes < line.max(0) + reach)).all(1)
    around[around] = distance.cdist(graph.nodes[around], line).min(1) < reach
    near = around[graph.ends].all(1)
    from_start = np.linalg.norm(graph.nodes - line[0], axis=1) - 2 * graph.tips
    ways = list(_ways(graph, near, from_start, 3 * length + 2 * reach, weigh))
    if not ways:
        return Paths((), np.zeros(0), np.zeros(0), np.zeros((0, len(graph.ends)), bool))
    drawn, total = _sampled(graph, [route for route, _ in ways])
    cost = _cost(drawn, total, line, length, half_width)
    return _best_paths(graph, ways, cost, total, half_width, keep)


def unsketched_paths(
    graph: TraceGraph,
    near: Bool[Array, " E"],
    unexplained: Bool[Array, " E"],
    half_width: float,
    weigh: int,
    keep: int,
) -> Paths:
    """Smooth paths that a body without a sketch may take; the first of them is none at all.

    Parameters
    ----------
    graph, half_width
        As above.
    near
        (E,) pieces that it may run along.
    unexplained
        (E,) pieces at one of which it begins.
    weigh, keep
        Paths looked at, and kept.
    """
    none = Paths((np.zeros((0, 2)),), np.zeros(1), np.zeros(1), np.zeros((1, len(near)), bool))
    unlikely = np.ones(len(graph.nodes))
    unlikely[graph.ends[unexplained]] = 0
    ways = list(_ways(graph, near, unlikely - 0.5 * graph.tips, np.inf, weigh))
    if not ways:
        return none
    drawn, total = _sampled(graph, [route for route, _ in ways])
    cost = UNSKETCHED + _bending(drawn, total, half_width)
    found = _best_paths(graph, ways, cost, total, half_width, keep)
    both = (none.cost, found.cost), (none.length, found.length), (none.covers, found.covers)
    return Paths((*none.points, *found.points), *map(np.concatenate, both))


def _best_paths(
    graph: TraceGraph,
    ways: list[Way],
    cost: Float[Array, " R"],
    total: Float[Array, " R"],
    half_width: float,
    keep: int,
) -> Paths:
    once = _distinct(ways, cost)
    cost, total = cost[once], total[once]
    order = _kept(cost, cost - UNCOVERED * total * UNIT / half_width, keep)
    routes = [ways[i][0] for i in once[order]]
    covers = np.zeros((len(routes), len(graph.ends)), dtype=bool)
    for row, route in zip(covers, routes, strict=True):
        row[np.array(route) >> 1] = True
    points = tuple(_polyline(graph, route) for route in routes)
    return Paths(points, cost[order], total[order], covers)


def _distinct(ways: list[Way], cost: Float[Array, " R"]) -> Int[Array, " D"]:
    """The cheapest route of those along the same pieces, cheapest first."""
    found: dict[int, int] = {}
    for i in np.argsort(cost, kind="stable").tolist():
        found.setdefault(ways[i][1], i)
    return np.array(list(found.values()), dtype=int)


def without_excess(candidates: list[Paths], half_width: float) -> list[Paths]:
    """Make paths pay for what they are longer than the bodies of the frame usually are.

    A path that runs on into a neighbour without a sketch explains more, but not its own body.
    """
    best = [p.length[0] for p in candidates if len(p.length)]
    if len(best) < ENOUGH_BODIES:
        return candidates
    usual = USUAL_LENGTH * np.median(best)
    weight = UNCOVERED * UNIT / half_width
    return [
        _sorted(replace(p, cost=p.cost + weight * np.maximum(p.length - usual, 0)))
        for p in candidates
    ]


def _sorted(paths: Paths) -> Paths:
    order = np.argsort(paths.cost, kind="stable")
    points = tuple(paths.points[i] for i in order)
    return Paths(points, paths.cost[order], paths.length[order], paths.covers[order])


def _kept(cost: Float[Array, " R"], earned: Float[Array, " R"], keep: int) -> Int[Array, " C"]:
    """The cheapest half by cost, the other half by cost less what the path would explain."""
    best = np.argsort(cost)[: keep // 2]
    rest = [i for i in np.argsort(earned)[:keep] if i not in set(best.tolist())]
    chosen = np.concatenate([best, np.array(rest[: keep - len(best)], dtype=int)])
    return chosen[np.argsort(cost[chosen])]


def _ways(
    graph: TraceGraph,
    near: Bool[Array, " E"],
    unlikely: Float[Array, " V"],
    longest: float,
    weigh: int,
) -> Iterator[Way]:
    """Paths without repeated pieces and without sharp turns, from the likeliest nodes."""
    leaving: dict[int, list[int]] = {}
    for piece in np.flatnonzero(near).tolist():
        for side in (0, 1):
            leaving.setdefault(int(graph.ends[piece, side]), []).append(2 * piece + side)
    nodes = np.array(list(leaving), dtype=int)
    if not len(nodes):
        return
    ends, lengths, headings, bridges = graph.lists
    budget = weigh // min(STARTS, len(nodes))
    for start in nodes[np.argsort(unlikely[nodes], kind="stable")[:STARTS]].tolist():
        queue: list[tuple[Route, int, float, list[float] | None]] = [
            ((step,), 1 << (step >> 1), lengths[step >> 1], None) for step in leaving[start]
        ]
        for route, used, length, heading in islice(queue, budget):
            piece, left = route[-1] >> 1, 1 - (route[-1] & 1)
            if not bridges[piece]:
                yield route, used
                heading = headings[piece][left]
            if len(queue) >= budget:
                continue
            for step in leaving.get(ends[piece][left], ()):
                further = step >> 1
                reached = length + lengths[further]
                if used >> further & 1 or reached > longest:
                    continue
                if (
                    heading is None
                    or bridges[further]
                    or _goes_on(heading, headings[further][step & 1])
                ):
                    queue.append(((*route, step), used | 1 << further, reached, heading))


def _goes_on(out: list[float], back: list[float]) -> bool:
    """Whether a path that leaves one piece along `out` may enter one that leaves as `back`."""
    return -(out[0] * back[0] + out[1] * back[1]) > TURN


def _sampled(
    graph: TraceGraph, routes: list[Route]
) -> tuple[Float[Array, "R S 2"], Float[Array, " R"]]:
    """Every route resampled to SAMPLES points, and its length."""
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
    target = total[:, None] * np.linspace(0, 1, SAMPLES)
    # One search in all rows: each is longer than what lies before it.
    row = np.arange(len(routes))[:, None]
    before = row * (1 + total.max())
    at = np.searchsorted((s[:, 1:] + before).ravel(), (target + before).ravel())
    at = (at.reshape(target.shape) - row * (s.shape[1] - 1)).clip(0, s.shape[1] - 2)
    left, right = s[row, at], s[row, at + 1]
    part = ((target - left) / np.maximum(right - left, 1e-9))[:, :, None].clip(0, 1)
    return points[row, at] * (1 - part) + points[row, at + 1] * part, total


def path_cost(points: Float[Array, "N 2"], sketch: Float[Array, "M 2"], half_width: float) -> float:
    """What one path costs by itself for a sketch: the lower the likelier it is meant."""
    line, length = resample(sketch, SAMPLES), arc_length(sketch)[-1]
    total = np.array([arc_length(points)[-1]])
    return float(_cost(resample(points, SAMPLES)[None], total, line, length, half_width)[0])


def _cost(
    drawn: Float[Array, "R S 2"],
    total: Float[Array, " R"],
    line: Float[Array, "S 2"],
    length: float,
    half_width: float,
) -> Float[Array, " R"]:
    scale = UNIT / half_width
    apart = np.linalg.norm(drawn - line, axis=2) * scale
    ends = np.minimum(apart[:, [0, -1]].mean(1), END_CAP)
    short = np.maximum(0.85 * length - total, 0) * scale
    return apart.mean(1) + ends + _bending(drawn, total, half_width) + SHORT * short


def unsketched_cost(points: Float[Array, "N 2"], half_width: float) -> float:
    """What a body without a sketch costs."""
    total = np.array([arc_length(points)[-1]])
    return UNSKETCHED + float(_bending(resample(points, SAMPLES)[None], total, half_width)[0])


def _bending(
    drawn: Float[Array, "R S 2"], total: Float[Array, " R"], half_width: float
) -> Float[Array, " R"]:
    # The skeleton zigzags by about a half-width where bodies cross; the bodies do not.
    smooth = drawn
    for _ in range(2):
        middle = (smooth[:, :-2] + 2 * smooth[:, 1:-1] + smooth[:, 2:]) / 4
        smooth = np.concatenate([smooth[:, :1], middle, smooth[:, -1:]], axis=1)
    step = np.diff(smooth, axis=1)
    heading = np.arctan2(step[..., 1], step[..., 0])
    turn = np.abs((np.diff(heading, axis=1) + np.pi) % (2 * np.pi) - np.pi)
    spacing = np.maximum(total / (SAMPLES - 1), FINEST * half_width)[:, None]
    bend = turn * half_width / spacing
    bending = (bend**2 * spacing / half_width).sum(1)
    return BENDING * bending + KINK * np.maximum(bend.max(1) - 0.45, 0)


def _polyline(graph: TraceGraph, route: Route) -> Float[Array, "N 2"]:
    parts = [graph.pieces[step >> 1][:: 1 - 2 * (step & 1)] for step in route]
    return np.concatenate([parts[0], *(p[1:] for p in parts[1:])])

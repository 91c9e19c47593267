"""Smooth paths through the graph of traces: the ways that a body may run."""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from napari_splinesketch.engine.spline import arc_length, resample
from napari_splinesketch.engine.tracing import TraceGraph
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
SHORT = 0.5
UNCOVERED = 1.0
UNSKETCHED = 30.0
"""What a body without a sketch costs, so that none is made up for a speck."""
ENOUGH_BODIES = 4
USUAL_LENGTH = 1.25
"""With so many sketches, lengths beyond this many times the median earn nothing."""


Route = tuple[tuple[int, int], ...]
"""Pieces with the end (0 or 1) at which each is entered."""


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
    apart = np.linalg.norm(graph.nodes[:, None] - line[None], axis=2).min(1)
    near = (apart[graph.ends] < reach).all(1) if len(graph.ends) else np.zeros(0, bool)
    from_start = np.linalg.norm(graph.nodes - line[0], axis=1) - 2 * graph.tips
    routes = list(_routes(graph, near, from_start, 3 * length + 2 * reach, weigh))
    if not routes:
        return Paths((), np.zeros(0), np.zeros(0), np.zeros((0, len(graph.ends)), bool))
    drawn, total = _sampled(graph, routes)
    cost = _cost(drawn, total, line, length, half_width)
    return _best_paths(graph, routes, cost, total, half_width, keep)


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
    routes = list(_routes(graph, near, unlikely - 0.5 * graph.tips, np.inf, weigh))
    if not routes:
        return none
    drawn, total = _sampled(graph, routes)
    cost = UNSKETCHED + _bending(drawn, total, half_width)
    found = _best_paths(graph, routes, cost, total, half_width, keep)
    both = (none.cost, found.cost), (none.length, found.length), (none.covers, found.covers)
    return Paths((*none.points, *found.points), *map(np.concatenate, both))


def _best_paths(
    graph: TraceGraph,
    routes: list[Route],
    cost: Float[Array, " R"],
    total: Float[Array, " R"],
    half_width: float,
    keep: int,
) -> Paths:
    once = _distinct_routes(routes, cost)
    routes, cost, total = [routes[i] for i in once], cost[once], total[once]
    order = _kept(cost, cost - UNCOVERED * total * UNIT / half_width, keep)
    covers = np.zeros((len(order), len(graph.ends)), dtype=bool)
    for row, i in enumerate(order):
        covers[row, [piece for piece, _ in routes[i]]] = True
    points = tuple(_polyline(graph, routes[i]) for i in order)
    return Paths(points, cost[order], total[order], covers)


def _distinct_routes(routes: list[Route], cost: Float[Array, " R"]) -> Int[Array, " D"]:
    """The cheapest route of those along the same pieces, cheapest first."""
    found: dict[frozenset[int], int] = {}
    for i in np.argsort(cost, kind="stable").tolist():
        found.setdefault(frozenset(piece for piece, _ in routes[i]), i)
    return np.array(list(found.values()))


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


def _routes(
    graph: TraceGraph,
    near: Bool[Array, " E"],
    unlikely: Float[Array, " V"],
    longest: float,
    weigh: int,
) -> Iterator[Route]:
    """Paths without repeated pieces and without sharp turns, from the likeliest nodes."""
    leaving: dict[int, list[tuple[int, int]]] = {}
    for piece in np.flatnonzero(near).tolist():
        for side in (0, 1):
            leaving.setdefault(int(graph.ends[piece, side]), []).append((piece, side))
    nodes = np.array(list(leaving), dtype=int)
    if not len(nodes):
        return
    ends, lengths, headings, bridges = graph.lists
    budget = weigh // min(STARTS, len(nodes))
    for start in nodes[np.argsort(unlikely[nodes], kind="stable")[:STARTS]].tolist():
        queue: deque[tuple[Route, float, list[float] | None]] = deque(
            ((step,), lengths[step[0]], None) for step in leaving[start]
        )
        for _ in range(budget):
            if not queue:
                break
            route, length, heading = queue.popleft()
            piece, side = route[-1]
            if not bridges[piece]:
                yield route
                heading = headings[piece][1 - side]
            used = {p for p, _ in route}
            for step in leaving.get(ends[piece][1 - side], ()):
                reached = length + lengths[step[0]]
                if step[0] in used or reached > longest:
                    continue
                if (
                    bridges[step[0]]
                    or heading is None
                    or _goes_on(heading, headings[step[0]][step[1]])
                ):
                    queue.append(((*route, step), reached, heading))


def _goes_on(out: list[float], back: list[float]) -> bool:
    """Whether a path that leaves one piece along `out` may enter one that leaves as `back`."""
    return -(out[0] * back[0] + out[1] * back[1]) > TURN


def _sampled(
    graph: TraceGraph, routes: list[Route]
) -> tuple[Float[Array, "R S 2"], Float[Array, " R"]]:
    """Every route resampled to SAMPLES points, and its length."""
    middle = np.array([p[len(p) // 2] for p in graph.pieces])
    longest = max(map(len, routes))
    pieces = np.full((len(routes), longest), -1)
    sides = np.zeros((len(routes), longest), dtype=int)
    for i, route in enumerate(routes):
        pieces[i, : len(route)], sides[i, : len(route)] = np.array(route).T
    there = pieces >= 0
    points = np.empty((len(routes), 2 * longest + 1, 2))
    points[:, 0] = graph.nodes[graph.ends[pieces[:, 0], sides[:, 0]]]
    points[:, 1::2] = middle[pieces]
    points[:, 2::2] = graph.nodes[graph.ends[pieces, 1 - sides]]
    half = np.where(there, graph.lengths[pieces] / 2, 0.0)
    s = np.concatenate([np.zeros((len(routes), 1)), np.cumsum(np.repeat(half, 2, axis=1), 1)], 1)
    total = s[:, -1]
    target = total[:, None] * np.linspace(0, 1, SAMPLES)
    at = (s[:, None, 1:] < target[:, :, None]).sum(2).clip(0, s.shape[1] - 2)
    left, right = np.take_along_axis(s, at, 1), np.take_along_axis(s, at + 1, 1)
    part = ((target - left) / np.maximum(right - left, 1e-9))[:, :, None].clip(0, 1)
    rows = np.arange(len(routes))[:, None]
    return points[rows, at] * (1 - part) + points[rows, at + 1] * part, total


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
    spacing = np.maximum(total / (SAMPLES - 1), 1e-6)[:, None]
    bend = turn * half_width / spacing
    bending = (bend**2 * spacing / half_width).sum(1)
    return BENDING * bending + KINK * np.maximum(bend.max(1) - 0.45, 0)


def _polyline(graph: TraceGraph, route: Route) -> Float[Array, "N 2"]:
    parts = [graph.pieces[p] if side == 0 else graph.pieces[p][::-1] for p, side in route]
    return np.concatenate([parts[0], *(p[1:] for p in parts[1:])])

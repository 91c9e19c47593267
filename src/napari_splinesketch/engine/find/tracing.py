"""From an image to a graph whose edges are pieces of body: threshold, skeleton, split, prune."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree
from skimage.morphology import remove_small_objects, skeletonize

from napari_splinesketch.engine import constants as const
from napari_splinesketch.engine.spline import arc_length
from napari_splinesketch.engine.types import Array


@dataclass(frozen=True, eq=False)
class TraceGraph:
    """Pieces of skeleton between nodes."""

    nodes: Float[Array, "V 2"]
    """Row, col of ends, junctions and splits."""
    tips: Bool[Array, " V"]
    """Whether the node is a free end of the skeleton."""
    pieces: tuple[Float[Array, "N 2"], ...]
    """Polylines, (N, 2) each, from the first to the second node of `ends`."""
    ends: Int[Array, "E 2"]
    """Node numbers."""
    lengths: Float[Array, " E"]
    """Arc lengths, px."""
    headings: Float[Array, "E 2 2"]
    """Unit vectors leaving the piece at its first and at its second node."""
    bridges: Bool[Array, " E"]
    """Short pieces between two junctions: where bodies cross, the skeleton runs along them in a
    direction that is no body's."""

    @cached_property
    def lists(self) -> tuple[list, list, list, list]:
        """Ends, lengths, headings and bridges as lists, for loops in Python."""
        arrays = (self.ends, self.lengths, self.headings, self.bridges)
        ends, lengths, headings, bridges = (a.tolist() for a in arrays)
        return ends, lengths, headings, bridges

    @cached_property
    def middles(self) -> Float[Array, "E 2"]:
        """(E, 2) points half way along the pieces."""
        return np.array([piece[len(piece) // 2] for piece in self.pieces]).reshape(-1, 2)


def trace(mask: Bool[Array, "H W"], half_width: float, usual: float = 0.0) -> TraceGraph:
    """The graph of the skeleton of a body mask, with straight links across its gaps.

    Every length scales with the bodies' typical half-width; `usual` is their usual length, px, as
    far as it is known.
    """
    chains = traced(mask, half_width)
    degree = _degrees(chains)

    number: dict[tuple, int] = {}
    pieces, ends, bridges = [], [], []
    longest = max(const.PIECE_HW * half_width, usual / const.PIECES_A_BODY)
    for chain in chains:
        crossing = degree[tuple(chain[0])] > 2 and degree[tuple(chain[-1])] > 2
        short = arc_length(chain)[-1] < const.BRIDGE_HW * half_width
        for piece in _split(chain.astype(float), longest):
            a, b = tuple(piece[0]), tuple(piece[-1])
            ends.append([number.setdefault(a, len(number)), number.setdefault(b, len(number))])
            pieces.append(piece)
            bridges.append(crossing and short)
    nodes = np.array(list(number), dtype=float).reshape(-1, 2)
    tips = np.array([degree[node] == 1 for node in number], dtype=bool)
    _, headings, _, lengths = ends_of(pieces, half_width)
    gaps = _gaps(nodes, tips, ends, headings, const.GAP_HW * half_width)
    if gaps:
        pieces += list(nodes[gaps])
        _, across, _, far = ends_of(pieces[-len(gaps) :], half_width)
        headings, lengths = np.concatenate([headings, across]), np.append(lengths, far)
        ends, bridges = ends + gaps, bridges + [False] * len(gaps)
    return TraceGraph(
        nodes,
        tips,
        tuple(pieces),
        np.array(ends, dtype=int).reshape(-1, 2),
        lengths,
        headings,
        np.array(bridges, dtype=bool),
    )


def without_specks(mask: Bool[Array, "H W"], half_width: float) -> Bool[Array, "H W"]:
    """A mask without patches that are too small to be bodies."""
    least = int(max(const.SPECK * half_width**2, const.SPECK_PIXELS))
    return remove_small_objects(mask, max_size=least)


def _gaps(nodes, tips, ends, headings, reach: float) -> list[tuple[int, int]]:
    """Pairs of nodes between which a body may go on unseen: what a free end points at."""
    if tips.sum() < 1 or len(nodes) < 3:
        return []
    out: dict[int, list[Float[Array, 2]]] = {}
    beside: dict[int, set[int]] = {}
    for pair, both in zip(ends, headings, strict=True):
        for node, heading in zip(pair, both, strict=True):
            out.setdefault(node, []).append(heading)
            beside.setdefault(node, set()).update(pair)
    tree, found = KDTree(nodes), set()
    for tip in np.flatnonzero(tips).tolist():
        likely = []
        for other in tree.query_ball_point(nodes[tip], reach):
            apart = nodes[other] - nodes[tip]
            distance = float(np.linalg.norm(apart))
            if other in beside[tip] or distance == 0:
                continue
            ahead = float(out[tip][0] @ apart) / distance
            facing = max(-float(heading @ apart) / distance for heading in out[other])
            if ahead > const.GAP_AHEAD and (not tips[other] or facing > const.GAP_FACING):
                likely.append((distance * (2 - ahead), other))
        for _, other in sorted(likely)[: const.GAPS_AN_END]:
            found.add((min(tip, other), max(tip, other)))
    return sorted(found)


def ends_of(
    chains: Sequence[Float[Array, "N 2"]], half_width: float, askew: float = 0.0
) -> tuple[Float[Array, "E 2 2"], Float[Array, "E 2 2"], Int[Array, "E 2"], Float[Array, " E"]]:
    """First and last points of chains, unit vectors that point out there, and the chains' lengths.

    What is within `askew` px of an end, a quarter of the chain at most, is left out; third comes
    how many points that are.
    """
    if not chains:
        return np.zeros((0, 2, 2)), np.zeros((0, 2, 2)), np.zeros((0, 2), dtype=int), np.zeros(0)
    points, last = np.concatenate(chains), np.cumsum([len(chain) for chain in chains]) - 1
    first, s = np.append(0, last[:-1] + 1), arc_length(points)

    def within(away: float | Float[Array, " E"]) -> Int[Array, "E 2"]:
        after = np.searchsorted(s, s[first] + away)
        before = np.searchsorted(s, s[last] - away, side="right") - 1
        return np.clip([after, before], first, last).T

    length = s[last] - s[first]
    at = within(np.minimum(askew, length / 4))
    out = points[at] - points[within(askew + const.HEADING_HW * half_width)]
    out /= np.linalg.norm(out, axis=2, keepdims=True) + 1e-9
    return points[at], out, np.abs(at - np.stack([first, last], axis=1)), length


def _split(chain: Float[Array, "N 2"], longest: float) -> list[Float[Array, "N 2"]]:
    """Equal parts of a chain, none much longer than `longest`."""
    s = arc_length(chain)
    parts = max(1, round(s[-1] / longest))
    cuts = np.searchsorted(s, np.linspace(0, s[-1], parts + 1)[1:-1])
    cuts = [0, *cuts, len(chain) - 1]
    return [chain[a : b + 1] for a, b in pairwise(cuts) if b > a]


def _chains(skeleton: Bool[Array, "H W"]) -> Iterator[Int[Array, "N 2"]]:
    """Pixel chains between pixels that do not have two neighbours, and closed loops."""
    pixels, links, degree = _links(skeleton)
    one, two, degrees = links[:, 0].tolist(), links[:, 1].tolist(), degree.tolist()
    seen: set[tuple[int, int]] = set()
    visited = np.zeros(len(pixels), dtype=bool)

    def beginning_at(start: int) -> Iterator[Int[Array, "N 2"]]:
        for step in links[start, : degrees[start]].tolist():
            if (start, step) in seen:
                continue
            before, at, chain = start, step, [start, step]
            while degrees[at] == 2 and at != start:
                before, at = at, two[at] if one[at] == before else one[at]
                chain.append(at)
            seen.update([(start, step), (at, before)])
            numbers = np.array(chain)
            visited[numbers] = True
            yield pixels[numbers]

    for start in np.flatnonzero((degree != 0) & (degree != 2)).tolist():
        yield from beginning_at(start)
    for start in np.flatnonzero((degree == 2) & ~visited).tolist():
        if not visited[start]:
            yield from beginning_at(start)


def _links(
    skeleton: Bool[Array, "H W"],
) -> tuple[Int[Array, "N 2"], Int[Array, "N 8"], Int[Array, " N"]]:
    """Skeleton pixels, the numbers of their neighbours, and how many of the eight there are.

    Diagonals that cut a corner are left out.
    """
    pixels = np.argwhere(skeleton)
    index = np.full((skeleton.shape[0] + 2, skeleton.shape[1] + 2), -1, np.int32)
    r, c = pixels.T + 1
    index[r, c] = np.arange(len(pixels))
    straight = [(0, 1), (1, 0), (0, -1), (-1, 0)]
    found = [index[r + dr, c + dc] for dr, dc in straight]
    for dr, dc in [(1, 1), (1, -1), (-1, -1), (-1, 1)]:
        corner = (index[r + dr, c] < 0) & (index[r, c + dc] < 0)
        found.append(np.where(corner, index[r + dr, c + dc], -1))
    links = np.stack(found, axis=1)
    there = links >= 0
    return pixels, np.take_along_axis(links, np.argsort(~there, 1, kind="stable"), 1), there.sum(1)


def traced(mask: Bool[Array, "H W"], half_width: float) -> list[Int[Array, "N 2"]]:
    """The chains of a mask's skeleton without short ones that hang on a junction."""
    skeleton = skeletonize(mask)
    chains = list(_chains(skeleton))
    degree = _degrees(chains)
    kept = skeleton.copy()
    for chain in chains:
        first, last = degree[tuple(chain[0])], degree[tuple(chain[-1])]
        spur = min(first, last) == 1 and max(first, last) > 2
        if spur and arc_length(chain)[-1] < const.SPUR_HW * half_width:
            free = chain[:-1] if first == 1 else chain[1:]
            kept[tuple(free.T)] = False
    return chains if kept.sum() == skeleton.sum() else list(_chains(kept))


def _degrees(chains: list[Int[Array, "N 2"]]) -> Counter[tuple]:
    """How many chains end at a pixel."""
    return Counter(tuple(end) for chain in chains for end in (chain[0], chain[-1]))

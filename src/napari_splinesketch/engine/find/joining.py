"""From pieces of skeleton to whole lines: each end goes on in the piece that it points at."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int
from scipy.cluster.hierarchy import DisjointSet
from scipy.spatial import KDTree

from napari_splinesketch.engine import constants as const
from napari_splinesketch.engine.find.tracing import ends_of
from napari_splinesketch.engine.spline import arc_length, resample
from napari_splinesketch.engine.types import Array, Line


def joined(
    skeleton: list[Int[Array, "N 2"]], evidence: Float[Array, "H W"], half_width: float
) -> list[Line]:
    """Lines of a skeleton's chains, cut where they kink and joined where they go on.

    Where bodies cross, or evidence has a gap, the cheapest joins are made first, and every end is
    joined once.
    """
    chains = [part for whole in skeleton for part in _unkinked(whole.astype(float), half_width)]
    if not chains:
        return []
    ends, out, askew, _ = ends_of(chains, half_width, const.CROOKED_HW * half_width)
    joins = _joins(ends.reshape(-1, 2), out.reshape(-1, 2), evidence, half_width)
    mate, lines = dict[int, int](), DisjointSet(range(len(chains)))
    for _, i, j in sorted(joins):
        if i not in mate and j not in mate and lines.merge(i >> 1, j >> 1):
            mate[i], mate[j] = j, i
    return list(_walked(chains, mate, askew.ravel().tolist()))


def _walked(chains: list[Line], mate: dict[int, int], left_out: list[int]) -> Iterator[Line]:
    """The chains from each free end on; where they are joined, so many points are `left_out`.

    End 2i is the first of chain i, and 2i + 1 its last.
    """
    reached = set[int]()
    for end in range(2 * len(chains)):
        if end in mate or end in reached:
            continue
        parts, at, last = [], end, end
        while at is not None:
            last = at ^ 1
            begin, beyond = (left_out[side] if side in mate else 0 for side in (at, last))
            chain = chains[at >> 1][:: 1 - 2 * (at & 1)]
            parts.append(chain[begin : len(chain) - beyond])
            at = mate.get(last)
        reached.add(last)
        yield np.concatenate(parts)


def _unkinked(chain: Line, half_width: float) -> list[Line]:
    """A chain in parts, none of which turns sharply."""
    length = arc_length(chain)[-1]
    count = int(length / (const.KINK_STEP_HW * half_width)) + 1
    away = round(const.KINK_HW / const.KINK_STEP_HW)
    if count < 2 * away + 3:
        return [chain]
    points = resample(chain, count)
    ahead = points[away:] - points[:-away]
    ahead /= np.linalg.norm(ahead, axis=1)[:, None] + 1e-9
    turn = np.arccos(np.clip((ahead[away:] * ahead[:-away]).sum(1), -1, 1))
    cuts = [0, count - 1]
    while turn.max() > const.KINK_RAD:
        sharpest = int(turn.argmax())
        cuts.append(sharpest + away)
        turn[max(0, sharpest - away) : sharpest + away + 1] = 0
    return [points[a : b + 1] for a, b in pairwise(sorted(cuts))]


def _joins(
    ends: Float[Array, "E 2"],
    out: Float[Array, "E 2"],
    evidence: Float[Array, "H W"],
    half_width: float,
) -> list[tuple[float, int, int]]:
    """Cost of every join of two ends that is possible, and the ends; `out` points out of them."""
    pairs = KDTree(ends).query_pairs(const.JOIN_HW * half_width, output_type="ndarray")
    one, two = pairs[pairs[:, 0] >> 1 != pairs[:, 1] >> 1].T
    between = ends[two] - ends[one]
    far = np.linalg.norm(between, axis=1)
    ahead = between / np.maximum(far, 1e-9)[:, None]
    turns = _angle(out[one], -out[two]), _angle(out[one], ahead), _angle(ahead, -out[two])
    turn = np.max(turns, axis=0)
    share = np.linspace(0, 1, 1 + int(2 * const.JOIN_HW))
    points = ends[one, None] + share[None, :, None] * between[:, None]
    seen = evidence[tuple(np.rint(points).astype(int).transpose(2, 0, 1))]
    unseen = 1 - np.minimum(seen / const.JOIN_SEEN, 1).mean(1)
    cost = const.JOIN_TURN * turn**2 + far / half_width * (
        const.JOIN_FAR + const.JOIN_UNSEEN * unseen
    )
    good = (turn < const.JOIN_RAD) & (cost < const.JOIN_MOST)
    return list(zip(cost[good].tolist(), one[good].tolist(), two[good].tolist(), strict=True))


def _angle(one: Float[Array, "N 2"], two: Float[Array, "N 2"]) -> Float[Array, " N"]:
    return np.arccos(np.clip((one * two).sum(1), -1, 1))

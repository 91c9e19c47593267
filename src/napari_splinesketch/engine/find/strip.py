"""Paths along the sketch: the image straightened along it, and the cheapest ways through that."""

import numpy as np
from jaxtyping import Float, Int
from scipy import ndimage
from skimage.graph import MCP_Geometric

from napari_splinesketch.engine import constants as const
from napari_splinesketch.engine import spline
from napari_splinesketch.engine.types import Array, Line


def paths_along(
    evidence: Float[Array, "H W"],
    sketch: Line,
    half_width: float,
    reach: float,
    *,
    between_ends: bool = False,
) -> list[Line]:
    """The path with the most evidence that runs along a sketch, within `reach` px of it.

    Dynamic programming over offsets across the sketch (the path is a function of the arc length of
    the sketch), with a cost for tilt and for distance; the ends are where evidence stops, near the
    sketch's own. Where the sketch's ends are the body's, a path `between_ends` comes second: the
    minimal path from end to end (Cohen and Kimmel 1997).
    """
    length = spline.arc_length(sketch)[-1]
    along, across = (
        max(const.STRIP_STEP_HW * half_width, const.STRIP_STEP_PX),
        max(const.STRIP_ACROSS_HW * half_width, const.STRIP_ACROSS_PX),
    )
    count = max(12, round(length / along) + 1)
    along = length / (count - 1)
    extra = int(np.ceil(const.STRIP_BEYOND * length / along)) + 3
    points, normal = frame(sketch, count, extra, along, 0.3 * reach)
    half = int(np.ceil(reach / across))
    offsets = across * np.arange(-half, half + 1)
    at = points[:, None] + offsets[None, :, None] * normal[:, None]
    seen = ndimage.map_coordinates(evidence, at.transpose(2, 0, 1), order=1, cval=0.0)
    cost = (1 - seen) + const.STRIP_ASTRAY * (offsets / reach) ** 2
    for beyond in (cost[:extra], cost[-extra:]):
        np.minimum(beyond, const.STRIP_EXTRA_MOST, out=beyond)
    steepest = max(2, int(np.ceil(const.STRIP_STEEPEST * along / across)))
    best = _cheapest(cost, steepest, const.STRIP_TILT * (across / along) ** 2)
    ways = np.arange(len(best)), best
    first, last = ends(seen[ways], extra)
    found = [at[ways][first : last + 1]]
    if between_ends:
        cost = 1 / (const.MINIMAL_FLOOR + seen.astype(np.float64))
        first, last = ((row, half) for row in (extra, extra + count - 1))
        search = MCP_Geometric(cost, sampling=(along, across))
        search.find_costs([first], [last])
        ways = tuple(np.transpose(search.traceback(last)))
        first, last = ends(seen[ways], 0)
        found.append(at[ways][first : last + 1])
    return found


def frame(
    sketch: Line, count: int, extra: int, along: float, smooth: float
) -> tuple[Float[Array, "S 2"], Float[Array, "S 2"]]:
    """`count` points every `along` px on a sketch, `extra` ones beyond its ends, and unit normals.

    They are of the sketch smoothed over `smooth` px.
    """
    points = spline.resample(sketch, count)
    soft = ndimage.gaussian_filter1d(points, max(1.0, smooth / along), axis=0, mode="nearest")
    tangent = spline.tangents(soft)
    steps = along * np.arange(1, extra + 1)[:, None]
    before, after = points[0] - tangent[0] * steps[::-1], points[-1] + tangent[-1] * steps
    tangent = tangent.take(np.arange(-extra, count + extra), axis=0, mode="clip")
    return np.concatenate([before, points, after]), tangent[:, ::-1] * [-1.0, 1.0]


def _cheapest(cost: Float[Array, "S T"], steepest: int, tilt: float) -> Int[Array, " S"]:
    """Columns of the cheapest way from the first row to the last (Viterbi)."""
    rows, columns = cost.shape
    price = tilt * np.arange(-steepest, steepest + 1.0) ** 2
    total = np.full((rows, columns + 2 * steepest), np.inf)
    inside = total[:, steepest:-steepest]
    inside[:] = cost
    before = np.lib.stride_tricks.sliding_window_view(total, columns, axis=1)
    for all_ways, row in zip(before, inside[1:], strict=False):
        row += np.minimum.reduce(all_ways + price[:, None])
    found = [int(inside[-1].argmin())]
    for row in total[-2::-1]:
        ways = row[found[-1] : found[-1] + len(price)] + price
        found.append(found[-1] + int(ways.argmin()) - steepest)
    return np.array(found[::-1])


def ends(seen: Float[Array, " S"], extra: int) -> tuple[int, int]:
    """First and last step: what is seen between them pays, what is left out of the sketch costs."""
    gained = np.concatenate([[0.0], np.cumsum(seen - const.STRIP_SEEN)])
    count, middle = len(seen), len(seen) // 2
    first = np.arange(middle)
    a = int(np.argmin(gained[first] + _price(extra - first)))
    last = np.arange(middle, count)
    b = middle + int(np.argmax(gained[last + 1] - _price(last - (count - 1 - extra))))
    return a, b


def _price(outside: Int[Array, " n"]) -> Float[Array, " n"]:
    """What a path costs that begins or ends so many steps outside of its sketch."""
    return np.where(outside > 0, const.STRIP_EXTRA * outside, -const.STRIP_LEFT_OUT * outside)

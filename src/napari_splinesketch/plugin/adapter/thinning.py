"""Lines with only as many points as the eye sees: napari's time grows with their number."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

SEEN = 0.03
"""How far a drawn line may lie from the curve, px."""


def thinned(lines: Sequence[Float[np.ndarray, "_ 2"]]) -> list[Float[np.ndarray, "_ 2"]]:
    """Leave out the points that lie within `SEEN` of the line through the others.

    What Douglas and Peucker do, for all lines at once. The ends stay.

    Parameters
    ----------
    lines
        (row, col) of each line's points, px; closed lines end where they begin.
    """
    if not lines:
        return []
    points = np.concatenate(lines)
    last = np.cumsum([len(line) for line in lines])
    keep = np.zeros(len(points), dtype=bool)
    keep[last - 1] = keep[np.append(0, last[:-1])] = True
    while True:
        more = _farthest(points, keep)
        if not more.any():
            break
        keep |= more
    return [line[kept] for line, kept in zip(lines, np.split(keep, last[:-1]), strict=True)]


def _farthest(
    points: Float[np.ndarray, "P 2"], keep: Bool[np.ndarray, " P"]
) -> Bool[np.ndarray, " P"]:
    """Of each stretch between two kept points, find the farthest that may not be left out."""
    corners = np.flatnonzero(keep)
    stretch = np.cumsum(keep) - 1
    begin = points[corners]
    along = np.append(begin[1:], begin[-1:], axis=0) - begin
    length = (along**2).sum(axis=1)
    off, way = points - begin[stretch], along[stretch]
    share = (off * way).sum(axis=1) / np.where(length, length, 1.0)[stretch]
    apart = np.linalg.norm(off - np.clip(share, 0, 1)[:, None] * way, axis=1)
    # A kept point is its own stretch's first, at no distance.
    most = np.maximum.reduceat(apart, corners)
    found = np.flatnonzero((apart > SEEN) & (apart == most[stretch]))
    first = found[np.unique(stretch[found], return_index=True)[1]]
    more = np.zeros(len(points), dtype=bool)
    more[first] = True
    return more

"""Where a body may have gone that is not where it was carried to."""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from napari_splinesketch.engine.spline import arc_length, resample
from napari_splinesketch.tracking.bodies import Body
from napari_splinesketch.tracking.drift import distance
from napari_splinesketch.tracking.types import Line

SAMPLES = 16
REACH = 0.6
"""How far a body may have gone, as a share of its length."""
LENGTH = 0.5
"""What a px of difference in length costs, in px of distance."""
TAKEN = 2.0
"""A suggestion that lies so near to a placed curve is taken, px."""


def place(
    bodies: Sequence[Body],
    expected: Mapping[int, Line],
    suggestions: Sequence[Line],
    placed: Sequence[Line],
) -> dict[int, Line]:
    """Give bodies in doubt the suggestions that no other body has, the nearest to each.

    Parameters
    ----------
    bodies
        Those in doubt.
    expected
        Where each of them is expected, by number.
    suggestions
        What stands out in the frame.
    placed
        Lines of the bodies that are not in doubt.
    """
    free = [line for line in suggestions if not any(near(line, other) for other in placed)]
    if not (free and bodies):
        return {}
    turned = [[_turned(line, expected[body.id]) for line in free] for body in bodies]
    cost = np.array(
        [
            [
                distance(line, expected[body.id])
                + LENGTH * abs(float(arc_length(line)[-1]) - body.length)
                for line in row
            ]
            for body, row in zip(bodies, turned, strict=True)
        ]
    )
    reach = REACH * np.array([[body.length] for body in bodies])
    rows, columns = linear_sum_assignment(np.minimum(cost, reach))
    pairs = zip(rows.tolist(), columns.tolist(), strict=True)
    return {bodies[i].id: turned[i][k] for i, k in pairs if cost[i, k] < reach[i, 0]}


def _turned(line: Line, like: Line) -> Line:
    """The line, run through the way that another one runs."""
    return min((line, line[::-1]), key=lambda way: distance(way, like))


def near(line: Line, other: Line, reach: float = TAKEN) -> bool:
    """Whether most of a line lies along another."""
    points = resample(line, SAMPLES)
    dense = resample(other, 4 * SAMPLES)
    apart = np.linalg.norm(points[:, None] - dense[None], axis=2).min(1)
    return float(np.median(apart)) < reach

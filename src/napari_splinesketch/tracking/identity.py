"""Which curve, or which suggestion, is which body: by what the frames around predict."""

from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np
from scipy.optimize import linear_sum_assignment

from napari_splinesketch.editing import flipped
from napari_splinesketch.engine.spline import arc_length
from napari_splinesketch.engine.types import Curve
from napari_splinesketch.tracking.bodies import Body
from napari_splinesketch.tracking.drift import distance, mostly_on, on_others, turned
from napari_splinesketch.tracking.motion import Points, Predicted
from napari_splinesketch.tracking.types import Line

AGREE = 3.0
"""Standard errors, beside half of a half-width, within which a curve is where it is expected."""
REACH, LENGTH = 0.6, 0.5
"""How far a body may have gone that is looked for among suggestions, as a share of its length; and
what a px of difference in length costs, in px of distance."""
TAKEN = 2.0
"""A suggestion that lies so near to a placed curve is taken, px."""
BAND = 4.0
"""Background beside a body of which its residual is known, px."""
FREE = 6.0
"""Numbers that a body's place and shape come to, about."""


def run_like(curve: Curve, like: Points) -> Curve:
    """The curve, run through the way that a line runs."""
    return curve if turned(curve.points, like) is curve.points else flipped(curve)


def agrees(line: Points, predicted: Predicted, half_width: float) -> bool:
    """Whether a line is where a body of such a half-width is expected."""
    return _apart(line, predicted) < AGREE + 0.5 * half_width / predicted.sd


def _apart(line: Points, predicted: Predicted) -> float:
    return float(np.sqrt(((line - predicted.line) ** 2).sum(1).mean() / 2)) / predicted.sd


def kept(
    predicted: Mapping[int, Predicted],
    there: Mapping[int, Curve],
    bodies: Mapping[int, Body],
    others: Sequence[Curve],
) -> dict[int, Curve]:
    """The curves of a frame by body: where that is expected, or its own if that is on no other."""
    pairs = list(product(predicted, there))
    lines = {(i, j): run_like(there[j], predicted[i].line).points for i, j in pairs}
    cost = np.array([min(_apart(lines[i, j], predicted[i]), 1e3) for i, j in pairs])
    rows, columns = linear_sum_assignment(cost.reshape(len(predicted), len(there)))
    found = [pairs[k] for k in (rows * len(there) + columns).tolist()]
    taken = {i: j for i, j in found if agrees(lines[i, j], predicted[i], bodies[i].half_width)}
    rest = [*others, *(there[j] for j in taken.values())]
    for i in sorted(set(there) - set(taken) - set(taken.values())):
        if not on_others(there[i].points, rest):
            taken[i] = i
    return {i: run_like(there[j], predicted[i].line) for i, j in taken.items()}


def cost_of(curve: Curve, predicted: Predicted, noise: float) -> float:
    """-2 log likelihood of a curve: what it leaves of the image, and that it is where it is.

    What predicts it may be wrong altogether, and counts no more than `AGREE`.
    """
    pixels = curve.length * 2 * (curve.typical_half_width + BAND)
    return (
        pixels * (curve.residual / max(noise, 1e-6)) ** 2
        + FREE * min(_apart(curve.points, predicted), AGREE) ** 2
    )


def place(
    bodies: Sequence[Body],
    expected: Mapping[int, Line],
    suggestions: Sequence[Line],
    placed: Sequence[Line],
) -> dict[int, Line]:
    """Give bodies in doubt the suggestions that no other body has, the nearest to each.

    What stands out in the frame is suggested; bodies that are not in doubt are placed.
    """
    free = [line for line in suggestions if not any(mostly_on(line, x, TAKEN) for x in placed)]
    pairs = list(product(bodies, free))
    lines = [turned(line, expected[body.id]) for body, line in pairs]
    far = [
        distance(line, expected[body.id]) + LENGTH * abs(float(arc_length(line)[-1]) - body.length)
        for (body, _), line in zip(pairs, lines, strict=True)
    ]
    cost = np.array(far).reshape(len(bodies), len(free))
    reach = REACH * np.array([body.length for body in bodies]).reshape(-1, 1)
    rows, columns = linear_sum_assignment(np.minimum(cost, reach))
    found = zip(rows.tolist(), columns.tolist(), strict=True)
    return {bodies[i].id: lines[i * len(free) + k] for i, k in found if cost[i, k] < reach[i, 0]}

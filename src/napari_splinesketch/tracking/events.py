"""What comes into view, leaves it or divides: it is said, and left to the user."""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from itertools import chain, pairwise

import numpy as np
from jaxtyping import Bool
from scipy.ndimage import binary_closing

from napari_splinesketch.engine.spline import arc_length
from napari_splinesketch.engine.types import Curve, Polarity
from napari_splinesketch.tracking.bodies import Body, Line, View
from napari_splinesketch.tracking.drift import apart_from, distance, mostly_on, turned
from napari_splinesketch.tracking.motion import of_length

LEFT, DIVIDED = "it left the image", "it divided into parts"
"""Why a body ends, other than that it is not found any more."""
Shown = Bool[np.ndarray, " P"]
EVERY = 5
"""Frames from one search for bodies that come into view to the next."""
SHORTEST = 0.4
"""Length of a body that has come into view, as a share of the usual one."""
EDGE = 2.0
"""Half-widths from the image's border at which it comes in."""
MOVED = 0.6
"""Share of the usual length by which a body may move between searches."""
PART, TOGETHER, LONGER = 0.2, (0.75, 1.25), 1.06
"""Lengths of the parts of a divided body as shares of its own: of each part at least, of both
together, and with the gap between them at least: what covers a body makes it no longer."""
GAP, HOLE = 1.5, 0.5
"""Half-widths between the parts, at least; and that may look empty inside one."""
ALONE = 0.5
"""Share of a part that must be away from all other curves."""
BEYOND = 1.6
"""By which a curve is looked at beyond its ends, where the parts may have gone."""
DEEP = 1.5
"""Depth of the border in which they are looked for, as a share of the usual length."""
TAKEN = 4.0
"""Distance at which a line lies on a curve that is there, px."""
Parts = tuple[float, float, float]
"""Lengths of the parts of a divided body, and of the gap between them, px."""


def parts(
    body: Body, curve: Curve, others: Sequence[Curve], seen: Callable[[Line], Shown]
) -> Parts | None:
    """Two parts that a body has divided into, if the image shows such where its curve is.

    What shows others may show nothing of it. Of a body of unknown width no gap is known.
    """
    if not np.isfinite(body.half_width):
        return None
    line = of_length(curve.points, BEYOND * curve.length)
    step = BEYOND * curve.length / (len(line) - 1)
    hole = max(round(HOLE * body.half_width / step), 1)
    shows = np.asarray(binary_closing(seen(line), iterations=hole), bool)
    alone, usual = apart_from(line, others), body.length
    runs = np.ma.clump_masked(np.ma.array(line[:, 0], mask=shows))
    runs = [(r.start * step, r.stop * step) for r in runs if alone[r].mean() > ALONE]
    for (begin, end), (start, stop) in pairwise(r for r in runs if r[1] - r[0] > PART * usual):
        one, other, gap = end - begin, stop - start, start - end
        whole = TOGETHER[0] * usual < one + other < TOGETHER[1] * usual
        if whole and gap > GAP * body.half_width and one + other + gap > LONGER * usual:
            return one, other, gap
    return None


class Entering:
    """Looks for bodies that come into view at the image's border, every few frames."""

    def __init__(self) -> None:
        # Two searches: one that passes may have covered a body in the last one.
        self._before = deque[list[Line]](maxlen=2)
        self._count = 0

    def __call__(
        self, view: View, polarity: Polarity, bodies: Mapping[int, Body], curves: Sequence[Curve]
    ) -> tuple[Line, ...]:
        """Give lines over the bodies that have come into view since the last search.

        Those that are followed tell how long and wide they are; there are curves of all others.
        """
        self._count += 1
        if self._count % EVERY != 1 or not view.whole or not bodies:
            return ()
        from napari_splinesketch.engine.find.suggest import suggest

        usual = float(np.median([body.length for body in bodies.values()]))
        half_width = float(np.nanmedian([body.half_width for body in bodies.values()]))
        free: list[Line] = []
        taken = [curve.points for curve in curves]
        for part in border(view.pixels.shape, int(DEEP * usual / view.place.size) + 1):
            if not np.isfinite(view.pixels[part]).any():
                continue
            corner = [side.start for side in part]
            for line in suggest(view.pixels[part], polarity=polarity):
                there = view.place.to_image(line + corner)
                if not any(mostly_on(there, other, TAKEN) for other in (*taken, *free)):
                    free.append(there)
        before = [*self._before]
        self._before.append(free)
        if not before:
            return ()
        size = view.place.to_image(np.array([view.pixels.shape]) - 1.0)[0]
        return tuple(
            line
            for line in free
            if arc_length(line)[-1] > SHORTEST * usual
            and min(line.min(), (size - line).min()) < EDGE * half_width
            and not any(distance(turned(line, x), x) < MOVED * usual for x in chain(*before))
        )


def border(shape: tuple[int, ...], depth: int) -> list[tuple[slice, slice]]:
    """Parts of an image that make up its border, so deep; all of it where that is not less."""
    rows, columns = (slice(0, size) for size in shape)
    if min(shape) <= 2 * depth:
        return [(rows, columns)]
    (top, bottom), (left, right) = ((slice(0, depth), slice(n - depth, n)) for n in shape)
    return [(top, columns), (bottom, columns), (rows, left), (rows, right)]

"""How curves are drawn: lines around bodies, colours of a status, marks beside those in doubt."""

from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

from napari_splinesketch.engine.spline import fine
from napari_splinesketch.engine.types import Curve, Status
from napari_splinesketch.geometry import edges, thinned
from napari_splinesketch.plugin.layers.space import Pair, View
from napari_splinesketch.plugin.model import Line, Record, once

MARKS: dict[Status, str] = {"good": "", "check": "?", "failed": "!"}  # the worst is last
STEP = 1.1  # between breadths that differ: for less, lines are not drawn again
BREADTHS: dict[Status, float] = {"good": 1.0, "check": 1.6, "failed": 2.2}  # of lines, relative
LEAST_LINE = 1.5  # breadth of a good curve's line at least, px of the screen: thinner ones break up
RIBBON_SDS = 2.0
UNKNOWN_REACH = 3.0  # from centreline to edge where no width is known, px
LEAST = 12  # pieces of one side of an outline
PIECES = 24, 99, 600
"""Vectors of a line at least and at most, and of all lines together, about: napari's thumbnail
alone takes 20 µs for each."""
NOTICEABLE_RESIDUAL = 0.25
NOTICEABLE_SD = 0.5
"""What weighs the same when the worst curve is looked for: share of the contrast, px."""
LETTER, LINE_HEIGHT, BESIDE = 10.0, 16.0, 1.0  # of a mark, px of the screen; how far from a halo
GAP, LEAST_GAP = 1.2, 4.0  # from edge to halo: in breadths of a line, and px of the screen at least
MOST = 60  # marks at once: more are not read, and napari's time for text grows with their number
GOLDEN = (np.sqrt(5) - 1) / 2  # steps of so much fill the interval from 0 to 1 evenly
PLACES = (0.5, 0.02, 0.98, 0.25, 0.75)  # where along a curve a mark may stand, the best first


@once
def has_outline(curve: Curve) -> bool:
    """Whether the width of a body is known."""
    return curve.status != "failed" and bool(np.isfinite(curve.half_width).all())


def breadth(curves: Sequence[Curve], pixel: float = 0.0) -> float:
    """Breadth of a good curve's line, px: a third of the bodies' width, in steps of a tenth.

    More where the eye would not see that: `pixel` is what one of the screen covers.
    """
    widths = np.array([curve.typical_half_width for curve in curves])
    finite = widths[np.isfinite(widths)]
    wanted = np.clip(0.6 * np.median(finite), 0.6, 8.0) if finite.size else 1.0
    return stepped(max(float(wanted), LEAST_LINE * pixel))


def stepped(size: float) -> float:
    """Round a size to a step: what differs by less is not drawn again."""
    return float(STEP ** np.round(np.log(size) / np.log(STEP)))


@once
def outline(curve: Curve) -> Line:
    """Draw a closed line at a half-width to both sides of a curve, px."""
    # A body is smooth on the scale of its width: more points would only cost time.
    curve = fine(curve)
    last = len(curve.points) - 1
    steps = int(np.clip(curve.length / max(curve.typical_half_width, 1e-9), LEAST, last))
    some = np.linspace(0, last, steps + 1).round().astype(int)
    return thinned([_around(curve.points[some], curve.half_width[some])])[0]


def gap(curves: Sequence[Curve], pixel: float) -> float:
    """How far a halo is from the edge of a body, px; `pixel` is what one of the screen covers."""
    return max(GAP * breadth(curves), LEAST_GAP * pixel)


def halo(curve: Curve, gap: float) -> Line:
    """Draw a closed line outside a body, px: all of the body and its outline can be seen in it."""
    known, curve = has_outline(curve), fine(curve)
    points = curve.points
    width = curve.half_width if known else np.full(len(points), UNKNOWN_REACH)
    away = points[[0, -1]] - points[[1, -2]]
    away *= gap / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-9)
    longer = np.concatenate([points[:1] + away[:1], points, points[-1:] + away[1:]])
    return _around(longer, np.pad(width, 1, mode="edge") + gap)


def ribbon(curve: Curve) -> Line | None:
    """Draw a closed line at `RIBBON_SDS` standard errors to both sides; None if not known."""
    if curve.status == "failed" or not np.isfinite(curve.sd).all():
        return None
    curve = fine(curve)
    return _around(curve.points, RIBBON_SDS * curve.sd)


def _around(points: Line, distance: Float[np.ndarray, " P"]) -> Line:
    left, right = edges(points, distance)
    return np.concatenate([left, right[::-1], left[:1]])


def coarse(lines: Sequence[Line]) -> list[Line]:
    """Leave out points of lines, the more the more lines there are."""
    count = int(np.clip(PIECES[2] // max(len(lines), 1), *PIECES[:2]))
    at = [np.linspace(0, len(line) - 1, min(len(line), count + 1)) for line in lines]
    return [line[np.round(some).astype(int)] for line, some in zip(lines, at, strict=True)]


@once
def severity(curve: Curve) -> tuple[int, float]:
    """Say how much a curve needs review: by status, then by residual and sd."""
    numbers = curve.residual / NOTICEABLE_RESIDUAL, float(np.median(curve.sd)) / NOTICEABLE_SD
    return [*MARKS].index(curve.status), max(n if np.isfinite(n) else np.inf for n in numbers)


def readable(records: Sequence[Record], view: View) -> Iterator[tuple[Record, Pair]]:
    """Choose curves whose marks can be read, the worst first, spread over the view; with places."""
    frame = [record for record in records if record.frame == view.frame]
    here = [record for record in frame if record.standing in ("check", "failed")]
    if not here:
        return
    ends = np.stack([_stands(r.curve)[0] for r in here])
    near = ((ends > view.low) & (ends < view.high)).all(axis=2).any(axis=-1)
    here = [here[i] for i in np.flatnonzero(near).tolist()]
    box = np.array([LINE_HEIGHT, 3 * LETTER]) * view.pixel / 2
    bodies = KDTree(np.concatenate([r.curve.points[::4] for r in frame]) / box, balanced_tree=False)
    taken, sizes, count = np.zeros((MOST, 2)), np.zeros((MOST, 2)), 0
    # Of the same severity, those are spread over the frame: neighbours have similar numbers, and
    # steps of the golden ratio fill an interval evenly.
    here.sort(key=lambda r: (severity(r.curve), r.id * GOLDEN % 1), reverse=True)
    for record in here:
        size = np.array([LINE_HEIGHT, LETTER * len(mark_of(record))]) * view.pixel / 2
        places = _places(record.curve, size, view)
        free = ((places - size > view.low) & (places + size < view.high)).all(axis=1)
        over = np.abs(places[:, None] - taken[:count]) < size + sizes[:count]
        places = places[free & ~over.all(axis=2).any(axis=-1)]
        if len(places):
            crowd = bodies.query_ball_point(places / box, 1.0, p=np.inf, return_length=True)
            taken[count], sizes[count] = places[np.argmin(crowd)], size
            yield record, taken[count].copy()
            count += 1
        if count == MOST:
            return


def mark_of(record: Record) -> str:
    """Write its number, and the sign of its status."""
    return f"{record.id} {MARKS[record.curve.status]}"


@once
def _stands(curve: Curve) -> tuple[Line, Line]:
    at = np.round(np.array(PLACES) * (len(curve.points) - 1)).astype(int)
    across = (edges(curve.points, np.ones(len(curve.points)))[0] - curve.points)[at]
    return curve.points[at], np.where(across[:, :1] > 0, -across, across)


def _places(curve: Curve, size: Pair, view: View) -> Line:
    """Where the middle of its mark, of half a size of (row, col), may stand; the best one first."""
    points, up = _stands(curve)
    half = (np.abs(up) * size).sum(axis=1, keepdims=True)  # of the mark's box, on the way there
    pixel = float(view.pixel.mean())
    reach = float(np.max(curve.half_width)) if has_outline(curve) else UNKNOWN_REACH
    away = (reach + gap([curve], pixel) + BESIDE * pixel + half) * up
    return np.stack([points + away, points - away], axis=1).reshape(-1, 2)

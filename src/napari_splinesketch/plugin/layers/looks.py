"""How curves are drawn: lines around bodies, colours of a status, few points."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from napari_splinesketch import palette
from napari_splinesketch.engine.types import Curve, Status
from napari_splinesketch.geometry import edges, thinned
from napari_splinesketch.plugin.model import once

Line = Float[np.ndarray, "_ 2"]

COLOURS: dict[Status, str] = palette.STATUS  # pyright: ignore[reportAssignmentType]
MARKS: dict[Status, str] = {"good": "", "check": "?", "failed": "!"}
"""Written beside the curve's number: a status is never told by colour alone."""
STEP = 1.1
"""Between breadths that differ: for less, lines are not drawn anew."""
BREADTHS: dict[Status, float] = {"good": 1.0, "check": 1.6, "failed": 2.2}
"""Breadth of the line, relative."""
RIBBON_SDS = 2.0
UNKNOWN_REACH = 3.0
"""From centreline to edge where no width is known, px."""
LEAST = 12
"""Points along one side of an outline."""
PIECES = 24, 99, 600
"""Vectors of a line at least and at most, and of all lines together, about: napari's thumbnail
alone takes 20 µs for each."""


@once
def _half_width(curve: Curve) -> float:
    return float(np.median(curve.half_width))


@once
def has_outline(curve: Curve) -> bool:
    """Whether the width of a body is known."""
    return curve.status != "failed" and bool(np.isfinite(curve.half_width).all())


def breadth(curves: Sequence[Curve]) -> float:
    """Breadth of a good curve's line, px: a third of the bodies' width, in steps of a tenth."""
    widths = np.array([_half_width(curve) for curve in curves])
    finite = widths[np.isfinite(widths)]
    wanted = np.clip(0.6 * np.median(finite), 0.6, 8.0) if finite.size else 1.0
    return float(STEP ** np.round(np.log(wanted) / np.log(STEP)))


def line_width(size: tuple[int, int]) -> float:
    """Breadth of a sketch's line on an image of (H, W) px, px."""
    return max(1.0, max(size) / 512)


@once
def outline(curve: Curve) -> Line:
    """Draw a closed line at a half-width to both sides of a curve, px."""
    # A body is smooth on the scale of its width: more points would only cost time.
    count = len(curve.points)
    spacing = max(curve.length / (count - 1), 1e-9)
    step = int(np.clip(_half_width(curve) / spacing, 1, count // LEAST))
    some = np.unique(np.append(np.arange(0, count, step), count - 1))
    return thinned([_around(curve.points[some], curve.half_width[some])])[0]


def reach(curve: Curve) -> float:
    """How far a body goes from its centreline, px; a guess where it is not known."""
    return float(np.max(curve.half_width)) if has_outline(curve) else UNKNOWN_REACH


def halo(curve: Curve, gap: float) -> Line:
    """Draw a closed line outside a body, px: all of the body and its outline can be seen in it."""
    width = curve.half_width if has_outline(curve) else np.full(len(curve.points), UNKNOWN_REACH)
    points = curve.points
    along = np.diff(points[[0, 1, -2, -1]], axis=0)[[0, 2]]
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    ends = np.stack([points[0] - gap * along[0], points[-1] + gap * along[1]])
    longer = np.concatenate([ends[:1], points, ends[1:]])
    return _around(longer, np.pad(width, 1, mode="edge") + gap)


def ribbon(curve: Curve) -> Line | None:
    """Draw a closed line at `RIBBON_SDS` standard errors to both sides; None if not known."""
    if curve.status == "failed" or not np.isfinite(curve.sd).all():
        return None
    return _around(curve.points, RIBBON_SDS * curve.sd)


def _around(points: Line, distance: Float[np.ndarray, " P"]) -> Line:
    left, right = edges(points, distance)
    return np.concatenate([left, right[::-1], left[:1]])


def coarse(lines: Sequence[Line]) -> list[Line]:
    """Leave out points of lines, the more the more lines there are."""
    count = int(np.clip(PIECES[2] // max(len(lines), 1), *PIECES[:2]))
    at = [np.linspace(0, len(line) - 1, min(len(line), count + 1)) for line in lines]
    return [line[np.round(some).astype(int)] for line, some in zip(lines, at, strict=True)]


def rgba(colours: Sequence[str]) -> Float[np.ndarray, "N 4"]:
    """Give colours as napari keeps them."""
    values = np.frombuffer(bytes.fromhex("".join([colour[1:] for colour in colours])), np.uint8)
    return np.insert(values.reshape(-1, 3) / np.float32(255), 3, 1.0, axis=1)

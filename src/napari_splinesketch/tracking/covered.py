"""A body of which something hides a part: what is seen of it, made whole as it is foretold.

How bright a body was along itself, when all of it was seen, says where what is seen now lies on it:
its ends, where they taper, and its shading fit in one place only.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool
from scipy import ndimage
from scipy.spatial.distance import cdist

from napari_splinesketch.engine.spline import arc_length, fit_knots, resample
from napari_splinesketch.engine.types import Curve
from napari_splinesketch.tracking import motion
from napari_splinesketch.tracking.bodies import INFERRED, Along, Body
from napari_splinesketch.tracking.drift import Light, apart_from
from napari_splinesketch.tracking.motion import Foretold
from napari_splinesketch.tracking.surface import normals
from napari_splinesketch.tracking.types import Line

DIM = 0.4
"""Share of its usual brightness below which a point of a body is hidden."""
SPREAD, MOST = 0.12, 3.0
"""Standard deviation of a body's brightness from frame to frame, as a share of it, and how many of
them count at most."""
SEEN = 0.1
"""Share of a body that must be seen, away from others."""
HIDDEN = 0.04
"""... and that must be hidden."""
ODD = 0.1
"""Share of it that may be bright where the curve does not go: then the curve left its body."""
NEAR = 3.0
"""Standard errors, beside half of a half-width, by which a body is elsewhere than foretold."""
FINE = 400
"""Points of the line along which a body is looked for."""
FEWEST = 5
"""Frames in which a part was hidden after which it must not be the same one ..."""
CHANGED = 0.3
"""... all the while that the body went on by two half-widths: px of it by which the part must
change for each px."""


def completed(
    body: Body, curve: Curve, foretold: Foretold, others: Sequence[Curve], light: Light
) -> Curve | None:
    """The curve with the parts that something hides where they are foretold; None without such.

    Gives the curve itself if the body turns out to be no longer than that.
    """
    half_width = body.half_width
    if not np.isfinite(foretold.sd + half_width):
        return None
    usual = body.brightness
    told = usual is not None
    if usual is None:
        bright = light.along(curve.points, half_width)[light.shows(curve.points)]
        usual = np.full(len(curve.points), np.median(bright) if len(bright) else np.inf)
    if not body.lacks(curve) and not _dim(body, curve, others, light, usual).any():
        return None
    near = NEAR * foretold.sd + 0.5 * half_width
    longer = resample(motion.of_length(foretold.line, 2 * body.length), FINE)
    s = arc_length(longer)
    s = s - (s[-1] - body.length) / 2  # from the foretold start
    apart = cdist(curve.points, longer)
    at = s[apart.argmin(1)]
    begin, end = at[0], at[-1]
    if end <= begin or np.median(apart.min(1)) > near:
        return None
    at = np.maximum.accumulate(at)
    best, least = None, np.inf
    ends = begin, end - body.length, 0.0
    for shift in np.arange(min(ends), max(ends) + 1):
        where = np.linspace(0, body.length, len(usual)) + shift
        on, whole = (
            np.stack([np.interp(where, x, y) for y in line.T], 1)
            for x, line in ((at, curve.points), (s, longer))
        )
        reached = (where >= begin) & (where <= end)
        shown, _ = _shown(np.where(reached[:, None], on, whole), others, light, usual, half_width)
        shown &= reached
        if shown.mean() < SEEN:
            continue
        known = np.flatnonzero(shown)
        away = [np.interp(np.arange(len(where)), known, x) for x in (on - whole)[known].T]
        points = whole + np.stack(away, 1)
        now, hidden = _shown(points, others, light, usual, half_width)
        unlike = (light.along(points, half_width) - usual) / (SPREAD * np.median(usual))
        unlike = np.minimum(unlike**2, MOST**2) * (now | hidden)
        cost = (shift / near) ** 2 + told * body.length / (2 * half_width) * unlike.mean()
        if cost < least:
            sd = np.interp(where, at, curve.sd)
            sd = np.where(shown, sd, np.maximum(sd, foretold.sd))
            best, least = (points, sd, hidden, float((now & ~shown).mean())), cost
    if best is None:
        return None
    points, sd, hidden, odd = best
    if odd > ODD or hidden.mean() < HIDDEN:
        return None
    return curve if _same_part(body, points, hidden, usual) else _with(curve, body, points, sd)


def _shown(
    line: Line, others: Sequence[Curve], light: Light, usual: Along, half_width: float
) -> tuple[Bool[np.ndarray, " P"], Bool[np.ndarray, " P"]]:
    """Where the image shows a body away from others, and where it does not."""
    alone, bright = apart_from(line, others), light.along(line, half_width) > DIM * usual
    return alone & bright, alone & ~bright


def _dim(
    body: Body, curve: Curve, others: Sequence[Curve], light: Light, usual: Along
) -> Bool[np.ndarray, " P"]:
    """Where a curve is not seen for as long as its body is wide, or for half of that at an end."""
    _, dim = _shown(curve.points, others, light, usual, body.half_width)
    width = max(round(body.half_width / body.length * len(dim)), 1)
    beyond = np.pad(dim, width, mode="edge")
    return np.asarray(ndimage.binary_opening(beyond, iterations=width), bool)[width:-width]


def _same_part(body: Body, points: Line, hidden: Bool[np.ndarray, " P"], usual: Along) -> bool:
    """Whether the same part of a body has been hidden while it went on along its path.

    What hides it would have to go with it: it is not hidden, but not there.
    """
    if len(body.hidden) < FEWEST:
        return False
    line, bright = body.hidden[0]
    tangent = normals(points) @ np.array([[0, -1], [1, 0]])
    gone = abs(float(((points - line) * tangent)[~hidden].sum(1).mean()))
    before = bright < DIM * usual
    changed = float((before != hidden)[np.isfinite(bright)].mean()) * body.length
    return gone > 2 * body.half_width and changed < CHANGED * gone


def _with(curve: Curve, body: Body, points: Line, sd: Along) -> Curve:
    """The curve along other points, as wide as its body last was."""
    half_width, count = body.seen[-1][1].half_width, len(curve.knots)
    width = np.interp(np.linspace(0, 1, count), np.linspace(0, 1, len(half_width)), half_width)
    knots = np.column_stack([fit_knots(points, count), width])
    return partly(replace(curve, points=points, knots=knots, sd=sd, half_width=half_width))


def partly(curve: Curve) -> Curve:
    """The curve, said to be inferred in part."""
    return replace(curve, status="check", reasons=(*curve.reasons, f"part of it is {INFERRED}"))

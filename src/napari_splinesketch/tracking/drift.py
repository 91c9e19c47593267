"""What speaks against a curve being the body that it was carried over from."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import copy

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

from napari_splinesketch.engine.spline import apart, neighbours, resample
from napari_splinesketch.engine.types import Array, Curve, Refinement
from napari_splinesketch.tracking.bodies import Body, Line, View
from napari_splinesketch.tracking.motion import directions

LONGER = 1.3
"""Factor by which a body's length may change from what it usually is."""
WIDER = 0.6
THIN = 1.5
"""Share of its half-width by which that may change; of thin bodies it is not known better, px."""
SHARPER, FOLD = 1.5, 0.25
"""Factor by which a body may bend more sharply than it did, and what is added to that, as a share
of 1 / half-width: a curve that leaves its body for another folds."""
UNEXPLAINED, KNOWN = 2.0, 3
"""Factor by which what a curve leaves of the image may be more than what it usually leaves, and
frames that tell that."""
JUMP = 0.35
"""Mean distance from where it was expected, as a share of the body's length."""
FAINT = 0.35
"""Brightness along the curve, as a share of the bodies' contrast, below which nothing is there."""
UNLIKE = 1.6
"""Factor by which the contrast may change from frame to frame."""
NEAR = 2.3
"""Half-widths between curves of which one may be taken for the other."""
EXPECTED = 0.4
"""Half-widths from where its body is expected within which a curve confirms that ..."""
UNSURE, UNSURER = 0.2, 2.0
"""... however uncertain it is; elsewhere it may be uncertain by so many half-widths, or times what
is usual of its body."""
WAITS = 3
"""Frames in a row in which a curve is not believed for that; a body that stays so does move so."""
BESIDE = 1.5
"""Half-widths from another curve where the image may show that one."""
SAME = 0.6
"""Half-widths between curves that lie on one body ..."""
ALONG = 0.5
"""... for this share of the length of one of them."""

LEARNED = 0.2
"""By how much one frame changes what is usual."""

AROUND = np.argwhere(np.ones((3, 3))) - 1
"""A place and those beside it."""


def doubts(
    body: Body, curve: Curve, expected: Line, astray: float = 0.0, smooth: bool = True
) -> list[str]:
    """Say what looks unlike the body so far, in words for the user.

    `astray` is how far off where it is expected may be, px.
    """
    found = []
    usual = body.length
    if (smooth and body.exceeded(curve)) or not usual / LONGER < curve.length < usual * LONGER:
        found.append(f"its length jumped from {usual:.0f} to {curve.length:.0f} px")
    before, now = body.half_width, curve.typical_half_width
    if np.isfinite(before) and abs(now - before) > max(WIDER * before, THIN):
        found.append(f"its half-width jumped from {before:.1f} to {now:.1f} px")
    if folds(body, curve):
        found.append("it bends more sharply than before")
    far = distance(curve.points, expected)
    if far > max(JUMP * usual, astray):
        found.append(f"it jumped by {far:.0f} px")
    return found


def misleads(body: Body, frame: int, curve: Curve) -> bool:
    """Whether a curve that others are near may not tell where its body is along its path.

    An end that touches another body slides along it unseen. Such a curve is not where its body is
    expected, and is more uncertain, longer or shorter than usual.
    """
    usual = float(np.median([known.sd.max() for _, known in body.seen]))
    uncertain = curve.sd.max() > max(UNSURE * body.half_width, UNSURER * usual)
    if not (uncertain or body.exceeds(abs(curve.length - body.length))):
        return False
    if abs(frame - body.seen[-1][0]) > WAITS + body.misses:
        return False
    return distance(curve.points, body.predicted(frame).line) >= EXPECTED * body.half_width


def explains_less(body: Body, curve: Curve) -> bool:
    """Whether a curve leaves more of the image than its body has left before."""
    before = [c.residual for _, c in body.seen if np.isfinite(c.residual)]
    return len(before) >= KNOWN and curve.residual > UNEXPLAINED * float(np.median(before))


def folds(body: Body, curve: Curve) -> bool:
    """Whether a curve bends as its body has not done before."""
    half_width = body.half_width
    if not np.isfinite(half_width):
        return False
    usual = max(_sharpest(c.points, half_width) for _, c in body.seen)
    return _sharpest(curve.points, half_width) > SHARPER * usual + FOLD / half_width


def _sharpest(points: Line, half_width: float) -> float:
    """The largest curvature of a line, mean over a body's width, 1 / px."""
    angle = directions(points)
    spacing = max(float(np.linalg.norm(np.diff(points, axis=0), axis=1).mean()), 1e-9)
    over = int(np.clip(round(2 * half_width / spacing), 1, len(angle) - 1))
    return float(np.abs(angle[over:] - angle[:-over]).max()) / (over * spacing)


def distance(a: Line, b: Line) -> float:
    """Mean distance of two lines that run the same way, px."""
    count = max(len(a), len(b))
    return float(np.linalg.norm(resample(a, count) - resample(b, count), axis=1).mean())


def turned(line: Line, like: Line) -> Line:
    """The line, run through the way that another one runs."""
    return min((line, line[::-1]), key=lambda way: distance(way, like))


def seeing(
    view: View, refinement: Refinement, usual: float | None
) -> Callable[[Line], Bool[np.ndarray, " P"]]:
    """Give what says at which points of a line, px of the image, the image shows a body.

    `usual` is the contrast of the frames before: one that differs much from it is of nothing.
    """
    # Of a copy: the frames that are held back do not keep the picture that is made here.
    pixels = np.nan_to_num(view.pixels.astype(float) - copy(refinement).background)
    smooth = ndimage.gaussian_filter(pixels, 0.5)
    contrast = abs(refinement.model.contrast)
    if usual:
        contrast = float(np.clip(contrast, usual / UNLIKE, usual * UNLIKE))
    sign = 1.0 if refinement.model.polarity == "bright" else -1.0
    least = FAINT * max(contrast, 1e-30)

    def shows(line: Line) -> Bool[np.ndarray, " P"]:
        at = view.place.to_block(line).T
        return sign * ndimage.map_coordinates(smooth, at, order=1) >= least

    return shows


class ShownPlaces:
    """Where frames have shown bodies: nothing that stays in its place hides a body there."""

    def __init__(self) -> None:
        self._cells: set[tuple[int, ...]] = set()
        self._size = 1.0
        self.faint: dict[int, float] = {}
        """Share of each body that frames do not show where nothing hides it: its ends are thin."""

    def learn(self, body: int, unseen: float) -> None:
        """Take a share of a body that a frame does not show."""
        usual = self.faint.get(body, unseen)
        self.faint[body] = usual + LEARNED * (unseen - usual)

    def add(self, points: Line, half_width: float) -> None:
        """Take points at which a body of such a half-width is seen, px of the image."""
        if not self._cells and np.isfinite(half_width):
            self._size = half_width / 2
        cells = np.rint(points / self._size).astype(int)[:, None] + AROUND
        self._cells.update(map(tuple, cells.reshape(-1, 2).tolist()))

    def at(self, line: Line) -> Bool[np.ndarray, " P"]:
        """Which points of a line lie there."""
        cells = np.rint(line / self._size).astype(int).tolist()
        return np.array([tuple(cell) in self._cells for cell in cells], bool)


def on_one_body(curves: Sequence[Curve]) -> dict[int, int]:
    """Positions of curves that run along another for much of their length, with the other's."""
    return {i: j for i, j, share in _shares(curves, SAME) if share > ALONG}


def near_each(curves: Sequence[Curve], reach: float = BESIDE) -> list[list[int]]:
    """Positions of the curves whose boxes come so near to that of each, in half-widths."""
    widest = max(map(_half_width, curves), default=0.0)
    return list(neighbours([curve.points for curve in curves], reach * widest))


def _shares(curves: Sequence[Curve], reach: float) -> Iterator[tuple[int, int, float]]:
    """Positions of curves whose boxes meet: of which share of one another is within its reach."""
    for i, (curve, beside) in enumerate(zip(curves, near_each(curves, reach), strict=True)):
        for j in beside:
            yield i, j, _share(curve.points, curves[j].points, reach * _half_width(curve))


def mostly_on(line: Line, other: Line, reach: float) -> bool:
    """Whether most of a line lies within so many px of another."""
    if (line.min(0) > other.max(0) + reach).any() or (line.max(0) < other.min(0) - reach).any():
        return False
    return _share(resample(line, 64), resample(other, 128), reach) > ALONG


def apart_from(
    line: Line, others: Sequence[Curve], reach: float = BESIDE
) -> Bool[np.ndarray, " P"]:
    """At which points of a line no other curve comes so near, in half-widths of that."""
    alone = np.ones(len(line), dtype=bool)
    for other in others:
        alone &= apart(line, other.points[::2]) > reach * _half_width(other)
    return alone


def lies_on(line: Line, other: Curve) -> bool:
    """Whether most of a line lies on the body of a curve."""
    return float(apart_from(line, [other], SAME).mean()) < 1 - ALONG


def near_others(curves: Mapping[int, Curve], share: float = 0.0) -> dict[int, set[int]]:
    """Say of each curve which others come near it, for more than a share of it, by number."""
    names = list(curves)
    found: dict[int, set[int]] = {name: set() for name in names}
    for i, j, near in _shares(list(curves.values()), NEAR):
        if near > share:
            found[names[i]].add(names[j])
            found[names[j]].add(names[i])
    return found


def _half_width(curve: Curve) -> float:
    width = curve.typical_half_width
    return width if np.isfinite(width) else 1.0


def _share(a: Float[Array, "N 2"], b: Float[Array, "M 2"], reach: float) -> float:
    return float((apart(a[::4], b[::2]) < reach).mean())

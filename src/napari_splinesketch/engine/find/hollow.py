"""Hollow bodies: two ridges side by side that are the rims of one.

A sketch that was clicked along the middle lies there. A line that was not clicked means the middle
where it lies between the rims: two bodies side by side are more usual, and look the same.
"""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from napari_splinesketch.engine import constants as const
from napari_splinesketch.engine import spline
from napari_splinesketch.engine.find import scoring, strip
from napari_splinesketch.engine.look.ridges import WIDTHS, rung_of
from napari_splinesketch.engine.look.scene import Scene
from napari_splinesketch.engine.look.sketched import first_high, reach_of, ridge_profile
from napari_splinesketch.engine.types import Array, Line


def middles(
    seen: Scene, sketches: list[Line], number: int, path: Line
) -> Iterator[tuple[int, Line]]:
    """Paths along the middles of hollow bodies that one sketch may mean, with their rungs.

    Its `path` is what it means if there is no hollow body: maybe a rim. What has a sketch of its
    own is no rim.
    """
    sketch, rung = sketches[number], seen.rungs[number]
    others = [*sketches[:number], *sketches[number + 1 :]]
    clicked = scoring.clicked(sketch)
    wider = range(rung + 2, len(seen.around[number][0].profile))
    found = _around(seen, sketch, rung, wider) if clicked else _beside(seen, sketch, rung, path)
    for wide, line in found:
        line = spline.smoothed([line], const.PATH_SMOOTH_HW * WIDTHS[wide])[0]
        reach = const.HOLLOW_RIM_HW * WIDTHS[wide] + WIDTHS[rung]
        if _between_rims(seen.evidence(rung), line, WIDTHS[wide]) and not any(
            _along(line, other, reach) for other in others
        ):
            yield wide, line


def _around(seen: Scene, sketch: Line, rung: int, wider: range) -> Iterator[tuple[int, Line]]:
    """Paths near a clicked sketch, at `wider` half-widths: its line runs along the middle."""
    if not wider:
        return
    near = scoring.close(WIDTHS[rung])
    heights = ridge_profile(seen.ridges, sketch, near, wider, seen.sign)[wider.start :]
    # The rims are ridges too, at half-widths of their own: each that stands out is tried.
    dips = 1 + np.flatnonzero((heights[1:-1] < heights[:-2]) & (heights[1:-1] < heights[2:]))
    for first, part in zip([0, *dips], np.split(heights, dips), strict=True):
        wide = wider.start + int(first) + first_high(part)
        reach = const.HOLLOW_MIDDLE_HW * WIDTHS[wide]
        yield wide, strip.paths_along(seen.evidence(wide), sketch, WIDTHS[wide], reach)[0]


def _beside(seen: Scene, sketch: Line, rung: int, path: Line) -> Iterator[tuple[int, Line]]:
    """The path between a rim and a ridge that runs along all of it, at the same distance.

    Where the ends of a straight line lie on the rim, or a stroke does not lie on its other side,
    there are two bodies instead.
    """
    straight = len(sketch) == 2
    evidence, half_width = seen.evidence(rung), WIDTHS[rung]
    widest = const.WIDEST_SHARE * spline.arc_length(sketch)[-1]
    rim = spline.resample(path, const.SCORE_SAMPLES)[const.HOLLOW_ENDS : -const.HOLLOW_ENDS]
    away = np.arange(const.HOLLOW_APART_HW * half_width, 2 * widest, half_width / 2)
    seen_there = spline.across(evidence, rim, np.concatenate([away, -away])).mean(0)
    sides = zip((1, -1), np.split(seen_there, 2), strict=True)
    side, along = max(sides, key=lambda one: one[1].max(initial=0.0))
    high = along.max(initial=0.0)
    if high < const.HOLLOW_SEEN:
        return
    first = int(along.argmax())
    lower = np.append(along[first:] < const.WIDTH_ENOUGH * high, True)
    middle = float(away[first:][: int(lower.argmax())].mean()) / 2
    at = np.linalg.norm(sketch[:, None] - rim, axis=2).argmin(1)
    off = side * ((sketch - rim[at]) * spline.normals(rim)[at]).sum(1)
    # The path between two ends may pass from rim to rim; one along a stroke seldom does.
    usual = np.sqrt(np.mean(off**2)) if straight else np.median(off)
    if usual < max(middle / 2, scoring.hit(half_width)):
        return
    wide = rung_of(middle + half_width)
    inside = seen.evidence(wide) * (1 - evidence)
    reach = reach_of(sketch, WIDTHS[wide])
    yield wide, strip.paths_along(inside, sketch, WIDTHS[wide], reach, between_ends=straight)[-1]


def _between_rims(evidence: Float[Array, "H W"], path: Line, half_width: float) -> bool:
    """Whether there is a ridge on either side of a path, and none along it."""
    away = np.linspace(-const.HOLLOW_RIM_HW, const.HOLLOW_RIM_HW, 2 * const.HOLLOW_OFFSETS + 1)
    line = spline.resample(path, const.SCORE_SAMPLES)
    one, middle, two = np.split(
        spline.across(evidence, line, half_width * away),
        [const.HOLLOW_OFFSETS, const.HOLLOW_OFFSETS + 1],
        axis=1,
    )
    rims = np.minimum(one.max(1), two.max(1)).mean()
    return bool(middle.mean() < const.BODY_EVIDENCE < rims)


def _along(path: Line, sketch: Line, reach: float) -> bool:
    """Whether a path and a sketch run along each other, within `reach` px for most of both."""
    one, two = (spline.resample(line, const.SCORE_SAMPLES) for line in (path, sketch))
    shares = ((spline.apart(*pair) < reach).mean() for pair in ((one, two), (two, one)))
    return bool(min(shares) > const.HOLLOW_OTHERS)

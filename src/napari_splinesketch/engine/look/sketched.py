"""What the image is like around one sketch: polarity and half-width of the body that it means."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.distance import cdist

from napari_splinesketch.engine import constants as const
from napari_splinesketch.engine import spline
from napari_splinesketch.engine.look.filters import median
from napari_splinesketch.engine.look.ridges import WIDTHS, Ridges, factor_of
from napari_splinesketch.engine.types import Array, Line


@dataclass(frozen=True)
class Around:
    """What is around a sketch, if its body is bright or if it is dark."""

    vote: float
    """From -1 (surely not) to 1."""
    rung: int
    """Index of the half-width in WIDTHS whose ridges are highest."""
    nearby: int
    """The same, with ridges the higher the nearer they are."""
    others: tuple[int, ...]
    """What else may be its body: `nearby`, and half-widths whose ridges are higher than narrower
    and wider ones, around the sketch or on it."""
    height: float
    """Of the body's ridge above its sides, in the image's units."""
    profile: tuple[float, ...]
    """The same for each half-width that was tried."""


def reach_of(line: Line, half_width: float) -> float:
    """How far from its sketch a body may be, px."""
    steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
    astray = min(const.STRAY_SHARE * steps.sum(), max(const.STRAY_HW * half_width, const.STRAY_PX))
    return float(max(const.CHORD_BULGE * steps.max(), astray))


def half_width_across(image: Float[Array, "H W"], path: Line, half_width: float) -> float:
    """Half-width of the body along a path, px: where its median profile is half as high.

    The mean of both sides, rounded up to the next point of the profile: a fit that begins a little
    too wide arrives sooner. `half_width` is about what it is.
    """
    points, offsets = _places(path), _offsets(const.WIDTH_PROFILE_HW * half_width)
    profile = median(np.ascontiguousarray(spline.across(image, points, offsets).T))
    middle = len(profile) // 2
    step = const.WIDTH_PROFILE_HW * half_width / middle
    found = []
    for side in (profile[middle::-1], profile[middle:]):
        top = side[: 1 + int(const.WIDTH_MIDDLE_HW * half_width / step)].mean()
        edge = int(half_width / step)
        low = edge + int(side[edge:].argmin())
        below = side[:low] <= (top + side[low]) / 2
        found.append(step * (0.5 + (int(below.argmax()) if below.any() else low)))
    return float(np.mean(found))


def look_around(ridges: Ridges, line: Line) -> tuple[Around, Around]:
    """What is around a sketch, seen as a bright body's and as a dark one's."""
    wanted = wanted_rungs(line)
    reach = reach_of(line, WIDTHS[wanted[-1]])
    heights = _ridges(ridges, line, reach, wanted, (1, -1))
    best = np.maximum(heights[1].max(1), 0)
    vote = float(np.tanh((best[0] - best[1]) / (0.15 * best.sum(0) + 1e-30)).mean())
    found, profiles = [], median(heights).transpose(1, 0, 2)
    for sign, (around, nearby, on) in zip((1, -1), profiles, strict=True):
        k, near, others = first_high(around), first_high(nearby), {*_high(around), *_high(on)}
        height, profile = float(max(around[k], 0.0)), tuple(around.tolist())
        found.append(Around(sign * vote, k, near, (near, *others), height, profile))
    return found[0], found[1]


def wanted_rungs(line: Line) -> range:
    """Indices in WIDTHS of the half-widths that the body of a sketch may have.

    Of a sketch that bends back on itself, such as a hairpin, no body that would lie inside itself.
    """
    count = const.SCORE_SAMPLES

    def inside_itself(rung: int) -> bool:
        (soft,) = spline.smoothed([line], WIDTHS[rung])  # scribbles go to and fro
        points, s = spline.resample(soft, count), np.linspace(0, spline.arc_length(soft)[-1], count)
        near = cdist(points, points) < const.LIMBS_HW * WIDTHS[rung]
        near &= np.abs(s[:, None] - s) > np.pi * WIDTHS[rung]
        return bool(near.any(1).mean() > const.LIMBS_SHARE)

    widest = max(const.WIDEST_SHARE * float(spline.arc_length(line)[-1]), const.WIDEST_PX)
    rungs = range(int(np.searchsorted(WIDTHS, widest, side="right")))
    while len(line) > 2 and len(rungs) > 1 and inside_itself(rungs[-1]):
        rungs = rungs[:-1]
    return rungs


def ridge_profile(
    ridges: Ridges, line: Line, reach: float, wanted: range, sign: int
) -> Float[Array, " R"]:
    """(R,) usual height of the ridge along a line for each of WIDTHS to the last one `wanted`.

    Looked for within `reach` px; 0 at half-widths that are not wanted.
    """
    return median(_ridges(ridges, line, reach, wanted, (sign,))[0, 0])


def first_high(profile: Float[Array, " R"]) -> int:
    """Index of the smallest half-width whose ridge is nearly the highest."""
    return int(np.argmax(profile >= const.WIDTH_ENOUGH * profile.max()))


def _high(profile: Float[Array, " R"]) -> list[int]:
    """The same wherever ridges are higher than narrower and wider ones, if not much less than any.

    The widest that was tried may be part of something wider.
    """
    found, least = [], const.OTHER_RIDGE * profile.max()
    for k in range(len(profile) - 1):
        if max(least, profile[k + 1], 0) < profile[k] >= profile[max(k - 1, 0)]:
            while k and profile[k - 1] >= const.WIDTH_ENOUGH * profile[k]:
                k -= 1
            found.append(k)
    return found


def _ridges(
    ridges: Ridges, line: Line, reach: float, wanted: range, signs: tuple[int, ...]
) -> Float[Array, "3 S R P"]:
    """Heights of the highest ridges across a line, of each sign, half-width and point.

    On each profile across the line the highest ridge counts, of any direction, the nearer the more.
    Heights are given as they are, and lowered by their distance; and those of ridges on the line.
    """
    points, offsets = _places(line), _offsets(reach)
    at = points[:, None] + offsets[None, :, None] * spline.normals(points)[:, None]
    near = 1 / (1 + (2 * offsets / reach) ** 2)
    found, reduced = np.zeros((3, len(signs), wanted.stop, len(at))), {}
    first = len(offsets) * np.arange(len(at))
    for rung in wanted:
        factor = factor_of(rung)
        chance = (
            const.CHANCE_HEIGHT
            * ridges.noise
            / np.sqrt(max(const.RIDGE_BLUR_HW * WIDTHS[rung], 0.5))
        )
        beside = np.abs(offsets) <= const.NARROW_HW * WIDTHS[rung] + const.NARROW_PX
        for k, sign in enumerate(signs):
            height = ridges.heights(rung, sign)
            if factor not in reduced:
                reduced[factor] = _pixels(at, near, height.shape, factor)
            pixels, weight = reduced[factor]
            high = height.ravel().take(pixels)
            weighted = weight * high
            most = first + weighted.argmax(1)
            found[0, k, rung] = high.take(most) * (weight.take(most) > 0)
            found[1, k, rung] = weighted.take(most)
            found[2, k, rung] = weighted[:, beside].max(1)
        found[:, :, rung] -= chance
    return found


def _pixels(
    at: Float[Array, "P T 2"], near: Float[Array, " T"], shape: tuple[int, int], factor: int
) -> tuple[Int[Array, "P T"], Float[Array, "P T"]]:
    """Flat indices of points in an image reduced to a shape, and their weights; 0 outside of it."""
    inside, flat = np.ones(at.shape[:2], dtype=bool), np.zeros(at.shape[:2], dtype=int)
    for x, size in zip(at.transpose(2, 0, 1), shape, strict=True):
        inside &= (x > -0.5) & (x < size * factor - 0.5)
        flat = flat * size + np.rint((x + 0.5) / factor - 0.5).clip(0, size - 1).astype(int)
    return flat, near * inside


def _places(line: Line) -> Float[Array, "P 2"]:
    """Where on a line profiles across it are read."""
    count = spline.arc_length(line)[-1] / const.PROFILE_STEP_PX
    return spline.resample(line, int(min(max(count, const.PROFILES_LEAST), const.PROFILES_MOST)))


def _offsets(reach: float) -> Float[Array, " T"]:
    """At which distances from a line profiles are read, px."""
    count = min(const.PROFILE_POINTS, 2 * int(np.ceil(reach)) + 1)
    return np.linspace(-reach, reach, count)

"""Suggest sketches: smooth lines over the bodies of an image that has none yet."""

from collections.abc import Callable, Sequence
from concurrent.futures import CancelledError
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np
from jaxtyping import Bool, Float, Int, Real
from scipy import ndimage
from scipy.spatial import KDTree

from napari_splinesketch.engine import checks
from napari_splinesketch.engine import constants as const
from napari_splinesketch.engine.find.joining import joined
from napari_splinesketch.engine.find.tracing import traced
from napari_splinesketch.engine.look import relief
from napari_splinesketch.engine.look.background import estimate_background
from napari_splinesketch.engine.look.band import band
from napari_splinesketch.engine.look.ridges import WIDTHS, Ridges, factor_of, rung_of
from napari_splinesketch.engine.look.scene import filled, pixel_noise
from napari_splinesketch.engine.spline import (
    arc_length,
    fit_knots,
    normals,
    resample,
    resample_each,
)
from napari_splinesketch.engine.types import Array, Line, OnProgress, Polarity, Progress, says_stop

Tick = Callable[[int], None]
"""Called after so many steps of the work; raises `CancelledError` when the caller cancels."""


@dataclass(frozen=True, eq=False)
class Suggestions:
    """Lines along everything that may be a body; choosing among them takes no time."""

    lines: tuple[Line, ...]
    """Sketches, strongest first; none lies on another."""
    strength: Float[Array, " N"]
    """Of each line against that of the usual body."""

    def choose(self, sensitivity: float = 0.5) -> tuple[Line, ...]:
        """The lines that stand out enough; a higher sensitivity, from 0 to 1, only adds lines."""
        checks.check_sensitivity(sensitivity)
        least = np.interp(sensitivity, (0, 0.5, 1), const.SUGGEST_STRENGTH)
        chosen = self.lines[: int((self.strength >= least).sum())]
        return tuple(sorted(chosen, key=lambda line: tuple(line.mean(0))))


@dataclass(frozen=True, eq=False)
class Traced:
    """One line as it was traced."""

    line: Line
    half_width: float
    """Of its body, px."""
    height: float
    """Of its ridge, in the image's units."""
    strength: float
    """Square root of its ridge's height, times how surely it is one along all of it, times its
    slenderness, times how often a line like it is found, whatever its half-width."""

    @property
    def length(self) -> float:
        """Px."""
        return float(arc_length(self.line)[-1])


def suggest(
    image: Real[Array, "H W"],
    sensitivity: float = 0.5,
    polarity: Polarity = "auto",
    half_width: float | None = None,
    *,
    on_progress: OnProgress | None = None,
) -> tuple[Line, ...]:
    """Sketch the bodies of an image: smooth lines along its ridges, of whatever width.

    Parameters
    ----------
    image
        (H, W) any real dtype, any range; pixels that are not finite are left out.
    sensitivity
        0 gives only what stands out, 1 also what is faint or short.
    polarity
        Whether bodies are "bright" or "dark" against the background; "auto" looks.
    half_width
        Rough distance from centreline to edge, px; None measures it.
    on_progress
        Called with a `Progress` now and then; returning False cancels.

    Returns
    -------
    tuple
        (N, 2) polylines, row and col in px, from top to bottom; none where nothing stands out, or
        after a cancel.

    Raises
    ------
    InputError
        Where the call makes no sense: no image, no finite pixel, a sensitivity outside 0 to 1,
        an unknown polarity, a half-width that no body of the image can have, an `on_progress` that
        is no function.
    """
    checks.check_sensitivity(sensitivity)  # before the work
    try:
        return prepare(image, polarity, half_width, on_progress).choose(sensitivity)
    except CancelledError:
        return ()


def prepare(
    image: Real[Array, "H W"],
    polarity: Polarity = "auto",
    half_width: float | None = None,
    on_progress: OnProgress | None = None,
) -> Suggestions:
    """Trace the bodies of an image, so that lines may be chosen with several sensitivities.

    Parameters and errors are those of `suggest`, and `CancelledError` where the caller cancels.
    """
    image = checks.checked_image(image)
    checks.check_options(image.shape, polarity, half_width)
    checks.check_call(on_progress, 0)
    image = checks.known(image).astype(np.float64)
    if checks.blank(image):
        return Suggestions((), np.zeros(0))
    shape, valid = image.shape, np.isfinite(image)
    whole = image if valid.all() else filled(image, valid)
    ridges = Ridges(whole, pixel_noise(whole))
    # What is in double precision is no longer needed; large values have no small differences then.
    whole = (whole - whole.min()).astype(np.float32)
    del image
    most = int(np.searchsorted(WIDTHS, max(const.SUGGEST_WIDEST * min(shape), 2.0), side="right"))
    rungs = every = range(most)
    if half_width is not None:
        rungs = [rung_of(half_width)]
    signs = {"bright": (1,), "dark": (-1,)}.get(polarity, (1, -1))
    steps, done = (1 + 4 * len(signs)) * len(rungs), 0

    def tick(more: int) -> None:
        nonlocal done
        done = min(done + more, steps)
        if on_progress and says_stop(on_progress(Progress("looking for bodies", done / steps))):
            raise CancelledError

    tick(0)
    found, clean = _along(ridges, valid, signs, rungs, every, tick)
    total = [sum(one.strength * one.length for one in lines) for lines in clean]
    # Rims do not tell which polarity bodies have; of that one, what looks like a rim may be a body.
    strongest = int(np.argmax(total))
    likely = list(found[strongest])
    for k, lines in enumerate(clean):
        if k != strongest and total[k] >= const.SUGGEST_BOTH * total[strongest]:
            likely += lines
    light = _light(ridges, whole, clean) if polarity == "auto" else None
    if light is not None:
        raised = Ridges(relief.raised(whole, light), ridges.noise)
        found, clean = _along(raised, valid, signs, rungs, every, tick)
        rises, falls = map(_height, clean)
        # Of bodies that are not in relief one side rises, and the other one falls as far.
        if rises > const.SUGGEST_RISES * falls:
            likely = found[0]
    best = _apart(likely, shape, tick)
    if not best:
        return Suggestions((), np.zeros(0))
    strength = np.array([one.strength for one in best])
    length = np.cumsum([one.length for one in best])
    usual = strength[np.searchsorted(length, const.SUGGEST_USUAL * length[-1])]
    lines = tuple(_sketch(one.line, one.half_width) for one in best)
    return Suggestions(lines, strength / usual)


def _along(
    ridges: Ridges,
    valid: Bool[Array, "H W"],
    signs: Sequence[int],
    rungs: Sequence[int],
    every: Sequence[int],
    tick: Tick,
) -> tuple[list[list[Traced]], list[list[Traced]]]:
    """Lines along bodies of some polarities, for each of them: all, and without doubles and rims.

    Bodies have half-widths of the `rungs`; beside a rim, a body may have `every` other one.
    """
    large, highest = valid.size > const.SUGGEST_LARGE, dict.fromkeys(signs, -np.inf)
    for rung in rungs:
        for sign in signs:
            of = float(np.quantile(ridges.heights(rung, sign), const.SUGGEST_HIGHEST))
            highest[sign] = max(highest[sign], of)
        if large:
            ridges.keep()
        tick(1)
    found = [_traced_at(ridges, valid, sign, rungs, highest[sign], tick) for sign in signs]
    return found, [
        _apart(_without_rims(ridges, lines, sign, every, large, tick), valid.shape, tick)
        for lines, sign in zip(found, signs, strict=True)
    ]


def _light(
    ridges: Ridges, image: Float[Array, "H W"], both: Sequence[Sequence[Traced]]
) -> Float[Array, "2"] | None:
    """Where light comes from that may put the bodies of an image in relief.

    `both` are lines along what is bright and along what is dark: in relief, neither is much lower.
    """
    low, high = sorted(map(_height, both))
    if low <= const.SUGGEST_EVEN * high:
        return None
    width, height, weight = np.transpose(
        [(one.half_width, one.height, one.strength * one.length) for one in chain(*both)]
    )
    usual = [
        float(np.quantile(of, 0.5, weights=weight, method="inverted_cdf")) for of in (width, height)
    ]
    background, _ = estimate_background(image, ridges.noise, widest=width.max())
    lights = relief.lights(relief.leaning(ridges, image - background, *usual))
    return lights[0] if lights else None


def _height(lines: Sequence[Traced]) -> float:
    """Of the ridges of all lines together."""
    return sum(one.height * one.length for one in lines)


def _traced_at(
    ridges: Ridges,
    valid: Bool[Array, "H W"],
    sign: int,
    rungs: Sequence[int],
    height: float,
    tick: Tick,
) -> list[Traced]:
    """Lines along bodies of one polarity, at several half-widths; `height` is of their ridges."""
    found: list[Traced] = []
    for rung in rungs:
        evidence = ridges.alone(rung, sign, height, const.SUGGEST_BLOCK_HW * WIDTHS[rung])
        evidence[~valid] = 0
        near = range(max(rung - 2, 0), min(rung + 3, len(WIDTHS)))
        tick(1)
        found += _traced(ridges, evidence, sign, rung, near, tick)
        if valid.size > const.SUGGEST_LARGE:
            ridges.keep({(k, sign) for k in near if k >= rung - 1})
    counts = np.minimum(_alike(found), const.ALIKE_ENOUGH)
    return [
        replace(one, strength=one.strength * count)
        for one, count in zip(found, counts, strict=True)
        if one.strength > 0
    ]


def _traced(
    ridges: Ridges, evidence: Float[Array, "H W"], sign: int, rung: int, near: range, tick: Tick
) -> list[Traced]:
    """Lines along bodies of one half-width."""
    width = WIDTHS[rung]
    chains = traced(_bodies(evidence, max(8 * width**2, 12)), width)
    tick(2)
    lines = joined(chains, evidence, width)
    tick(1)
    lengths = np.array([arc_length(line)[-1] for line in lines])
    long = np.flatnonzero(lengths >= const.SUGGEST_SHORTEST_HW * width)
    if not len(long):
        return []
    lines, lengths = [lines[i] for i in long], lengths[long]
    counts = np.maximum(8, (lengths / 2).astype(int))
    points = np.concatenate(resample_each(lines, counts.tolist())[0])
    line = np.repeat(np.arange(len(lines)), counts)
    each = range(len(lines))
    heights = np.array(
        [ndimage.median(_heights(ridges, k, sign, points), line, each) for k in near]
    )
    highest = np.maximum(heights.max(0), 0)
    own = near.start + (heights >= const.SUGGEST_WIDTH * highest).argmax(0)
    seen = np.minimum(evidence[tuple(np.rint(points).astype(int).T)] / const.SURE_EVIDENCE, 1)
    sure = np.add.reduceat(seen, np.cumsum(counts) - counts) / counts
    strength = np.sqrt(highest) * sure**3 * np.log(lengths / width)
    strength[np.abs(own - rung) > const.SUGGEST_OFF] = 0
    found = zip(lines, own.tolist(), highest.tolist(), strength.tolist(), strict=True)
    return [Traced(line, WIDTHS[k], height, strong) for line, k, height, strong in found]


def _bodies(evidence: Float[Array, "H W"], most: float) -> Bool[Array, "H W"]:
    """Pixels of bodies: what is above the lower threshold, in parts that reach the higher one.

    Parts of `most` pixels or fewer are left out. scikit-image has a function for each of these two,
    and each labels the image anew.
    """
    low, high = const.SUGGEST_BODY
    part = np.empty(evidence.shape, np.int32)
    ndimage.label(evidence > low, output=part)
    kept = np.bincount(part.ravel()) > most
    kept &= np.bincount(part[evidence > high], minlength=len(kept)) > 0
    kept[0] = False
    return kept[part]


def _heights(ridges: Ridges, rung: int, sign: int, points: Line) -> Float[Array, " P"]:
    """Height of the ridge of one half-width at some points."""
    heights, factor = ridges.heights(rung, sign), factor_of(rung)
    at = np.rint((points + 0.5) / factor - 0.5).astype(int)
    return heights[tuple(np.clip(at, 0, np.array(heights.shape) - 1).T)]


def _alike(found: Sequence[Traced]) -> Int[Array, " N"]:
    """How many lines are like each one, itself among them: a body is found at several widths."""
    if not found:
        return np.zeros(0, dtype=int)
    points = np.array([resample(one.line, const.ALIKE_PLACES) for one in found])
    length = np.array([one.length for one in found])
    width = np.array([one.half_width for one in found])
    middle = points.mean(1)
    near = KDTree(middle).query_ball_point(
        middle, const.ALIKE_ALONG * length + const.ALIKE_BESIDE_HW * width
    )
    one, two = np.repeat(np.arange(len(found)), [len(of) for of in near]), np.concatenate(near)
    ahead = np.gradient(points, axis=1)[one]
    ahead /= np.linalg.norm(ahead, axis=2, keepdims=True) + 1e-9
    alike = np.zeros(len(one), dtype=bool)
    for way in (1, -1):
        apart = points[two, ::way] - points[one]
        along = np.abs((apart * ahead).sum(2)).mean(1)
        beside = np.abs((apart * ahead[..., ::-1] * (1, -1)).sum(2)).mean(1)
        alike |= (along < const.ALIKE_ALONG * length[one]) & (
            beside < const.ALIKE_BESIDE_HW * width[one]
        )
    return np.bincount(one[alike], minlength=len(found))


def _without_rims(
    ridges: Ridges,
    found: Sequence[Traced],
    sign: int,
    rungs: Sequence[int],
    large: bool,
    tick: Tick,
) -> list[Traced]:
    """The lines that are no rims of bodies, as halos are.

    Beside a rim the ridge of a much wider body of the other polarity runs, which is higher; it may
    have the half-width of any of the `rungs`. Of a `large` image no ridges are kept.
    """
    if not found:
        return []
    lines, _ = resample_each([one.line for one in found])
    counts = [len(line) for line in lines]
    points, normal = np.concatenate(lines), np.concatenate([normals(line) for line in lines])
    width, beside = np.repeat([one.half_width for one in found], counts), np.zeros(len(points))
    for rung in rungs:
        tick(0)
        wider = np.flatnonzero(const.RIM_WIDER * width < WIDTHS[rung])
        if len(wider):
            away = (width[wider] + const.RIM_AWAY_HW * WIDTHS[rung])[:, None] * normal[wider]
            for at in (points[wider] - away, points[wider] + away):
                beside[wider] = np.maximum(beside[wider], _heights(ridges, rung, -sign, at))
        if large:
            ridges.keep()
    each = np.repeat(np.arange(len(found)), counts)
    usual = ndimage.median(beside, each, range(len(found)))
    pairs = zip(found, usual.tolist(), strict=True)
    return [one for one, high in pairs if high <= const.RIM_HIGHER * one.height]


def _apart(found: Sequence[Traced], shape: tuple[int, int], tick: Tick) -> list[Traced]:
    """The strongest lines first, without those that lie on stronger ones."""
    best: list[Traced] = []
    taken = np.zeros(shape, dtype=bool)
    for i, one in enumerate(sorted(found, key=lambda one: -one.strength)):
        if i % const.CHUNK == 0:
            tick(0)
        if taken[tuple(np.rint(one.line).astype(int).T)].mean() > const.COVERED:
            continue
        best.append(one)
        reach = const.COVERED_HW * one.half_width + const.COVERED_PX
        rows, columns, inside = band(one.line, reach, taken.shape)
        taken[rows, columns] |= inside
    return best


def _sketch(line: Line, half_width: float) -> Line:
    """A smooth line of few points, easy to edit by hand."""
    count = round(arc_length(line)[-1] / (const.SUGGEST_SPACING_HW * half_width)) + 1
    return fit_knots(line, int(np.clip(count, *const.SUGGEST_POINTS)))

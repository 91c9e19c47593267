"""The public call: sketches in, curves out."""

import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from jaxtyping import Float, Real
from scipy.linalg import block_diag

from napari_splinesketch.engine import checks, compile_cache, islands, spline
from napari_splinesketch.engine import constants as const
from napari_splinesketch.engine.find import finding
from napari_splinesketch.engine.fit import fitting, solver
from napari_splinesketch.engine.fit.fit_scene import Centrelines, Reporter, fit_scene
from napari_splinesketch.engine.islands import Island
from napari_splinesketch.engine.look import relief, scene
from napari_splinesketch.engine.report import assemble
from napari_splinesketch.engine.report.assemble import Part
from napari_splinesketch.engine.settings import PRESETS, Hold, PresetName, Settings
from napari_splinesketch.engine.types import (
    CANCELLED,
    Array,
    Curve,
    InputError,
    OnProgress,
    Polarity,
    Progress,
    Refinement,
    Sketches,
    says_stop,
)

Scenes = list[tuple[list[int], scene.Scene]]


def refine(
    image: Real[Array, "H W"],
    sketches: Sketches,
    preset: PresetName | Settings = "balanced",
    *,
    polarity: Polarity = "auto",
    half_width: float | None = None,
    fixed: Sequence[Curve] | None = (),
    on_progress: OnProgress | None = None,
    seed: int = 0,
) -> Refinement:
    """Fit all sketched bodies of one image together.

    Time and memory follow the sketches' surroundings, whatever the size of the image.

    Parameters
    ----------
    image
        (H, W) any real dtype, any range; pixels that are not finite are left out.
    sketches
        (N, 2) polylines, N ≥ 2, (row, col) in pixels, pixel centres at integers.
    preset
        "balanced" or "paper", or settings of your own; "fast" and "thorough" are the same as
        "balanced".
    polarity
        Whether bodies are "bright" or "dark" against the background; "auto" looks, and also sees
        bodies in relief, bright on one side and dark on the other.
    half_width
        Rough distance from centreline to edge, px; None to measure it.
    fixed
        Curves that take part in the rendering but do not move; failed ones, and those far from all
        sketches, do not take part. None for none.
    on_progress
        Called with a `Progress` now and then, from one thread at a time; returning False cancels.
    seed
        Of the random numbers, where a preset uses any.

    Returns
    -------
    Refinement
        One curve per sketch, in the same order, with reconstruction and diagnostics. A sketch that
        cannot be refined comes back as drawn, with status "failed" and the reason. The
        reconstruction is made from `image` when it is first read: read it before other pixels are
        written there.

    Raises
    ------
    InputError
        Where the call makes no sense at all: no image, no finite pixel, a sketch that is not
        (N, 2), an unknown preset or polarity, a half-width that no body of the image can have,
        something else than curves, a function or a whole number where those are expected.
    """
    began = time.perf_counter()
    image = checks.checked_image(image)
    drawn = checks.checked_lines(sketches, "sketches", "sketch")
    if not (preset in PRESETS if isinstance(preset, str) else isinstance(preset, Settings)):
        raise InputError(f"preset is {preset!r}; choose one of {', '.join(PRESETS)}.")
    checks.check_hold(preset, len(drawn))
    checks.check_options(image.shape, polarity, half_width)
    checks.check_call(on_progress, seed)
    still = checks.checked_fixed(fixed)
    faults = [checks.fault(line, image.shape) for line in drawn]
    lines = [
        x if f else spline.steadied(spline.distinct(x), const.FREEHAND_POINTS)
        for x, f in zip(drawn, faults, strict=True)
    ]
    usable = [i for i, fault in enumerate(faults) if not fault]
    # Sketches that are the same as one before: to fit them side by side would tell nothing more.
    first = {lines[i].tobytes(): i for i in reversed(usable)}
    copies = {i: at for i in usable if (at := first[lines[i].tobytes()]) != i}
    alone = [i for i in usable if i not in copies]
    parts: list[Part] = []
    progress = _Progress(on_progress, lines, len(alone))
    try:
        with compile_cache.kept():
            apart = islands.split(image, lines, alone, still)
            for island, scenes in _read(image, apart, polarity, half_width, progress):
                if isinstance(scenes, str):
                    faults = [scenes if i in island.members else f for i, f in enumerate(faults)]
                    continue
                for members, seen in scenes:
                    mine = island.of(members)
                    parts.append(_fitted(mine, seen, preset, seed, progress.of(mine)))
                    progress.done(parts[-1])
    except fitting.Stopped:
        parts, faults = [], [CANCELLED] * len(lines)
    found = assemble.assemble(image, drawn, faults, copies, parts, began)
    if usable or not still:
        return found
    shown = _with_fixed(image, still, polarity, half_width)
    return Refinement.lazy(found.curves, shown, found.model, time.perf_counter() - began)


def _with_fixed(
    image: Real[Array, "H W"], still: list[Curve], polarity: Polarity, half_width: float | None
) -> Refinement:
    """What the image looks like where nothing but fixed curves is: fitted to it where they are."""
    held = Settings(hold=(Hold(*[const.PIN_PX] * 3),) * len(still))
    lines = [curve.points for curve in still]
    return refine(image, lines, held, polarity=polarity, half_width=half_width)


def _read(
    image: Real[Array, "H W"],
    all_islands: Sequence[Island],
    polarity: Polarity,
    half_width: float | None,
    progress: "_Progress",
) -> Iterator[tuple[Island, Scenes | str]]:
    """The scenes of each island, or why nothing is to be seen there.

    One light falls on all of an image, so all are read before the first is given.
    """
    waiting, moments = list[tuple[Island, Scenes]](), np.zeros((3, 3))
    tick = partial(progress, "looking at the image", 0.0)

    def pixels_of(island: Island) -> Real[Array, "h w"]:
        tick()
        return checks.known(island.pose.cut(image))

    def look(
        island: Island, signs: Polarity | list[int], towards: Float[Array, "2"] | None = None
    ) -> Scenes:
        pixels = pixels_of(island)
        return scene.read_scenes(pixels, island.sketches, signs, half_width, towards, tick)

    for island in all_islands:
        blank = checks.blank(pixels_of(island))
        if blank:
            yield island, blank
            continue
        scenes = look(island, polarity)
        if polarity == "auto":
            signs = finding.signs(scenes, island.sketches)
            if any(signs[i] != seen.sign for members, seen in scenes for i in members):
                scenes = look(island, signs)
            turn = block_diag(island.pose.turn, 1.0)
            moments += turn.T @ scene.leaning(scenes) @ turn
        scene.tidy(scenes)
        waiting.append((island, scenes))

    def lit_from(light: Float[Array, "2"]) -> list[tuple[Island, Scenes]]:
        return [(island, look(island, "bright", island.pose.turn @ light)) for island, _ in waiting]

    lights = relief.lights(moments)
    costs = [_cost(lit_from(light)) for light in lights]
    if lights and min(costs) < _cost(waiting):
        enough = const.RELIEF_NEARLY * min(costs)
        waiting = lit_from(next(x for x, cost in zip(lights, costs, strict=True) if cost <= enough))
    for island, scenes in waiting:
        scene.tidy(scenes)
        yield island, scenes


def _cost(read: list[tuple[Island, Scenes]]) -> float:
    """What all sketches cost at least."""
    return sum(finding.least_cost(scenes, island.sketches) for island, scenes in read)


def _fitted(
    island: Island, seen: scene.Scene, preset: PresetName | Settings, seed: int, report: Reporter
) -> Part:
    # Curves that came without a half-width are as wide as the others.
    fixed = [np.nan_to_num(curve, nan=seen.half_width) for curve in island.fixed]
    island = replace(island, fixed=fixed)
    if preset == "paper":
        from napari_splinesketch.paper.result import fit_paper

        with solver.settings():
            return fit_paper(island, seen, seed, report)
    settings = Settings() if isinstance(preset, str) else preset
    if settings.hold is not None:
        settings = replace(settings, hold=tuple(settings.hold[i] for i in island.members))
    found = fit_scene(seen, island.sketches, island.fixed, settings, report)
    return assemble.describe(island, found)


class _Progress:
    """Passes progress on, from one thread at a time; never falls.

    Centrelines are passed on as often as takes a small share of the time. What the callback raises,
    or `Stopped` where it returns False, is raised in all threads from then on.
    """

    def __init__(self, on_progress: OnProgress | None, lines: list[Array], total: int):
        self._call, self._fraction = on_progress, 0.0
        self._lines, self._total, self._before = list(lines), total, 0
        self._lock, self._over = threading.Lock(), None
        self._due = 0.0

    def __call__(self, stage: str, fraction: float, lines: list[Array] | None = None) -> None:
        if self._call is None:
            return
        with self._lock:
            if self._over:
                raise self._over
            self._fraction = max(self._fraction, min(float(fraction), 1.0))
            now = Progress(stage, self._fraction, tuple(lines) if lines else None)
            try:
                if says_stop(self._call(now)):
                    raise fitting.Stopped
            except BaseException as error:
                self._over = error
                raise

    def of(self, island: Island) -> Reporter:
        """What reports on one island, as its share of everything."""

        def report(stage: str, fraction: float, centrelines: Centrelines | None = None) -> None:
            if self._call is None:
                return
            lines = None
            if time.perf_counter() >= self._due and (centrelines or self._before):
                now = centrelines() if centrelines else []  # may have to wait for them
                began, lines = time.perf_counter(), list(self._lines)
                for i, line in zip(island.members, now, strict=False):
                    lines[i] = island.pose.outside(line)
                ended = time.perf_counter()
                self._due = ended + const.LINES_APART * (ended - began)
            done = self._before + fraction * len(island.members)
            self(stage, done / self._total, lines)

        return report

    def done(self, part: Part) -> None:
        """Remember the curves of an island."""
        self._before += len(part.members)
        for i, curve in zip(part.members, part.curves, strict=True):
            self._lines[i] = np.asarray(curve.points)

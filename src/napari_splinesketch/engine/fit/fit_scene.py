"""All bodies of a scene: find their paths, choose the model, polish."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Protocol

import numpy as np
from jaxtyping import Float
from scipy import ndimage

from napari_splinesketch.engine import spline
from napari_splinesketch.engine.find import finding, trials
from napari_splinesketch.engine.fit import bands, fitting, model, pairs
from napari_splinesketch.engine.fit.fitting import Body
from napari_splinesketch.engine.look.scene import Scene
from napari_splinesketch.engine.settings import LevelSettings, Settings
from napari_splinesketch.engine.types import Array, Curve

Line = Float[Array, "N 2"]
Centrelines = Callable[[], list[Line]]
COARSE_KNOTS = 8
MOST_WEIGHED = 60
"""So many bodies tell which parts of the model pay."""
TRIM = 1.5
"""A body alone is polished from its coarse fit without so many half-widths at either end: ends
find their place better from within."""
ENOUGH = 8
"""So many of 64 points in the image are a curve to begin with."""
LOOSE_FIT = 0.1
"""Half-widths, at least LOOSE_FIT_PX, that knots may miss a traced path by (rms)."""
LOOSE_FIT_PX = 0.15


class Reporter(Protocol):
    """Passes progress on, and raises `fitting.Stopped` when the user wants no more."""

    def __call__(self, stage: str, fraction: float, centrelines: Centrelines | None = None) -> None:
        """Say what is being done, how much of it is, and how to see the curves as they are."""
        ...


@dataclass(frozen=True, eq=False)
class SceneFit:
    """What a scene is made of.

    Attributes
    ----------
    bodies
        One for each sketch.
    fixed
        Bodies that did not move.
    beside
        Bodies without a sketch that lie across the others.
    starts
        Where the fit of each sketch began.
    parts
        Which parts of the model pay; empty where that was not weighed.
    """

    bodies: list[Body]
    fixed: list[Body]
    beside: list[Body]
    starts: list[trials.Start]
    parts: dict[str, model.Part]


def fit_scene(
    seen: Scene,
    sketches: list[Line],
    fixed: Sequence[Curve],
    corner: Float[Array, "2"],
    settings: Settings,
    report: Reporter,
) -> SceneFit:
    """Refine all sketches of one image.

    Parameters
    ----------
    seen
        The image, or the window of it that matters.
    sketches
        (N, 2) polylines in the window's pixels.
    fixed, corner
        Curves that take part but do not move, in the image's pixels; and the window's corner.
    settings
        The preset.
    report
        Progress.
    """
    report("tracing bodies", 0.02)
    still = [spline.resample(c.points, 100) - corner for c in fixed]
    comparison = None
    if settings.judge and settings.hold is None:
        comparison = _comparison(seen, fixed, corner, settings.judge, report)
    if settings.hold is None:
        found = finding.find(
            seen, sketches, still, settings, comparison,
            lambda share: report("tracing bodies", 0.02 + 0.03 * share),
        )  # fmt: skip
    else:
        believed = [trials.Start(s, traced=True) for s in sketches]
        found = finding.Found(believed, [(i,) for i in range(len(sketches))])
    starts, number = _approach(seen, found.starts, settings), len(sketches)
    parts = _weigh(seen, starts, settings)
    needs = [knots_needed(s.line, seen.half_width, settings.knots) for s in starts]
    alone = {c[0] for c in found.clusters if len(c) == 1}
    groups: dict[int, list[int]] = {}
    for members in found.clusters:
        groups.setdefault(max(needs[i] for i in members), []).extend(members)
    flat = seen.background_kind != "textured" and not settings.everything
    priors = bands.default_priors(len(starts) + len(fixed), seen.half_width)
    priors = model.restrict(priors, parts, flat)

    def on_polish(share: float, lines: Centrelines) -> None:
        report("polishing", 0.4 + 0.6 * share, lambda: lines()[:number])

    bodies, others = _polish(
        seen, starts, alone, groups, fixed, corner, settings, priors, on_polish
    )
    sketched, beside = bodies[:number], bodies[number:]
    if settings.hold is not None:
        return SceneFit(sketched, others, beside, starts, parts)
    again = partial(_polish_again, seen, settings.polish, settings.knots[0])
    sketched = pairs.settle_pairs(seen, sketches, sketched, [*others, *beside], again)
    return SceneFit(sketched, others, beside, starts[:number], parts)


def _polish_again(
    seen: Scene,
    level: LevelSettings,
    knots: int,
    lines: list[Line],
    widths: list[float],
    rest: list[Body],
) -> list[Body]:
    """Fit lines with half-widths of their own beside bodies that stay."""
    knots = max([knots, *(len(b.knots) for b in rest)])
    priors = bands.default_priors(len(lines) + len(rest), seen.half_width)
    start = [
        bands.start_values(spline.fit_knots(x, knots), priors.mean[0], log_width_0=np.log(w))
        for x, w in zip(lines, widths, strict=True)
    ]
    still = [bands.start_values(spline.fit_knots(b.points(64), knots), b.parameters) for b in rest]
    theta = np.array([*start, *still])
    return fitting.fit_level(seen.normal, seen, theta, priors, level, moving=len(lines))[
        : len(lines)
    ]


def _comparison(
    seen: Scene,
    fixed: Sequence[Curve],
    corner: Float[Array, "2"],
    level: LevelSettings,
    report: Reporter,
) -> trials.Comparison:
    """Fits of candidate paths, coarser than the final one."""
    soft = ndimage.gaussian_filter(seen.normal, level.blur * seen.half_width)

    def fit(
        lines: list[Line], replica, still: list[tuple[int, int]], part: tuple[float, float]
    ) -> list[Body]:
        priors = bands.default_priors(len(lines) + len(still), seen.half_width)
        theta = _begin(lines, priors, COARSE_KNOTS)
        if still:
            others = _still(fixed, corner, COARSE_KNOTS, priors)
            theta = np.concatenate([theta, others[[k for _, k in still]]])
            replica = np.concatenate([replica, [r for r, _ in still]])
        return fitting.fit_level(
            soft, seen, theta, priors, level, replica=replica, moving=len(lines),
            report=lambda done, _: report(
                "comparing paths", 0.05 + 0.3 * float(np.interp(done, (0, 1), part))
            ),
        )  # fmt: skip

    return trials.Comparison(soft, level.stride(seen.half_width) ** 2, fit)


def _weigh(seen: Scene, starts: list[trials.Start], settings: Settings) -> dict[str, model.Part]:
    """Which parts of the model pay, by the fits that compared paths."""
    bodies = [s.body for s in starts if s.body is not None][:MOST_WEIGHED]
    if settings.everything or settings.judge is None or not bodies:
        return {}
    priors = bands.default_priors(len(bodies), seen.half_width)
    return model.weigh(bodies, priors, settings.judge.stride(seen.half_width) ** 2)


def knots_needed(line: Line, half_width: float, allowed: tuple[int, ...]) -> int:
    """The fewest knots whose spline follows a traced path as closely as a trace is worth."""
    loose = max(LOOSE_FIT * half_width, LOOSE_FIT_PX)
    dense = spline.resample(line, 64)
    for count in allowed:
        fitted = spline.resample(spline.sample(spline.fit_knots(line, count), 100), 64)
        if np.sqrt(((fitted - dense) ** 2).sum(1).mean()) < loose:
            return count
    return allowed[-1]


def _begin(lines: list[Line], priors: bands.Priors, knots: int, **overrides: float):
    mean = priors.mean[0]
    return np.array(
        [bands.start_values(spline.fit_knots(line, knots), mean, **overrides) for line in lines]
    )


def _resume(
    start: trials.Start, alone: bool, mean: Float[Array, " G"], knots: int, seen: Scene
) -> Float[Array, " D"]:
    """Where a polish begins: on the curve fitted along the path, or on the path itself.

    What a coarse fit makes of a body outside the image is not taken on.
    """
    if start.body is None:
        return bands.start_values(spline.fit_knots(start.line, knots), mean)
    line = start.body.points(64)
    inside = ((line >= 0) & (line < seen.normal.shape)).all(1)
    if inside.sum() > ENOUGH:
        line = line[inside]
    if alone:
        line = spline.trimmed(line, TRIM * seen.half_width)
        return bands.start_values(spline.fit_knots(line, knots), mean)
    return bands.start_values(spline.fit_knots(line, knots), start.body.parameters)


def _approach(seen: Scene, starts: list[trials.Start], settings: Settings):
    """Bring sketches without a trace near their bodies, from coarse to fine."""
    lost = [i for i, s in enumerate(starts) if not s.traced]
    if not lost:
        return starts
    priors = bands.default_priors(len(lost), seen.half_width)
    theta = _begin([starts[i].line for i in lost], priors, settings.knots[0])
    for level in settings.coarse:
        soft = ndimage.gaussian_filter(seen.normal, level.blur * seen.half_width)
        theta = np.array([b.theta for b in fitting.fit_level(soft, seen, theta, priors, level)])
    moved = dict(zip(lost, fitting.lines_of(theta), strict=True))
    return [replace(s, line=moved[i]) if i in moved else s for i, s in enumerate(starts)]


def _polish(seen, starts, alone, groups, fixed, corner, settings: Settings, priors, report):
    """Full resolution, group by group: bodies of a group have the same number of knots."""
    bodies: list[Body] = [None] * len(starts)  # type: ignore[list-item]
    others: list[Body] = []
    done = 0
    for knots, members in sorted(groups.items()):
        count = len(members)
        mine = priors.of([*members, *range(len(starts), len(starts) + len(fixed))])
        theta = np.array(
            [_resume(starts[i], i in alone, priors.mean[0], knots, seen) for i in members]
        )
        if fixed:
            theta = np.concatenate([theta, _still(fixed, corner, knots, priors)])

        def on_level(share, current, members=members, done=done, count=count):
            def lines():
                now = dict(zip(members, (b.points() for b in current()[:count]), strict=True))
                known = {i: b.points() for i, b in enumerate(bodies) if b is not None}
                return [{**known, **now}.get(i, s.line) + corner for i, s in enumerate(starts)]

            report((done + share * count) / len(starts), lines)

        found = fitting.fit_level(
            seen.normal, seen, theta, mine, settings.polish, moving=count, report=on_level,
            anchor=_anchor(theta, knots, settings.hold),
        )  # fmt: skip
        for i, body in zip(members, found, strict=False):
            bodies[i] = body
        others = found[count:]
        done += count
    return bodies, others


def _anchor(theta: Float[Array, "n D"], knots: int, sd: float | None) -> bands.Anchor | None:
    """Holds curves to where they begin."""
    if sd is None:
        return None
    mean = theta[:, : 2 * knots]
    return bands.Anchor(mean, np.full(mean.shape, sd**-2.0))


def _still(fixed: Sequence[Curve], corner, knots: int, priors: bands.Priors):
    """Parameters of fixed curves."""
    return np.array(
        [
            bands.start_values(
                spline.fit_knots(c.points - corner, knots),
                priors.mean[0],
                log_width_0=float(np.log(max(np.nanmedian(c.half_width), 0.5))),
            )
            for c in fixed
        ]
    )

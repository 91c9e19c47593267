"""All bodies of a scene: find their paths, choose the model, polish."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Protocol

import numpy as np
from jaxtyping import Float

from napari_splinesketch.engine import spline
from napari_splinesketch.engine.find import finding
from napari_splinesketch.engine.find.finding import Start
from napari_splinesketch.engine.fit import bands, fitting, model, pairs
from napari_splinesketch.engine.fit.fitting import Body
from napari_splinesketch.engine.fit.tube import INDEX
from napari_splinesketch.engine.look.scene import Scene
from napari_splinesketch.engine.settings import LevelSettings, Settings
from napari_splinesketch.engine.types import Array, Curve

Line = Float[Array, "N 2"]
Centrelines = Callable[[], list[Line]]
MOST_WEIGHED = 60
"""So many bodies tell which parts of the model pay."""
SAMPLES = 256
HELD, HOLDING = 0.05, 2
"""What is held in place is held within so many px: sketches without a body, and for so many more
sweeps the ends beyond which a body goes on."""
GROWS, GROWS_PX = 1.5, 1.5
"""An end may grow beyond its path by so many half-widths and px: skeletons end before bodies do."""
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
    seen
        The image, in units of the bodies' contrast.
    bodies
        One for each sketch.
    fixed
        Bodies that did not move.
    starts
        Where the fit of each sketch began.
    parts
        Which parts of the model pay.
    """

    seen: Scene
    bodies: list[Body]
    fixed: list[Body]
    starts: list[Start]
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
    if settings.hold is None:
        found = finding.find(
            seen, sketches, still, settings,
            lambda share: report("tracing bodies", 0.02 + 0.3 * share),
        )  # fmt: skip
    else:
        found = finding.believed(seen, sketches)
    seen, starts = found.seen, found.starts
    needs = [knots_needed(s.line, seen.half_width, settings.knots) for s in starts]
    groups: dict[int, list[int]] = {}
    for members in found.clusters:
        groups.setdefault(max(needs[i] for i in members), []).extend(members)
    flat = seen.background_kind != "textured" and not settings.everything
    priors = bands.default_priors(len(starts) + len(fixed), seen.half_width)
    for mean, start in zip(priors.mean, starts, strict=False):
        mean[[INDEX["log_width_0"], INDEX["contrast"]]] = np.log(start.half_width), start.contrast
    priors = model.restrict(priors, {}, flat)

    def on_polish(share: float, lines: Centrelines) -> None:
        report("polishing", 0.4 + 0.6 * share, lines)

    bodies, others = _polish(seen, starts, groups, fixed, corner, settings, priors, on_polish)
    weighed = range(min(len(bodies), MOST_WEIGHED))
    parts = model.weigh([bodies[i] for i in weighed], priors.of([*weighed]), 1.0)
    if settings.hold is None:
        again = partial(_polish_again, seen, settings.polish, settings.knots[0])
        bodies = pairs.settle_pairs(seen, sketches, bodies, others, again)
    return SceneFit(seen, bodies, others, starts, parts)


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


def knots_needed(line: Line, half_width: float, allowed: tuple[int, ...]) -> int:
    """The fewest knots whose spline follows a traced path as closely as a trace is worth."""
    loose = max(LOOSE_FIT * half_width, LOOSE_FIT_PX)
    dense = spline.resample(line, 64)
    for count in allowed:
        fitted = spline.resample(spline.sample(spline.fit_knots(line, count), 100), 64)
        if np.sqrt(((fitted - dense) ** 2).sum(1).mean()) < loose:
            return count
    return allowed[-1]


def _polish(seen, starts, groups, fixed, corner, settings: Settings, priors, report):
    """Full resolution, group by group: bodies of a group have the same number of knots."""
    bodies: list[Body] = [None] * len(starts)  # type: ignore[list-item]
    others: list[Body] = []
    done = 0
    for knots, members in sorted(groups.items()):
        count = len(members)
        mine = priors.of([*members, *range(len(starts), len(starts) + len(fixed))])
        theta = np.array(
            [
                bands.start_values(spline.fit_knots(starts[i].line, knots), priors.mean[i])
                for i in members
            ]
        )
        if fixed:
            theta = np.concatenate([theta, _still(fixed, corner, knots, priors)])

        def on_level(share, current, members=members, done=done, count=count):
            def lines():
                now = dict(zip(members, (b.points() for b in current()[:count]), strict=True))
                known = {i: b.points() for i, b in enumerate(bodies) if b is not None}
                return [{**known, **now}.get(i, s.line) for i, s in enumerate(starts)]

            report((done + share * count) / len(starts), lines)

        found = fitting.fit_level(
            seen.normal, seen, theta, mine, settings.polish, moving=count, report=on_level,
            anchor=_anchor(theta, knots, [starts[i] for i in members], settings.hold),
        )  # fmt: skip
        cut = [
            _ended(b, starts[i]) if starts[i].found else None
            for b, i in zip(found, members, strict=False)
        ]
        if settings.hold is None and any(c is not None for c in cut):
            stay = [not starts[i].found for i in members]
            found = _held(seen, found, cut, stay, mine, settings.polish)
        for i, body in zip(members, found, strict=False):
            bodies[i] = body
        others = found[count:]
        done += count
    return bodies, others


def _anchor(
    theta: Float[Array, "n D"], knots: int, starts: list[Start], sd: float | None
) -> bands.Anchor | None:
    """Holds curves to where they begin: all of them, or those whose bodies were not found."""
    if sd is None and all(start.found for start in starts):
        return None
    mean = theta[:, : 2 * knots]
    weight = np.full(mean.shape, 0.0 if sd is None else sd**-2.0)
    weight[[i for i, start in enumerate(starts) if not start.found]] = HELD**-2.0
    return bands.Anchor(mean, weight)


def _ended(body: Body, start: Start) -> Line | None:
    """The knots of a body without what grew too far beyond its path; None where nothing did."""
    line = body.points(SAMPLES)
    s = spline.arc_length(line)
    half, cuts = SAMPLES // 2, [0.0, s[-1]]
    for end, tip, part in ((0, start.line[0], line[:half]), (1, start.line[-1], line[half:])):
        at = s[int(np.linalg.norm(part - tip, axis=1).argmin()) + half * end]
        grown = abs(cuts[end] - at)
        if grown > (0 if start.goes_on[end] else GROWS * start.half_width + GROWS_PX):
            stays = 0 if start.goes_on[end] else min(grown, start.half_width)
            cuts[end] = at + stays * (2 * end - 1)
    if cuts == [0.0, s[-1]]:
        return None
    inside = (s >= cuts[0]) & (s <= cuts[1])
    return spline.fit_knots(line[inside], len(body.knots)) if inside.sum() > half / 2 else None


def _held(
    seen: Scene,
    bodies: list[Body],
    ended: list[Line | None],
    stay: list[bool],
    priors: bands.Priors,
    level: LevelSettings,
) -> list[Body]:
    """Fit bodies once more with the ends of some of them, and all of those that stay, held."""
    theta = np.array([b.theta for b in bodies])
    knots = len(bodies[0].knots)
    mean, weight = theta[:, : 2 * knots].copy(), np.zeros((len(bodies), 2 * knots))
    weight[np.flatnonzero(stay)] = HELD**-2.0
    for row, cut in enumerate(ended):
        if cut is not None:
            mean[row] = theta[row, : 2 * knots] = cut.T.ravel()
            weight[row, [0, knots - 1, knots, 2 * knots - 1]] = HELD**-2.0
    level = replace(level, steps=level.steps[:HOLDING])
    anchor = bands.Anchor(mean, weight)
    return fitting.fit_level(
        seen.normal, seen, theta, priors, level, moving=len(ended), anchor=anchor
    )


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

"""All bodies of a scene: find their paths, choose the model, polish in batches on all cores."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import chain
from typing import Protocol, TypeVar

import jax
import numpy as np
from jaxtyping import Bool, Float
from scipy.sparse.csgraph import connected_components

from napari_splinesketch.engine import constants as const
from napari_splinesketch.engine import spline
from napari_splinesketch.engine.find import finding, neighbours
from napari_splinesketch.engine.find.finding import Start
from napari_splinesketch.engine.fit import bands, fitting, pairs
from napari_splinesketch.engine.fit.fitting import Body
from napari_splinesketch.engine.look.scene import Scene
from napari_splinesketch.engine.settings import Hold, Settings
from napari_splinesketch.engine.types import Array, Line

Centrelines = Callable[[], list[Line]]
Result = TypeVar("Result")


class Reporter(Protocol):
    """Passes progress on, and raises `fitting.Stopped` when the user wants no more."""

    def __call__(self, stage: str, fraction: float, centrelines: Centrelines | None = None) -> None:
        """Say what is being done, how much of it is, and how to see the curves as they are."""
        ...


@dataclass(frozen=True, eq=False)
class SceneFit:
    """What a scene is made of."""

    seen: Scene
    """The image, in units of the bodies' contrast."""
    bodies: list[Body]
    """One for each sketch."""
    fixed: list[Body]
    """Bodies that did not move."""
    starts: list[Start]
    """Where the fit of each sketch began."""
    held: set[int]
    """Numbers of the curves that stay on their paths."""


def fit_scene(
    seen: Scene,
    sketches: list[Line],
    fixed: Sequence[Float[Array, "P 3"]],
    settings: Settings,
    report: Reporter,
) -> SceneFit:
    """Refine all sketches of one image, or of the window of it that matters.

    `fixed` are points and half-widths of curves that take part but do not move.
    """
    report("tracing bodies", 0.02)
    thinnest = const.THINNEST_FIXED_PX
    given = [
        (spline.resample(c[:, :2], 100), max(float(np.median(c[:, 2])), thinnest), 1.0)
        for c in fixed
    ]
    if settings.hold is None:
        seen, starts = finding.find(
            seen, sketches, [line for line, *_ in given], settings,
            lambda share: report("tracing bodies", 0.02 + 0.3 * share),
        )  # fmt: skip
        seen = neighbours.without_neighbours(seen, starts, [line for line, *_ in given])
    else:
        starts = finding.believed(seen, sketches)
    needs = [knots_needed(s.line, s.half_width, settings.knots) for s in starts]
    bodies, others, held = _fit_batches(seen, starts, given, needs, settings, report)
    if settings.hold is None:
        free = [s.found and i not in held for i, s in enumerate(starts)]
        bodies = pairs.settle_pairs(seen, starts, bodies, free, others)
    seen.ridges.keep()
    return SceneFit(seen, bodies, others, starts, held)


def _fit_batches(
    seen: Scene,
    starts: list[Start],
    fixed: list[tuple[Line, float, float]],
    needs: list[int],
    settings: Settings,
    report: Reporter,
) -> tuple[list[Body], list[Body], set[int]]:
    """Fit all bodies, in batches side by side, and the appearance of the fixed ones.

    Returns
    -------
    A body for each start and for each fixed curve; and which curves are held to their paths.
    """
    drawn = [(s.line, s.half_width) for s in starts] + [(line, width) for line, width, _ in fixed]
    meets = bands.touching([fitting.around(seen, *one) for one in drawn])
    batches = in_batches(meets[: len(starts), : len(starts)], needs)
    near = [set(np.flatnonzero(meets[len(starts) :, batch].any(1)).tolist()) for batch in batches]
    near[-1] |= set(range(len(fixed))).difference(*near)
    done: dict[int, Body] = {}
    so_far: dict[int, Line] = {i: start.line for i, start in enumerate(starts)}
    shares = [0.0] * len(batches)

    def fit_batch(number: int):
        members, beside = batches[number], sorted(near[number])

        def on_fit(share: float, current: Callable[[], Float[Array, "n P 2"]]) -> None:
            def lines() -> list[Line]:
                so_far.update(zip(members, current(), strict=False))
                return list(so_far.values())

            shares[number] = share * len(members)
            report("polishing", 0.4 + 0.6 * sum(shares) / len(starts), lines)

        fitted, kept = _fit_group(
            seen, [starts[i] for i in members], [fixed[k] for k in beside],
            [needs[i] for i in members],
            [settings.hold[i] for i in members] if settings.hold else [], on_fit,
        )  # fmt: skip
        done.update(zip(members, fitted, strict=False))
        return dict(zip(beside, fitted[len(members) :], strict=True)), {members[k] for k in kept}

    others: dict[int, Body] = {}
    held: set[int] = set()
    for looks, kept in side_by_side(fit_batch, len(batches)):
        others |= looks
        held |= kept
    return [done[i] for i in range(len(starts))], [others[k] for k in range(len(fixed))], held


def in_batches(meets: Bool[Array, "n n"], knots: Sequence[int]) -> list[list[int]]:
    """Curves in batches, the largest first.

    Curves that touch, directly or by others, come into one batch, beside others that need as many
    `knots`: small arrays cost little memory, and the curves are the same however many batches there
    are at a time. A GPU gets as many curves at a time as there are.
    """
    most = const.CURVE_SIZES[0 if jax.default_backend() == "cpu" else -1]
    count, label = connected_components(meets, directed=False)
    blocks = [np.flatnonzero(label == k).tolist() for k in range(count)]
    found: dict[int, list[list[int]]] = {}
    for block in sorted(blocks, key=len, reverse=True):
        alike = found.setdefault(max(knots[i] for i in block), [[]])
        if len(alike[-1]) + len(block) > most and alike[-1]:
            alike.append([])
        alike[-1] += block
    return sorted(chain.from_iterable(found.values()), key=len, reverse=True)


def side_by_side(run: Callable[[int], Result], count: int) -> list[Result]:
    """What `run` gives for each number below `count`, as many at a time as there are cores.

    What the first of them raises is raised here; those that had not begun are left out.
    """
    if min(count, cores()) < 2:
        return [run(number) for number in range(count)]
    with ThreadPoolExecutor(cores()) as pool:
        return list(pool.map(run, range(count)))


def cores() -> int:
    """Cores that this process may use: those it is bound to, and OMP_NUM_THREADS at most."""
    bound = getattr(os, "sched_getaffinity", None)
    there = len(bound(0)) if bound else os.cpu_count() or 1
    wanted = os.environ.get("OMP_NUM_THREADS", "")
    return min(there, int(wanted)) if wanted.isdecimal() and int(wanted) else there


def knots_needed(line: Line, half_width: float, allowed: tuple[int, ...]) -> int:
    """The fewest knots whose spline follows a traced path within a trace's own accuracy."""
    loose = np.clip(const.KNOT_MISS_HW * half_width, *const.KNOT_MISS_PX)
    length = spline.arc_length(line)[-1]
    fewest = const.KNOTS_FEW if length > const.KNOTS_SHORT_HW * half_width else 0
    allowed = tuple(
        n for n in allowed
        if n > fewest and (n <= const.KNOTS_MANY or length > const.KNOTS_APART_PX * n)
    ) or allowed[:1]  # fmt: skip
    return next((n for n in allowed if spline.knot_miss(line, n) < loose), allowed[-1])


def _fit_group(
    seen: Scene,
    starts: list[Start],
    fixed: list[tuple[Line, float, float]],
    own: list[int],
    holds: Sequence[Hold],
    report: fitting.Report,
) -> tuple[list[Body], set[int]]:
    """Fit bodies together, and the appearance of the fixed ones.

    All have as many knots in the solver as the one that needs most; the others are held to splines
    of their `own` numbers. Curves whose ends grew where nothing is seen, and those that left their
    paths, are fitted again and held there; those that leave again are put back on their paths, and
    their rows are returned, too.
    """
    knots, count = max(own), len(starts)
    moving = [(s.line, s.half_width, s.contrast) for s in starts]
    whole = all(start.whole for start in starts)
    theta, priors = bands.begin([*moving, *fixed], knots, seen, whole)
    hold = np.zeros((len(theta), 2 * knots, 2 * knots))
    ends = [0, knots - 1, knots, 2 * knots - 1]
    for row, start in enumerate(starts):
        theta[row, : 2 * knots], hold[row] = bands.stiff(start.line, own[row], knots)
        if holds:
            hold[row] += bands.precision(theta[row, : 2 * knots].reshape(2, -1).T, holds[row])
        if not start.found:
            hold[row] += np.eye(2 * knots) / const.PIN_PX**2
    found = fitting.fit_curves(seen, theta, priors, moving=count, hold=hold, report=report)
    asked, strayed = [row for row, s in enumerate(starts) if s.found and not holds], set()
    for last in (False, True):
        now, known = np.array([body.theta for body in found]), dict(enumerate(found))
        for row in asked:
            if _strayed(seen, found[row], starts[row]):
                strayed |= {row} if last else set()
                sd = const.PIN_PX if last else const.HELD_NEAR_HW * starts[row].half_width
                now[row], hold[row] = theta[row], hold[row] + np.eye(2 * knots) / sd**2
            elif not last and (line := _ended(found[row], starts[row])) is not None:
                now[row, : 2 * knots] = bands.stiff(line, own[row], knots)[0]
                hold[row, ends, ends] += const.HELD_END_PX**-2.0
            else:
                continue
            del known[row]
        asked = [row for row in asked if row not in known]
        if asked:
            found = fitting.fit_curves(
                seen, now, priors, const.SWEEPS[: const.HELD_SWEEPS],
                moving=count, hold=hold, known=known, report=lambda _, lines: report(1.0, lines),
            )  # fmt: skip
    numbers = [*own, *[knots] * len(fixed)]
    return [body.with_knots(n) for body, n in zip(found, numbers, strict=True)], strayed


def _strayed(seen: Scene, body: Body, start: Start) -> bool:
    """Whether a curve folded over itself, or left its path for where less of a body is seen."""
    line = body.points(const.STRAY_SAMPLES)
    s = spline.arc_length(line)
    inside = line[np.minimum(s, s[-1] - s) > start.half_width]  # tips may hook
    if len(inside) > 2 and spline.sharpest_turn(inside, start.half_width) > const.FOLD_RAD:
        return True
    if spline.apart(line, start.line).max() < const.STRAYED_HW * start.half_width:
        return False
    more = finding.extra_costs(seen, start, line)
    return more["unseen"] + more["kink"] > const.STRAYED_COST


def _ended(body: Body, start: Start) -> Line | None:
    """A body's centreline without what grew too far beyond its path; None if nothing did."""
    line = body.points(const.STRAY_SAMPLES)
    s = spline.arc_length(line)
    half, cuts = const.STRAY_SAMPLES // 2, [0.0, s[-1]]
    for end, tip, part in ((0, start.line[0], line[:half]), (1, start.line[-1], line[half:])):
        at = s[int(np.linalg.norm(part - tip, axis=1).argmin()) + half * end]
        grown = abs(cuts[end] - at)
        if grown > (
            0 if start.goes_on[end] else const.GROWTH_HW * start.half_width + const.GROWTH_PX
        ):
            stays = 0 if start.goes_on[end] else min(grown, start.half_width)
            cuts[end] = at + stays * (2 * end - 1)
    if cuts == [0.0, s[-1]]:
        return None
    inside = (s >= cuts[0]) & (s <= cuts[1])
    return line[inside] if inside.sum() > half / 2 else None

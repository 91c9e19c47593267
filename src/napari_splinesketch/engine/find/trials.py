"""Sets of paths, each fitted to the image in its own replica of the scene."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float, Int

from napari_splinesketch.engine.fit import fitting
from napari_splinesketch.engine.judge.doubt import NO_RIVAL
from napari_splinesketch.engine.types import Array

TOGETHER = 128
"""Curves fitted at a time, at most, so that time and memory grow in proportion to the curves."""

Line = Float[Array, "N 2"]


@dataclass(frozen=True, eq=False)
class Start:
    """Where the fit of one sketch begins.

    Attributes
    ----------
    line
        (N, 2) the traced path, or the sketch where there is none.
    traced
        Whether a path was found.
    margin
        By how much the best set of paths with another curve here is worse, in unexplained pixels.
    body
        What was fitted along the line already, if anything.
    """

    line: Line
    traced: bool
    margin: float = NO_RIVAL
    body: fitting.Body | None = None


@dataclass(frozen=True, eq=False)
class Comparison:
    """How sets of paths are compared.

    Attributes
    ----------
    image
        (H, W) the normalised image, blurred.
    weight
        Pixels of the image that each pixel looked at stands for.
    fit
        Fits lines to that image, each within its replica of the scene, beside fixed curves given
        as (replica, number): the fitted bodies, then the fixed ones. The last argument says which
        part of all fits this is, from 0 to 1.
    """

    image: Float[Array, "H W"]
    weight: float
    fit: Callable[
        [list[Line], Int[Array, " n"], list[tuple[int, int]], tuple[float, float]],
        list[fitting.Body],
    ]


@dataclass(frozen=True, eq=False)
class Trial:
    """One set of paths for one cluster: those of its sketches, then those without one.

    Attributes
    ----------
    cluster
        Its number.
    starts
        Where the fits begin.
    still
        Fixed curves that lie across.
    """

    cluster: int
    starts: list[Start]
    still: list[fitting.Body] = field(default_factory=list)

    @property
    def bodies(self) -> list[fitting.Body]:
        """The fitted starts."""
        return [s.body for s in self.starts if s.body is not None]


def fitted(
    trials: list[Trial], fixed: list[Line], comparison: Comparison, half_width: float
) -> list[Trial]:
    """The trials with every path fitted, each trial a replica of the scene."""
    across: dict[int, list[int]] = {}
    for t in trials:
        met = across.setdefault(t.cluster, [])
        met += [k for k in _met(fixed, t.starts, half_width) if k not in met]
    found: list[Trial] = []
    for batch in _batches(trials, across):
        part = len(found) / len(trials), (len(found) + len(batch)) / len(trials)
        found += _fitted(batch, across, comparison, part)
    return found


def _batches(trials: list[Trial], across: dict[int, list[int]]) -> Iterator[list[Trial]]:
    batch: list[Trial] = []
    size = 0
    for t in trials:
        count = len(t.starts) + len(across[t.cluster])
        if batch and size + count > TOGETHER:
            yield batch
            batch, size = [], 0
        batch.append(t)
        size += count
    if batch:
        yield batch


def _fitted(
    trials: list[Trial],
    across: dict[int, list[int]],
    comparison: Comparison,
    part: tuple[float, float],
) -> list[Trial]:
    lines = [s.line for t in trials for s in t.starts]
    replica = np.repeat(np.arange(len(trials)), [len(t.starts) for t in trials])
    still = [(r, k) for r, t in enumerate(trials) for k in across[t.cluster]]
    bodies = comparison.fit(lines, replica, still, part)
    moved, fixed = iter(bodies[: len(lines)]), iter(bodies[len(lines) :])
    return [
        Trial(
            t.cluster,
            [replace(s, body=next(moved)) for s in t.starts],
            [next(fixed) for _ in across[t.cluster]],
        )
        for t in trials
    ]


def _met(fixed: list[Line], starts: list[Start], half_width: float) -> list[int]:
    """Fixed curves whose surroundings overlap with those of some paths."""
    if not fixed or not starts:
        return []
    points = np.concatenate([s.line for s in starts])
    low, high = points.min(0) - 4 * half_width, points.max(0) + 4 * half_width
    return [k for k, f in enumerate(fixed) if (f.max(0) > low).all() and (f.min(0) < high).all()]

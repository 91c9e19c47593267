"""Where a body is when the image does not say: ahead of what is known of it, or in between.

How well each way of moving predicts a body is measured on its own last frames, so that nothing is
assumed of how it moves: a worm crawls along its path or swims by waves, a filament glides.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from numpy.lib.stride_tricks import sliding_window_view

from napari_splinesketch.engine.spline import arc_length, tangents
from napari_splinesketch.engine.types import Array

BEFORE = 0.5
"""Error of a prediction by one frame before any was measured, px ..."""
COUNTED = 1.0
"""... which counts as much as so many measured ones."""
GROWTH = 1.2
"""Power of the number of frames by which errors of predictions grow."""
BASE = 3
"""Frames whose movement together predicts: that of one would be twice as uncertain as a curve's
ends are."""
END = 12
"""Points at either end whose direction a body goes on in."""
AGREE = 3.0
"""Standard errors, beside half of a half-width, within which a curve is where it is expected."""
WAVES = np.arange(0.4, 2.3, 0.1)
"""How often the wave of a swimmer may go into its length."""
SHIFT = 25
"""Points by which the bends of a body move along it from one known frame to the next at most."""

Points = Float[Array, "P 2"]
Known = tuple[float, Points]
"""A frame, and points of the body there, all the same number and from the same end."""
Mover = Callable[[Points, Points, float], Points]
"""Takes the points before, the last ones and how many such steps to go."""


class Predicted(NamedTuple):
    """Where a body is expected, and the standard error, px: infinite where nothing tells it."""

    line: Points
    sd: float

    def agrees(self, line: Points, half_width: float) -> bool:
        """Whether a line is where a body of such a half-width is expected."""
        apart = float(np.sqrt(((line - self.line) ** 2).sum(1).mean() / 2))
        return apart < AGREE * self.sd + 0.5 * half_width


def ahead(known: Sequence[Known]) -> Callable[[float], Predicted]:
    """What predicts a body in frames beyond those known, and how far off that may be.

    The nearest of the known ones is the last; up to four more tell how it moves.
    """
    if len(known) < 2:
        return lambda frame: Predicted(known[-1][1], np.inf)
    base = min(BASE, max((len(known) - 1) // 2, 1))
    mover, error = _best(known, base)
    older, newer = known[-1 - base], known[-1]

    def there(frame: float) -> Predicted:
        line = mover(older[1], newer[1], steps_to(older, newer, frame))
        return Predicted(line, error * max(abs(frame - newer[0]), 1.0) ** GROWTH)

    return there


def between(before: Sequence[Known], after: Sequence[Known], frame: float) -> Predicted:
    """Where a body is in a frame of a gap, and how far off that may be.

    Each side, of which the frame nearest to the gap is the last, predicts it; where they agree it
    is between the two, nearer to the nearer one.
    """
    first, last = before[-1][0], after[-1][0]
    share = (frame - first) / (last - first)
    ways = ahead(before), ahead(after)
    sides = ways[0](frame), ways[1](frame)
    blend = share**2 * (3 - 2 * share)
    # What each side misses at the far end of the gap is put right in proportion.
    forth = sides[0].line + share**2 * (after[-1][1] - ways[0](last).line)
    back = sides[1].line + (1 - share) ** 2 * (before[-1][1] - ways[1](first).line)
    sds = [side.sd for side in sides if np.isfinite(side.sd)]
    sd = float(np.sqrt(1 / sum(e**-2.0 for e in sds))) if sds else BEFORE
    apart = float(np.sqrt(((forth - back) ** 2).sum(1).mean()))
    return Predicted((1 - blend) * forth + blend * back, max(sd, apart / 2))


def of_length(line: Points, length: float) -> Points:
    """The line, made longer or shorter at both ends alike."""
    s = arc_length(line)
    more = (length - s[-1]) / 2
    return _along(line, s, np.linspace(-more, s[-1] + more, len(line)))


def _best(known: Sequence[Known], base: int) -> tuple[Mover, float]:
    """The mover that would have predicted the last frames best, and its error.

    A movement is that of so many frames together. Waves can predict almost any single frame, so
    that one does not tell that there are any.
    """
    movers = MOVERS if len(known) > base + 2 else MOVERS[:-1]
    total, count = np.zeros(len(movers)), 0
    for i in range(base, len(known) - 1):
        older, newer = known[i - base], known[i]
        for frame, there in known[i + 1 :]:
            lag = max(abs(frame - newer[0]), 1.0)
            count += 1
            for k, mover in enumerate(movers):
                line = mover(older[1], newer[1], steps_to(older, newer, frame))
                total[k] += ((line - there) ** 2).sum(1).mean() / 2 / lag ** (2 * GROWTH)
    if not count:
        return movers[0], np.inf
    best = int(np.argmin(total))
    return movers[best], float(np.sqrt((total[best] + COUNTED * BEFORE**2) / (count + COUNTED)))


def steps_to(older: Known, newer: Known, frame: float) -> float:
    """How many times the way between two known frames it is on to a frame."""
    return (frame - newer[0]) / (newer[0] - older[0]) if newer[0] != older[0] else 0.0


def _half(older: Points, newer: Points, steps: float) -> Points:
    """Half of the last movement again: swimmers turn round."""
    return newer + 0.5 * steps * (newer - older)


def _stay(older: Points, newer: Points, steps: float) -> Points:
    return newer


def _drift(older: Points, newer: Points, steps: float) -> Points:
    """All of it as its middle moved."""
    return newer + steps * (newer - older).mean(0)


def _slide(older: Points, newer: Points, steps: float) -> Points:
    """Along its own path, and straight on beyond its end."""
    s = arc_length(newer)
    along = float(((newer - older) * tangents(newer)).sum(1).mean()) * steps
    return _along(newer, s, s + along)


def _wave(older: Points, newer: Points, steps: float) -> Points:
    """Its bends go on along it, as those of a swimmer do, while its middle goes on."""
    before, now = directions(older), directions(newer)
    shifts, both = _shifts(len(now))
    apart = both * (now - sliding_window_view(np.pad(before, SHIFT), len(now)))
    count = both.sum(1)
    mean = apart.sum(1) / count
    unlike = (apart**2).sum(1) / count - mean**2
    best = int(np.argmin(unlike[1:-1])) + 1
    left, least, right = unlike[best - 1 : best + 2]
    between = (left - right) / max(2 * (left - 2 * least + right), 1e-12)
    at = np.arange(len(now)) + (shifts[best] + np.clip(between, -0.5, 0.5)) * steps
    turned = (mean[best] + np.pi) % (2 * np.pi) - np.pi
    angle = _going_on(now, at) + steps * turned
    step = arc_length(newer)[-1] / len(now) * np.stack([np.cos(angle), np.sin(angle)], 1)
    line = np.concatenate([np.zeros((1, 2)), np.cumsum(step, axis=0)])
    return line + (newer + steps * (newer - older) - line).mean(0)


@lru_cache
def _shifts(count: int) -> tuple[np.ndarray, np.ndarray]:
    """By how many points a line may have gone on, and where it then lies upon what it was."""
    shifts = np.arange(-SHIFT, SHIFT + 1)
    before = np.arange(count) + shifts[:, None]
    return shifts, ((before >= 0) & (before < count)).astype(float)


def directions(line: Points) -> Float[np.ndarray, " P-1"]:
    """Of its steps, rad."""
    step = np.diff(line, axis=0)
    return np.unwrap(np.arctan2(step[:, 1], step[:, 0]))


def _going_on(angle: Float[np.ndarray, " N"], at: Float[np.ndarray, " M"]) -> np.ndarray:
    """Directions of a line at places along it; beyond its ends it bends evenly and in a wave."""
    basis, fitting = _waves(len(angle))
    terms = fitting @ angle
    best = int(np.argmin((((basis @ terms[..., None])[..., 0] - angle) ** 2).sum(1)))
    inside = np.clip(at, 0, len(angle) - 1)
    there, end = (_waved(WAVES[best], x / len(angle)) @ terms[best] for x in (at, inside))
    return np.interp(inside, np.arange(len(angle)), angle) + there - end


@lru_cache
def _waves(count: int) -> tuple[np.ndarray, np.ndarray]:
    """An even bend with each of the waves upon it, at so many points; and what fits that."""
    basis = np.stack([_waved(wave, np.arange(count) / count) for wave in WAVES])
    return basis, np.linalg.pinv(basis)


def _waved(wave: float, u: Float[np.ndarray, " N"]) -> Float[np.ndarray, "N 4"]:
    turn = 2 * np.pi * wave * u
    return np.stack([np.ones_like(u), u, np.sin(turn), np.cos(turn)], 1)


def _along(line: Points, s: Float[Array, " P"], at: Float[Array, " P"]) -> Points:
    """Points of a line at arc lengths `at`, straight on beyond its ends."""
    inside = np.stack([np.interp(at, s, x) for x in line.T], 1)
    ends = line[0] - line[: END + 1][-1], line[-1] - line[-1 - END :][0]
    head, tail = (e / (np.linalg.norm(e) + 1e-9) for e in ends)
    beyond = np.maximum(at - s[-1], 0.0)[:, None] * tail
    return inside + beyond + np.maximum(-at, 0.0)[:, None] * head


MOVERS: tuple[Mover, ...] = (_half, _stay, _drift, _slide, _wave)
"""The last needs more than one frame to be told from the others."""

"""Fit a list of curves to a normalised image."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain

import jax
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import special
from scipy.linalg import block_diag
from scipy.spatial import KDTree

from napari_splinesketch.engine import constants as const
from napari_splinesketch.engine import spline
from napari_splinesketch.engine.fit import bands as pad
from napari_splinesketch.engine.fit import solver
from napari_splinesketch.engine.fit.tube import GLOBALS, INDEX, blend, brightness
from napari_splinesketch.engine.look.scene import Scene
from napari_splinesketch.engine.types import Array


class Stopped(Exception):
    """Raised inside the engine when the caller cancels."""


@dataclass(frozen=True, eq=False)
class Body:
    """One fitted curve."""

    theta: Float[Array, " D"]
    """Rows and columns of the K knots, px, then `tube.GLOBALS`."""
    pixels: Int[Array, " m"]
    """Flat indices of its band in the image."""
    own: Float[Array, " m"]
    """Its brightness there, as a share of the contrast."""
    cost: float
    """χ² of its band and its priors."""
    hessian: Float[Array, "D D"]
    """Normal matrix of band and priors, for the noise that was assumed."""

    @cached_property
    def covariance(self) -> Float[Array, "D D"]:
        """(D, D) inverse of the normal matrix; directions that nothing tells stay finite."""
        matrix = self.hessian.astype(np.float64)
        return np.linalg.inv(matrix + 1e-9 * np.trace(matrix) * np.eye(len(matrix)))

    @property
    def knots(self) -> Float[Array, "K 2"]:
        """(K, 2) row and col of the knots, px."""
        return self.theta[: len(self.theta) - len(GLOBALS)].reshape(2, -1).T

    @property
    def parameters(self) -> Float[Array, " G"]:
        """(G,) the parameters named in `tube.GLOBALS`."""
        return self.theta[-len(GLOBALS) :]

    def __getitem__(self, name: str) -> float:
        """One of `tube.GLOBALS`."""
        return float(self.parameters[INDEX[name]])

    @property
    def half_width(self) -> float:
        """Of the body along most of its length, px."""
        return float(np.exp(self["log_width_0"]))

    def with_knots(self, few: int) -> "Body":
        """The same curve with fewer knots, where it has no more freedom than that."""
        if few == len(self.knots):
            return self
        knots, same = len(self.knots), np.eye(len(GLOBALS))
        onto = block_diag(*[spline.thinner(knots, few)] * 2, same)
        back = block_diag(*[spline.even_basis(few, knots)] * 2, same)
        return replace(self, theta=onto @ self.theta, hessian=back.T @ self.hessian @ back)

    def points(self, count: int = 48) -> Float[Array, "count 2"]:
        """Points of the centreline, uniform in the spline's parameter."""
        return spline.even_basis(len(self.knots), count) @ self.knots


Report = Callable[[float, Callable[[], Float[Array, "n P 2"]]], None]
"""Called with the share done and a way to see the centrelines so far; may raise `Stopped`."""


def fit_curves(
    seen: Scene,
    theta: Float[Array, "n D"],
    priors: pad.Priors,
    sweeps: Sequence[int] = const.SWEEPS,
    *,
    moving: int | None = None,
    hold: Float[Array, "n 2K 2K"] | None = None,
    known: Mapping[int, Body] | None = None,
    beside: Sequence[Body] = (),
    report: Report | None = None,
) -> list[Body]:
    """Levenberg–Marquardt sweeps over all curves, from the parameters `theta`.

    Only the first `moving` curves move; of the others the appearance is fitted. Bodies `beside`
    them stay as they are; so do those that are `known` to be where they start, by number, unless
    what they touch has moved. `hold` is the inverse covariance of the knots around where they
    start, px⁻², and `sweeps` the most evaluations of each curve in each sweep.
    """
    n, knots, known = len(theta), (theta.shape[1] - len(GLOBALS)) // 2, known or {}
    pinned = np.arange(n) >= (n if moving is None else moving)
    hold = np.zeros((n, 2 * knots, 2 * knots)) if hold is None else hold.copy()
    hold[pinned] = const.PIN_PX**-2.0 * np.eye(2 * knots)
    widths = np.exp(theta[:, INDEX["log_width_0"] - len(GLOBALS)])
    pixels = [
        known[i].pixels if i in known else around(seen, line, width)
        for i, (line, width) in enumerate(zip(lines_of(theta), widths, strict=True))
    ]
    meets = pad.touching(pixels)
    every = [*pixels, *(body.pixels for body in beside)]
    bands, shift, begin = pad.make_bands(seen.normal, every, theta, seen.half_width, priors, hold)
    fit = solver.start(begin, bands.values.shape[1])
    for row, body in chain(known.items(), enumerate(beside, n)):
        fit.own[row, : len(body.own)] = body.own
    level, basis = pad.level(seen), pad.spline_basis(knots)
    with solver.settings():
        bands, fit, level, basis = _put(bands, fit, level, basis)

    def parameters() -> Float[Array, "n D"]:
        return np.asarray(fit.theta)[:n].astype(np.float64) + shift

    new, visited = ~np.isin(np.arange(n), list(known)), np.zeros(n, dtype=bool)
    free = ~pinned | (meets & ~pinned).any(1)
    pending = meets.any(1) & new
    sweeps = sweeps if meets.any() else (sum(sweeps),)
    for turn, steps in enumerate((1, *sweeps)):
        done = 0
        for chunk in _turns(np.flatnonzero(pending), meets & (turn > 0)):
            order = np.zeros(len(begin), np.int32)
            order[: len(chunk)] = chunk
            numbers = np.int32(len(chunk)), np.int32(steps)
            with solver.settings():
                fit = solver.sweep(bands, level, fit, basis, order, *numbers)
            done += len(chunk)
            if report:
                share = (turn + done / pending.sum()) / (1 + len(sweeps))
                report(share, lambda: lines_of(parameters()))
        moved = pending & (np.asarray(fit.gain)[:n] > const.GAIN)
        visited |= pending
        pending = (moved | (meets & moved).any(1)) & free if turn else new
        if not pending.any():
            break
    found = parameters()
    own, cost, hessian = (np.asarray(a) for a in (fit.own, fit.cost, fit.hessian))
    return [
        Body(found[i], p, own[i, : len(p)].copy(), float(cost[i]), hessian[i].copy())
        if visited[i]
        else known[i]
        for i, p in enumerate(pixels)
    ]


# Several times as fast as `jax.device_put` for many small arrays.
_put = jax.jit(lambda *given: given)


def moved(seen: Scene, body: Body, knots: Float[Array, "K 2"]) -> Body:
    """A body with its knots elsewhere, as it is drawn there."""
    there = replace(body, theta=np.concatenate([knots.T.ravel(), body.parameters]))
    if np.abs(knots - body.knots).max() < const.STAYS_PX:
        return there
    pixels = around(seen, there.points(), body.half_width)
    count = const.MOVED_SAMPLES_A_KNOT * len(knots)
    line = spline.even_basis(len(knots), count) @ knots
    at = np.column_stack(np.divmod(pixels, seen.valid.shape[1]))
    distance, nearest = KDTree(line).query(at)
    own = brightness(distance, nearest / (count - 1), body.parameters, np, special.erf)
    return replace(there, pixels=pixels, own=own)


def around(seen: Scene, line: Float[Array, "P 2"], half_width: float) -> Int[Array, " m"]:
    """Flat indices of the pixels of a body and of the background beside it."""
    margin = max(const.MARGIN_HW * seen.half_width, const.MARGIN_PX)
    return pad.band_pixels(line, half_width + margin, seen.valid)


def _turns(curves: Int[Array, " c"], meets: Bool[Array, "n n"]) -> Iterator[list[int]]:
    """The curves in chunks; of those that step at the same time no two meet.

    Two overlapping curves that step together would overshoot, again and again. One after the other,
    each sees the others as they are by then.
    """
    turns, alone = list[list[int]](), solver.at_a_time() == 1
    for i in curves.tolist():
        mine = next((turn for turn in turns if alone or not meets[i, turn].any()), None)
        if mine is None:
            turns.append([i])
        else:
            mine.append(i)
    for turn in turns:
        yield from (turn[first : first + const.CHUNK] for first in range(0, len(turn), const.CHUNK))


def lines_of(theta: Float[Array, "n D"], count: int = 48) -> Float[Array, "n P 2"]:
    """Points of the centrelines of many parameter vectors, uniform in the spline's parameter."""
    k = (theta.shape[1] - len(GLOBALS)) // 2
    return spline.even_basis(k, count) @ theta[:, : 2 * k].reshape(-1, 2, k).transpose(0, 2, 1)


def drawn(bodies: Sequence[Body], at: Int[Array, " P"]) -> Float[Array, " P"]:
    """Bodies at some of the image's flat indices, which rise, in contrasts."""
    if not len(at):
        return np.zeros(0)
    first = at[0]
    total, most = np.zeros((2, at[-1] - first + 1))
    for body in bodies:
        here = slice(*np.searchsorted(body.pixels, (first, at[-1] + 1)))
        pixels, own = body.pixels[here] - first, body.own[here]
        total[pixels] += own
        most[pixels] = np.maximum(most[pixels], own)
    overlap = float(np.median([body["overlap"] for body in bodies]))
    return blend(overlap, 0.0, total[at - first], most[at - first], np)

"""Fit a list of curves to a normalised image."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import jax
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.linalg import block_diag

from napari_splinesketch.engine import spline
from napari_splinesketch.engine.fit import bands as pad
from napari_splinesketch.engine.fit import solver
from napari_splinesketch.engine.fit.profile import blend
from napari_splinesketch.engine.fit.tube import GLOBALS, INDEX
from napari_splinesketch.engine.look.scene import Scene
from napari_splinesketch.engine.types import Array

GAIN = 1.0
"""A curve that improved its χ² by less in a visit is not visited again ..."""
RESTLESS = 0.03
"""... and one that improved it by more than this share in its last has not settled: it is visited
again ..."""
MORE = 24
"""... in so many more sweeps at most."""
MARGIN, MARGIN_PX = 0.5, 4.0
"""Background on either side of a body in its band, half-widths, and px at least."""
CHUNK = 128
"""Curves between two chances to cancel."""


class Stopped(Exception):
    """Raised inside the engine when the caller wants no more."""


@dataclass(frozen=True, eq=False)
class Body:
    """One fitted curve.

    Attributes
    ----------
    theta
        (D,) rows and columns of the K knots, px, then `tube.GLOBALS`.
    pixels
        (m,) flat indices of its band in the image.
    own
        (m,) its brightness there, as a share of the contrast.
    cost
        χ² of its band and its priors.
    hessian
        (D, D) normal matrix of band and priors, for the noise that was assumed.
    """

    theta: Float[Array, " D"]
    pixels: Int[Array, " m"]
    own: Float[Array, " m"]
    cost: float
    hessian: Float[Array, "D D"]

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


Report = Callable[[float, Callable[[], list[Body]]], None]
"""Called with the share done and a way to see the curves as they are; may raise `Stopped`."""


def fit_curves(
    seen: Scene,
    theta: Float[Array, "n D"],
    priors: pad.Priors,
    sweeps: Sequence[int],
    *,
    moving: int | None = None,
    hold: Float[Array, "n 2K 2K"] | None = None,
    report: Report | None = None,
) -> list[Body]:
    """Levenberg–Marquardt sweeps over all curves.

    Parameters
    ----------
    seen
        The image.
    theta
        (n, D) where to start.
    priors
        Of the n curves.
    sweeps
        Evaluations of each curve in each sweep.
    moving
        The first so many curves move; of the others only the look is fitted.
    hold
        (n, 2K, 2K) inverse covariance of the knots around where they start, px⁻²; None for no
        hold.
    report
        See `Report`.
    """
    n, d = theta.shape
    k = (d - len(GLOBALS)) // 2
    pinned = np.arange(n) >= (n if moving is None else moving)
    hold = np.zeros((n, 2 * k, 2 * k)) if hold is None else hold.copy()
    hold[pinned] = pad.PIN**-2.0 * np.eye(2 * k)
    margin = max(MARGIN * seen.half_width, MARGIN_PX)
    pixels = [
        pad.band_pixels(line, width + margin, seen.valid)
        for line, width in zip(lines_of(theta), _widths(theta, seen.half_width), strict=True)
    ]
    bands, shift, begin = pad.make_bands(seen.normal, pixels, theta, seen.half_width, priors, hold)
    basis, bend = pad.spline_basis(k)
    shared = solver.Level(
        np.concatenate([np.full(2 * k, -1e6), priors.low]).astype(np.float32),
        np.concatenate([np.full(2 * k, 1e6), priors.high]).astype(np.float32),
        np.float32(seen.noise),
        np.float32(max(solver.MOVES * seen.half_width, solver.MOVES_PX)),
    )
    fit = solver.start(begin, bands.values.shape[1])
    bands, fit, shared, basis, bend = jax.device_put((bands, fit, shared, basis, bend))

    def bodies() -> list[Body]:
        found = np.asarray(fit.theta)[:n].astype(np.float64) + shift
        own, cost, hessian = (np.asarray(a) for a in (fit.own, fit.cost, fit.hessian))
        return [
            Body(found[i], p, own[i, : len(p)], float(cost[i]), hessian[i])
            for i, p in enumerate(pixels)
        ]

    meets = _meeting(pixels, seen.valid.shape[1])
    free = ~pinned | (meets & ~pinned).any(1)
    pending: Sequence[int] = np.flatnonzero(meets.any(1) | pinned).tolist()
    for turn, steps in enumerate((1, *sweeps, *[sweeps[-1]] * MORE)):
        visited = 0
        for now in _apart(pending, meets) if turn else _chunks(pending):
            order = np.zeros(len(begin), np.int32)
            order[: len(now)] = now
            numbers = np.int32(len(now)), np.int32(steps)
            with jax.enable_x64(False):
                fit = solver.sweep(bands, shared, fit, basis, bend, order, *numbers)
            visited += len(now)
            if report:
                report(min((turn + visited / len(pending)) / (1 + len(sweeps)), 1.0), bodies)
        gain, cost = np.asarray(fit.gain)[:n], np.asarray(fit.cost)[:n]
        moved = gain > (GAIN if turn < len(sweeps) else RESTLESS * cost)
        pending = _unsettled(moved, pending, meets, free) if turn else range(n)
        if not pending:
            break
    return bodies()


def _apart(curves: Sequence[int], meets: Bool[Array, "n n"]) -> Iterator[list[int]]:
    """The curves in chunks of which no two meet, so that each sees the others as they are now.

    Two overlapping curves that step at the same time overshoot together, for ever.
    """
    colours: list[list[int]] = []
    for i in curves:
        free = (c for c in colours if not meets[i, c].any())
        colour = next(free, None)
        if colour is None:
            colours.append([i])
        else:
            colour.append(i)
    for colour in colours:
        yield from _chunks(colour)


def _chunks(curves: Sequence[int]) -> Iterator[list[int]]:
    for first in range(0, len(curves), CHUNK):
        yield list(curves[first : first + CHUNK])


def _unsettled(moved, visited: Sequence[int], meets, free) -> list[int]:
    """Curves to visit next: those that moved when they were visited, and those beside them."""
    here = np.zeros(len(meets), dtype=bool)
    here[list(visited)] = True
    moved = here & moved
    again = moved | (meets & moved).any(1)
    return np.flatnonzero(again & free).tolist()


def _meeting(pixels: list[Int[Array, " m"]], width: int) -> Bool[Array, "n n"]:
    """Which curves' bands touch, by their bounding boxes."""
    low = np.array([(p.min() // width, (p % width).min()) if len(p) else (0, 0) for p in pixels])
    high = np.array([(p.max() // width, (p % width).max()) if len(p) else (-1, -1) for p in pixels])
    meets = np.all((low[:, None] <= high[None]) & (high[:, None] >= low[None]), axis=2)
    np.fill_diagonal(meets, False)
    return meets


def lines_of(theta: Float[Array, "n D"], count: int = 48) -> Float[Array, "n P 2"]:
    """Points of the centrelines of many parameter vectors, uniform in the spline's parameter."""
    k = (theta.shape[1] - len(GLOBALS)) // 2
    return spline.even_basis(k, count) @ theta[:, : 2 * k].reshape(-1, 2, k).transpose(0, 2, 1)


def _widths(theta: Float[Array, "n D"], half_width: float) -> Float[Array, " n"]:
    width = np.exp(theta[:, INDEX["log_width_0"] - len(GLOBALS)])
    return np.clip(width, 0.5 * half_width, 2 * half_width)


def render_at(pixels: Int[Array, " P"], bodies: Sequence[Body]) -> Float[Array, " P"]:
    """Bodies at some pixels (sorted flat indices), as a share of the contrast."""
    total, most = np.zeros(len(pixels)), np.zeros(len(pixels))
    for body in bodies:
        at = np.searchsorted(pixels, body.pixels)
        total[at] += body.own
        most[at] = np.maximum(most[at], body.own)
    overlap = float(np.median([body["overlap"] for body in bodies]))
    return blend(overlap, 0.0, total, most, np)

"""Generated films with perfect labels: bodies that crawl, swim or glide, cross and hide."""

from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from jaxtyping import Bool, Float

from napari_splinesketch.metrics import POINTS
from napari_splinesketch.synthetic.drawing import (
    Finish,
    Look,
    Points,
    draw_bodies,
    taken,
    taper,
    texture_of,
)

Motion = Literal["crawl", "swim", "glide", "still"]
_SPEEDS = (0.7, 1.3)
_STEP = 0.25
_LIGHT = 0.2
_DEFOCUS = 1.0
"""Largest change of brightness, relative, and of blur, px, where light and focus drift."""
_TRIES = 150
_SPREAD = 0.25
"""Spread of the places where bodies meet, as a share of their length (standard deviation)."""
_MARGIN = 4.0
"""Margin of the frame that bodies keep clear of, px."""
_PARTING = 1.5
"""Speed at which the halves of a divided body move apart, px per frame."""
_APART = 5.0
"""Distance between the bodies of the first frame, half-widths."""


@dataclass(frozen=True, eq=False)
class Film:
    """A generated film and everything true about it."""

    images: Float[np.ndarray, "T H W"]
    """(T, H, W) float32: what a camera would give."""
    centrelines: Float[np.ndarray, "T n 100 2"]
    """(T, n, 100, 2): row and col, uniform in arc length, px."""
    half_widths: Float[np.ndarray, "n 100"]
    """(n, 100): distance from the centreline to the edge, px."""
    visible: Bool[np.ndarray, "T n 100"]
    """(T, n, 100): which points are drawn and inside the frame."""
    look: Look
    """The settings it was drawn with."""


def film(
    seed: int,
    *,
    motion: Motion = "crawl",
    frames: int = 60,
    bodies: int = 4,
    shape: tuple[int, int] = (208, 192),
    length: float = 60.0,
    half_width: float = 2.5,
    speed: float = 1.5,
    crossing: bool = True,
    touching: bool = False,
    hidden: int = 0,
    cover: float = 0.0,
    covered_first: bool = False,
    drift: bool = False,
    divides: int = 0,
    **look: object,
) -> Film:
    """Generate a film of slender bodies; the same arguments always give the same film.

    Parameters
    ----------
    seed
        Seed of every random draw.
    motion
        "crawl": along its own winding path; "swim": a wave travels along it; "glide": along a
        nearly straight path; "still".
    frames, bodies, shape
        Number of frames and of bodies; height and width of a frame, px.
    length, half_width, speed
        Typical values, px and px per frame.
    crossing
        Whether the bodies meet in the middle of the frame halfway through the film.
    touching
        Whether bodies that do not meet there may still cross, wherever they go.
    hidden
        Every second body vanishes for this many frames, about when bodies meet.
    cover
        Radius of an opaque disc of background near the middle, px; 0 for none.
    covered_first
        Whether the disc may cover a part of a body in the first frame.
    drift
        Whether focus and light change over the film.
    divides
        Frame from which the first body is two halves that move apart; 0 for never.
    **look
        Settings of `Look` to use in place of random ones.
    """
    if motion not in get_args(Motion):
        raise ValueError(f"motion is {motion!r}; choose one of {get_args(Motion)}.")
    rng = np.random.default_rng([seed, 18])
    chosen = replace(Look.draw(rng), **look)  # pyright: ignore[reportArgumentType]
    pace = 0.0 if motion == "still" else speed
    lines = _placed(
        rng, motion, frames, bodies, np.array(shape), length, half_width, pace, crossing, touching
    )
    widths = half_width * rng.uniform(0.85, 1.15, bodies)[:, None] * taper(chosen)
    if divides:
        lines[divides:, 0] += _parting(lines[divides:, 0])
    lit = np.ones((frames, bodies))
    for body in range(0, bodies, 2) if hidden else ():
        first = int(np.clip(frames / 2 + rng.normal(0, frames / 8), 2, frames - hidden - 2))
        lit[first : first + hidden, body] = 0
    for _ in range(_TRIES):
        centre = np.array(shape) / 2 + rng.normal(0, 12, 2)
        uncovered = np.linalg.norm(lines - centre, axis=3) >= cover
        if uncovered[0].all() or covered_first:
            break
    else:
        raise ValueError(f"{_TRIES} discs of {cover:g} px cover bodies in the first frame.")
    inside = ((lines >= 0) & (lines <= np.array(shape) - 1)).all(3)
    images = _drawn(rng, chosen, shape, lines, widths, lit, (centre, cover), drift, divides)
    visible = inside & uncovered & (lit[:, :, None] > 0)
    return Film(images, lines, widths, visible, chosen)


def _placed(
    rng: np.random.Generator,
    motion: Motion,
    frames: int,
    bodies: int,
    shape: np.ndarray,
    length: float,
    half_width: float,
    speed: float,
    crossing: bool,
    touching: bool,
) -> Float[np.ndarray, "T n 100 2"]:
    """Bodies that stay in the frame, apart from each other in the first one."""
    found: list[np.ndarray] = []
    for _ in range(_TRIES * bodies):
        if crossing:
            heading = 2 * np.pi * (len(found) + rng.uniform(-0.2, 0.2)) / bodies
            meeting = shape / 2 + rng.normal(0, _SPREAD * length, 2)
        else:
            heading, meeting = rng.uniform(0, 2 * np.pi), rng.uniform(0.15, 0.85, 2) * shape
        line = _moving(rng, motion, frames, length * rng.uniform(0.8, 1.1), speed, heading)
        line = line + meeting
        if line.min() < _MARGIN or (line > shape - 1 - _MARGIN).any():
            continue
        reach, together = _APART * half_width, slice(1 if crossing or touching else None)
        pairs = (
            (a, b)
            for o in found
            for a, b in zip(line[together], o[together], strict=True)
            if np.linalg.norm(a[50] - b[50]) < 1.2 * length + reach
        )
        if all(_distance(a, b) > reach for a, b in pairs):
            found.append(line)
        if len(found) == bodies:
            return np.stack(found, axis=1)
    raise ValueError(
        f"{bodies} bodies of length {length:g} px at {speed:g} px a frame do not fit into a film "
        f"of {frames} frames of {tuple(shape)} px; make the frame larger or the film shorter."
    )


def _parting(lines: Float[np.ndarray, "T 100 2"]) -> Float[np.ndarray, "T 100 2"]:
    """How far the halves of a body have moved since it divided."""
    away = lines[:, POINTS // 2 :].mean(1) - lines[:, : POINTS // 2].mean(1)
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    gone = _PARTING * np.arange(1, len(lines) + 1)[:, None] * away
    side = np.where(np.arange(POINTS) < POINTS // 2, -0.5, 0.5)
    return gone[:, None] * side[:, None]


def _distance(a: Points, b: Points) -> float:
    return float(np.linalg.norm(a[::4, None] - b[None, ::4], axis=2).min())


def _moving(
    rng: np.random.Generator,
    motion: Motion,
    frames: int,
    length: float,
    speed: float,
    heading: float,
) -> Float[np.ndarray, "T 100 2"]:
    """A body through time, with its middle at the origin about halfway through."""
    speed = speed * rng.uniform(*_SPEEDS)
    t = np.arange(frames) - frames / 2 + rng.normal(0, frames / 12)
    unsteady = rng.uniform(0, 0.3) * np.sin(2 * np.pi * (t / 25 + rng.uniform()))
    progress = np.cumsum(speed * (1 + unsteady))
    progress -= np.interp(0.0, t, progress)
    s = np.arange(-200.0, 200.0, _STEP) * max(1.0, length / 60)
    turn = rng.normal(0, 0.004 if motion == "glide" else 0.008)
    angle = heading + turn * s
    wave, phase = rng.uniform(0.5, 0.8), rng.uniform(0, 2 * np.pi)
    wavelength = length * rng.uniform(0.7, 1.1)
    if motion in ("crawl", "still"):
        angle = angle + wave * np.sin(2 * np.pi * s / wavelength + phase)
    u = np.linspace(-0.5, 0.5, POINTS) * length
    at = progress[:, None] + u
    beat = rng.uniform(0.04, 0.08)
    turning = np.interp(at, s, angle)
    if motion == "swim":
        turning = turning + wave * np.sin(2 * np.pi * (u / wavelength + beat * t[:, None]) + phase)
    path = np.cumsum(np.stack([np.sin(angle), np.cos(angle)], 1) * (s[1] - s[0]), axis=0)
    path -= path[len(s) // 2]
    middle = np.stack([np.interp(progress, s, x) for x in path.T], 1)
    steps = np.stack([np.sin(turning), np.cos(turning)], 2) * length / (POINTS - 1)
    body = np.cumsum(steps, axis=1)
    if motion == "swim":
        return body - body.mean(1, keepdims=True) + middle[:, None]
    return np.stack([np.interp(at, s, x) for x in path.T], 2)


def _drawn(
    rng: np.random.Generator,
    look: Look,
    shape: tuple[int, int],
    lines: Float[np.ndarray, "T n 100 2"],
    widths: Float[np.ndarray, "n 100"],
    lit: Float[np.ndarray, "T n"],
    cover: tuple[Float[np.ndarray, "2"], float],
    drift: bool,
    divides: int,
) -> Float[np.ndarray, "T H W"]:
    finishes = [Finish.draw(rng, look) for _ in widths]
    texture = texture_of(rng, look, shape)
    rows, columns = np.indices(shape)
    apart = np.hypot(rows - cover[0][0], columns - cover[0][1])
    texture = texture * (apart >= cover[1])
    phases = 2 * np.pi * rng.uniform(0, 1, 2)
    images = []
    for frame, here in enumerate(lines):
        there = [i for i in range(len(widths)) if lit[frame, i] > 0]
        drawn_as = [(here[i], widths[i], finishes[i]) for i in there]
        if divides and frame >= divides and 0 in there:
            halves = np.split(here[0], 2)
            half_width = widths[0].max() * taper(look, len(halves[0]))
            drawn_as[:1] = [(half, half_width, finishes[0]) for half in halves]
        parts = tuple(zip(*drawn_as, strict=True)) or ((), (), ())
        drawn = draw_bodies(parts[0], parts[1], parts[2], look, shape)
        swing = np.sin(2 * np.pi * frame / 40 + phases) * drift
        blur = look.blur + _DEFOCUS * max(swing[0], 0.0)
        images.append(taken(rng, drawn * texture, look, blur, 1 + _LIGHT * swing[1])[-1])
    return np.array(images, dtype=np.float32)

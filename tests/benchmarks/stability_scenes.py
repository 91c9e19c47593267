"""Frames on which methods fail: generated bodies in the positions that are hard to tell apart.

`stability_plate_edge.png` is a real frame with the rim of a plate, a hair line and debris, into
which generated bodies are drawn: from the public repository kirkegaardlab/deeptanglelabel
(MIT License, Copyright (c) 2023 Julius B. Kirkegaard), cropped.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import skimage.io
from jaxtyping import Float
from scipy import ndimage

from napari_splinesketch import synthetic
from napari_splinesketch.synthetic import drawing
from napari_splinesketch.synthetic.bodies import random_curve

PLATE_EDGE = Path(__file__).with_name("stability_plate_edge.png")
SHAPE = (128, 128)
MARGIN = 6.0
_TRIES = 2000

Line = Float[np.ndarray, "N 2"]


@dataclass(frozen=True, eq=False)
class Drawn:
    """A frame and the centrelines in it.

    Attributes
    ----------
    image
        (H, W).
    truths
        One (100, 2) array per body, row and col, px.
    half_width
        Of the bodies, px.
    """

    image: np.ndarray
    truths: tuple[Line, ...]
    half_width: float


def usual(rng: np.random.Generator, bodies: int = 2, **options) -> Drawn:
    """A frame as `synthetic.scene` makes it."""
    made = synthetic.scene(int(rng.integers(2**31)), bodies=bodies, **options)
    width = float(np.mean([w.max() for w in made.half_widths]))
    return Drawn(made.image, made.centrelines, width)


def draw(
    rng: np.random.Generator,
    centrelines: Sequence[Line],
    *,
    half_width: float = 3.0,
    shape: tuple[int, int] = SHAPE,
    **look,
) -> Drawn:
    """Draw bodies along given centrelines, with a random look."""
    chosen = replace(synthetic.Look.draw(rng), **look)
    lines = tuple(synthetic.resample(c) for c in centrelines)
    widths = tuple(half_width * drawing.taper(chosen) for _ in lines)
    finishes = tuple(drawing.Finish.draw(rng, chosen) for _ in lines)
    drawn = drawing.draw_bodies(lines, widths, finishes, chosen, shape)
    drawn = drawn * drawing.texture_of(rng, chosen, shape)
    image = drawing.taken(rng, drawn, chosen, chosen.blur)[-1]
    return Drawn(image.astype(np.float32), lines, half_width)


def _inside(lines: Sequence[Line], shape=SHAPE, margin: float = MARGIN) -> bool:
    points = np.concatenate(lines)
    return bool((points > margin).all() and (points < np.array(shape) - 1 - margin).all())


def _about(rng: np.random.Generator, lines: Sequence[Line], shape=SHAPE) -> list[Line]:
    """Turn lines together at random and put their middle near that of the frame."""
    points = np.concatenate(lines)
    middle = (points.min(0) + points.max(0)) / 2
    angle = rng.uniform(0, 2 * np.pi)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    place = (np.array(shape) - 1) / 2 + rng.uniform(-5, 5, 2)
    return [(line - middle) @ turn + place for line in lines]


def _arranged(rng: np.random.Generator, arrange, shape=SHAPE) -> list[Line]:
    """The first of many random arrangements that fits into the frame."""
    for _ in range(_TRIES):
        lines = _about(rng, arrange(), shape)
        if _inside(lines, shape):
            return lines
    raise ValueError(f"No arrangement fits into a frame of {shape} px.")


def _tangents(line: Line) -> Line:
    step = np.gradient(line, axis=0)
    return step / np.linalg.norm(step, axis=1, keepdims=True)


def parallel(rng: np.random.Generator) -> Drawn:
    """Two bodies side by side that touch, like one thick body."""
    half_width = 3.0

    def arrange() -> list[Line]:
        line = random_curve(rng, rng.uniform(75, 95), half_width, 0.6)
        across = _tangents(line)[:, ::-1] * [1, -1]
        gap = 2 * half_width * rng.uniform(0.95, 1.1)
        beside = line + gap * across
        slide = int(rng.integers(0, 12))
        return [line, beside[slide:] if rng.random() < 0.5 else beside[: 100 - slide]]

    return draw(rng, _arranged(rng, arrange), half_width=half_width)


def coil(rng: np.random.Generator) -> Drawn:
    """A body that lies over itself: a loop with crossed ends, or a ring that closes."""
    u = np.linspace(0, 1, 200)

    def arrange() -> list[Line]:
        if rng.random() < 0.5:  # crossed ends
            length, turning = rng.uniform(125, 150), np.deg2rad(rng.uniform(240, 300))
            bend = np.exp(-0.5 * ((u - 0.5) / 0.16) ** 2)
        else:  # a ring that winds beside itself
            length, turning = rng.uniform(120, 140), np.deg2rad(rng.uniform(380, 430))
            bend = 1.15 - 0.3 * u
        heading = np.cumsum(bend) / bend.sum() * turning
        steps = np.stack([np.sin(heading), np.cos(heading)], axis=1) * length / len(u)
        return [np.cumsum(steps, axis=0)]

    return draw(rng, _arranged(rng, arrange))


def _meeting(rng: np.random.Generator, degrees: tuple[float, float], end: bool) -> list[Line]:
    """Two gently bent bodies that meet at an angle, in their middles or end to middle."""
    first, second = (random_curve(rng, rng.uniform(80, 105), 3.0, 0.35) for _ in range(2))
    at, there = (int(rng.integers(40, 60)) for _ in range(2))
    if end:
        there = 0
    headings = [
        np.arctan2(*t[i, ::-1]) for t, i in ((_tangents(first), at), (_tangents(second), there))
    ]
    angle = np.deg2rad(rng.uniform(*degrees)) * rng.choice([-1, 1])
    turned = synthetic.rotate(second, np.rad2deg(headings[0] - headings[1] + angle))
    return [first, turned + first[at] - turned[there]]


def crossing(rng: np.random.Generator) -> Drawn:
    """Two bodies that cross at 12 to 25 degrees."""
    return draw(rng, _arranged(rng, lambda: _meeting(rng, (12, 25), end=False)))


def junction(rng: np.random.Generator) -> Drawn:
    """A body that ends on the middle of another, leaving it at 20 to 40 degrees."""
    shape = (160, 160)
    lines = _arranged(rng, lambda: _meeting(rng, (20, 40), end=True), shape)
    return draw(rng, lines, shape=shape)


def leaving(rng: np.random.Generator) -> Drawn:
    """A body of which 15 to 45 % lie outside the frame; the truth is what lies inside."""
    for _ in range(_TRIES):
        line = random_curve(rng, 100, 3.0, 1.0) + rng.uniform(0, 127, 2)
        inside = ((line >= 0) & (line <= 127)).all(axis=1)
        one_piece = np.count_nonzero(np.diff(inside.astype(int))) == 1
        if one_piece and 0.55 < inside.mean() < 0.85:
            found = draw(rng, [line])
            return replace(found, truths=(synthetic.resample(line[inside]),))
    raise ValueError("No body leaves the frame as wanted.")


def vignetted(rng: np.random.Generator) -> Drawn:
    """A strong gradient, and corners that are half as bright as the middle."""
    slopes = rng.uniform(1.5, 3, 2) * rng.choice([-1, 1], 2)
    made = usual(rng, 2, contrast=0.15, level=0.5, gradient=tuple(slopes), shape=(140, 150))
    r, c = (np.linspace(-1, 1, n) for n in made.image.shape)
    return replace(made, image=made.image * (1 - 0.25 * (r[:, None] ** 2 + c**2)))


@cache
def _plate() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The real frame, its smooth brightness, and how far each pixel is from anything dark."""
    image = skimage.io.imread(PLATE_EDGE).astype(float)
    smooth = ndimage.median_filter(image, 21)
    clear = (image > smooth - 14) & (smooth > 110)
    return image, smooth, np.asarray(ndimage.distance_transform_edt(clear))


def plate_edge(rng: np.random.Generator) -> Drawn:
    """A thin dark body in a real frame, close to the plate's rim, a hair line, debris or a worm."""
    image, smooth, clear = _plate()
    half_width = 1.1
    for _ in range(_TRIES):
        line = random_curve(rng, rng.uniform(30, 42), half_width, 0.8)
        line = line + rng.uniform(0, np.array(image.shape) - 1)
        if not _inside([line], image.shape, 4):
            continue
        rows, cols = np.rint(line).astype(int).T
        if 3.5 < clear[rows, cols].min() < 9:
            widths = half_width * drawing.taper(synthetic.Look())
            look = synthetic.Look(flatness=0.6)
            body = drawing.draw_bodies((line,), (widths,), (drawing.Finish(),), look, image.shape)
            dark = 0.5 * smooth * ndimage.gaussian_filter(body, 0.6)
            return Drawn(np.clip(image - dark, 0, 255).astype(np.uint8), (line,), half_width)
    raise ValueError("No place for a body.")


def empty(rng: np.random.Generator) -> tuple[Drawn, Line]:
    """A body in one half of a wide frame, and a line in the other half, where there is none."""
    made = usual(rng, 1, shape=(128, 300), length=70)
    while made.truths[0][:, 1].max() > 120:
        made = usual(rng, 1, shape=(128, 300), length=70)
    line = random_curve(rng, 70, 3.0, 0.5)
    return made, line - line.mean(0) + [64, 245]

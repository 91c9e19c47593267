"""Generated scenes of deliberately foreign make: nothing in them comes from the engine's model.

A body is a profile across times a shading along, over a half-width that ends at the tips; what is
around it (blobs, an edge, fringes, other bodies) is added on top.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from zlib import crc32

import numpy as np
from jaxtyping import Float
from real_cases import Case, Line, by_arc, length_of
from scipy.ndimage import gaussian_filter
from scipy.spatial import KDTree

from napari_splinesketch.synthetic import resample
from napari_splinesketch.synthetic.bodies import place, random_curve

NAME = "foreign_"
"""What the names of these cases begin with."""
SET = "hand"
"""Name of their set of sketches."""
SEEDS = 2
SAMPLES = 3
"""Each pixel is the mean of so many by so many samples."""
REACH = 2.2
"""A body reaches so many half-widths from its centreline, its halo included."""
MISS = (1.5, 5.0)
"""A vertex of a sketch is off by half a half-width, but never less or more than this, px."""

BESIDE = (2.5, 6.0)
"""How far two bodies of a pair are apart, in half-widths."""

Along = Float[np.ndarray, " N"]


def blunt(x: Along, length: float, width: float) -> Along:
    """Half-width at distance x from the first tip: constant, with round ends."""
    near = np.clip(np.minimum(x, length - x) / width, 0, 1)
    return width * np.sqrt(1 - (1 - near) ** 2)


def pointed(x: Along, length: float, width: float) -> Along:
    """Half-width that falls in a line to both tips over four half-widths."""
    return np.clip(np.minimum(x, length - x) / 4, 0, width)


def club(x: Along, length: float, width: float) -> Along:
    """Half-width that thins in a line from one round end to a third of it at the other."""
    thin = width / 3
    last = blunt(np.maximum(x, length / 2), length, thin) / thin
    return np.minimum(blunt(x, length, width), (width - (width - thin) * x / length) * last)


TAPERS = {"blunt": blunt, "pointed": pointed, "club": club}


def _flat(u: np.ndarray) -> np.ndarray:
    return (u < 1).astype(float)


def _tube(u: np.ndarray) -> np.ndarray:
    return np.sqrt(np.clip(1 - u**2, 0, None))


PROFILES = {"flat": _flat, "tube": _tube}
"""Profiles of bodies that end at their half-width: a sheet's, and that of a tube that glows."""


def _round(u: np.ndarray) -> np.ndarray:
    return np.exp(-2 * u**2)


def _hollow(u: np.ndarray) -> np.ndarray:
    return 0.15 * (u < 1) + np.exp(-(((u - 0.85) / 0.2) ** 2))


def _haloed(u: np.ndarray) -> np.ndarray:
    return 1.0 * (u < 1) - 0.5 * ((u >= 1) & (u < 1.8))


def _even(s: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    del rng
    return np.ones_like(s)


def _beads(s: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return 0.25 + 0.75 * np.cos(np.pi * (rng.integers(8, 14) * s + rng.random())) ** 2


def _fading(s: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return np.where(rng.random() < 0.5, s, 1 - s) * 0.85 + 0.15


def _blinking(s: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    gaps = rng.uniform(0.15, 0.85, 3)
    return np.prod([1 - np.exp(-(((s - gap) / 0.03) ** 2)) for gap in gaps], axis=0)


@dataclass(frozen=True)
class Look:
    """What a scene looks like.

    Attributes
    ----------
    profile, along, taper
        Brightness across a body, at distances in half-widths; along it; its half-width.
    half_width, length, bodies, shape
        Of one body, px; how many; of the frame.
    dark
        Share of bodies that are darker than the background.
    around
        What is added: "blobs", "edge", "fringes", "network".
    lit
        Whether bodies are in relief: bright on one side and dark on the other.
    noise
        Standard deviation, in contrasts.
    """

    profile: Callable[[np.ndarray], np.ndarray] = _round
    along: Callable[[np.ndarray, np.random.Generator], np.ndarray] = _even
    taper: Callable[[Along, float, float], Along] = blunt
    half_width: float = 3.0
    length: float = 110.0
    bodies: int = 6
    shape: tuple[int, int] = (300, 340)
    dark: float = 0.0
    around: frozenset[str] = field(default_factory=frozenset)
    lit: bool = False
    noise: float = 0.08


LOOKS = {
    "round": Look(),
    "flat": Look(profile=_flat),
    "hollow": Look(profile=_hollow, half_width=4.5),
    "haloed": Look(profile=_haloed, dark=1.0),
    "beads": Look(along=_beads, half_width=2.0),
    "fading": Look(along=_fading),
    "blinking": Look(along=_blinking, half_width=2.0),
    "pointed": Look(taper=pointed, profile=_flat, half_width=4.0),
    "club": Look(taper=club, profile=_flat, half_width=5.0),
    "blobs": Look(around=frozenset({"blobs"})),
    "edge": Look(around=frozenset({"edge"})),
    "fringes": Look(around=frozenset({"fringes"}), half_width=4.0),
    "network": Look(around=frozenset({"network"}), half_width=2.0, bodies=3),
    "mixed": Look(dark=0.5),
    "thin": Look(half_width=1.2, length=90.0, bodies=8),
    "relief": Look(lit=True, half_width=5.0, length=160.0, shape=(380, 430)),
    "wide": Look(half_width=16.0, length=400.0, bodies=4, shape=(700, 800)),
}


def cases(wanted: Callable[[str], bool] = lambda name: True) -> Iterator[Case]:
    """Every look a few times; only scenes whose names are wanted are drawn."""
    for kind, look in LOOKS.items():
        for seed in range(SEEDS):
            name = f"{NAME}{kind}_{seed}"
            if wanted(name):
                yield scene(name, kind, look)


def scene(name: str, kind: str, look: Look) -> Case:
    """Draw a scene; its name is its seed."""
    rng = np.random.default_rng(crc32(name.encode()))
    lines, widths = _bodies(rng, look)
    image = np.zeros(look.shape)
    for line, width in zip(lines, widths, strict=True):
        sign = -1.0 if rng.random() < look.dark else 1.0
        image += sign * drawn(rng, line, width, look)
    image = gaussian_filter(image, 0.7) + _around(rng, look)
    if look.lit:
        image = in_relief(image, rng.uniform(0, 2 * np.pi), look.half_width)
    image += look.noise * rng.standard_normal(look.shape)
    grey = (np.clip(90 + 40 * image, 0, 255)).astype(np.uint8)
    sketches = tuple(hand_drawn(rng, line, look.half_width) for line in lines)
    return Case(name, f"generated, {kind}", grey, lines, {SET: sketches}, look.half_width)


def in_relief(image: np.ndarray, angle: float, half_width: float) -> np.ndarray:
    """The slope of an image towards an angle, in contrasts for bodies of a half-width."""
    down, across = np.gradient(image)
    return half_width * (np.sin(angle) * down + np.cos(angle) * across)


def _bodies(rng: np.random.Generator, look: Look) -> tuple[tuple[Line, ...], list[float]]:
    lines: tuple[Line, ...] = ()
    for body in range(look.bodies):
        length = look.length * rng.uniform(0.7, 1.2)
        across = body % 3 == 2
        lines += (
            place(
                rng,
                length,
                look.half_width,
                0.8,
                look.shape,
                1.5 * look.half_width + 4,
                lines,
                across=across,
                shared=0.6 if across else 0.2,
            ),
        )
    widths = [look.half_width * rng.uniform(0.85, 1.15) for _ in lines]
    if "network" in look.around:
        trunks = lines
        for trunk in trunks:
            for at in rng.uniform(0.15, 0.85, 3):
                branch = _branch(rng, trunk, at, look)
                if branch is not None:
                    lines += (branch,)
                    widths.append(0.7 * look.half_width)
    return lines, widths


def _branch(rng: np.random.Generator, trunk: Line, at: float, look: Look) -> Line | None:
    """A body that leaves a trunk at 35 to 70 degrees, or None where the frame has no room."""
    point = trunk[int(at * (len(trunk) - 1))]
    step = np.gradient(trunk, axis=0)[int(at * (len(trunk) - 1))]
    curve = random_curve(rng, 0.5 * look.length, look.half_width, 0.6)
    start = np.gradient(curve, axis=0)[0]
    turn = np.arctan2(*step) + rng.choice([-1, 1]) * np.deg2rad(rng.uniform(35, 70))
    turn -= np.arctan2(*start)
    matrix = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    line = (curve - curve[0]) @ matrix.T + point
    inside = (line > 4).all() and (line < np.array(look.shape) - 5).all()
    return line if inside else None


def drawn(
    rng: np.random.Generator, line: Line, width: float, look: Look
) -> Float[np.ndarray, "H W"]:
    """One body alone, in contrasts."""
    length = length_of(line)
    fine = by_arc(resample(line, max(100, int(length))), int(4 * length) + 1)
    along = np.linspace(0, 1, len(fine))
    half = np.maximum(look.taper(length * along, length, width), 1e-3)
    shade = look.along(along, rng)
    reach = REACH * width + 2
    low = np.maximum(np.floor(fine.min(axis=0) - reach), 0).astype(int)
    high = np.minimum(np.ceil(fine.max(axis=0) + reach) + 1, look.shape).astype(int)
    steps = (np.arange(SAMPLES) + 0.5) / SAMPLES - 0.5
    rows, columns = (
        (np.arange(a, b)[:, None] + steps).ravel() for a, b in zip(low, high, strict=True)
    )
    grid = np.stack(np.meshgrid(rows, columns, indexing="ij"), axis=-1)
    found = KDTree(fine).query(grid.reshape(-1, 2), distance_upper_bound=reach)
    distance, nearest = (np.asarray(part) for part in found)
    near = np.isfinite(distance)
    values = np.zeros(len(distance))
    at = nearest[near]
    values[near] = shade[at] * look.profile(distance[near] / half[at])
    size = high - low
    out = np.zeros(look.shape)
    out[low[0] : high[0], low[1] : high[1]] = values.reshape(
        size[0], SAMPLES, size[1], SAMPLES
    ).mean(axis=(1, 3))
    return out


def _around(rng: np.random.Generator, look: Look) -> Float[np.ndarray, "H W"]:
    rows, columns = np.mgrid[: look.shape[0], : look.shape[1]].astype(float)
    out = rng.uniform(-0.5, 0.5) * rows / look.shape[0]
    if "blobs" in look.around:
        for _ in range(4):
            r, c = rng.uniform(0, look.shape)
            size = rng.uniform(2, 6) * look.half_width
            out += 3.5 * np.exp(-((rows - r) ** 2 + (columns - c) ** 2) / (2 * size**2))
    if "edge" in look.around:
        angle = rng.uniform(0, np.pi)
        beyond = np.sin(angle) * (rows - look.shape[0] / 2)
        beyond += np.cos(angle) * (columns - look.shape[1] / 2)
        out -= 2.0 * (beyond > rng.uniform(20, 60))
    if "fringes" in look.around:
        angle = rng.uniform(0, np.pi)
        phase = (np.sin(angle) * rows + np.cos(angle) * columns) / (5 * look.half_width)
        out += 0.35 * np.sin(2 * np.pi * phase)
    return out


def hand_drawn(rng: np.random.Generator, line: Line, half_width: float, points: int = 5) -> Line:
    """A few points of a line, each off in any direction."""
    vertices = by_arc(line, points)
    off = np.clip(0.5 * half_width, *MISS)
    return vertices + rng.normal(0, off / np.sqrt(2), vertices.shape)


def single(seed: int, half_width: float, length: float, **look: object) -> Case:
    """One body in a frame that just holds it, and a sketch of five points, more where it is long.

    Parameters
    ----------
    seed, half_width, length
        Of the random draws; of the body, px.
    **look
        Settings of `Look` to use instead of the usual.
    """
    rng = np.random.default_rng([seed, int(10 * half_width), int(length)])
    curve = random_curve(rng, length, half_width, 0.9)
    margin = 3 * half_width + 12
    line = curve - curve.min(axis=0) + margin
    shape = tuple(int(n) for n in np.ceil(line.max(axis=0) + margin))
    chosen = replace(Look(shape=shape, half_width=half_width), **look)  # pyright: ignore[reportArgumentType]
    image = gaussian_filter(drawn(rng, line, half_width, chosen), 0.7)
    image += chosen.noise * rng.standard_normal(shape)
    points = 5 + int(max(0.0, length - 400) // 200)
    sketch = hand_drawn(rng, line, half_width, points)
    name = f"{half_width:g} x {length:g}"
    return Case(name, "single", image.astype(np.float32), (line,), {SET: (sketch,)}, half_width)


def pair(seed: int) -> Case:
    """Two bodies side by side in a frame that just holds them; the reference is one of them."""
    rng = np.random.default_rng([seed, 2])
    half_width, length = rng.uniform(1.5, 3.0), rng.uniform(80, 120)
    curve = random_curve(rng, length, half_width, 0.5)
    along = np.gradient(curve, axis=0)
    aside = along[:, ::-1] * [-1, 1] / np.linalg.norm(along, axis=1, keepdims=True)
    lines = np.stack([curve, curve + rng.uniform(*BESIDE) * half_width * aside])
    lines += 3 * half_width + 12 - lines.min(axis=(0, 1))
    rows, columns = np.ceil(lines.max(axis=(0, 1)) + 3 * half_width + 12).astype(int).tolist()
    look = Look(shape=(rows, columns), half_width=half_width)
    image = sum(drawn(rng, line, half_width, look) for line in lines)
    image = gaussian_filter(image, 0.7) + look.noise * rng.standard_normal(look.shape)
    return Case(f"pair {seed}", "pair", image, (lines[0],), {}, half_width)

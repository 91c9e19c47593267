"""Scenes of bodies, drawn by exact distance to a tapered outline; background, specks and noise."""

from dataclasses import dataclass, fields, replace
from typing import Literal

import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import gaussian_filter

from napari_splinesketch.engine.look.band import band
from napari_splinesketch.engine.types import InputError
from napari_splinesketch.metrics import POINTS, nearest, resample
from napari_splinesketch.synthetic.bodies import Points, place

_SUPERSAMPLING = 4
_FINE_STEP = 0.25
_TEXTURE_SIZE = 2.0
_SPECK_BRIGHTNESS = (0.4, 1.0)
_SPECK_SIZE = (0.3, 0.8)
_LENGTHS = (0.8, 1.1)
_WIDTHS = (0.83, 1.17)

Frame = Float[np.ndarray, "H W"]


@dataclass(frozen=True)
class Look:
    """How a generated scene looks; `Look.draw` makes one at random."""

    polarity: Literal["bright", "dark"] = "bright"
    """Bodies brighter or darker than the background."""
    level: float = 0.35
    contrast: float = 0.4
    """`level` and `contrast`: intensity of the background and of a body above (or below) it; images
    lie about in 0-1."""
    snr: float = 12.0
    """Contrast divided by the noise's standard deviation on a body."""
    photon_share: float = 0.5
    """Share of the noise's variance, on a body, that grows with the intensity."""
    gradient: tuple[float, float] = (0.0, 0.0)
    """(2,): change of the background along rows and along columns over the frame, contrasts."""
    blur: float = 0.75
    """Standard deviation of the point-spread function, px."""
    flatness: float = 0.5
    """Cross-section of a body: 1 flat, 0 elliptic."""
    overlap: float = 0.7
    """How overlapping bodies combine: 1 maximum, 0 sum."""
    taper_power: float = 0.45
    taper_length: float = 0.28
    taper_floor: float = 0.25
    """`taper_power`, `taper_length` and `taper_floor`: half-width over its largest value:
    max(floor, min(1, x / (length * L)) ** power) at distance x from the nearer end of a body of
    length L."""
    brightness_sd: float = 0.04
    """Spread of brightness between bodies, relative."""
    shading: float = 0.06
    """Amplitude of slow shading along a body, relative."""
    texture: float = 0.04
    """Standard deviation of the bodies' texture, relative."""
    debris: int = 0
    """Number of specks beside the bodies."""

    def __post_init__(self) -> None:
        if self.polarity not in ("bright", "dark"):
            raise InputError(f"polarity is {self.polarity!r}; choose 'bright' or 'dark'.")

    @classmethod
    def draw(cls, rng: np.random.Generator) -> "Look":
        """Draw a look at random, always without debris."""
        polarity = rng.choice(["bright", "dark"])
        return cls(
            polarity="bright" if polarity == "bright" else "dark",
            level=rng.uniform(0.25, 0.4) if polarity == "bright" else rng.uniform(0.6, 0.75),
            contrast=rng.uniform(0.3, 0.5),
            snr=rng.uniform(10, 15),
            photon_share=rng.uniform(0.2, 0.8),
            gradient=(rng.uniform(-0.25, 0.25), rng.uniform(-0.25, 0.25)),
            blur=rng.uniform(0.5, 1.0),
            flatness=rng.uniform(0.3, 0.9),
            overlap=rng.uniform(0.4, 1.0),
            taper_power=rng.uniform(0.35, 0.6),
            taper_length=rng.uniform(0.15, 0.35),
            taper_floor=rng.uniform(0.08, 0.45),
            shading=rng.uniform(0.0, 0.1),
            texture=rng.uniform(0.0, 0.06),
        )


@dataclass(frozen=True)
class Finish:
    """How one body differs from the next."""

    brightness: float = 1.0
    """Relative to the scene's contrast."""
    waves: float = 1.0
    phase: float = 0.0
    """`waves` and `phase`: periods of the slow shading along the body, and where it starts,
    radians."""

    @classmethod
    def draw(cls, rng: np.random.Generator, look: Look) -> "Finish":
        """Draw at random."""
        return cls(
            brightness=1 + look.brightness_sd * rng.standard_normal(),
            waves=rng.uniform(0.5, 1.5),
            phase=rng.uniform(0, 2 * np.pi),
        )


@dataclass(frozen=True, eq=False)
class Scene:
    """A generated frame and everything true about it."""

    image: Float[np.ndarray, "H W"]
    """(H, W) float32: what a camera would give."""
    clean: Float[np.ndarray, "H W"]
    """(H, W): the same without noise."""
    background: Float[np.ndarray, "H W"]
    """(H, W): the same without noise and bodies."""
    noise_sd: Float[np.ndarray, "H W"]
    """(H, W): standard deviation of `image` minus `clean`."""
    centrelines: tuple[Points, ...]
    """One (100, 2) array per body, uniform in arc length, px."""
    half_widths: tuple[Float[np.ndarray, "100"], ...]
    """One (100,) array per body: distance from the centreline to the edge, px."""
    finishes: tuple[Finish, ...]
    """Brightness and shading of each body."""
    look: Look
    """The settings it was drawn with."""


def scene(
    seed: int,
    *,
    bodies: int = 1,
    shape: tuple[int, int] = (128, 128),
    length: float = 100.0,
    half_width: float = 3.0,
    bend: float = 1.0,
    crossing: bool | None = None,
    margin: float = 5.0,
    shared: float = 0.4,
    **look: object,
) -> Scene:
    """Generate a frame of slender bodies; the same arguments always give the same frame.

    Parameters
    ----------
    seed
        Seed of every random draw.
    bodies
        Number of bodies.
    shape
        Height and width of the frame, px.
    length
        Typical length, px; each body's is 0.8-1.1 times as much.
    half_width
        Typical half-width, px; each body's is 0.83-1.17 times as much.
    bend
        Strength of bending: 0 straight, 1 mostly C and S shapes.
    crossing
        Whether every body but the first crosses an earlier one; by default for 2 or 3 bodies.
    margin
        Smallest distance of a centreline from the frame's border, px; negative lets bodies
        leave the frame.
    shared
        Largest share of a body's length that may lie within two half-widths of another body's
        centreline: 1 allows bodies side by side.
    **look
        Settings of `Look` to use in place of random ones.

    Raises
    ------
    InputError
        If the bodies do not fit into the frame, or a setting or polarity is unknown.
    """
    unknown = set(look) - {field.name for field in fields(Look)}
    if unknown:
        raise InputError(f"Unknown settings {sorted(unknown)}; `Look` lists the known ones.")
    rng = np.random.default_rng(seed)
    chosen = replace(Look.draw(rng), **look)  # pyright: ignore[reportArgumentType]
    widths = half_width * rng.uniform(*_WIDTHS, bodies)
    how = {"across": bodies in (2, 3) if crossing is None else crossing, "shared": shared}
    centrelines: tuple[Points, ...] = ()
    for width in widths:
        size = length * rng.uniform(*_LENGTHS)
        centrelines += (place(rng, size, width, bend, shape, margin, centrelines, **how),)
    half_widths = tuple(width * taper(chosen) for width in widths)
    finishes = tuple(Finish.draw(rng, chosen) for _ in widths)
    drawn = draw_bodies(centrelines, half_widths, finishes, chosen, shape)
    texture = texture_of(rng, chosen, shape)
    drawn = drawn * texture + specks_of(rng, chosen, half_width, shape)
    background, clean, noise_sd, image = taken(rng, drawn, chosen, chosen.blur)
    image = image.astype(np.float32)
    return Scene(image, clean, background, noise_sd, centrelines, half_widths, finishes, chosen)


def taper(look: Look, points: int = POINTS) -> Float[np.ndarray, " points"]:
    """Half-width along a body, relative to its largest, at points uniform in arc length."""
    from_end = np.minimum(np.linspace(0, 1, points), np.linspace(1, 0, points))
    rise = np.minimum(1, from_end / look.taper_length)
    return np.maximum(look.taper_floor, rise**look.taper_power)


def draw_body(
    centreline: Points,
    half_width: Float[np.ndarray, " N"],
    finish: Finish,
    look: Look,
    shape: tuple[int, int],
) -> tuple[Int[np.ndarray, "P 2"], Float[np.ndarray, " P"]]:
    """Draw one body before blur: the pixels that it touches, and their brightness in contrasts.

    Its points are uniform in arc length, px; `shape` is the frame's.
    """
    length = np.linalg.norm(np.diff(centreline, axis=0), axis=1).sum()
    fine = resample(centreline, max(POINTS, int(length / _FINE_STEP) + 1))
    pixels = _near(fine, half_width.max() + 1, shape)
    steps = (np.arange(_SUPERSAMPLING) + 0.5) / _SUPERSAMPLING - 0.5
    offsets = np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)
    distance, along = nearest((pixels[:, None] + offsets).reshape(-1, 2), fine)
    width = np.interp(along, np.linspace(0, 1, len(half_width)), half_width)
    # A ramp one sample wide makes the area inside the outline exact to second order.
    inside = np.clip(0.5 + (width - distance) * _SUPERSAMPLING, 0, 1)
    roundness = np.sqrt(np.clip(1 - (distance / width) ** 2, 0, None))
    shade = look.flatness + (1 - look.flatness) * roundness
    shade *= 1 + look.shading * np.cos(2 * np.pi * finish.waves * along + finish.phase)
    return pixels, finish.brightness * (inside * shade).reshape(-1, len(offsets)).mean(axis=1)


def _near(fine: Points, reach: float, shape: tuple[int, int]) -> Int[np.ndarray, "P 2"]:
    """Pixels of the frame within `reach` of a finely sampled line (and a few more)."""
    rows, columns, mask = band(fine, reach + 1, shape)
    return np.argwhere(mask) + np.array([rows.start, columns.start])


def draw_bodies(
    centrelines: tuple[Points, ...],
    half_widths: tuple[Float[np.ndarray, " N"], ...],
    finishes: tuple[Finish, ...],
    look: Look,
    shape: tuple[int, int],
) -> Frame:
    """Draw all bodies of a scene, combined where they overlap, before texture and blur."""
    total, highest = np.zeros(shape), np.zeros(shape)
    for centreline, half_width, finish in zip(centrelines, half_widths, finishes, strict=True):
        pixels, values = draw_body(centreline, half_width, finish, look, shape)
        rows, columns = pixels.T
        total[rows, columns] += values
        highest[rows, columns] = np.maximum(highest[rows, columns], values)
    return look.overlap * highest + (1 - look.overlap) * total


def texture_of(rng: np.random.Generator, look: Look, shape: tuple[int, int]) -> Frame:
    """Draw relative brightness of the bodies' texture over the frame, 1 on average."""
    smooth = gaussian_filter(rng.standard_normal(shape), _TEXTURE_SIZE)
    return 1 + look.texture * 2 * np.sqrt(np.pi) * _TEXTURE_SIZE * smooth


def background_of(look: Look, shape: tuple[int, int]) -> Frame:
    """Intensity of the frame without bodies."""
    rows = np.linspace(-0.5, 0.5, shape[0])[:, None] * look.gradient[0]
    columns = np.linspace(-0.5, 0.5, shape[1])[None] * look.gradient[1]
    return look.level + look.contrast * (rows + columns)


def specks_of(
    rng: np.random.Generator, look: Look, half_width: float, shape: tuple[int, int]
) -> Frame:
    """Draw round specks, up to about a body's width across, in contrasts, before blur."""
    out = np.zeros(shape)
    for _ in range(look.debris):
        centre = rng.uniform(0, shape)[None]
        radius = half_width * rng.uniform(*_SPECK_SIZE)
        brightness = rng.uniform(*_SPECK_BRIGHTNESS)
        pixels = _near(centre, radius + 1, shape)
        distance = np.linalg.norm(pixels - centre, axis=1)
        rows, columns = pixels.T
        out[rows, columns] += brightness * np.clip(0.5 + radius - distance, 0, 1)
    return out


def taken(
    rng: np.random.Generator, drawn: Frame, look: Look, blur: float, light: float = 1.0
) -> tuple[Frame, Frame, Frame, Frame]:
    """Take a picture of drawn bodies, out of focus by `blur` px.

    Gives the intensity without bodies and with them, the standard deviation of photon and read
    noise at each pixel, and what a camera would give.
    """
    background, sign = background_of(look, drawn.shape), 1 if look.polarity == "bright" else -1
    clean = light * (background + sign * look.contrast * gaussian_filter(drawn, blur))
    photons = look.photon_share * np.clip(clean / (look.level + sign * look.contrast), 0, None)
    noise_sd = look.contrast / look.snr * np.sqrt(photons + 1 - look.photon_share)
    return background, clean, noise_sd, clean + noise_sd * rng.standard_normal(drawn.shape)

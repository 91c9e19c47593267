"""Generated scenes with perfect labels."""

from dataclasses import dataclass, fields, replace

import numpy as np
from jaxtyping import Float

from napari_splinesketch.synthetic import drawing
from napari_splinesketch.synthetic.bodies import place
from napari_splinesketch.synthetic.drawing import Finish, Look, Points

_LENGTHS = (0.8, 1.1)
_WIDTHS = (0.83, 1.17)


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
    ValueError
        If the bodies do not fit into the frame, or a setting is unknown.
    """
    unknown = set(look) - {field.name for field in fields(Look)}
    if unknown:
        raise ValueError(f"Unknown settings {sorted(unknown)}; `Look` lists the known ones.")
    rng = np.random.default_rng(seed)
    chosen = replace(Look.draw(rng), **look)  # pyright: ignore[reportArgumentType]
    must_cross = crossing if crossing is not None else bodies in (2, 3)
    widths = half_width * rng.uniform(*_WIDTHS, bodies)
    how = {"across": must_cross, "shared": shared}
    centrelines: tuple[Points, ...] = ()
    for width in widths:
        size = length * rng.uniform(*_LENGTHS)
        body = place(rng, size, width, bend, shape, margin, centrelines, **how)
        centrelines += (body,)
    half_widths = tuple(width * drawing.taper(chosen) for width in widths)
    finishes = tuple(Finish.draw(rng, chosen) for _ in widths)
    drawn = drawing.draw_bodies(centrelines, half_widths, finishes, chosen, shape)
    texture = drawing.texture_of(rng, chosen, shape)
    drawn = drawn * texture + drawing.specks_of(rng, chosen, half_width, shape)
    background, clean, noise_sd, image = drawing.taken(rng, drawn, chosen, chosen.blur)
    image = image.astype(np.float32)
    return Scene(image, clean, background, noise_sd, centrelines, half_widths, finishes, chosen)

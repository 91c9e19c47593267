"""The frames and sketches that every method gets."""

from dataclasses import dataclass
from functools import lru_cache
from zlib import crc32

import numpy as np
import perturbations

from napari_splinesketch import synthetic

TUNING_SEEDS = 50_000
_SEEDS_PER_COUNT = 100_000


@dataclass(frozen=True)
class Cell:
    """Frames with as many bodies, whose labels were all spoilt in the same way.

    Attributes
    ----------
    bodies
        Number of bodies in a frame; two or three cross each other.
    kind, strength
        How the sketch differs from the truth: "rotation" by so many degrees, "displacement" by so
        many px, "scaling" by a factor, "pca" with so many components, or the straight lines
        "chord" (between the ends) and "axis" (the body's length along its main axis).
    """

    bodies: int
    kind: str
    strength: float = 0.0


@dataclass(frozen=True, eq=False)
class Frame:
    """One generated image, what is true about it, and its sketches.

    Attributes
    ----------
    image
        (H, W) float32.
    bright
        Whether bodies are brighter than the background.
    truths, sketches
        One (100, 2) and one (N, 2) array per body, row and col, px.
    """

    image: np.ndarray
    bright: bool
    truths: tuple[np.ndarray, ...]
    sketches: tuple[np.ndarray, ...]

    @property
    def checksum(self) -> str:
        """Changes whenever the image or a sketch does."""
        data = b"".join(np.ascontiguousarray(a).tobytes() for a in (self.image, *self.sketches))
        return f"{crc32(data):08x}"


def frame(cell: Cell, index: int, *, tuning: bool = False) -> Frame:
    """Frame number `index` of a cell; `tuning` frames are never used for results."""
    seed = _SEEDS_PER_COUNT * cell.bodies + index + (TUNING_SEEDS if tuning else 0)
    scene = scene_of(seed, cell.bodies)
    rng = np.random.default_rng([seed, *cell.kind.encode()])
    return Frame(
        image=scene.image,
        bright=scene.look.polarity == "bright",
        truths=scene.centrelines,
        sketches=tuple(spoil(c, cell.kind, cell.strength, rng) for c in scene.centrelines),
    )


@lru_cache(maxsize=256)
def scene_of(seed: int, bodies: int) -> synthetic.Scene:
    """Generate a scene of 128 × 128 px, once."""
    return synthetic.scene(seed, bodies=bodies)


def spoil(curve: np.ndarray, kind: str, strength: float, rng: np.random.Generator) -> np.ndarray:
    """Spoil a label; rotations turn either way, displacements go in any direction."""
    if kind == "rotation":
        return synthetic.rotate(curve, strength * rng.choice([-1, 1]))
    if kind == "displacement":
        return perturbations.displace(curve, strength, rng)
    if kind == "scaling":
        return perturbations.scale(curve, strength)
    if kind == "pca":
        return synthetic.compress(curve, int(strength))
    if kind == "chord":
        return perturbations.chord(curve)
    if kind == "axis":
        return perturbations.axis_line(curve)
    if kind == "part":
        count = round(strength * len(curve))
        first = rng.integers(len(curve) - count + 1)
        return synthetic.rotate(curve[first : first + count], rng.choice([-12.0, 12.0]))[::16]
    raise ValueError(f"Unknown kind of sketch {kind!r}.")


COUNTS = (1, 2, 3)
TABLE_KINDS = (("rotation", 20.0), ("displacement", 10.0), ("scaling", 0.7), ("pca", 2.0))
LINE_KINDS = (("chord", 0.0), ("axis", 0.0))
SWEEPS = {
    "rotation": (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0),
    "displacement": (0.0, 5.0, 10.0, 15.0, 20.0, 25.0),
    "scaling": (0.3, 0.5, 0.7, 0.85, 1.0, 1.15, 1.3, 1.5, 1.7),
}


def table_cells() -> list[Cell]:
    """List the cells of Table 1."""
    return [Cell(n, kind, strength) for n in COUNTS for kind, strength in TABLE_KINDS]


def line_cells() -> list[Cell]:
    """List the cells of Table 2."""
    return [Cell(n, kind, strength) for n in COUNTS for kind, strength in LINE_KINDS]


def sweep_cells() -> list[Cell]:
    """List the cells of Figure 2."""
    return [Cell(n, kind, s) for n in COUNTS for kind, all_s in SWEEPS.items() for s in all_s]

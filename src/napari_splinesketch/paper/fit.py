"""From sketches to the paper's parameters, and from those to curves and images."""

import math
from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from napari_splinesketch.engine.spline import arc_length, even_basis, fit_knots, sample
from napari_splinesketch.engine.types import POINTS
from napari_splinesketch.paper.blobs import (
    REACH,
    Blobs,
    Canvas,
    Place,
    background,
    blend_tiles,
    compose,
    convolve,
    draw_tiles,
    half_width_ratio,
    initial_profile,
    spline_knots,
)
from napari_splinesketch.paper.loss import Target

_HALF_WIDTHS_PER_UNIT = 40.0
_START_WIDTH = 0.8
_WIDTH_LIMITS = (0.02, 0.98)
_ROOM_TO_GROW = 1.5
_FEWEST = {"curves": 4, "blobs": 64, "pixels": 128}


@dataclass(frozen=True, eq=False)
class PaperFit:
    """The result of `refine_paper`."""

    knots: Float[np.ndarray, "n K 3"]
    """(n, K, 3): row, col and half-width at the knots of each sketch's spline, px; fixed curves are
    not among them."""
    reconstruction: Float[np.ndarray, "H W"]
    """(H, W): Ŷ, in the units of the given image."""
    background: Float[np.ndarray, "H W"]
    """(H, W): the same without bodies."""
    losses: dict[str, Float[np.ndarray, " T"]]
    """‖Y - Ŷ‖², in areas of a body, before each step of "background", "splines" (of the seed that
    was kept) and "everything"."""
    score: float
    """Mean of (Y - Ŷ)² over the image: the smaller, the likelier the fit is right."""
    alpha: float
    """α: 1 where the brightest of overlapping bodies hides the others, 0 where they add up."""
    scene: Blobs
    place: Place
    canvas: Canvas
    """`scene`, `place` and `canvas`: what `render_bodies` draws from."""


def prepare(
    image: Float[np.ndarray, "H W"],
    sketches: list[Float[np.ndarray, "N 2"]],
    fixed: list[Float[np.ndarray, "K 3"]],
    *,
    half_width: float,
    knots: int,
    spacing: float,
) -> tuple[Blobs, Place, Target, Canvas]:
    """Give the scene that sketches and fixed curves describe, padded to sizes that recur."""
    corner = np.array(image.shape) - 1.0
    inside = [np.clip(sketch, 0.0, corner) for sketch in sketches]
    lines = [np.column_stack([sketch, np.full(len(sketch), half_width)]) for sketch in inside]
    lines += [sample(curve, POINTS) for curve in fixed]
    count, unit = len(lines), _HALF_WIDTHS_PER_UNIT * half_width
    padded = bucket(count, _FEWEST["curves"], 4)
    points = np.zeros((padded, knots, 3))
    points[:count] = [fit_knots(line, knots) for line in lines]
    widest = max([1.0, *(curve[:, 2].max() / half_width for curve in fixed)])
    start = min(_START_WIDTH, _WIDTH_LIMITS[1] / widest)
    points, widths = points[..., :2], start * points[..., 2] / half_width
    widths = np.clip(widths, *_WIDTH_LIMITS)
    lengths = np.ones(padded)
    lengths[:count] = [arc_length(line)[-1] for line in lines]
    scale = half_width / (half_width_ratio(initial_profile()) * start)

    patch = 4 * math.ceil(REACH * _START_WIDTH * scale / 2) + 1
    frame = (_size(image.shape[0]), _size(image.shape[1]))
    tile = _size(_ROOM_TO_GROW * lengths.max() + patch)
    blobs = bucket(lengths.max() / (spacing * half_width), _FEWEST["blobs"], 2)
    canvas = Canvas(frame, (min(tile, frame[0]), min(tile, frame[1])), patch, blobs)

    centre = points.mean(axis=1, keepdims=True)
    scene = Blobs(
        centre=_float(centre[:, 0] / unit),
        offsets=_float((points - centre) / unit),
        widths=_float(np.log(widths / (1 - widths))),
        log_scale=_float(0.0),
        blend=_float(0.0),
        brightness=_float(0.0),
        gradient=_float([0.0, 0.0]),
        log_contrast=_float(-np.log(start)),
        profile=_float(initial_profile()),
        kernel=_float(np.pad([[1.0]], 1)),
    )
    numbers = jnp.asarray(count), jnp.asarray(len(sketches))
    place = Place(*numbers, _float(image.shape), _float(unit), _float(scale))
    known = np.isfinite(image)
    outside = [(0, size - n) for size, n in zip(frame, image.shape, strict=True)]
    pixels, seen = (np.pad(a, outside) for a in (np.where(known, image, 0.0), known))
    area = 2 * half_width * lengths[:count].mean()
    target = Target(_float(pixels), _float(seen), _float(area), _float(lengths))
    return scene, place, target, canvas


_float = partial(jnp.asarray, dtype=jnp.float32)


def bucket(value: float, fewest: int, factor: int) -> int:
    """Round up to `fewest` times a power of `factor`."""
    return fewest * factor ** max(0, math.ceil(math.log(max(value, fewest) / fewest, factor)))


def _size(value: float) -> int:
    """Round up to 128, 192, 256, 384, 512, ... px."""
    larger = bucket(value, _FEWEST["pixels"], 2)
    return larger * 3 // 4 if larger > _FEWEST["pixels"] and value <= larger * 3 / 4 else larger


def centrelines(scene: Blobs, place: Place, count: int) -> list[Float[np.ndarray, "100 2"]]:
    """Points of the first splines, row and col, px."""
    rows = even_basis(scene.offsets.shape[1], POINTS)
    return list(rows @ np.asarray(spline_knots(scene, place))[:count, :, :2])


def render_bodies(fit: PaperFit) -> Float[np.ndarray, "n H W"]:
    """Each body rendered alone, without background, in the units of the given image."""
    place, bodies = fit.place._replace(real=jnp.asarray(1)), []
    for i in range(len(fit.knots)):
        names = ("centre", "offsets", "widths")
        first = {name: jnp.roll(getattr(fit.scene, name), -i, axis=0) for name in names}
        scene = fit.scene._replace(**first)
        image, empty = render(scene, place, fit.canvas, fit.reconstruction.shape)
        bodies.append(image - empty)
    return np.array(bodies)


def render(
    scene: Blobs, place: Place, canvas: Canvas, shape: tuple[int, ...]
) -> list[Float[np.ndarray, "H W"]]:
    """Give reconstruction and background, as large as the image, in its units."""
    height, width = shape
    both = _pictures(scene, draw(scene, place, canvas)[0], place, canvas.frame)
    return [np.asarray(picture)[:height, :width] for picture in both]


@partial(jax.jit, static_argnames="canvas")
def draw(scene: Blobs, place: Place, canvas: Canvas) -> tuple[jax.Array, jax.Array]:
    """All splines in the padded frame (H, W), and their lengths (N,), px."""
    tiles, origin, length = draw_tiles(scene, place, canvas)
    return blend_tiles(tiles, origin, scene.blend, canvas.frame), length


@partial(jax.jit, static_argnames="frame")
def _pictures(
    scene: Blobs, bodies: Float[jax.Array, "H W"], place: Place, frame: tuple[int, int]
) -> tuple[jax.Array, jax.Array]:
    """Reconstruction and background, both (H, W), padded."""
    image = compose(scene, bodies, place, frame)
    empty = background(scene, place, frame)
    return convolve(image, scene.kernel), convolve(empty, scene.kernel)

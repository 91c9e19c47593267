"""Pictures of part of an image: where they lie, and what is seen of a body in them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from jaxtyping import Float, Int, Real, Shaped
from scipy.ndimage import map_coordinates

from napari_splinesketch.engine.types import Curve, Line
from napari_splinesketch.geometry import edges

SPACING = 0.5
"""Between the places across a body at which a picture is read, px at most."""
KEPT = 4
"""Planes that are remembered: the one in view is read again with every change of the look."""
Along = Float[np.ndarray, " P"]
Picture = Shaped[np.ndarray, "H W"]


@dataclass(frozen=True, eq=False)
class Grid:
    """Where a block of pixels lies in its image.

    `origin` is (row, col) of its first pixel centre in the image at full resolution, `step` the
    pixels of the image from one pixel of the block to the next.
    """

    origin: Float[np.ndarray, "2"]
    step: Float[np.ndarray, "2"]

    def to_image(self, points: Line) -> Line:
        """Take the block's (row, col) to the image's."""
        return self.origin + self.step * points

    def to_block(self, points: Line) -> Line:
        """Take the image's (row, col) to the block's."""
        return (points - self.origin) / self.step

    @property
    def size(self) -> float:
        """Size of the block's pixels, px of the image: the mean of both directions."""
        return float(np.sqrt(np.prod(self.step)))

    def curve_to_image(self, curve: Curve) -> Curve:
        """Take a curve of the block to the image."""
        size = self.size
        knots = np.column_stack([self.to_image(curve.knots[:, :2]), size * curve.knots[:, 2]])
        return replace(
            curve,
            knots=knots,
            points=self.to_image(curve.points),
            half_width=size * curve.half_width,
            sd=size * curve.sd,
        )

    def curve_to_block(self, curve: Curve) -> Curve:
        """Take a curve of the image to the block."""
        return Grid(-self.origin / self.step, 1 / self.step).curve_to_image(curve)


@dataclass(frozen=True, eq=False)
class Patch:
    """A reconstruction of part of a frame, and the same without bodies, where that is known."""

    grid: Grid
    pixels: Float[np.ndarray, "H W"]
    background: Float[np.ndarray, "H W"] | None = None

    @property
    def nbytes(self) -> int:
        """Bytes that it holds."""
        return self.pixels.nbytes + (0 if self.background is None else self.background.nbytes)


def patched(
    old: Patch, new: Patch, low: Float[np.ndarray, "2"], high: Float[np.ndarray, "2"]
) -> Patch:
    """Take part of a new picture of a frame, from `low` to `high` (px), into an old one.

    The old one is dropped if it has another step.
    """
    step = new.grid.step
    if not np.allclose(old.grid.step, step):
        return new
    grid, first, ends = around_all((old, new))
    inside = np.round((np.array([low, high]) - grid.origin) / step).astype(int)
    low, high = np.maximum(inside[0], first[1]), np.minimum(inside[1] + 1, ends[1])

    def joined(before: Picture, after: Picture) -> Picture:
        whole = np.full(np.max(ends, axis=0), np.nan, dtype=after.dtype)
        whole[slices(first[0], ends[0])] = before
        whole[slices(low, high)] = after[slices(low - first[1], high - first[1])]
        return whole

    background = None
    if old.background is not None and new.background is not None:
        background = joined(old.background, new.background)
    return Patch(grid, joined(old.pixels, new.pixels), background)


def around_all(
    patches: Sequence[Patch],
) -> tuple[Grid, Int[np.ndarray, "N 2"], Int[np.ndarray, "N 2"]]:
    """Give a grid with room for pictures of one step, and the corners of each on it."""
    grid = Grid(np.min([p.grid.origin for p in patches], axis=0), patches[0].grid.step)
    first = np.array([grid.to_block(p.grid.origin) for p in patches]).round().astype(int)
    return grid, first, first + [p.pixels.shape for p in patches]


def slices(low: Int[np.ndarray, "2"], high: Int[np.ndarray, "2"]) -> tuple[slice, slice]:
    """Give the rows and columns between two corners."""
    return slice(int(low[0]), int(high[0])), slice(int(low[1]), int(high[1]))


class Planes:
    """Array-like (*leading, H, W) of which `plane` makes (H, W) when napari asks for one.

    Planes are numbered over all leading axes. dask would do the same, at 10 ms for each plane.
    """

    def __init__(self, shape: tuple[int, ...], dtype: Any, plane: Callable[[int], Picture]):
        self.shape, self.ndim, self.size = shape, len(shape), int(np.prod(shape))
        self.dtype = np.dtype(dtype)
        self._plane = lru_cache(KEPT)(plane)

    def __getitem__(self, key: Any) -> Shaped[np.ndarray, "..."]:
        """Read like a NumPy array, making only the planes asked for."""
        key = key if isinstance(key, tuple) else (key,)
        at = key.index(Ellipsis) if Ellipsis in key else len(key)
        every = [slice(None)] * (self.ndim - len(key) + (at < len(key)))
        key, leading = (*key[:at], *every, *key[at + 1 :]), self.shape[:-2]
        numbers = np.arange(int(np.prod(leading))).reshape(leading)[key[:-2]]
        planes = np.array([self._plane(int(n)) for n in numbers.ravel()], dtype=self.dtype)
        whole = planes.reshape(*numbers.shape, *self.shape[-2:])
        return whole[(*[slice(None)] * numbers.ndim, *key[-2:])]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Shaped[np.ndarray, "..."]:
        """Make all planes."""
        return self[()].astype(dtype or self.dtype)

    # napari's menu of a layer calls these: a duplicate may be drawn into.
    astype = __array__

    def __deepcopy__(self, memo: object) -> Shaped[np.ndarray, "..."]:
        return np.asarray(self)

    def __len__(self) -> int:
        return self.shape[0]


def film_of(
    pictures: Mapping[int, Patch],
    leading: tuple[int, ...],
    make: Callable[[int, Patch], Picture] = lambda frame, patch: patch.pixels,
) -> tuple[Planes, Grid]:
    """Put the frames that are known on one grid; NaN elsewhere.

    Of the `pictures` by frame, those on another step than the last one are left out; `make` gives
    the pixels that are shown of one. `leading` are the lengths of the axes before (row, col).
    """
    step = list(pictures.values())[-1].grid.step
    same = {n: p for n, p in pictures.items() if np.allclose(p.grid.step, step)}
    grid, first, ends = around_all(list(same.values()))
    places = dict(zip(same, map(slices, first, ends), strict=True))
    shape = (*leading, *np.max(ends, axis=0).tolist())

    def plane(number: int) -> Picture:
        frame = np.full(shape[-2:], np.nan, dtype=np.float32)
        if number in same:
            frame[places[number]] = make(number, same[number])
        return frame

    return Planes(shape, np.float32, plane), grid


def across(points: Line, half_width: Along) -> Float[np.ndarray, "P Q 2"]:
    """Places on a body's cross-sections, from edge to edge, px; one where no width is known."""
    reach = np.nan_to_num(half_width, nan=0.0, posinf=0.0)
    count = 1 + 2 * int(np.ceil(reach.max(initial=0.0) / SPACING))
    return np.linspace(*edges(points, reach), count, axis=1) if count > 1 else points[:, None]


def mean_across(picture: Real[np.ndarray, "H W"], points: Line, half_width: Along) -> Along:
    """Average a picture over a body's cross-section at each point of its centreline.

    Pixels that are not finite are left out, as are those beyond the picture; NaN where none is
    left. Points and half-widths as for `across`, in pixels of the picture.
    """
    where = np.moveaxis(across(points, half_width), -1, 0)
    finite = np.isfinite(picture)
    filled = np.where(finite, picture, 0.0).astype(float)
    values = map_coordinates(filled, where, order=1, cval=0.0).sum(axis=1)
    # Weights fall to zero with the pixels that are missing, as the values do.
    total = map_coordinates(finite.astype(float), where, order=1, cval=0.0).sum(axis=1)
    return np.divide(values, total, out=np.full(len(points), np.nan), where=total > 1e-6)

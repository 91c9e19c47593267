"""Pixels: what the engine sees of an image, and pictures of some frames that napari can show."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from jaxtyping import Float, Int, Real, Shaped
from napari.layers import Image

from napari_splinesketch.grids import Grid, Patch, slices
from napari_splinesketch.plugin.layers.space import frame_index

WHOLE_FRAME = 2**22
"""Frames in memory of up to this many pixels are given whole."""
LARGEST_BLOCK = 2**24
"""A coarser level of a multiscale image is read where a block would have more pixels."""
MARGIN = 64
"""Kept around the sketches beside the length of the longest, px."""
LUMINANCE = np.array([0.2125, 0.7154, 0.0721], dtype=np.float32)
"""Rec. 709."""
KEPT = 4
"""Planes that are remembered: the one in view is read again with every change of the look."""


@dataclass(frozen=True, eq=False)
class Block:
    """Part of one frame, the `key` of an array-like `level`; to be read in a thread."""

    grid: Grid
    level: Any
    key: tuple[int | slice, ...]
    rgb: bool

    @property
    def whole(self) -> bool:
        """Whether it is all of the frame."""
        axes = range(len(self.key) - 2, len(self.key))
        return all(self.key[a] == slice(0, int(self.level.shape[a])) for a in axes)

    def read(self) -> Real[np.ndarray, "H W"]:
        """Read the pixels, a colour image as luminance; the array is the caller's own."""
        pixels = np.array(self.level[self.key])
        return pixels[..., :3].astype(np.float32) @ LUMINANCE if self.rgb else pixels


def block_around(image: Image, frame: int, lines: Sequence[Float[np.ndarray, "N 2"]]) -> Block:
    """Choose what to read of a frame for some sketches, px, at least one.

    Of a multiscale image, the finest level that is not too large is taken.
    """
    shapes = _shapes(image)
    low, high = _region(lines, shapes[0])
    sizes = [np.prod((high - low) * shape / shapes[0]) for shape in shapes]
    fine = next((i for i, size in enumerate(sizes) if size <= LARGEST_BLOCK), len(sizes) - 1)
    level, shape = _levels(image)[fine], shapes[fine]
    step = shapes[0] / shape
    start = np.floor(low / step).astype(int)
    stop = np.minimum(np.ceil(high / step), shape).astype(int)
    if isinstance(level, np.ndarray) and np.prod(shape) <= WHOLE_FRAME:
        start, stop = np.zeros(2, int), shape
    return _block(image, frame, fine, start, stop)


def block_on(image: Image, frame: int, grid: Grid, shape: tuple[int, ...]) -> Block | None:
    """Find the pixels of an image that (H, W) places on a grid stand for.

    None where the image has no such pixels any more: its data may have been replaced.
    """
    shapes = _shapes(image)
    steps = shapes[0] / shapes
    level = next((i for i, step in enumerate(steps) if np.allclose(step, grid.step)), None)
    if level is None:
        return None
    start = np.rint((grid.origin - (grid.step - 1) / 2) / grid.step).astype(int)
    stop = start + shape
    if (start < 0).any() or (stop > shapes[level]).any():
        return None
    return _block(image, frame, level, start, stop)


def _levels(image: Image) -> list[Any]:
    return list(image.data) if image.multiscale else [image.data]  # pyright: ignore


def _shapes(image: Image) -> Int[np.ndarray, "L 2"]:
    return image.level_shapes[:, image.ndim - 2 : image.ndim]


def _block(
    image: Image, frame: int, number: int, start: Int[np.ndarray, "2"], stop: Int[np.ndarray, "2"]
) -> Block:
    """The pixels from `start` to `stop` of a level."""
    level, shapes = _levels(image)[number], _shapes(image)
    step = shapes[0] / shapes[number]
    # Pixel 0 of a coarser level covers the first `step` pixels: its centre is not theirs.
    grid = Grid(step * start + (step - 1) / 2, step)
    index = frame_index(image, frame)
    if image.multiscale:
        depth = np.array(level.shape[: len(index)])
        index = tuple(
            int(i) for i in np.array(index) * depth // image.level_shapes[0][: len(index)]
        )
    area = tuple(slice(int(a), int(b)) for a, b in zip(start, stop, strict=True))
    return Block(grid, level, (*index, *area), image.rgb)


def _region(
    lines: Sequence[Float[np.ndarray, "N 2"]], shape: Sequence[int]
) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]:
    """Corners of the part of the image that the sketches need, px at full resolution."""
    longest = max(np.linalg.norm(np.diff(line, axis=0), axis=1).sum() for line in lines)
    points = np.clip(np.concatenate(lines), 0, np.array(shape) - 1)
    margin = MARGIN + longest
    return np.maximum(points.min(0) - margin, 0), np.minimum(points.max(0) + margin, shape)


class Planes:
    """Array-like (*leading, H, W) of which `plane` makes (H, W) when napari asks for one.

    Planes are numbered over all leading axes. dask would do the same, at 10 ms for each plane.
    """

    def __init__(
        self, shape: tuple[int, ...], dtype: Any, plane: Callable[[int], Shaped[np.ndarray, "H W"]]
    ):
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

    def __len__(self) -> int:
        return self.shape[0]


class Film(Planes):
    """A film of the frames that are known, on one grid; NaN elsewhere.

    Of the `pictures` by frame, those on another step than the last one are left out; `make` gives
    the pixels that are shown of one. `leading` are the lengths of the axes before (row, col).
    """

    def __init__(
        self,
        pictures: Mapping[int, Patch],
        leading: tuple[int, ...],
        make: Callable[[int, Patch], Float[np.ndarray, "H W"]] = lambda frame, patch: patch.pixels,
    ):
        step = list(pictures.values())[-1].grid.step
        same = {n: p for n, p in pictures.items() if np.allclose(p.grid.step, step)}
        origin = np.min([p.grid.origin for p in same.values()], axis=0)
        corner = {n: np.round((p.grid.origin - origin) / step).astype(int) for n, p in same.items()}
        ends = [corner[n] + picture.pixels.shape for n, picture in same.items()]
        self.grid = Grid(origin, step)
        shape = (*leading, *np.max(ends, axis=0).tolist())

        def plane(number: int) -> Float[np.ndarray, "H W"]:
            frame = np.full(shape[-2:], np.nan, dtype=np.float32)
            if number in same:
                patch, at = same[number], corner[number]
                frame[slices(at, at + patch.pixels.shape)] = make(number, patch)
            return frame

        super().__init__(shape, np.float32, plane)

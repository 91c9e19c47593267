"""What the engine sees of an image: one frame of it, no more than it needs, in grey."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float, Int, Real
from napari.layers import Image

from napari_splinesketch.engine.types import Curve
from napari_splinesketch.plugin.adapter.space import frame_index

WHOLE_FRAME = 2**22
"""Frames in memory of up to this many pixels are given whole."""
LARGEST_BLOCK = 2**24
"""A coarser level of a multiscale image is read where a block would have more pixels."""
MARGIN = 64
"""Kept around the sketches beside the length of the longest, px."""
LUMINANCE = np.array([0.2125, 0.7154, 0.0721], dtype=np.float32)
"""Rec. 709."""


@dataclass(frozen=True, eq=False)
class Grid:
    """Where a block of pixels lies in its image.

    Attributes
    ----------
    origin
        (2,): (row, col) of the block's first pixel centre in the image at full resolution.
    step
        (2,): pixels of the image from one pixel of the block to the next.
    """

    origin: Float[np.ndarray, "2"]
    step: Float[np.ndarray, "2"]

    def to_image(self, points: Float[np.ndarray, "N 2"]) -> Float[np.ndarray, "N 2"]:
        """Take the block's (row, col) to the image's."""
        return self.origin + self.step * points

    def to_block(self, points: Float[np.ndarray, "N 2"]) -> Float[np.ndarray, "N 2"]:
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
class Block:
    """Part of one frame, not yet read: reading may be slow and belongs into a thread.

    Attributes
    ----------
    grid
        Where the block lies in the image.
    level
        The array to read from: NumPy, dask, zarr, ...
    key
        What to read of it.
    rgb
        Whether its last axis is colour.
    """

    grid: Grid
    level: Any
    key: tuple[int | slice, ...]
    rgb: bool

    def read(self) -> Real[np.ndarray, "H W"]:
        """Read the pixels, a colour image as luminance; the array is the caller's own."""
        pixels = np.array(self.level[self.key])
        return pixels[..., :3].astype(np.float32) @ LUMINANCE if self.rgb else pixels


def block_around(image: Image, frame: int, lines: Sequence[Float[np.ndarray, "N 2"]]) -> Block:
    """Choose what to read for some sketches.

    Parameters
    ----------
    image
        The image; of a multiscale one, the finest level that is not too large is taken.
    frame
        Index of the frame.
    lines
        (N, 2) sketches in pixels of the image, at least one.
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
    image: Image,
    frame: int,
    number: int,
    start: Int[np.ndarray, "2"],
    stop: Int[np.ndarray, "2"],
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

"""A film of which only some frames exist, as an array that napari can show."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from jaxtyping import Float, Int

from napari_splinesketch.plugin.adapter.pixels import Grid
from napari_splinesketch.plugin.adapter.planes import Planes


class Picture(Protocol):
    """Pixels on part of a frame, which may be made when they are asked for."""

    @property
    def grid(self) -> Grid:
        """Where they lie."""
        ...

    @property
    def shape(self) -> tuple[int, ...]:
        """(H, W)."""
        ...

    @property
    def pixels(self) -> Float[np.ndarray, "H W"]:
        """The pixels."""
        ...


@dataclass(frozen=True, eq=False)
class Patch:
    """A picture of part of a frame.

    Attributes
    ----------
    grid
        Where it lies.
    pixels
        The reconstruction, or another picture.
    background
        The same without bodies, where it is known.
    """

    grid: Grid
    pixels: Float[np.ndarray, "H W"]
    background: Float[np.ndarray, "H W"] | None = None

    @property
    def nbytes(self) -> int:
        """Bytes that it holds."""
        return self.pixels.nbytes + (0 if self.background is None else self.background.nbytes)

    @property
    def shape(self) -> tuple[int, ...]:
        """(H, W)."""
        return self.pixels.shape


def patched(
    old: Patch, new: Patch, low: Float[np.ndarray, "2"], high: Float[np.ndarray, "2"]
) -> Patch:
    """Take part of a new picture of a frame into an old one.

    Parameters
    ----------
    old, new
        The pictures; the old one is dropped if it has another step.
    low, high
        Corners of that part, px of the image.
    """
    step = new.grid.step
    if not np.allclose(old.grid.step, step):
        return new
    origin = np.minimum(old.grid.origin, new.grid.origin)
    first = [np.round((p.grid.origin - origin) / step).astype(int) for p in (old, new)]
    ends = [at + p.pixels.shape for at, p in zip(first, (old, new), strict=True)]
    inside = np.round((np.array([low, high]) - origin) / step).astype(int)
    low, high = np.maximum(inside[0], first[1]), np.minimum(inside[1] + 1, ends[1])

    def joined(
        before: Float[np.ndarray, "H W"], after: Float[np.ndarray, "H W"]
    ) -> Float[np.ndarray, "H W"]:
        whole = np.full(np.max(ends, axis=0), np.nan, dtype=after.dtype)
        whole[_window(first[0], ends[0])] = before
        whole[_window(low, high)] = after[_window(low - first[1], high - first[1])]
        return whole

    background = None
    if old.background is not None and new.background is not None:
        background = joined(old.background, new.background)
    return Patch(Grid(origin, step), joined(old.pixels, new.pixels), background)


def _window(low: Int[np.ndarray, "2"], high: Int[np.ndarray, "2"]) -> tuple[slice, slice]:
    return slice(int(low[0]), int(high[0])), slice(int(low[1]), int(high[1]))


@dataclass(frozen=True, eq=False)
class Computed:
    """A picture of which the pixels are made when they are asked for."""

    grid: Grid
    shape: tuple[int, ...]
    make: Callable[[], Float[np.ndarray, "H W"]]

    @property
    def pixels(self) -> Float[np.ndarray, "H W"]:
        """The pixels, made anew."""
        return self.make()


class Film(Planes):
    """Array-like (*frames, H, W) that holds the frames it was given; NaN elsewhere.

    Parameters
    ----------
    pictures
        By frame; those on another step than the last one are left out.
    leading
        Lengths of the axes before (row, col).
    """

    def __init__(self, pictures: Mapping[int, Picture], leading: tuple[int, ...]):
        step = list(pictures.values())[-1].grid.step
        same = {n: p for n, p in pictures.items() if np.allclose(p.grid.step, step)}
        origin = np.min([p.grid.origin for p in same.values()], axis=0)
        corner = {n: np.round((p.grid.origin - origin) / step) for n, p in same.items()}
        ends = [corner[n] + picture.shape for n, picture in same.items()]
        self.grid = Grid(origin, step)
        self._pictures = {n: (corner[n].astype(int), picture) for n, picture in same.items()}
        shape = (*leading, *np.max(ends, axis=0).astype(int).tolist())
        super().__init__(shape, np.float32, self._frame)

    def _frame(self, number: int) -> Float[np.ndarray, "H W"]:
        frame = np.full(self.shape[-2:], np.nan, dtype=self.dtype)
        if number in self._pictures:
            (row, col), picture = self._pictures[number]
            frame[row : row + picture.shape[0], col : col + picture.shape[1]] = picture.pixels
        return frame

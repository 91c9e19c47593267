"""A film of which only some frames exist, as an array that napari can show."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from napari_splinesketch.plugin.adapter.pixels import Grid


@dataclass(frozen=True, eq=False)
class Patch:
    """A picture of part of a frame."""

    grid: Grid
    pixels: Float[np.ndarray, "H W"]


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
    whole = np.full(np.max(ends, axis=0), np.nan, dtype=new.pixels.dtype)
    whole[_window(first[0], ends[0])] = old.pixels
    inside = np.round((np.array([low, high]) - origin) / step).astype(int)
    low, high = np.maximum(inside[0], first[1]), np.minimum(inside[1] + 1, ends[1])
    whole[_window(low, high)] = new.pixels[_window(low - first[1], high - first[1])]
    return Patch(Grid(origin, step), whole)


def _window(low: Int[np.ndarray, "2"], high: Int[np.ndarray, "2"]) -> tuple[slice, slice]:
    return slice(int(low[0]), int(high[0])), slice(int(low[1]), int(high[1]))


class Film:
    """Array-like (*frames, H, W) that holds the frames it was given; NaN elsewhere.

    Parameters
    ----------
    patches
        Pictures by frame; those on another step than the last one are left out.
    leading
        Lengths of the axes before (row, col).
    """

    dtype = np.dtype(np.float32)

    def __init__(self, patches: Mapping[int, Patch], leading: tuple[int, ...]):
        step = list(patches.values())[-1].grid.step
        same = {n: p for n, p in patches.items() if np.allclose(p.grid.step, step)}
        origin = np.min([p.grid.origin for p in same.values()], axis=0)
        corner = {n: np.round((p.grid.origin - origin) / step) for n, p in same.items()}
        ends = [corner[n] + patch.pixels.shape for n, patch in same.items()]
        self.grid = Grid(origin, step)
        self.shape = (*leading, *np.max(ends, axis=0).astype(int).tolist())
        self.ndim = len(self.shape)
        self.size = int(np.prod(self.shape))
        self._patches = {n: (corner[n].astype(int), patch.pixels) for n, patch in same.items()}

    def __getitem__(self, key: Any) -> Float[np.ndarray, "..."]:
        """Read like a NumPy array, making only the frames asked for."""
        key = key if isinstance(key, tuple) else (key,)
        if Ellipsis in key:
            at = key.index(Ellipsis)
            key = (*key[:at], *[slice(None)] * (self.ndim - len(key) + 1), *key[at + 1 :])
        depth = self.ndim - 2
        leading = (*key, *[slice(None)] * depth)[:depth]
        numbers = np.arange(int(np.prod(self.shape[:depth]))).reshape(self.shape[:depth])[leading]
        frames = np.array([self._frame(int(n)) for n in numbers.ravel()], dtype=self.dtype)
        whole = frames.reshape(*numbers.shape, *self.shape[depth:])
        return whole[(*[slice(None)] * numbers.ndim, *key[depth:])]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Float[np.ndarray, "..."]:
        """Make all frames."""
        return self[()].astype(dtype or self.dtype)

    def __len__(self) -> int:
        return self.shape[0]

    def _frame(self, number: int) -> Float[np.ndarray, "H W"]:
        frame = np.full(self.shape[-2:], np.nan, dtype=self.dtype)
        if number in self._patches:
            (row, col), pixels = self._patches[number]
            frame[row : row + pixels.shape[0], col : col + pixels.shape[1]] = pixels
        return frame

"""Arrays that are made plane by plane when napari asks for one."""

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
from jaxtyping import Shaped

KEPT = 4
"""Planes that are remembered: the one in view is read again with every change of the look."""


class Planes:
    """Array-like (*leading, H, W).

    Parameters
    ----------
    shape
        Of the whole.
    dtype
        Of its values.
    plane
        Makes (H, W) for a number that counts over all leading axes.
    """

    def __init__(
        self,
        shape: tuple[int, ...],
        dtype: Any,
        plane: Callable[[int], Shaped[np.ndarray, "H W"]],
    ):
        self.shape = shape
        self.dtype = np.dtype(dtype)
        self.ndim = len(shape)
        self.size = int(np.prod(shape))
        self._plane = lru_cache(KEPT)(plane)

    def __getitem__(self, key: Any) -> Shaped[np.ndarray, "..."]:
        """Read like a NumPy array, making only the planes asked for."""
        key = key if isinstance(key, tuple) else (key,)
        if Ellipsis in key:
            at = key.index(Ellipsis)
            key = (*key[:at], *[slice(None)] * (self.ndim - len(key) + 1), *key[at + 1 :])
        depth = self.ndim - 2
        leading = (*key, *[slice(None)] * depth)[:depth]
        numbers = np.arange(int(np.prod(self.shape[:depth]))).reshape(self.shape[:depth])[leading]
        planes = np.array([self._plane(int(n)) for n in numbers.ravel()], dtype=self.dtype)
        whole = planes.reshape(*numbers.shape, *self.shape[depth:])
        return whole[(*[slice(None)] * numbers.ndim, *key[depth:])]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Shaped[np.ndarray, "..."]:
        """Make all planes."""
        return self[()].astype(dtype or self.dtype)

    def __len__(self) -> int:
        return self.shape[0]

"""Lines as vectors end to end, which napari draws anew in a few milliseconds."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

PIECES = 24, 99, 600
"""Straight pieces that a line is drawn with, at least and at most, and all lines together, about:
napari's thumbnail alone takes 20 µs for each.
"""


def pieces(lines: Sequence[Float[np.ndarray, "N D"]]) -> list[Float[np.ndarray, "P 2 D"]]:
    """Cut lines into vectors: where each begins, and how far it goes."""
    count = int(np.clip(PIECES[2] // max(len(lines), 1), *PIECES[:2]))
    return [_cut(line, count) for line in lines]


def _cut(line: Float[np.ndarray, "N D"], count: int) -> Float[np.ndarray, "P 2 D"]:
    at = np.round(np.linspace(0, len(line) - 1, min(len(line), count + 1))).astype(int)
    return np.stack([line[at][:-1], np.diff(line[at], axis=0)], axis=1)

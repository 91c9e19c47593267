"""Compile what the first click needs before it comes."""

import numpy as np

LINES = (1, 20)
"""Numbers of bodies in the images: the smallest and the next size that programs come in."""
KNOTS = (8, 12)
SPACING = 10
LENGTH = 60
HALF_WIDTH = 2.0
"""Of the generated lines, px."""


def warm_up() -> None:
    """Import JAX and refine generated lines, so that the usual programs are compiled.

    Takes seconds the first time and a fraction of one when the compiled programs are in the
    user's cache. Call it in a worker thread.
    """
    from napari_splinesketch.engine.refine import refine
    from napari_splinesketch.engine.settings import Settings

    for knots in KNOTS:
        settings = Settings(knots=(knots,))
        for count in LINES:
            image, sketches = _lines(count)
            refine(image, sketches, settings, half_width=HALF_WIDTH)


def _lines(count: int) -> tuple[np.ndarray, list[np.ndarray]]:
    """Bright horizontal lines below each other, and a sketch of each."""
    row, column = np.mgrid[: SPACING * (count + 1), : 2 * LENGTH]
    rows = SPACING * np.arange(1, count + 1)
    ends = LENGTH + np.array([-0.5, 0.5]) * LENGTH
    outside = np.maximum(np.abs(column - LENGTH) - LENGTH / 2, 0)
    across = np.abs(row[:, :, None] - rows).min(2)
    grain = 0.01 * ((row * 7 + column * 3) % 5)
    image = np.clip(HALF_WIDTH - np.hypot(across, outside) + 0.5, 0, 1) + grain
    return image, [np.column_stack([np.full(2, r), ends]) for r in rows]

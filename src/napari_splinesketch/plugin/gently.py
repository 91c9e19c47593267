"""Long changes in short steps, so that the window lives in between."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import nullcontext
from functools import partial
from itertools import islice
from typing import Any

import numpy as np
from napari.layers import Shapes
from qtpy.QtCore import QTimer

BREATH_MS = 5
MANY = 200
"""With so many sketches, what follows from several edits in a row is worked out once."""
CHUNK = 50
"""Shapes added at once: napari takes about as long for one of them as for so many."""


def step_through(steps: Iterator[object], last: Callable[[], None] = lambda: None) -> None:
    """Take a step at each turn of the event loop, and call `last` after the last one."""
    try:
        next(steps)
    except StopIteration:
        last()
    else:
        QTimer.singleShot(BREATH_MS, partial(step_through, steps, last))


def add_shapes(
    layer: Shapes, shapes: Iterable[np.ndarray], kinds: Sequence[str], **look: Any
) -> Iterator[slice]:
    """Add shapes to a layer, some at each step; gives which.

    An empty layer is hidden until all but the last few are in it: to draw a layer again and again
    takes napari longer than to fill it.

    Parameters
    ----------
    layer
        Where they go.
    shapes
        Their vertices; made when they are needed.
    kinds
        What each is, as napari names it.
    **look
        Colours and widths, as `Shapes.add` takes them: for all, or a list with one for each.
    """
    made = iter(shapes)
    veiled = layer.visible and layer.nshapes == 0 and len(kinds) > CHUNK
    if veiled:
        layer.visible = False
    try:
        for start in range(0, len(kinds), CHUNK):
            part = slice(start, start + CHUNK)
            last = part.stop >= len(kinds)
            if veiled and last:
                veiled, layer.visible = False, True
                yield slice(0, 0)
            some: dict[str, Any] = {"shape_type": list(kinds[part])}
            some |= {k: v[part] if isinstance(v, list) else v for k, v in look.items()}
            with nullcontext() if last else layer.block_thumbnail_update():
                layer.add(list(islice(made, CHUNK)), **some)
            yield part
    finally:
        if veiled:
            layer.visible = True


class Soon:
    """Calls something at the next turn of the event loop, once however often it is asked for.

    Parameters
    ----------
    call
        What is called.
    after
        Milliseconds that the window may live before.
    """

    def __init__(self, call: Callable[[], object], after: int = 0):
        self._timer = QTimer()
        self._timer.setSingleShot(True)
        self._timer.setInterval(after)
        self._timer.timeout.connect(call)

    def __call__(self) -> None:
        """Ask for the call."""
        self._timer.start()

    def stop(self) -> None:
        """Call nothing any more."""
        self._timer.stop()

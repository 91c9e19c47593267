"""The plugin on a bare viewer model: everything but the window."""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from napari.components import ViewerModel
from napari.layers import Image, Shapes
from napari.utils.interactions import mouse_press_callbacks

from napari_splinesketch.plugin.controller import Controller
from napari_splinesketch.plugin.saver import Saver

from .hand import until

SOON = 20.0
LINES = [np.array([[20.0, 20], [20, 60]]), np.array([[50.0, 30], [60, 70], [80, 80]])]


class Bench:
    """A viewer model with what the dock makes, and nothing that shows it.

    Attributes
    ----------
    viewer, controller, saver
        As in the dock.
    """

    def __init__(self, viewer: ViewerModel | None = None):
        self.viewer = viewer or ViewerModel()
        self.controller = Controller(self.viewer)
        self.saver = Saver(self.controller)

    def image(self, shape: Sequence[int] = (96, 128), seed: int = 0) -> Image:
        """Add an image."""
        pixels = np.random.default_rng(seed).normal(100, 5, shape).astype(np.float32)
        image = self.viewer.add_image(pixels, name=f"image {seed}")
        assert isinstance(image, Image)
        return image

    def sketches(self, lines: Sequence[Any] = LINES, name: str = "sketches") -> Shapes:
        """Add a layer of lines."""
        layer = Shapes(list(lines), shape_type="path", name=name)
        self.viewer.add_layer(layer)
        return layer

    def click(self, layer: Shapes, *points: tuple[float, ...]) -> None:
        """Click vertices of a polyline that is not ended yet."""
        layer.mode = "add_polyline"
        self.viewer.layers.selection.active = layer
        for point in points:
            pos = np.array(point[:-3:-1])
            event = {"position": point, "pos": pos, "modifiers": (), "type": "mouse_press"}
            mouse_press_callbacks(layer, SimpleNamespace(**event))

    def refine(self) -> None:
        """Refine what is new, and wait for the end."""
        self.controller.refine()
        self.rest()

    def begin(self) -> None:
        """Open an image, sketch two bodies and refine them."""
        self.image()
        self.sketches()
        self.refine()

    def rest(self) -> None:
        """Wait until nothing runs."""
        until(lambda: self.controller.progress is None, SOON)

    def resume(self) -> None:
        """Bring back what is offered, and wait for the end."""
        until(self.saver.offers, SOON)
        self.saver.resume()
        self.rest()
        until(lambda: not self.controller.drawing.runs, SOON)

    def close(self) -> None:
        """Close the dock; the window stays."""
        self.saver.close()
        self.controller.close()


@contextmanager
def bench(viewer: ViewerModel | None = None) -> Iterator[Bench]:
    """Open a bench and close it."""
    made = Bench(viewer)
    try:
        yield made
    finally:
        made.close()


def saved_files(home: Path, name: str = "*") -> list[Path]:
    """Files of saved work, without locks and what is being written, which goes while one looks."""
    found = (Path(at) / each for at, _, names in os.walk(home) for each in names)
    paths = ((path.relative_to(home), path) for path in sorted(found))
    seen = (path for inner, path in paths if not any(part[0] == "." for part in inner.parts))
    return [path for path in seen if path.match(name)]

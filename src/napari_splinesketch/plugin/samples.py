"""Images with rough lines over some of their bodies: File > Open Sample, and the demo."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from napari_splinesketch import palette
from napari_splinesketch.data import load_sample
from napari_splinesketch.plugin.layers.drawn import SUFFIX, line_style
from napari_splinesketch.plugin.layers.slot import ROLE
from napari_splinesketch.synthetic import rotate, scene

if TYPE_CHECKING:
    from napari import Viewer

LayerData = tuple[Any, dict[str, Any], str]

SEED = 4
SIZE = (192, 192)
TURN = 20
"""How far the lines over the generated bodies are turned, degrees."""

AXES = ("t", "y", "x")
PLUGIN = "napari-splinesketch"
WINDOW = (1300, 860)
"""Size of the demo's window, px."""
FIT_AFTER_MS = 300
"""The window takes its size first."""


def worms_dense() -> list[LayerData]:
    """One frame of swimming worms."""
    return _layers("worms", *load_sample("worms_dense"))


def worms_swimming() -> list[LayerData]:
    """Eleven frames of swimming worms; lines in the first, which opens, and in the sixth."""
    return _layers("swimming worms", *load_sample("worms_swimming"))


def generated() -> list[LayerData]:
    """Three crossing bodies; rough lines over them, and a hidden layer of the truth."""
    made = scene(SEED, bodies=3, shape=SIZE)
    rough = [rotate(line, TURN)[::33] for line in made.centrelines]
    image, sketches = _layers("generated", made.image, rough)
    hidden = {"edge_color": palette.TRUTH, "visible": False, "metadata": {ROLE: "truth"}}
    truth = _lines("generated truth", made.centrelines, SIZE) | hidden
    return [image, (list(made.centrelines), truth, "shapes"), sketches]


def _layers(name: str, image: np.ndarray, lines: Sequence[np.ndarray]) -> list[LayerData]:
    axes = {"axis_labels": AXES[-image.ndim :]}
    look = _lines(name + SUFFIX, lines, image.shape[-2:])
    return [(image, {"name": name} | axes, "image"), (list(lines), look | axes, "shapes")]


def _lines(name: str, lines: Sequence[np.ndarray], shape: tuple[int, ...]) -> dict[str, Any]:
    kinds = ["line" if len(line) == 2 else "path" for line in lines]
    return {"name": name, "shape_type": kinds, **line_style((shape[0], shape[1]))}


def open_demo(*, block: bool = True) -> "Viewer":
    """Open a window with worms, rough lines over some of them, and the dock.

    Unless it may `block` until the window is closed, running it is left to the caller.
    """
    import napari
    from qtpy.QtCore import QTimer

    from napari_splinesketch.plugin.dock import SplinesketchDock

    viewer = napari.Viewer(title="Splinesketch demo")
    viewer.window.resize(*WINDOW)
    # From the menu it has the plugin's name too: cut off at the width of a dock.
    viewer.window.add_dock_widget(SplinesketchDock(viewer), name="Splinesketch")
    viewer.open_sample(PLUGIN, "worms_dense")
    QTimer.singleShot(FIT_AFTER_MS, viewer.reset_view)
    if block:
        napari.run()
    return viewer

"""Sample data for File > Open Sample: images, each with rough lines over some of its bodies."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from napari_splinesketch import palette
from napari_splinesketch.data import load_sample
from napari_splinesketch.plugin.layers.drawn import SUFFIX, line_style
from napari_splinesketch.plugin.layers.slot import ROLE
from napari_splinesketch.synthetic import rotate, scene

LayerData = tuple[Any, dict[str, Any], str]

SEED = 4
SIZE = (192, 192)
TURN = 20
"""How far the lines over the generated bodies are turned, degrees."""

AXES = ("t", "y", "x")


def worms_dense() -> list[LayerData]:
    """One frame of swimming worms."""
    return _layers("worms", *load_sample("worms_dense"))


def worms_swimming() -> list[LayerData]:
    """Eleven frames of swimming worms; lines in the first and in the sixth, which opens."""
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

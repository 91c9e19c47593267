"""Generated scenes with perfect labels, and the ways in which labels are spoilt for tests.

Bodies are drawn by exact distance to a tapered outline and not by the engine's renderer, so that
no test fits a scene with the model that drew it.
"""

from napari_splinesketch.metrics import resample
from napari_splinesketch.synthetic.look import Look
from napari_splinesketch.synthetic.perturbations import (
    axis_line,
    chord,
    compress,
    displace,
    rotate,
    scale,
)
from napari_splinesketch.synthetic.scenes import Scene, scene

__all__ = [
    "Look",
    "Scene",
    "axis_line",
    "chord",
    "compress",
    "displace",
    "resample",
    "rotate",
    "scale",
    "scene",
]

"""Generated scenes with perfect labels, and lines that are less exact.

Bodies are drawn by exact distance to a tapered outline and not by the engine's renderer, so that
no test fits a scene with the model that drew it.
"""

from napari_splinesketch.metrics import resample
from napari_splinesketch.synthetic.bodies import compress, rotate
from napari_splinesketch.synthetic.drawing import Look, Scene, scene

__all__ = ["Look", "Scene", "compress", "resample", "rotate", "scene"]

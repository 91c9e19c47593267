"""One meaning for each colour, in the window, in overlays and in figures.

From the palette of Okabe and Ito, which everybody can tell apart.
"""

from napari_splinesketch.engine.types import Status

STATUS: dict[Status, str] = {"good": "#009e73", "check": "#e69f00", "failed": "#d55e00"}
"""Bluish green, orange, vermilion: what a refinement says of a curve."""
SKETCH = "#0072b2"
"""Blue: what the user drew."""
LABEL = STATUS | {"sketch": SKETCH}
"""What the file of a label says of it."""
MOVING = "#56b4e9"
"""Sky blue: what is on its way, or can be dragged."""
TRUTH = "#f0e442"
"""Yellow: what is known to be true."""
UNCERTAIN = "#cc79a7"
"""Reddish purple: how far a curve may be off."""

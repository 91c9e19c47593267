"""Sub-pixel splines for slender bodies from a rough sketch, by differentiable rendering."""

from typing import TYPE_CHECKING

import lazy_loader

if TYPE_CHECKING:
    from napari_splinesketch.engine.find.suggest import suggest
    from napari_splinesketch.engine.refine import refine
    from napari_splinesketch.engine.settings import Settings
    from napari_splinesketch.engine.types import Curve, InputError, Progress, Refinement
    from napari_splinesketch.labels import read_labels, write_labels

__version__ = "0.2.0"

__all__ = [
    "Curve",
    "InputError",
    "Progress",
    "Refinement",
    "Settings",
    "__version__",
    "read_labels",
    "refine",
    "suggest",
    "write_labels",
]

# Imported when they are first used, so that importing the package is cheap.
__getattr__, _, _ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "engine.find.suggest": ["suggest"],
        "engine.refine": ["refine"],
        "engine.settings": ["Settings"],
        "engine.types": ["Curve", "InputError", "Progress", "Refinement"],
        "labels": ["read_labels", "write_labels"],
    },
)

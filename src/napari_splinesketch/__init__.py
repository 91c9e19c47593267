"""Sub-pixel splines for slender bodies from a rough sketch, by differentiable rendering."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from napari_splinesketch.engine.find.suggest import suggest
    from napari_splinesketch.engine.refine import refine
    from napari_splinesketch.engine.settings import Settings
    from napari_splinesketch.engine.types import Curve, Progress, Refinement
    from napari_splinesketch.labels import read_labels, write_labels

__version__ = "0.2.0"

__all__ = [
    "Curve",
    "Progress",
    "Refinement",
    "Settings",
    "__version__",
    "read_labels",
    "refine",
    "suggest",
    "write_labels",
]

_HOME = {
    "Curve": "engine.types",
    "Progress": "engine.types",
    "Refinement": "engine.types",
    "Settings": "engine.settings",
    "read_labels": "labels",
    "refine": "engine.refine",
    "suggest": "engine.find.suggest",
    "write_labels": "labels",
}


def __getattr__(name: str) -> Any:
    """Import public names when they are first used, so that importing the package is cheap."""
    from importlib import import_module

    if name in _HOME:
        return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

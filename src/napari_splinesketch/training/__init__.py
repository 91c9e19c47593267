"""Training sets for detectors: images with the refined curves that somebody accepted."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from napari_splinesketch.training.export import export_training
    from napari_splinesketch.training.load import Sample, TrainingSet, read_training
    from napari_splinesketch.training.split import Split

__all__ = ["Sample", "Split", "TrainingSet", "export_training", "read_training"]

_HOME = {
    "Sample": "load",
    "Split": "split",
    "TrainingSet": "load",
    "export_training": "export",
    "read_training": "load",
}


def __getattr__(name: str) -> Any:
    """Import public names when they are first used: the command line's help only needs `Split`."""
    from importlib import import_module

    if name in _HOME:
        return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

"""Training sets for detectors: images with the refined curves that somebody accepted."""

from typing import TYPE_CHECKING

import lazy_loader

if TYPE_CHECKING:
    from napari_splinesketch.training.export import export_training
    from napari_splinesketch.training.load import Sample, TrainingSet, read_training
    from napari_splinesketch.training.split import Split

__all__ = ["Sample", "Split", "TrainingSet", "export_training", "read_training"]

# Imported when they are first used: the command line's help only needs `Split`.
__getattr__, _, _ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "export": ["export_training"],
        "load": ["Sample", "TrainingSet", "read_training"],
        "split": ["Split"],
    },
)

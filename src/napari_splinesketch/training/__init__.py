"""Training sets for detectors: images with the refined curves that somebody accepted."""

from napari_splinesketch.training.export import export_training
from napari_splinesketch.training.load import Sample, TrainingSet, read_training
from napari_splinesketch.training.split import Split

__all__ = ["Sample", "Split", "TrainingSet", "export_training", "read_training"]

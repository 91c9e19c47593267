"""Reading and writing curves: plain functions, without Qt, napari or JAX."""

from napari_splinesketch.labels.format import LabelsError
from napari_splinesketch.labels.formats import read_labels, write_labels
from napari_splinesketch.labels.types import Label, Labels

__all__ = ["Label", "Labels", "LabelsError", "read_labels", "write_labels"]

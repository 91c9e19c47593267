"""Labels of a file, one frame at a time, however long the film."""

import os

from napari_splinesketch.labels.formats import reader_of
from napari_splinesketch.labels.stream import AnyLabels, ByFrame, in_frames


def open_labels(path: str | os.PathLike[str]) -> AnyLabels:
    """Look through a file of labels, to give them frame by frame if that takes less memory.

    A table in the order of its frames, as all of ours are, takes the memory of one frame and
    8 bytes for each further one, and so do NumPy arrays. Other files are read as a whole.
    """
    return reader_of(path).open_by_frame(path)


def by_frame(path: str | os.PathLike[str]) -> ByFrame:
    """Look through a file of labels, and be ready to give them frame by frame."""
    return in_frames(open_labels(path))

"""Labels of a file, one frame at a time, however long the film."""

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import groupby

import numpy as np
from jaxtyping import Int

from napari_splinesketch.engine.types import Array
from napari_splinesketch.labels import table
from napari_splinesketch.labels.formats import reader_of
from napari_splinesketch.labels.types import Label, Labels


@dataclass(frozen=True, eq=False)
class ByFrame:
    """The labels of a file.

    Attributes
    ----------
    frames
        (F,) the numbers of the frames that have some, rising.
    head
        What all share, without the labels themselves.
    read
        Gives the labels of each of `frames`.
    """

    frames: Int[Array, " F"]
    head: Labels
    read: Callable[[], Iterator[tuple[Label, ...]]]


def by_frame(path: str | os.PathLike[str]) -> ByFrame:
    """Look through a file of labels, and be ready to give them frame by frame.

    A table in the order of its frames, as all of ours are, takes the memory of one frame and
    8 bytes for each further one. Other files are read as a whole.
    """
    if reader_of(path).read is table.read:
        found = table.overview(path)
        if found is not None:
            return ByFrame(*found, partial(table.read_frames, path))
    return of_labels(reader_of(path).read(path))


def of_labels(labels: Labels) -> ByFrame:
    """Give labels that are in memory frame by frame."""
    ordered = sorted(labels.labels, key=lambda label: label.frame)
    groups = [tuple(group) for _, group in groupby(ordered, key=lambda label: label.frame)]
    head = Labels((), labels.scale, labels.units, labels.shape, labels.provenance, labels.notes)
    frames = np.array([group[0].frame for group in groups], dtype=np.int64)
    return ByFrame(frames, head, partial(iter, groups))

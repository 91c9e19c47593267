"""Labels in napari's own menus: File > Open, drag and drop, Save Selected Layers."""

import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from napari.utils.notifications import show_info

from napari_splinesketch.engine.types import OnProgress, Progress
from napari_splinesketch.labels import Label, Labels, LabelsError, read_labels, write_labels
from napari_splinesketch.labels.formats import HEAD, WRITERS, reader_of
from napari_splinesketch.labels.stream import in_frames
from napari_splinesketch.plugin import words
from napari_splinesketch.plugin.adapter.labels import labels_of_layer, layer_of_labels

COLUMNS = {"curve", "point", "half_width"}
"""Columns by which a CSV of labels is told from any other; napari reads that of shapes."""
FEATURE = re.compile(rb'"type"\s*:\s*"Feature(Collection)?"')
WCON_UNITS = re.compile(rb'"units"\s*:\s*\{(?=[^{}]*"t"\s*:)(?=[^{}]*"x"\s*:)[^{}]*"y"\s*:')

LayerData = tuple[list[Any], dict[str, Any], str]


def get_reader(path: str | list[str]) -> Callable[[str | list[str]], list[LayerData]] | None:
    """Give napari a reader, or None where the files are no labels of ours."""
    paths = [path] if isinstance(path, str) else path
    return read if all(map(_is_labels, paths)) else None


def read(path: str | list[str]) -> list[LayerData]:
    """Read labels, each file as a layer of paths; say what was left out."""
    paths = [path] if isinstance(path, str) else path
    layers = []
    for each in paths:
        labels = read_labels(each)
        if labels.notes:
            show_info(f"{Path(each).name}: {words.together(labels.notes)}")
        layers.append(layer_of_labels(labels, Path(each).stem))
    return layers


def write(path: str, data: Any, meta: dict[str, Any]) -> list[str]:
    """Write a layer of lines in the format of the path's ending; say what it cannot hold.

    napari has asked before it replaces a file; a name that it could not ask for, because the
    ending was missing, is not replaced.
    """
    named = path if Path(path).suffix else path + WRITERS[0].suffix
    lost = write_labels(named, labels_of_layer(data, meta), overwrite=named == path)
    if lost:
        show_info(f"{Path(named).name}: {words.together(lost)}")
    return [named]


class CancelledError(Exception):
    """The user wants nothing written any more."""


class _Watched(tuple[Label, ...]):
    """Labels of a frame that tell when somebody goes through them."""

    tell: Callable[[], None]

    def __iter__(self) -> Iterator[Label]:
        for label in super().__iter__():
            self.tell()
            yield label


def export(
    path: str | Path, labels: Labels, overwrite: bool, on_progress: OnProgress
) -> tuple[str, ...]:
    """Write labels; to be called in a thread.

    Parameters
    ----------
    path
        The file; its ending says the format.
    labels
        What to write.
    overwrite
        Whether a file that is there is replaced.
    on_progress
        Told how far it is; once it returns False, nothing is written.

    Returns
    -------
    tuple of str
        What the format has no place for.
    """
    told = 0

    def tell() -> None:
        nonlocal told
        told += 1
        # Most formats go through them twice.
        fraction = min(told / (2 * len(labels.labels)), 1.0)
        if on_progress(Progress("writing the file", fraction)) is False:
            raise CancelledError

    frames = in_frames(labels)

    def watched() -> Iterator[tuple[Label, ...]]:
        for frame in frames.read():
            some = _Watched(frame)
            some.tell = tell
            yield some

    return write_labels(path, replace(frames, read=watched), overwrite=overwrite)


def _is_labels(path: str) -> bool:
    """Tell by name and first bytes, where other programs use the ending too."""
    try:
        suffix = reader_of(path).suffix
        with Path(path).open("rb") as file:
            head = file.read(HEAD)
    except (LabelsError, OSError):
        return False
    return CLAIMS[suffix](head) if suffix in CLAIMS else True


def _is_table(head: bytes) -> bool:
    header = head.decode("utf-8-sig", errors="replace").partition("\n")[0]
    return COLUMNS <= {name.strip().strip('"') for name in header.split(",")}


def _is_json_of_lines(head: bytes) -> bool:
    return bool(FEATURE.search(head) or WCON_UNITS.search(head))


def _is_roi(head: bytes) -> bool:
    return head.startswith(b"Iout")


def _begins_with(ending: bytes) -> Callable[[bytes], bool]:
    """Tell whether the first file in a zip has such a name."""
    return lambda head: (
        head.startswith(b"PK\x03\x04")
        and head[30 : 30 + int.from_bytes(head[26:28], "little")].lower().endswith(ending)
    )


def _is_array_of_points(head: bytes) -> bool:
    file = BytesIO(head)
    try:
        version = np.lib.format.read_magic(file)
        header = np.lib.format.read_array_header_1_0
        if version != (1, 0):
            header = np.lib.format.read_array_header_2_0
        shape, _, _ = header(file)
    except ValueError:
        return False
    return len(shape) in (3, 4) and shape[-1] == 2


CLAIMS: dict[str, Callable[[bytes], bool]] = {
    ".csv": _is_table,
    ".json": _is_json_of_lines,
    ".npy": _is_array_of_points,
    ".npz": _begins_with(b".npy"),
    ".roi": _is_roi,
    ".zip": _begins_with(b".roi"),
}
"""What the first bytes must be for files whose ending is not ours alone."""

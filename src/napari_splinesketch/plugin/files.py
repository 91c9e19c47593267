"""Labels in napari's own menus: File > Open, drag and drop, Save Selected Layers."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import npe2
from napari.plugins._npe2 import get_readers
from napari.plugins.utils import get_preferred_reader
from napari.settings import get_settings
from napari.utils.notifications import show_info

from napari_splinesketch.engine.types import OnProgress, Progress
from napari_splinesketch.labels import (
    Labels,
    LabelsError,
    read_labels,
    shapes_csv,
    write_labels,
)
from napari_splinesketch.labels.formats import WRITERS, claiming
from napari_splinesketch.labels.types import in_frames
from napari_splinesketch.plugin import words
from napari_splinesketch.plugin.layers.labels import labels_of_layer, layer_of_labels

PLUGIN = "napari-splinesketch"

LayerData = tuple[list[Any], dict[str, Any], str]


def get_reader(path: str | list[str]) -> Callable[[str | list[str]], list[LayerData]] | None:
    """Give napari a reader, or None where the files are no labels of ours."""
    paths = [path] if isinstance(path, str) else path
    if all(map(_is_labels, paths)):
        return read
    return _napari_s_own if all(each.lower().endswith(".csv") for each in paths) else None


def _napari_s_own(path: str | list[str]) -> Any:
    """Hand tables of others on to napari: see `open_tables`."""
    paths = [path] if isinstance(path, str) else path
    return npe2.read(paths, stack=False, plugin_name="napari")


def open_tables() -> None:
    """Let napari open tables without asking for a reader: ours, which hands on what is not ours.

    Left alone where the user has chosen one, or a third plugin reads tables. It is a setting of
    the user's, so she is told.
    """
    plugins = get_settings().plugins
    others = set(get_readers("any.csv")) - {"napari", PLUGIN}
    if not others and get_preferred_reader("any.csv") is None:
        plugins.extension2reader = {**plugins.extension2reader, "*.csv": PLUGIN}
        show_info(
            "Splinesketch now opens tables (*.csv), and leaves those of others to napari. "
            "To change it: Preferences > Plugins > File extension readers."
        )


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
    told, reached = 0, 0.0

    def tell(done: float | None) -> None:
        nonlocal told, reached
        told += 1
        # Most formats go through them twice.
        fraction = told / (2 * len(labels.labels)) if done is None else done
        reached = max(reached, min(fraction, 1.0))
        if on_progress(Progress("writing the file", reached)) is False:
            raise CancelledError

    return write_labels(path, replace(in_frames(labels), tell=tell), overwrite=overwrite)


def _is_labels(path: str) -> bool:
    """Tell by name and first bytes; napari reads its own Shapes CSV itself."""
    try:
        return claiming(path) not in (None, shapes_csv.FORMAT)
    except (LabelsError, OSError):
        return False

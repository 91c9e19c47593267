"""Asking where, and in which format, curves go."""

from pathlib import Path

from qtpy.QtWidgets import QFileDialog, QWidget

from napari_splinesketch.labels.formats import WRITERS

KINDS = {f"{writer.name} (*{writer.suffix})": writer.suffix for writer in WRITERS}
"""The formats as a file dialog lists them, the first one proposed, and how their names end."""
DEFAULT = WRITERS[0].suffix


def ask_where(parent: QWidget, folder: Path, name: str) -> tuple[Path, bool] | None:
    """Let the user choose a file; None if she does not.

    Parameters
    ----------
    parent
        The widget that asks.
    folder
        Where the dialog opens.
    name
        Name of the file, without ending.

    Returns
    -------
    tuple
        The file, and whether it may be replaced: the dialog asks for the name that was typed,
        not for one that it got an ending for.
    """
    chosen, kind = QFileDialog.getSaveFileName(
        parent, "Export curves", str(folder / f"{name}{DEFAULT}"), ";;".join(KINDS)
    )
    if not chosen:
        return None
    path = with_ending(chosen, KINDS.get(kind, DEFAULT))
    return Path(path), path == chosen


def with_ending(path: str, suffix: str) -> str:
    """Give a path the ending of the chosen format, unless it has that of another one.

    The proposed ending gives way: dialogs keep it when another format is chosen.
    """
    ending = max((s for s in KINDS.values() if path.lower().endswith(s)), key=len, default="")
    if ending not in ("", DEFAULT) or ending == suffix:
        return path
    return path[: len(path) - len(ending)] + suffix

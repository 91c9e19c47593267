"""napari's own CSV of a Shapes layer: lines and paths only, in data coordinates.

A file that is written is a labels CSV, too: napari reads the lines and ignores other columns.
"""

from collections.abc import Iterator, Sequence
from itertools import repeat
from pathlib import Path
from typing import Any

import numpy as np

from napari_splinesketch.engine.types import InputError
from napari_splinesketch.labels import table
from napari_splinesketch.labels.format import Format, Source
from napari_splinesketch.labels.types import AnyLabels, Label, in_frames

HEADER = ("index", "shape-type", "vertex-index", "axis-0", "axis-1")
AXES = ("axis-0", "axis-1", "axis-2")
KINDS = {"index": int, "shape-type": str, "vertex-index": int, **dict.fromkeys(AXES, float)}
LINES = ("line", "path")
AREAS = ("rectangle", "ellipse", "polygon")


def write(path: Path, labels: AnyLabels) -> None:
    """Write each curve as a path: (row, col), or (frame, row, col) where a frame is not 0."""
    film = bool(in_frames(labels).frames.any())

    def leading(number: int, label: Label) -> table.Columns:
        frame = (repeat(float(label.frame)),) if film else ()
        axes = zip(AXES, (*frame, *label.points.T.tolist()), strict=False)
        columns: table.Columns = {"index": repeat(number), "shape-type": repeat("path")}
        return columns | {"vertex-index": range(len(label.points)), **dict(axes)}

    table.write(path, labels, leading)


def read(source: Source) -> Iterator[Label]:
    """Read lines and paths as sketches, numbered as in the file.

    The last two axes are row and col in data coordinates, which are pixels unless the layer was
    drawn on another grid than the image's; with three axes the first is the frame, rounded.
    """
    by, count = ("frame", "index"), "vertex-index"
    for lines, columns in table.read_curves(source, KINDS, HEADER, by, count, check=_check_axes):
        kind = columns["shape-type"]
        if kind not in LINES + AREAS:
            allowed = ", ".join(LINES + AREAS)
            raise InputError(f"shape-type is {kind[:40]!r}; expected one of {allowed}")
        if kind in AREAS or len(lines) < 2:
            source.left_out[kind if kind in AREAS else "point"] += 1
        else:
            yield _sketch(columns)


def _check_axes(header: Sequence[str]) -> None:
    axes = sorted(name for name in header if name.startswith("axis-"))
    if axes not in (list(AXES[:2]), list(AXES)):
        raise InputError(
            f"columns {', '.join(axes)[:80]}; expected axis-0 and axis-1 (row, col), or also "
            "axis-2 (frame, row, col)"
        )


def _sketch(columns: dict[str, Any]) -> Label:
    axes = [columns[name] for name in AXES if name in columns]
    frames = np.round(axes[0]) if len(axes) == 3 else np.zeros(1)
    if not np.all(frames == frames[0]):
        raise InputError("the shape spans several frames; draw it in one")
    if not 0 <= frames[0] < 2**53:
        raise InputError(f"axis-0 is {frames[0]:g}; expected the frame, a number from 0")
    points, number = np.column_stack(axes[-2:]), columns["index"]
    return Label.from_sketch(points, frame=int(frames[0]), identity=number)


MARK = rb"\A[^\n]*shape-type"
MARKS = {".shapes.csv": MARK, ".csv": MARK}
FORMAT = Format("napari Shapes CSV", MARKS, read, write, table.LOSSES)

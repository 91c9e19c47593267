"""napari's own CSV of a Shapes layer: lines and paths only, in data coordinates.

What is written is a labels CSV too: napari reads the lines, and lets further columns be.
"""

from collections.abc import Iterable, Iterator
from itertools import repeat
from pathlib import Path

import numpy as np

from napari_splinesketch.labels.csv_columns import Rows, read_curves
from napari_splinesketch.labels.format import Format, Source
from napari_splinesketch.labels.stream import AnyLabels, in_frames
from napari_splinesketch.labels.table import losses, write_rows
from napari_splinesketch.labels.types import Label

HEADER = ("index", "shape-type", "vertex-index", "axis-0", "axis-1")
AXES = ("axis-0", "axis-1", "axis-2")
KINDS = {
    "index": int,
    "shape-type": str,
    "vertex-index": int,
    **dict.fromkeys(AXES, float),
}
LINES = ("line", "path")
AREAS = ("rectangle", "ellipse", "polygon")


def write(path: Path, labels: AnyLabels) -> None:
    """Write each curve as a path: (row, col), or (frame, row, col) where a frame is not 0."""
    film = bool(in_frames(labels).frames.any())

    def leading(number: int, label: Label) -> tuple[Iterable[object], ...]:
        size = len(label.points)
        frame = (repeat(float(label.frame), size),) if film else ()
        first = repeat(number, size), repeat("path", size), range(size)
        return *first, *frame, *label.points.T.tolist()

    with path.open("x", encoding="utf-8", newline="") as file:
        write_rows(file, labels, HEADER + (("axis-2",) if film else ()), leading)


def read(source: Source) -> Iterator[Label]:
    """Read lines and paths as sketches, numbered as in the file.

    The last two axes are row and col in data coordinates, which are pixels unless the layer was
    drawn on another grid than the image's; with three axes the first is the frame, rounded.
    """
    same = ("vertex-index", "shape-type")
    for rows in read_curves(source, KINDS, HEADER, ("frame", "index"), same, check=_check_axes):
        yield from _shape(source, rows)


def _check_axes(header: list[str]) -> None:
    axes = sorted(name for name in header if name.startswith("axis-"))
    if axes not in (list(AXES[:2]), list(AXES)):
        raise ValueError(
            f"columns {', '.join(axes)[:80]}; expected axis-0 and axis-1 (row, col), or also "
            "axis-2 (frame, row, col)"
        )


def _shape(source: Source, rows: Rows) -> Iterator[Label]:
    """Give a shape as a sketch, where it can be one."""
    kind = rows.columns["shape-type"].item(0)
    if kind not in LINES + AREAS:
        allowed = ", ".join(LINES + AREAS)
        raise ValueError(f"shape-type is {kind[:40]!r}; expected one of {allowed}")
    if kind in AREAS or len(rows.lines) < 2:
        source.left_out[kind if kind in AREAS else "point"] += 1
        return
    axes = [rows.columns[name] for name in AXES if name in rows.columns]
    frame, number = _frame(axes), rows.columns["index"].item(0)
    yield Label.from_sketch(np.column_stack(axes[-2:]), frame=frame, identity=number)


def _frame(axes: list[np.ndarray]) -> int:
    frames = np.round(axes[0]) if len(axes) == 3 else np.zeros(1)
    if not np.all(frames == frames[0]):
        raise ValueError("the shape spans several frames; draw it in one")
    if not 0 <= frames[0] < 2**53:
        raise ValueError(f"axis-0 is {frames[0]:g}; expected the frame, a number from 0")
    return int(frames[0])


def claims(ending: str, head: bytes) -> bool:
    """Tell from its first line whether a CSV is one of shapes, and no more."""
    return b"shape-type" in head.partition(b"\n")[0]


FORMAT = Format("napari Shapes CSV", (".shapes.csv", ".csv"), read, write, losses, claims)

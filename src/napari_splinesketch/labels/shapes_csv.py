"""napari's own CSV of a Shapes layer: lines and paths only, in data coordinates.

What is written is a labels CSV too: napari reads the lines, and lets further columns be.
"""

from collections.abc import Iterable, Iterator
from itertools import repeat
from pathlib import Path

import numpy as np

from napari_splinesketch.labels.csv_columns import Rows, read_rows, runs
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
    rest: list[tuple[Rows, slice]] = []
    for rows in read_rows(source, KINDS, HEADER, _check_axes):
        for place in runs(rows.columns["index"]):
            if rest and _first(rest, "index") != rows.columns["index"][place.start]:
                yield from _shape(source, rest)
                rest = []
            if not rest:
                source.place = f"line {rows.lines[place.start]}"
                source.refuse_again(0, int(rows.columns["index"][place.start]))
            rest.append((rows, place))
    if rest:
        yield from _shape(source, rest)


def _check_axes(header: list[str]) -> None:
    axes = sorted(name for name in header if name.startswith("axis-"))
    if axes not in (list(AXES[:2]), list(AXES)):
        raise ValueError(
            f"columns {', '.join(axes)[:80]}; expected axis-0 and axis-1 (row, col), or also "
            "axis-2 (frame, row, col)"
        )


def _first(rows: list[tuple[Rows, slice]], name: str) -> object:
    return rows[0][0].columns[name][rows[0][1].start]


def _shape(source: Source, rows: list[tuple[Rows, slice]]) -> Iterator[Label]:
    """Give a shape as a sketch, where it can be one."""
    lines = np.concatenate([rows.lines[place] for rows, place in rows])
    columns = {
        name: np.concatenate([rows.columns[name][place] for rows, place in rows])
        for name in rows[0][0].columns
    }
    kind = str(columns["shape-type"][0])
    for wrong in np.flatnonzero(columns["shape-type"] != kind)[:1]:
        source.place = f"line {lines[wrong]}"
        raise ValueError(f"shape-type differs from {kind!r} on line {lines[0]}")
    for wrong in np.flatnonzero(columns["vertex-index"] != np.arange(len(lines)))[:1]:
        source.place = f"line {lines[wrong]}"
        number = columns["vertex-index"][wrong]
        raise ValueError(f"vertex-index is {number}; expected {wrong}, counting from 0")
    source.place = f"line {lines[0]}"
    if kind not in LINES + AREAS:
        allowed = ", ".join(LINES + AREAS)
        raise ValueError(f"shape-type is {kind[:40]!r}; expected one of {allowed}")
    if kind in AREAS or len(lines) < 2:
        source.left_out[kind if kind in AREAS else "point"] += 1
        return
    axes = [columns[name] for name in AXES if name in columns]
    frame = _frame(source, axes)
    points = np.column_stack(axes[-2:])
    yield Label.from_sketch(points, frame=frame, identity=int(columns["index"][0]))


def _frame(source: Source, axes: list[np.ndarray]) -> int:
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

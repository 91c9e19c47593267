"""napari's own CSV of a Shapes layer: lines and paths only, in data coordinates."""

import csv
import os
from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from napari_splinesketch.labels.files import atomic, blamed
from napari_splinesketch.labels.rows import Row, Rows, open_rows
from napari_splinesketch.labels.stream import AnyLabels, in_frames
from napari_splinesketch.labels.types import Label, Labels

HEADER = ("index", "shape-type", "vertex-index", "axis-0", "axis-1")
LINES = ("line", "path")
AREAS = ("rectangle", "ellipse", "polygon")


def write(path: str | os.PathLike[str], labels: AnyLabels, *, overwrite: bool = False) -> None:
    """Write each curve as a path: (row, col), or (frame, row, col) where a frame is not 0."""
    film = bool(in_frames(labels).frames.any())
    with (
        atomic(path, overwrite=overwrite) as temporary,
        temporary.open("x", encoding="utf-8", newline="") as file,
    ):
        table = csv.writer(file, lineterminator="\n")
        table.writerow(HEADER + (("axis-2",) if film else ()))
        for index, label in enumerate(labels.labels):
            frame = (float(label.frame),) if film else ()
            table.writerows(
                (index, "path", vertex, *frame, *point)
                for vertex, point in enumerate(label.points.tolist())
            )


def losses(labels: AnyLabels) -> tuple[str, ...]:
    """Say what a Shapes CSV has no place for."""
    lost = ["Shapes CSV keeps lines only: no half-width, standard error, status or identity"]
    if labels.scale:
        lost.append("Shapes CSV has no place for the scale and units")
    if labels.provenance:
        lost.append("Shapes CSV has no place for provenance (version, settings, image, date)")
    return tuple(lost)


def fits(head: bytes) -> bool:
    """Tell from its first line whether a CSV is one of shapes."""
    return b"shape-type" in head.partition(b"\n")[0]


def read(path: str | os.PathLike[str]) -> Labels:
    """Read lines and paths as sketches, numbered as in the file.

    The last two axes are row and col in data coordinates, which are pixels unless the layer was
    drawn on another grid than the image's; with three axes the first is the frame, rounded.
    """
    with open_rows(path, HEADER) as rows:
        return _Reader(rows).labels()


@dataclass(eq=False)
class _Shape:
    index: int
    kind: str
    line: int
    vertices: list[tuple[float, ...]] = field(default_factory=list)


class _Reader:
    def __init__(self, rows: Rows) -> None:
        self._rows = rows
        axes = [name for name in rows.header if name.startswith("axis-")]
        self._axes = [f"axis-{number}" for number in range(len(axes))]
        if len(axes) > 3 or set(axes) != set(self._axes):
            raise rows.error(
                f"columns {', '.join(axes)[:80]}; expected axis-0 and axis-1 (row, col), or also "
                "axis-2 (frame, row, col)"
            )
        self._left_out: Counter[str] = Counter()

    def labels(self) -> Labels:
        labels: dict[int, Label] = {}
        seen: set[int] = set()
        shape: _Shape | None = None
        for row in self._rows:
            index = self._rows.integer(row, "index")
            if shape is None or index != shape.index:
                if shape:
                    self._keep(shape, labels)
                if index in seen:
                    raise self._rows.error(f"shape {index} starts again")
                seen.add(index)
                shape = _Shape(index, row["shape-type"], self._rows.line)
            self._add(shape, row)
        if shape:
            self._keep(shape, labels)
        return Labels(tuple(labels.values()), notes=self._notes())

    def _add(self, shape: _Shape, row: Row) -> None:
        if row["shape-type"] != shape.kind:
            raise self._rows.error(f"shape-type differs from {shape.kind!r} on line {shape.line}")
        vertex = self._rows.integer(row, "vertex-index")
        if vertex != len(shape.vertices):
            raise self._rows.error(
                f"vertex-index is {vertex}; expected {len(shape.vertices)}, counting from 0"
            )
        shape.vertices.append(tuple(self._rows.number(row, name) for name in self._axes))

    def _keep(self, shape: _Shape, labels: dict[int, Label]) -> None:
        if shape.kind in AREAS:
            self._left_out[shape.kind] += 1
        elif shape.kind not in LINES:
            raise self._rows.error(
                f"shape-type is {shape.kind[:40]!r}; expected one of {', '.join(LINES + AREAS)}",
                shape.line,
            )
        elif len(shape.vertices) < 2:
            self._left_out["point"] += 1
        else:
            labels[shape.index] = self._label(shape)

    def _label(self, shape: _Shape) -> Label:
        vertices = np.array(shape.vertices)
        frames = np.round(vertices[:, 0]) if len(self._axes) == 3 else np.zeros(1)
        if not np.all(frames == frames[0]):
            raise self._rows.error("the shape spans several frames; draw it in one", shape.line)
        if not 0 <= frames[0] < 2**53:
            raise self._rows.error(
                f"axis-0 is {frames[0]:g}; expected the frame, a number from 0", shape.line
            )
        with blamed(lambda reason: self._rows.error(reason, shape.line)):
            return Label.from_sketch(vertices[:, -2:], frame=int(frames[0]), identity=shape.index)

    def _notes(self) -> tuple[str, ...]:
        if not self._left_out:
            return ()
        counts = ", ".join(f"{count} {kind}" for kind, count in sorted(self._left_out.items()))
        return (f"left out {counts}: only lines and paths of two or more vertices can be sketches",)

"""Reading the native table: every check, and the line where it failed."""

import itertools
from array import array
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import cast

import numpy as np
from jaxtyping import Float

from napari_splinesketch.engine.types import Array
from napari_splinesketch.labels.files import blamed
from napari_splinesketch.labels.rows import Row, Rows
from napari_splinesketch.labels.types import Label, Labels, LabelStatus, Review

PIXELS = ("frame", "curve", "point", "row", "col", "half_width", "sd", "arc_length", "status")
REVIEW = ("review",)
UNITS = ("y", "x", "half_width_units", "units")
REQUIRED = tuple(name for name in PIXELS if name != "arc_length")
SCALE_TOLERANCE = 1e-6


def _doubles() -> "array[float]":
    return array("d")


@dataclass(eq=False)
class _Block:
    """The consecutive rows of one curve."""

    frame: int
    curve: int
    status: str
    review: str
    line: int
    row: "array[float]" = field(default_factory=_doubles)
    col: "array[float]" = field(default_factory=_doubles)
    half_width: "array[float]" = field(default_factory=_doubles)
    sd: "array[float]" = field(default_factory=_doubles)

    def label(self) -> Label:
        points = np.column_stack([self.row, self.col])
        status, review = cast(LabelStatus, self.status), cast(Review, self.review)
        width, sd = np.array(self.half_width), np.array(self.sd)
        return Label(self.frame, self.curve, points, width, sd, status, review)


class DisorderError(ValueError):
    """A table whose frames are in no order."""


class TableReader:
    """Reads one table."""

    def __init__(self, rows: Rows) -> None:
        self._rows = rows
        self._physical = all(name in rows.header for name in ("y", "x", "units"))
        self._units: str | None = None
        self._y = _doubles()
        self._x = _doubles()
        self._found: tuple[float, float] | None = None
        self._settled = 0

    def labels(self) -> Labels:
        """Read everything."""
        labels = tuple(self._curves(set()))
        self._settle(labels)
        return self.head(labels)

    def frames(self) -> Iterator[tuple[Label, ...]]:
        """Read frame by frame; DisorderError where a frame comes after a later one.

        The scale is that of the first frame, and `head` has it when all are read.
        """
        known: set[tuple[int, int]] = set()
        last = -1
        for frame, curves in itertools.groupby(self._curves(known), lambda label: label.frame):
            if frame < last:
                raise DisorderError
            labels, last = tuple(curves), frame
            known -= {(label.frame, label.curve) for label in labels}
            self._settle(labels)
            yield labels

    def head(self, labels: tuple[Label, ...] = ()) -> Labels:
        """Give labels with what was read of scale and units."""
        with blamed(lambda reason: self._rows.error(reason, 2)):
            return Labels(labels, self._found, (self._units or None) if self._found else None)

    def _curves(self, known: set[tuple[int, int]]) -> Iterator[Label]:
        """Read curve by curve; `known` gathers their keys."""
        block: _Block | None = None
        for row in self._rows:
            key = self._rows.integer(row, "frame"), self._rows.integer(row, "curve")
            if block is None or key != (block.frame, block.curve):
                if block:
                    yield self._finished(block)
                if key in known:
                    raise self._rows.error(
                        f"curve {key[1]} of frame {key[0]} starts again; "
                        "the rows of a curve must follow one another"
                    )
                known.add(key)
                block = _Block(*key, row["status"], row.get(*REVIEW, "open"), self._rows.line)
            self._add(block, row)
        if block:
            yield self._finished(block)

    def _add(self, block: _Block, row: Row) -> None:
        rows = self._rows
        point = rows.integer(row, "point")
        if point != len(block.row):
            raise rows.error(f"point is {point}; expected {len(block.row)}, counting from 0")
        if row["status"] != block.status:
            raise rows.error(f"status differs from {block.status!r} on line {block.line}")
        if row.get(*REVIEW, "open") != block.review:
            raise rows.error(f"review differs from {block.review!r} on line {block.line}")
        block.row.append(rows.number(row, "row"))
        block.col.append(rows.number(row, "col"))
        block.half_width.append(rows.number(row, "half_width"))
        block.sd.append(rows.number(row, "sd"))
        if self._physical:
            self._y.append(rows.number(row, "y"))
            self._x.append(rows.number(row, "x"))
            self._units = row["units"] if self._units is None else self._units
            if row["units"] != self._units:
                raise rows.error(f"units are {row['units']!r} here but {self._units!r} above")

    def _finished(self, block: _Block) -> Label:
        with blamed(lambda reason: self._rows.error(reason, block.line)):
            return block.label()

    def _settle(self, labels: tuple[Label, ...]) -> None:
        """Take the scale from labels that were read, or compare it with that of earlier ones."""
        if not (self._physical and labels):
            return
        # What has been read of the curve after these stays for the next time.
        count = sum(len(label.points) for label in labels)
        pixels = np.concatenate([label.points for label in labels])
        sizes: list[float | None] = []
        for axis, (name, values) in enumerate((("y", self._y), ("x", self._x))):
            physical = np.array(values[:count])
            del values[:count]
            sizes.append(self._found[axis] if self._found else _factor(pixels[:, axis], physical))
            self._check_factor(pixels[:, axis], physical, sizes[-1], name)
        # A curve along one axis, in row 0, says nothing of the other: pixels are then square.
        y, x = sizes[0] or sizes[1], sizes[1] or sizes[0]
        self._found = (y, x) if y and x else None
        self._settled += count

    def _check_factor(
        self,
        pixels: Float[Array, " N"],
        physical: Float[Array, " N"],
        factor: float | None,
        name: str,
    ) -> None:
        expected = pixels * (factor or 0.0)
        agree = np.abs(physical - expected) <= SCALE_TOLERANCE * np.abs(expected) + 1e-300
        if not np.all(agree) or (factor is not None and not factor > 0):
            line = self._settled + int(np.argmin(agree)) + 2
            pixel = {"y": "row", "x": "col"}[name]
            raise self._rows.error(
                f"{name} is not {pixel} times one scale; correct it or remove columns "
                f"{', '.join(UNITS)}",
                line,
            )


def _factor(pixels: Float[Array, " N"], physical: Float[Array, " N"]) -> float | None:
    """Find the shortest decimal number that maps `pixels` on `physical`, bit for bit.

    Where none does, as in tables that were rounded, the ratio at the largest coordinate.
    """
    largest = int(np.argmax(np.abs(pixels)))
    if pixels[largest] == 0:
        return None
    ratio = float(physical[largest] / pixels[largest])
    if not np.isfinite(ratio):
        return 0.0
    for digits in range(1, 18):
        candidate = float(f"{ratio:.{digits}g}")
        if np.array_equal(pixels * candidate, physical):
            return candidate
    for neighbour in (np.nextafter(ratio, 0), np.nextafter(ratio, np.inf)):
        if np.array_equal(pixels * neighbour, physical):
            return float(neighbour)
    return ratio

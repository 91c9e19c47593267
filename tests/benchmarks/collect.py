"""The stored rows that are about the present frames."""

from collections.abc import Iterable
from functools import cache

import methods
import numpy as np
from bound import NAME as BOUND
from frames import Cell, frame
from rows import FOLDER, Row, read
from stats import Summary, summary

from napari_splinesketch.metrics import average_dtw

SAME = 2e-3
"""Rows are about the present frames where their sketches are as far off as today's, relatively."""


class Results:
    """Rows by method."""

    def __init__(self, names: Iterable[str] = methods.NAMES) -> None:
        kept = {name: _valid(name) for name in names}
        self.rows = {name: rows for name, rows in kept.items() if rows}
        self.rows[BOUND] = list(read(FOLDER / "rows" / f"{BOUND}.csv"))

    @property
    def names(self) -> list[str]:
        """Methods with results, the sketch first."""
        return [name for name in self.rows if name != BOUND]

    def outdated(self, name: str) -> bool:
        """Whether the method has changed since its rows were made."""
        present = methods.make(name).version if methods.missing(name) is None else None
        return present is not None and any(row.version != present for row in self.rows[name])

    def of(self, name: str, cells: Iterable[Cell]) -> list[Row]:
        """Rows of a method in some cells."""
        wanted = set(cells)
        return [row for row in self.rows.get(name, ()) if row.cell in wanted]

    def summary(self, name: str, *cells: Cell) -> Summary | None:
        """Summary of a method over some cells; None where it has no results."""
        return summary(self.of(name, cells))

    def bound(self, bodies: int) -> Summary | None:
        """Summary of the Cramér-Rao bound for so many bodies in a frame."""
        return summary([row for row in self.rows[BOUND] if row.bodies == bodies])


def _valid(name: str) -> list[Row]:
    rows = read(FOLDER / "rows" / f"{name}.csv")
    return [row for row in rows if np.isclose(row.initial, _initial(row), rtol=SAME)]


def _initial(row: Row) -> float:
    """Average DTW of the row's sketch as it is made today, px: another processor rounds another
    way, so that images are not the same to the last bit.
    """
    sketch, truth = _bodies(row.cell, row.index)[row.body]
    return average_dtw(sketch, truth)


@cache
def _bodies(cell: Cell, index: int) -> list[tuple[np.ndarray, np.ndarray]]:
    made = frame(cell, index)
    return list(zip(made.sketches, made.truths, strict=True))

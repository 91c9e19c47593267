"""Bodies keep their numbers."""

import gc
from weakref import ref

import numpy as np
import pytest

from napari_splinesketch.plugin.columns import rows_of
from napari_splinesketch.plugin.model import Record, identify

from .fakes import as_drawn

A = np.array([[0.0, 0], [0, 40]])
B = np.array([[20.0, 0], [20, 40]])
C = np.array([[60.0, 0], [40, 20], [60, 40]])


def record(number: int, line: np.ndarray, frame: int = 0) -> Record:
    return Record(number, frame, line, as_drawn(line))


CASES: dict[str, tuple[list[np.ndarray], list[int]]] = {
    "the same": ([A, B, C], [4, 5, 6]),
    "another order": ([C, A, B], [6, 4, 5]),
    "drawn from the other end": ([A[::-1], B, C[::-1]], [4, 5, 6]),
    "one moved": ([A, B + 5, C], [4, 5, 6]),
    "one deleted": ([A, C], [4, 6]),
    "one new": ([A, B, A + 200, C], [4, 5, 8, 6]),
    "one deleted and one new, far off": ([A + 200, B, C], [8, 5, 6]),
    "all new": ([A + 200, A + 300], [8, 9]),
    "with a vertex more": ([np.array([[0.0, 0], [1, 20], [0, 40]]), B, C], [4, 5, 6]),
}


@pytest.mark.parametrize("name", CASES)
def test_identify(name: str) -> None:
    lines, ids = CASES[name]
    known = [record(4, A), record(5, B), record(6, C)]
    assert identify(lines, known, [*known, record(7, A, frame=1)]) == ids


def test_the_first_numbers() -> None:
    assert identify([A, B], [], []) == [1, 2]


def test_a_row_of_the_table_keeps_no_other_curves() -> None:
    first, second = record(1, A), record(1, B, frame=1)
    rows_of([first, second])
    gone = ref(second.curve)
    del second
    gc.collect()
    assert gone() is None
    assert len(rows_of([first])) == 1

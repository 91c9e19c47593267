"""Sets of paths are fitted in batches, each with the fixed curves that lie across it."""

import numpy as np
import pytest

from napari_splinesketch.engine.find import trials
from napari_splinesketch.engine.find.trials import Comparison, Start, Trial, fitted

FIXED = [np.array([[0.0, 5.0], [0.0, 15.0]]), np.array([[900.0, 5.0], [900.0, 15.0]])]


def line(row: float) -> np.ndarray:
    return np.array([[row, 0.0], [row, 20.0]])


def sets() -> list[Trial]:
    """Three sets of two clusters; the first cluster lies across the first fixed curve."""
    rows = [(0, (1.0, 5.0)), (0, (2.0, 6.0)), (1, (400.0,))]
    return [Trial(number, [Start(line(r), True) for r in each]) for number, each in rows]


@pytest.mark.parametrize("together", [1, 4, 6, 128])
def test_batches_give_what_one_fit_gives(monkeypatch: pytest.MonkeyPatch, together: int) -> None:
    monkeypatch.setattr(trials, "TOGETHER", together)
    parts, sizes = [], []

    def fit(lines, replica, still, part):
        parts.append(part)
        sizes.append(len(lines) + len(still))
        assert len(lines) == len(replica)
        return [x[0, 0] for x in lines] + [f"fixed {k} of {r}" for r, k in still]

    found = fitted(sets(), FIXED, Comparison(np.zeros((1, 1)), 1.0, fit), 2.0)
    assert [[s.body for s in t.starts] for t in found] == [[1.0, 5.0], [2.0, 6.0], [400.0]]
    assert [len(t.still) for t in found] == [1, 1, 0]
    assert all(str(b).startswith("fixed 0") for t in found for b in t.still)
    assert [t.cluster for t in found] == [0, 0, 1]
    assert max(sizes) <= max(together, 3)
    assert [a for a, _ in parts[1:]] == [b for _, b in parts[:-1]]
    assert (parts[0][0], parts[-1][1]) == (0.0, 1.0)


def test_nothing_to_compare_needs_no_fit() -> None:
    def fit(*_):
        raise AssertionError

    assert fitted([], FIXED, Comparison(np.zeros((1, 1)), 1.0, fit), 2.0) == []

"""Blocks of frames go to one part each, with a gap between the parts."""

import numpy as np
import pytest

from napari_splinesketch.training import Split
from napari_splinesketch.training.split import LEFT_OUT

FILM = np.arange(1000)


def test_the_shares_are_kept_and_neighbours_stay_together() -> None:
    parts = Split().parts(FILM)
    counts = [int((parts == part).sum()) for part in range(3)]
    assert Split().sizes(FILM) == (50, 5)
    assert counts[1] + counts[2] > 170
    assert counts[0] > 700
    kept = FILM[parts != LEFT_OUT]
    changes = np.flatnonzero(np.diff(parts[kept]))
    assert 3 <= len(changes) <= 8  # between two parts each, not between all frames
    assert (np.diff(kept)[changes] > 5).all()


def test_the_seed_alone_decides() -> None:
    assert np.array_equal(Split(seed=3).parts(FILM), Split(seed=3).parts(FILM))
    assert any(not np.array_equal(Split(seed=s).parts(FILM), Split().parts(FILM)) for s in (1, 2))


SHARES = {
    "all train": ((1.0, 0.0, 0.0), {0}),
    "no val": ((9.0, 0.0, 1.0), {0, 2}),
    "tiny shares get a block": ((0.98, 0.01, 0.01), {0, 1, 2}),
}


@pytest.mark.parametrize(("shares", "wanted"), SHARES.values(), ids=SHARES.keys())
def test_shares_above_nothing_get_something(
    shares: tuple[float, float, float], wanted: set[int]
) -> None:
    for count in (3, 10, 1000):
        assert set(Split(shares, gap=0).parts(np.arange(count))) == wanted


def test_a_gap_costs_training_frames_before_others() -> None:
    parts = Split((0.5, 0.0, 0.5), block=10, gap=3).parts(np.arange(20))
    assert (parts == 2).sum() == 10
    assert (parts == 0).sum() == 7
    assert (parts == LEFT_OUT).sum() == 3


def test_frames_far_apart_need_no_gap() -> None:
    frames = np.arange(0, 400, 20)
    assert LEFT_OUT not in Split(block=20, gap=5).parts(frames)


def test_one_frame_and_none_make_no_trouble() -> None:
    assert Split().parts(np.array([17])).tolist() == [0]
    assert Split().parts(np.zeros(0, dtype=int)).tolist() == []


@pytest.mark.parametrize(
    ("wrong", "reason"),
    [
        ({"shares": (0.0, 0.0, 0.0)}, "three numbers from 0"),
        ({"shares": (1.0, -0.1, 0.1)}, "three numbers from 0"),
        ({"shares": (1.0, float("nan"), 0.1)}, "three numbers from 0"),
        ({"shares": 0.8}, "shares are 0.8"),
        ({"block": 0}, "block is 0"),
        ({"block": 1.5}, "block is 1.5; give a whole number from 1"),
        ({"gap": -1}, "gap is -1"),
        ({"seed": -1}, "seed is -1"),
        ({"seed": None}, "seed is None"),
    ],
)
def test_what_divides_nothing_is_refused(wrong: dict, reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        Split(**wrong)

"""What comes into view, leaves it or divides is said."""

from dataclasses import replace

import numpy as np
import pytest
from generated_films import Film, film

from napari_splinesketch.engine.types import Curve
from napari_splinesketch.tracking import Body, Tracked, View, follow
from napari_splinesketch.tracking.events import border, parts

from .test_follow import LINE, curve

SHORT = {"frames": 24, "bodies": 2, "length": 40.0, "shape": (120, 100), "speed": 1.0}


def tracked(made: Film, numbers: tuple[int, ...] = (0, 1)) -> list[Tracked]:
    start = [Body(i, ((0, curve(made.centrelines[0, i], 2.5)),)) for i in numbers]
    frames = range(1, len(made.images))
    return list(follow(frames, start, lambda t, _: View(made.images[t]), preset="fast"))


@pytest.mark.slow
def test_a_body_that_divides_is_reported_and_ends() -> None:
    made = film(4, motion="glide", divides=6, crossing=False, **SHORT)
    results = tracked(made)
    ended = [r for r in results if r.lost]
    assert [sorted(r.lost) for r in ended] == [[0]]
    assert 6 <= ended[0].frame <= 20
    assert "it divided into parts of" in ended[0].missing[0]
    assert all(1 in r.ids for r in results)
    assert not any(r.entered for r in results)


@pytest.mark.slow
def test_nothing_divides_where_something_lies_on_a_body() -> None:
    made = film(4, motion="glide", cover=8.0, **SHORT)
    assert not any("divided" in why for r in tracked(made) for why in r.missing.values())


def test_a_body_of_unknown_width_has_no_parts() -> None:
    unknown = replace(curve(LINE), half_width=np.full(100, np.nan))
    assert parts(Body(7, ((0, unknown),)), unknown, (), lambda line: np.ones(len(line))) is None


def test_parts_are_longer_with_their_gap_and_show_nothing_in_between() -> None:
    body = Body(7, ((0, curve(LINE)),))

    def found(*shown: tuple[float, float], others: tuple[Curve, ...] = ()) -> bool:
        def seen(line: np.ndarray) -> np.ndarray:
            return np.any([(line[:, 1] > a) & (line[:, 1] < b) for a, b in shown], axis=0)

        return parts(body, curve(LINE), others, seen) is not None

    assert found((7, 22), (29, 44))
    assert not found((7, 44)), "there is no gap"
    assert not found((10, 22), (29, 40)), "no longer than before: something covers it"
    assert not found((10, 36), (42, 46)), "a part is too short"
    assert not found((7, 24), (26, 44)), "no wider than what looks empty by noise"
    across = curve(np.array([[8.0, 30], [12, 44]]))
    assert not found((7, 22), (29, 44), others=(across,)), "a part is another body"
    assert found((7, 22), (29, 44), others=(curve(np.array([[0.0, 36], [30, 36]])),)), "crossed"


def test_a_body_that_comes_in_over_the_border_is_reported_once() -> None:
    made = film(7, motion="glide", **{**SHORT, "frames": 40})
    low = np.maximum(made.centrelines[:, 0].min((0, 1)).astype(int) - 12, 0)
    high = made.centrelines[:, 0].max((0, 1)).astype(int) + 12
    cut = made.images[:, low[0] : high[0], low[1] : high[1]]
    lines = made.centrelines - low
    inside = ((lines >= 0) & (lines <= np.array(cut.shape[1:]) - 1)).all(3).mean(2)
    assert inside[0, 1] == 0 and inside[:, 1].max() > 0.9
    results = tracked(replace(made, images=cut, centrelines=lines), (0,))
    entered = [(r.frame, line) for r in results for line in r.entered]
    assert len(entered) == 1
    frame, line = entered[0]
    assert inside[frame, 1] > 0.3
    apart = np.linalg.norm(line[:, None] - lines[frame, 1], axis=2).min(1)
    assert np.median(apart) < 3


def test_only_the_border_of_a_large_image_is_searched() -> None:
    shown = np.zeros((50, 80), int)
    for part in border(shown.shape, 10):
        shown[part] += 1
    assert (shown[10:-10, 10:-10] == 0).all() and shown.astype(bool).sum() == 50 * 80 - 30 * 60
    assert [shown[part].shape for part in border(shown.shape, 25)] == [shown.shape]

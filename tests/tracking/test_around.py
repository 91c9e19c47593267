"""A correction changes its neighbourhood, and no more frames than that are fitted again."""

from collections.abc import Sequence

import numpy as np

from napari_splinesketch.engine.types import Curve, OnProgress
from napari_splinesketch.tracking import Body, Given, View, around

from .test_follow import BRIGHT, LINE, OTHER, FakeRefine, curve, moved

WRONG = range(13, 18)


def there(frame: int) -> dict[int, Curve]:
    """Body 7 was taken for something else in a few frames; body 3 was right."""
    return {7: curve(moved(LINE, 8.0 * (frame in WRONG), 0)), 3: curve(OTHER)}


def fitted(
    frames: Sequence[Sequence[int]],
    given=lambda frame: Given(),
    line: np.ndarray = LINE,
    on_progress: OnProgress | None = None,
) -> tuple:
    reads: list[int] = []

    def read(frame: int, lines: Sequence[np.ndarray]) -> View:
        reads.append(frame)
        return View(BRIGHT)

    refine = FakeRefine((0, 0))
    start = [Body(7, ((15, curve(line)),))]
    how = {"given": given, "refine": refine, "on_progress": on_progress}
    results = list(around(frames, start, read, there, **how))
    assert all(len(lines) == 1 for lines, _ in refine.calls), "only the corrected body is fitted"
    return reads, results


def test_frames_around_are_fitted_again_until_nothing_changes() -> None:
    reads, results = fitted([range(16, 60), range(14, -1, -1)])
    assert [result.frame for result in results] == [16, 17, 14, 13]
    assert sorted(reads) == [11, 12, 13, 14, 16, 17, 18, 19], "two more on either side"
    for result in results:
        assert result.ids == (7,)
        np.testing.assert_allclose(result.curves[0].points[0], LINE[0])


def test_nothing_is_carried_over_what_was_decided() -> None:
    def given(frame: int) -> Given:
        return Given({7: there(frame)[7]}) if frame == 17 else Given()

    reads, results = fitted([range(16, 60)], given)
    assert reads == [16]
    assert [result.frame for result in results] == [16]


def test_a_body_that_was_turned_round_is_turned_in_all_frames() -> None:
    _, results = fitted([range(16, 24), range(14, 9, -1)], line=LINE[::-1])
    assert [result.frame for result in results] == [*range(16, 24), *range(14, 9, -1)]
    for result in results:
        np.testing.assert_allclose(result.curves[0].points[0], LINE[-1])


def test_progress_goes_on_from_one_way_to_the_other() -> None:
    told: list[float] = []
    frames = [range(16, 18), range(14, 11, -1)]
    fitted(frames, line=LINE[::-1], on_progress=lambda progress: told.append(progress.fraction))
    assert told == sorted(told)
    assert 0.9 < told[-1] <= 1

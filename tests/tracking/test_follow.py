"""Bodies through time: who is carried where, what is doubted, what is left alone."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest

from napari_splinesketch import synthetic
from napari_splinesketch.engine.settings import Settings
from napari_splinesketch.engine.types import Curve, InputError, Progress, Refinement, SceneModel
from napari_splinesketch.grids import Grid
from napari_splinesketch.metrics import average_dtw, resample
from napari_splinesketch.tracking import Body, Given, Tracked, View, follow


def moved(line: np.ndarray, rows: float, columns: float) -> np.ndarray:
    return line + np.array([rows, columns])


LINE = np.array([[10.0, 10], [10, 40]])
OTHER = moved(LINE, 30, 5)
MODEL = SceneModel("bright", (8,), 2.0, "constant", "constant", None, 1.0, 0.05, 0.7)
BRIGHT = np.ones((60, 80))


def curve(line: np.ndarray, half_width: float = 2.0) -> Curve:
    points = resample(line)
    knots = np.column_stack([points[::11], np.full(10, half_width)])
    wide, sure = np.full(100, half_width), np.full(100, 0.1)
    return Curve(knots, points, wide, sure, "good", (), 0.05)


@dataclass
class FakeRefine:
    """Gives every line back moved by a step, or what `answer` makes of it."""

    step: tuple[float, float] = (0.0, 1.0)
    answer: Callable[[np.ndarray], Curve] = field(default=lambda line: curve(line))
    calls: list[tuple[list[np.ndarray], list[Curve]]] = field(default_factory=list)

    def __call__(
        self,
        image: np.ndarray,
        sketches: Sequence[np.ndarray],
        preset: Any,
        /,
        *,
        fixed: Sequence[Curve],
        on_progress: Callable[[Progress], bool | None],
    ) -> Refinement:
        self.calls.append((list(sketches), list(fixed)))
        for share in (0.1, 0.9):
            on_progress(Progress("tracing", share))
        if np.isnan(image).all():
            raise InputError("image has no finite pixel")
        curves = tuple(self.answer(np.asarray(line) + self.step) for line in sketches)
        return Refinement(curves, image, np.zeros(image.shape), MODEL, 0.1)


def bright(frame: int, lines: Sequence[np.ndarray]) -> View:
    return View(BRIGHT)


def run(refine: FakeRefine, frames: Sequence[int] = (1, 2, 3), **options: Any) -> list[Tracked]:
    start = {7: [(0, curve(LINE))], 3: [(0, curve(OTHER))]}
    start = options.pop("start", start)
    return list(follow(frames, known(start), options.pop("read", bright), refine=refine, **options))


def test_frames_may_be_arrays_and_other_things_are_refused_in_words() -> None:
    assert [r.ids for r in run(FakeRefine(), read=lambda *_: BRIGHT)] == [(7, 3)] * 3
    colour, _ = run(FakeRefine(), (1, 2), read=lambda *_: View(np.ones((60, 80, 3))))
    assert colour.error.startswith("image has shape (60, 80, 3); give one 2-D grey image")
    with pytest.raises(ValueError, match=r"start has Curve.*; give bodies"):
        list(follow([1], [curve(LINE)], bright))  # pyright: ignore[reportArgumentType]
    twice = [Body(7, ((0, curve(line)),)) for line in (LINE, LINE + 20)]
    with pytest.raises(ValueError, match="start has two bodies 7; give each its own number"):
        list(follow([1], twice, bright))
    with pytest.raises(ValueError, match="preset is 'slow'; choose one of fast"):
        run(FakeRefine(), preset="slow")


def known(start: dict[int, list[tuple[int, Curve]]]) -> list[Body]:
    return [Body(number, tuple(seen)) for number, seen in start.items()]


def test_bodies_keep_their_numbers_and_their_direction() -> None:
    results = run(FakeRefine())
    assert [result.frame for result in results] == [1, 2, 3]
    assert all(result.ids == (7, 3) and not result.drifting for result in results)
    moved = np.array([result.curves[0].points[0] for result in results])
    assert (np.diff(moved[:, 1]) > 0).all()
    assert results[-1].curves[0].points[-1, 1] > results[-1].curves[0].points[0, 1]


def test_two_known_frames_give_a_velocity() -> None:
    refine = FakeRefine((0, 0))
    start = {1: [(4, curve(LINE)), (5, curve(moved(LINE, 4, 0)))]}
    run(refine, [6], start=start)
    np.testing.assert_allclose(refine.calls[0][0][0][0], LINE[0] + (6, 0))
    back = FakeRefine((0, 0))
    run(back, [4], start={1: [(6, curve(LINE)), (5, curve(moved(LINE, 4, 0)))]})
    np.testing.assert_allclose(back.calls[0][0][0][0], LINE[0] + (6, 0))


def test_a_body_that_is_known_well_is_left_room_to_move_as_a_whole() -> None:
    held: list[float] = []
    fake = FakeRefine()

    def refine(image: np.ndarray, lines: Any, preset: Any, /, **options: Any) -> Refinement:
        held.append(preset.hold[0].across if isinstance(preset, Settings) and preset.hold else 0.0)
        return fake(image, lines, preset, **options)

    body = Body(7, tuple((t, curve(moved(LINE, 0, t))) for t in range(5)))
    list(follow([5], [body], bright, refine=refine))
    knots = 10  # that go together: each tells the less of where the whole is
    assert held[0] > 0.8 * np.sqrt(knots) * body.predicted(5)[1]


def test_what_is_given_stays_and_leads_on() -> None:
    refine = FakeRefine((0, 0))
    kept = curve(moved(LINE, 9, 0))
    new = curve(moved(OTHER, 0, 20))

    def given(frame: int) -> Given:
        return Given({7: kept, 12: new}) if frame == 1 else Given()

    first, second = run(refine, [1, 2], given=given)
    assert first.given == (7, 12)
    assert first.ids == (3,)
    lines, fixed = refine.calls[0]
    assert len(lines) == 1
    np.testing.assert_allclose([c.points for c in fixed], [kept.points, new.points])
    assert second.ids == (7, 3, 12)
    np.testing.assert_allclose(second.sketches[7][0], LINE[0] + (9 + 4.5, 0))


def test_a_frame_that_is_whole_is_not_touched() -> None:
    refine = FakeRefine()
    kept = curve(LINE)
    (result,) = run(refine, [1], given=lambda frame: Given({7: kept}, whole=True))
    assert not refine.calls
    assert result.ids == ()
    assert set(result.missing) == {3}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda line: curve(line[0] + (line - line[0]) * 1.5), "length jumped from 30 to 45"),
        (lambda line: curve(line, 6.0), "half-width jumped from 2.0 to 6.0"),
        (lambda line: curve(moved(line, 15, 0)), "jumped by 15 px"),
        (lambda line: curve(LINE if line[0, 0] < 25 else moved(LINE, 0.5, 1)), "the same body"),
    ],
    ids=["length", "width", "place", "two on one"],
)
def test_drift_is_flagged_with_its_reason(change: Callable, words: str) -> None:
    (result,) = run(FakeRefine((0, 0), change), [1])
    assert result.drifting
    flagged = [c for i, c in zip(result.ids, result.curves, strict=True) if i in result.drifting]
    assert all(c.status == "check" for c in flagged)
    assert any(words in c.reasons[0] for c in flagged), flagged[0].reasons


def test_a_body_in_doubt_is_looked_for_where_it_was_and_then_lost() -> None:
    def shrinks(line: np.ndarray) -> Curve:
        return curve(line if line[0, 0] > 25 else line[0] + (line - line[0]) * 0.5)

    refine = FakeRefine((0, 0), shrinks)
    results = run(refine, range(1, 6), smooth=False)
    assert [7 in result.drifting for result in results] == [True, True, False, False, False]
    assert [sorted(result.lost) for result in results] == [[], [], [7], [], []]
    assert "length jumped" in results[2].missing[7]
    np.testing.assert_allclose(results[1].sketches[7][[0, -1]], LINE)
    assert results[-1].ids == (3,)


def test_where_nothing_is_there_is_no_curve() -> None:
    half = BRIGHT.copy()
    half[:25] = 0
    results = run(FakeRefine((0, 0)), read=lambda frame, lines: View(half), smooth=False)
    assert [result.ids for result in results] == [(3,)] * 3
    assert "nothing" in results[0].missing[7]
    assert results[2].lost == {7}


def test_a_curve_that_crosses_others_is_doubted_where_it_explains_less_than_before() -> None:
    def answer(line: np.ndarray) -> Curve:
        return replace(curve(line), residual=0.15 if np.ptp(line[:, 0]) < 5 else 0.05)

    across = np.array([[5.0, 25], [35, 25]])
    for near, doubted in ((across, True), (moved(across, 0, 40), False)):
        start = {i: [(t, curve(x)) for t in range(4)] for i, x in ((7, LINE), (3, near))}
        (result,) = run(FakeRefine((0, 0), answer), [4], start=start)
        assert (7 in result.drifting) == doubted


def test_a_body_that_leaves_the_image_is_lost_at_once() -> None:
    start = {1: [(0, curve(LINE)), (1, curve(moved(LINE, -14, 0)))]}
    (result,) = run(FakeRefine(), [2], start=start)
    assert result.lost == {1}
    assert "left the image" in result.missing[1]


def test_a_bad_frame_does_not_stop_the_others() -> None:
    def read(frame: int, lines: Sequence[np.ndarray]) -> View:
        if frame == 1:
            raise OSError("the disk is gone")
        return View(BRIGHT if frame != 2 else np.full(BRIGHT.shape, np.nan))

    results = run(FakeRefine(), read=read)
    assert results[0].error == "the disk is gone"
    assert "no finite pixel" in results[1].error
    assert results[2].ids == (7, 3)


def test_a_body_where_a_frame_has_no_pixels_does_not_stop_the_others() -> None:
    """Beyond the border of a frame that was moved to fit the others."""
    film = np.ones((5, 200, 80))
    film[2, :140] = np.nan
    start = {7: [(0, curve(LINE))], 3: [(0, curve(moved(LINE, 170, 5)))]}
    for smooth in (True, False):
        refine = FakeRefine((0, 0))
        results = run(refine, range(1, 5), start=start, read=lambda t, _: film[t], smooth=smooth)
        assert not any(result.error for result in results)
        assert all(3 in result.ids for result in results)


@pytest.mark.parametrize("seen", [(), ((0, curve(LINE)),)])
def test_a_body_of_which_no_length_is_known_does_not_stop_the_others(seen: tuple) -> None:
    """Such as the curve of a sketch of one point."""
    dot = [(frame, replace(one, points=np.full((100, 2), 20.0))) for frame, one in seen]
    results = run(FakeRefine(), start={5: dot, 7: [(0, curve(LINE))]})
    assert [result.ids for result in results] == [(7,)] * 3
    assert not any(result.error for result in results)


def test_progress_rises_and_cancelling_ends_it() -> None:
    told: list[Progress] = []
    known_well = [(t, curve(moved(LINE, 0, t))) for t in range(-4, 1)]
    start = {7: known_well, 3: [(0, curve(OTHER))]}  # the one is held, the other is searched for
    results = run(FakeRefine(), start=start, on_progress=told.append)
    fractions = [progress.fraction for progress in told]
    assert fractions == sorted(fractions)
    assert told[-1].stage.startswith("frame 3: ")
    assert len(results) == 3
    results = run(FakeRefine(), on_progress=lambda progress: progress.fraction < 0.4)
    assert [result.frame for result in results] == [1]


def test_pixels_may_be_part_of_the_image() -> None:
    refine = FakeRefine((0, 0))
    (result,) = run(
        refine, [1], read=lambda frame, lines: View(BRIGHT, Grid(np.array([5.0, 3.0]), np.ones(2)))
    )
    np.testing.assert_allclose(refine.calls[0][0][0][0], LINE[0] - (5, 3))
    np.testing.assert_allclose(result.curves[0].points[[0, -1]], LINE)


@pytest.fixture(scope="module")
def film() -> tuple[np.ndarray, list[list[np.ndarray]]]:
    """Two crossing bodies that move by 3 px a frame, then one of them by 16 px at once."""
    made = synthetic.scene(5, bodies=2, shape=(112, 128), length=70)
    image = np.median(made.image) * np.ones((5, 112, 128), np.float32)
    noise = np.random.default_rng(0).normal(0, made.noise_sd.mean(), image.shape)
    truth = []
    for frame, (first, second) in enumerate([(0, 0), (3, -2), (6, -4), (9, -6), (9, 10)]):
        lines = [made.centrelines[0] + (first, 0), made.centrelines[1] + (0, second)]
        truth.append(lines)
        depth = np.abs(made.clean - made.background).max()
        for line, wide in zip(lines, made.half_widths, strict=True):
            rows, columns = np.mgrid[:112, :128]
            apart = np.min(
                [np.hypot(rows - r, columns - c) - w for (r, c), w in zip(line, wide, strict=True)],
                axis=0,
            )
            image[frame] = np.maximum(image[frame], np.median(made.image) + depth * (apart < 0))
    return image + noise, truth


@pytest.mark.parametrize("forwards", [True, False])
def test_crossing_bodies_keep_their_numbers(film: Any, forwards: bool) -> None:
    images, truth = film
    frames = [0, 1, 2, 3] if forwards else [3, 2, 1, 0]
    start = {i: [(frames[0], curve(line))] for i, line in enumerate(truth[frames[0]])}
    results = list(
        follow(frames[1:], known(start), lambda frame, lines: View(images[frame]), preset="fast")
    )
    for result in results:
        assert sorted(result.ids) == [0, 1]
        for number, one in zip(result.ids, result.curves, strict=True):
            assert average_dtw(one.points, truth[result.frame][number]) < 2


def test_a_body_that_jumped_is_placed_by_what_the_image_suggests(film: Any) -> None:
    images, truth = film
    start = {i: [(3, curve(line))] for i, line in enumerate(truth[3])}
    (result,) = follow([4], known(start), lambda frame, lines: View(images[4]), preset="fast")
    for number, one in zip(result.ids, result.curves, strict=True):
        assert average_dtw(one.points, truth[4][number]) < 2
    assert sorted(result.ids) == [0, 1]

"""Sketches far from each other: each on its own part of the image, and nothing else is touched."""

import copy
import pickle
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from napari_splinesketch import refine
from napari_splinesketch.engine import islands

from .scenes import SHAPE, frame, sketches_of

FAR = np.array([1800, 2400])


def corners() -> tuple[np.ndarray, list[np.ndarray]]:
    """Two frames in opposite corners of a large image, and a sketch in each."""
    image = np.zeros((1904, 2528), np.float32)
    sketches = []
    for seed, corner in ((0, np.zeros(2, int)), (3, FAR)):
        made = frame(seed)
        low = corner + SHAPE
        image[corner[0] : low[0], corner[1] : low[1]] = made.image
        sketches += [s + corner for s in sketches_of(made)]
    return image, sketches


def line(*points: tuple[float, float]) -> np.ndarray:
    return np.array(points, float)


CASES = {
    "near": ([line((50, 50), (50, 90)), line((60, 50), (60, 90))], [(0, 1)]),
    "far": ([line((50, 50), (50, 90)), line((50, 700), (60, 740))], [(0,), (1,)]),
    "a chain": ([line((50, c), (50, c + 40)) for c in (50, 150, 250, 350)], [(0, 1, 2, 3)]),
    "within the box of two": (
        [line((50, 50), (450, 50)), line((300, 300), (300, 310)), line((450, 60), (450, 500))],
        [(0, 1, 2)],
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_islands_hold_what_overlaps(case):
    lines, expected = CASES[case]
    found = islands.split(np.zeros((900, 900)), lines, range(len(lines)), [])
    assert sorted(tuple(sorted(i.members)) for i in found) == expected
    covered = np.zeros((900, 900), int)
    for island in found:
        covered[island.pose.window] += 1
    assert covered.max() == 1


@pytest.mark.parametrize(("points", "most"), [(2, 1150), (41, 320)])
def test_the_window_of_a_long_sketch_follows_the_body_that_it_may_mean(points, most):
    """A clicked body is beside its clicks; that of a straight line may bulge far from it."""
    row = np.linspace(100, 2900, points)
    (island,) = islands.split(np.zeros((3000, 3000)), [np.stack([row, 0 * row + 1500], 1)], [0], [])
    columns = island.pose.window[1]
    assert 0.3 * 2800 / (points - 1) < (columns.stop - columns.start) / 2 < most


def test_far_sketches_do_not_change_each_other():
    image, sketches = corners()
    both = refine(image, sketches)
    for sketch, curve in zip(sketches, both.curves, strict=True):
        assert curve.status != "failed"
        alone = refine(image, [sketch]).curves[0]
        np.testing.assert_array_equal(alone.knots, curve.knots)
        assert alone.reasons == curve.reasons


def test_the_order_of_far_sketches_does_not_matter():
    image, sketches = corners()
    there, back = refine(image, sketches), refine(image, sketches[::-1])
    for one, other in zip(there.curves, back.curves[::-1], strict=True):
        np.testing.assert_array_equal(one.knots, other.knots)


def upended(points: np.ndarray) -> np.ndarray:
    return np.column_stack([points[:, 0], SHAPE[1] - 1 - points[:, 1]])


TURNS = {
    "transposed": (np.transpose, lambda points: points[:, ::-1]),
    "flipped": (np.fliplr, upended),
    "turned by a quarter": (np.rot90, lambda points: upended(points)[:, ::-1]),
    "upside down": (
        lambda image: image[::-1, ::-1],
        lambda points: np.array(SHAPE) - 1 - points,
    ),
}


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("kind", ["crossing", "one straight line", "beside a fixed curve"])
def test_how_the_image_is_turned_does_not_matter(turn, kind):
    of_image, of_points = TURNS[turn]
    made = frame(3 if kind == "crossing" else 0, 3 if kind == "crossing" else 1)
    sketches, fixed = sketches_of(made), []
    if kind == "one straight line":
        # The same line when it is turned upside down: only the image tells how it is turned.
        sketches = [line((40, 30), (40, 90))]
    if kind == "beside a fixed curve":
        fixed = [refine(made.image, [line((100, 20), (100, 80))]).curves[0]]
        fixed = [replace(fixed[0], status="good")]
    there = refine(made.image, sketches, fixed=fixed).curves
    moved = [replace(curve, points=of_points(curve.points)) for curve in fixed]
    again = refine(of_image(made.image), [of_points(s) for s in sketches], fixed=moved).curves
    for one, other in zip(there, again, strict=True):
        np.testing.assert_allclose(other.points, of_points(one.points), atol=1e-6)
        np.testing.assert_allclose(other.half_width, one.half_width, atol=1e-6)
        assert other.reasons == one.reasons


def test_memory_follows_the_sketches():
    image, sketches = corners()
    refine(image, sketches)
    tracemalloc.start()
    result = refine(image, sketches)
    before = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert before < image.nbytes
    assert result.shape == image.shape
    assert "reconstruction" not in vars(result)


def test_pictures_are_made_when_they_are_read():
    made = frame(0)
    result = refine(made.image, sketches_of(made))
    copies = [copy.deepcopy(result), pickle.loads(pickle.dumps(result)), copy.copy(result)]
    picture = result.reconstruction
    assert picture is result.reconstruction
    assert (np.abs(picture - result.background) > 0).any()
    for again in copies:
        np.testing.assert_array_equal(again.reconstruction, picture)
        np.testing.assert_array_equal(again.background, result.background)
    with pytest.raises(AttributeError, match="Refinement has no attribute 'picture'"):
        _ = result.picture  # pyright: ignore[reportAttributeAccessIssue]


def test_a_result_fills_no_pages_of_a_notebook():
    made = frame(0)
    result = refine(made.image, sketches_of(made))
    assert "array" not in repr(result)
    assert "reconstruction" not in vars(result)
    [one, *_] = result.curves
    said = f"status={one.status!r}, reasons={one.reasons!r}, residual={one.residual!r}"
    assert repr(one) == f"Curve({said})"


def test_a_stray_click_stops_nothing():
    made = frame(0)
    sketches = sketches_of(made)
    found = refine(made.image, [np.array([[20.0, 30.0]]), *sketches])
    assert found.curves[0].status == "failed"
    assert "only one point" in found.curves[0].reasons[0]
    np.testing.assert_array_equal(
        found.curves[1].knots, refine(made.image, sketches).curves[0].knots
    )

"""A film of some frames reads like the array that it stands for."""

from copy import deepcopy
from typing import Any

import numpy as np
import pytest

from napari_splinesketch.grids import Grid, Patch, film_of, patched

KEYS: dict[str, Any] = {
    "frame": 1,
    "frame and rows": (1, slice(2, 5)),
    "pixel": (2, 3, 4),
    "rows of all frames": (slice(None), 3),
    "some frames": (slice(0, 3, 2), slice(None), slice(1, 4)),
    "everything": (),
    "dots": (Ellipsis, 2),
}


def patch(value: float, origin: tuple[float, float], step: float = 1.0) -> Patch:
    grid = Grid(np.array(origin), np.array([step, step]))
    return Patch(grid, np.full((4, 5), value))


@pytest.mark.parametrize("name", KEYS)
def test_it_reads_like_an_array(name: str) -> None:
    film, grid = film_of({0: patch(1.0, (10, 20)), 2: patch(2.0, (12, 21))}, (3,))
    dense = np.full((3, 6, 6), np.nan, np.float32)
    dense[0, :4, :5] = 1
    dense[2, 2:, 1:] = 2
    np.testing.assert_array_equal(np.asarray(film), dense)
    np.testing.assert_array_equal(film[KEYS[name]], dense[KEYS[name]])
    np.testing.assert_array_equal(grid.origin, [10, 20])


def test_a_copy_can_be_drawn_into_and_has_the_type_that_is_asked_for() -> None:
    film, _ = film_of({0: patch(1.0, (0, 0))}, (2,))
    copy: Any = deepcopy(film)
    copy[0, 1, 1] = 7
    assert np.asarray(copy)[0, 1, 1] == 7
    assert film[0, 1, 1] == 1
    assert film.astype(np.float16).dtype == np.float16


def test_frames_over_two_axes() -> None:
    film, _ = film_of({4: patch(7.0, (0, 0))}, (2, 3))
    assert film.shape == (2, 3, 4, 5)
    assert film[1, 1, 2, 2] == 7
    assert np.isnan(film[0, 1]).all()
    assert film[1].shape == (3, 4, 5)


def test_an_image_without_frames() -> None:
    film, _ = film_of({0: patch(7.0, (0, 0))}, ())
    assert film.shape == (4, 5)
    assert (np.asarray(film) == 7).all()
    assert film[1:3, 2].shape == (2,)


def test_frames_on_another_step_than_the_last_are_left_out() -> None:
    film, _ = film_of({0: patch(1.0, (0, 0), 2.0), 1: patch(2.0, (0, 0))}, (2,))
    assert np.isnan(film[0]).all()
    assert (film[1] == 2).all()


def test_part_of_a_picture_is_taken_into_another() -> None:
    old, new = patch(1.0, (10, 20)), patch(2.0, (12, 23))
    made = patched(old, new, np.array([13.0, 20.0]), np.array([14.0, 25.0]))
    dense = np.full((6, 8), np.nan)
    dense[:4, :5] = 1
    dense[3:5, 3:6] = 2
    np.testing.assert_array_equal(made.pixels, dense)
    np.testing.assert_array_equal(made.grid.origin, (10, 20))
    assert patched(patch(1.0, (0, 0), 2.0), new, np.zeros(2), np.zeros(2)) is new

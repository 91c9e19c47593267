"""The engine gets the right pixels, and no more are read than it needs."""

from typing import Any

import dask.array as da
import numpy as np
import pytest
from napari.layers import Image

from napari_splinesketch.grids import Grid
from napari_splinesketch.plugin.layers import space
from napari_splinesketch.plugin.layers.space import block_around

from .fakes import as_drawn

CHUNKS: Any = 64
LINE = np.array([[40.0, 30], [60, 80]])


def watched(data: np.ndarray, read: list[int]) -> da.Array:
    """A lazy array that notes how many pixels are made of it."""

    def note(block: np.ndarray) -> np.ndarray:
        read.append(block.size)
        return block

    return da.from_array(data, chunks=CHUNKS).map_blocks(note, dtype=data.dtype, meta=data[:0, :0])


def ramp(*shape: int) -> np.ndarray:
    """Every pixel its own value."""
    return np.arange(np.prod(shape), dtype=np.float32).reshape(shape)


def test_a_small_image_is_given_whole() -> None:
    data = ramp(100, 120)
    block = block_around(Image(data), 0, [LINE])
    np.testing.assert_array_equal(block.read(), data)
    np.testing.assert_array_equal(block.grid.to_image(LINE), LINE)


def test_the_pixels_are_a_copy_so_that_the_user_may_paint_on() -> None:
    data = ramp(100, 120)
    read = block_around(Image(data), 0, [LINE]).read()
    assert not np.shares_memory(read, data)


def test_the_frame_in_view_is_read() -> None:
    data = ramp(3, 4, 50, 70)
    np.testing.assert_array_equal(block_around(Image(data), 7, [LINE]).read(), data[1, 3])


def test_colour_becomes_luminance() -> None:
    rng = np.random.default_rng(0)
    data = rng.integers(0, 255, (3, 50, 70, 4), dtype=np.uint8)
    read = block_around(Image(data, rgb=True), 2, [LINE]).read()
    red, green, blue = data[2, ..., :3].astype(float).transpose(2, 0, 1)
    np.testing.assert_allclose(read, 0.2125 * red + 0.7154 * green + 0.0721 * blue, rtol=1e-5)


@pytest.mark.parametrize("lazy", [False, True])
def test_of_a_large_image_only_the_region_is_read(
    monkeypatch: pytest.MonkeyPatch, lazy: bool
) -> None:
    monkeypatch.setattr(space, "WHOLE_FRAME", 1000)
    data = ramp(900, 1100)
    line = LINE + np.array([400, 500])
    image = Image(da.from_array(data, chunks=CHUNKS) if lazy else data)
    block = block_around(image, 0, [line])
    read = block.read()
    assert read.size < 0.2 * data.size
    row, col = np.round(block.grid.to_block(line)).astype(int)[0]
    assert read[row, col] == data[440, 530]


def test_dask_computes_only_the_chunks_of_the_region_and_frame() -> None:
    computed = []

    def make(block_info: Any = None) -> np.ndarray:
        where = block_info[None]["chunk-location"]
        computed.append(where)
        return np.full(block_info[None]["chunk-shape"], float(where[0]))

    stack = da.map_blocks(
        make, chunks=((1,) * 5, (128,) * 8, (128,) * 8), dtype=float, meta=np.empty((0, 0, 0))
    )
    image = Image(stack, contrast_limits=(0, 1), cache=False)
    computed.clear()
    block = block_around(image, 3, [LINE])
    assert not computed, "choosing reads nothing"
    assert (block.read() == 3).all()
    assert {where[0] for where in computed} == {3}
    assert len(computed) <= 4


def test_multiscale_is_read_at_full_resolution_where_that_is_not_too_much() -> None:
    fine, coarse = [], []
    levels = [watched(ramp(800, 1000), fine), watched(ramp(400, 500), coarse)]
    image = Image(levels, multiscale=True, contrast_limits=(0, 1), cache=False)
    fine.clear()
    coarse.clear()
    block = block_around(image, 0, [LINE + 300])
    read = block.read()
    assert not coarse
    assert read.size <= sum(fine) < 0.3 * 800 * 1000
    row, col = np.round(block.grid.to_block(LINE + 300)).astype(int)[1]
    assert read[row, col] == 360 * 1000 + 380


def test_a_coarser_level_is_read_where_the_region_is_large(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(space, "LARGEST_BLOCK", 60_000)
    rows, cols = np.mgrid[:640, :960].astype(float)
    fine = 1000 * rows + cols
    coarse = fine.reshape(160, 4, 480, 2).mean((1, 3))
    image = Image([fine, coarse], multiscale=True, contrast_limits=(0, 1))
    line = np.array([[100.0, 200.0], [400.0, 500.0]])
    block = block_around(image, 0, [line])
    np.testing.assert_array_equal(block.grid.step, [4, 2])
    read = block.read()
    assert read.size <= coarse.size
    places = np.array([[10.0, 20.0], [31, 7]])
    values = read[tuple(places.astype(int).T)]
    np.testing.assert_allclose(block.grid.to_image(places) @ [1000, 1], values)


def test_curves_go_to_the_image_and_back() -> None:
    grid = Grid(np.array([10.5, 20.5]), np.array([2.0, 2.0]))
    curve = as_drawn(LINE)
    there = grid.curve_to_image(curve)
    np.testing.assert_allclose(there.points[0], [90.5, 80.5])
    np.testing.assert_allclose(there.half_width, 2 * curve.half_width)
    np.testing.assert_allclose(there.sd, 2 * curve.sd)
    np.testing.assert_allclose(there.length, 2 * curve.length)
    back = grid.curve_to_block(there)
    for name in ("knots", "points", "half_width", "sd"):
        np.testing.assert_allclose(getattr(back, name), getattr(curve, name))


def test_sketches_beyond_the_image_read_something() -> None:
    block = block_around(Image(da.zeros((500, 600), chunks=100)), 0, [LINE - 5000])
    assert min(block.read().shape) > 0

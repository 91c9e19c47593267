"""What reading and drawing take at most, on the files that need most of it."""

import tracemalloc
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from napari_splinesketch.labels import Label, Labels, LabelsError, read_labels, write_labels
from napari_splinesketch.raster import Body, label_image, rasterise

COUNT = 1500
ROOM = 1_000_000
"""Bytes for the text that is being parsed."""


PAIR = "[[0,0],[1,1]]"
XS = ",".join(["0"] * 10 * COUNT)
GREEDY = {
    "long.csv": "curve,row,col\n" + "0,1,2\n" * 10 * COUNT,
    "short.csv": "curve,row,col\n" + "".join(f"{i},0,{p}\n" for i in range(COUNT) for p in (0, 1)),
    "shapes.csv": "index,shape-type,vertex-index,axis-0,axis-1\n"
    + "".join(f"{i},line,{p},0,{p}\n" for i in range(COUNT) for p in (0, 1)),
    "long.geojson": f'{{"type":"LineString","coordinates":[{",".join(["[0,0]"] * 10 * COUNT)}]}}',
    "short.geojson": f'{{"type":"MultiLineString","coordinates":[{",".join([PAIR] * COUNT)}]}}',
    "many.geojson": "[" + ",".join([f'{{"type":"LineString","coordinates":{PAIR}}}'] * COUNT) + "]",
    "long.wcon": '{"units":{"t":"","x":"","y":""},"data":{"id":1,"t":0,'
    f'"x":[{XS}],"y":[{XS}]}}}}',
    "short.wcon": '{"units":{"t":"","x":"","y":""},"data":['
    + ",".join(f'{{"id":1,"t":{i},"x":[0,1],"y":[0,1]}}' for i in range(COUNT))
    + "]}",
}
"""Few characters for each point or curve that is given back."""


@pytest.mark.parametrize("name", GREEDY)
def test_reading_takes_a_small_multiple_of_what_it_gives(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_text(GREEDY[name], encoding="utf-8")
    read_labels(path)
    tracemalloc.start()
    try:
        labels = read_labels(path)
        given, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    print(f"{name}: {peak / given:.1f} times the {given} bytes of {len(labels.labels)} curves")
    assert peak < 6 * given + ROOM


REFUSED = {
    "columns.csv": "curve," * 10_000 + "\n",
    "quotes.csv": "curve,row,col\n" + '"' * 1_000_001,
}
"""Much that is nothing to give back."""


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_curve_takes_no_memory(
    tmp_path: Path, name: str, peak_memory: Callable[..., float]
) -> None:
    path = tmp_path / name
    path.write_text(REFUSED[name], encoding="utf-8")

    def read() -> None:
        with suppress(LabelsError):
            assert read_labels(path).labels == ()

    # The text itself takes up to 4 bytes a character.
    most = 4 * ROOM + 4 * len(REFUSED[name])
    assert peak_memory(read, most) < most


def test_arrays_take_no_more_memory_than_stated(
    tmp_path: Path, peak_memory: Callable[..., float]
) -> None:
    np.save(tmp_path / "a.npy", np.ones((1, 1200, 2, 2), np.uint8))
    peak = peak_memory(lambda: read_labels(tmp_path / "a.npy"), 200 * 4800)
    print(f"short splines: {peak / 4800:.0f} bytes for each number of the array")
    assert peak < 200 * 4800


def wide(size: int) -> Body:
    """A body that fills an image."""
    return 1, np.array([[0.0, 0.0], [size, size]]), np.full(2, float(size))


def one_body(body: Body, shape: tuple[int, int]) -> object:
    return rasterise(*body[1:], shape)


@pytest.mark.parametrize("draw", [one_body, lambda body, shape: label_image([body], shape)])
def test_drawing_takes_a_few_bytes_a_pixel(
    draw: Callable[[Body, tuple[int, int]], object],
    peak_memory: Callable[..., float],
) -> None:
    peaks = [peak_memory(lambda size=size: draw(wide(size), (size, size))) for size in (1000, 2000)]
    assert (peaks[1] - peaks[0]) / (2000**2 - 1000**2) < 5
    assert peaks[1] < 5 * 2000**2 + 20_000_000


@pytest.mark.parametrize(("ending", "most"), [(".geojson", 8), (".wcon", 8), (".coco.json", 12.5)])
def test_our_own_files_take_no_more_memory_than_stated(
    tmp_path: Path, ending: str, most: float
) -> None:
    along = np.random.default_rng(0).uniform(1, 2, (4, 100))
    points = np.cumsum(along[:2].T, axis=0)
    labels = Labels(tuple(Label(0, i, points, along[2], along[3], "good") for i in range(300)))
    write_labels(tmp_path / f"a{ending}", labels)
    tracemalloc.start()
    try:
        back = read_labels(tmp_path / f"a{ending}")
        given, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert len(back.labels) == 300
    assert peak < most * given + ROOM

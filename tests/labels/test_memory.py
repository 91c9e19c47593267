"""The bounds on memory that docs/files.md states, on the files that need most of it."""

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from napari_splinesketch.labels import LabelsError, read_labels

CSV_HEADER = "frame,curve,point,row,col,half_width,sd,status\n"
SHAPES_HEADER = "index,shape-type,vertex-index,axis-0,axis-1\n"
COUNT = 1200

GREEDY = {
    "short curves.csv": (
        32,
        CSV_HEADER + "".join(f"0,{i},{p},0,0,0,0,good\n" for i in range(COUNT) for p in (0, 1)),
    ),
    "short shapes.csv": (
        32,
        SHAPES_HEADER + "".join(f"{i},line,{p},0,{p}\n" for i in range(COUNT) for p in (0, 1)),
    ),
    "columns.csv": (32, "frame," * 10_000 + "\n"),
    "short trees.swc": (
        64,
        "".join(f"{i} 0 0 0 0 0 -1\n{i + 1} 0 0 1 0 0 {i}\n" for i in range(0, 2 * COUNT, 2)),
    ),
    "one tree.swc": (64, "".join(f"{i} 0 0 {i} 0 0 {i - 1}\n" for i in range(COUNT))),
    "points.geojson": (
        100,
        '{"type":"LineString","coordinates":[' + ",".join(["[0,0]"] * COUNT) + "]}",
    ),
    "short lines.geojson": (
        100,
        '{"type":"MultiLineString","coordinates":[' + ",".join(["[[0,0],[1,1]]"] * COUNT) + "]}",
    ),
    "objects.geojson": (100, "[" + ",".join(["{}"] * 10 * COUNT) + "]"),
    "wide text.geojson": (100, '["\N{GRINNING FACE}",' + ",".join(["{}"] * 10 * COUNT) + "]"),
    "points.wcon": (
        100,
        '{"units":{"t":"","x":"","y":""},"data":{"id":1,"t":0,"x":['
        + ",".join(["0"] * COUNT)
        + '],"y":['
        + ",".join(["0"] * COUNT)
        + "]}}",
    ),
    "short spines.wcon": (
        100,
        '{"units":{"t":"","x":"","y":""},"data":[{"id":1,"t":['
        + ",".join(map(str, range(COUNT)))
        + '],"x":['
        + ",".join(["[0,1]"] * COUNT)
        + '],"y":['
        + ",".join(["[0,1]"] * COUNT)
        + "]}]}",
    ),
}


@pytest.mark.parametrize("name", GREEDY)
def test_reading_takes_no_more_memory_than_stated(
    tmp_path: Path, name: str, peak_memory: Callable[[Callable[[], object]], int]
) -> None:
    times, text = GREEDY[name]
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")

    def read() -> None:
        with suppress(LabelsError):
            read_labels(path)

    ratio = peak_memory(read) / path.stat().st_size
    print(f"{name}: {ratio:.1f} bytes of memory for each byte of the file")
    assert ratio < times


def test_arrays_take_no_more_memory_than_stated(
    tmp_path: Path, peak_memory: Callable[[Callable[[], object]], int]
) -> None:
    np.save(tmp_path / "a.npy", np.ones((1, COUNT, 2, 2), np.uint8))
    peak = peak_memory(lambda: read_labels(tmp_path / "a.npy"))
    print(f"short splines: {peak / (COUNT * 4):.0f} bytes for each number of the array")
    assert peak < 200 * COUNT * 4

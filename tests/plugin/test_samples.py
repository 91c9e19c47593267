"""Sample data: images with rough lines that lie over bodies."""

from typing import Any

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates, minimum_filter

from napari_splinesketch.data import IMAGES, SampleName, load_sample
from napari_splinesketch.metrics import average_dtw, resample
from napari_splinesketch.plugin.dock import SplinesketchDock

from .bench import saved_files
from .hand import refine, until


@pytest.mark.parametrize("name", IMAGES)
def test_every_line_lies_roughly_over_a_dark_body(name: SampleName) -> None:
    image, sketches = load_sample(name)
    assert len(sketches) >= 20
    for line in sketches:
        frame = image[int(line[0, 0])] if line.shape[1] == 3 else image
        dark = gaussian_filter(frame.astype(float), 20) - frame
        points = resample(line[:, -2:], 40).T
        near = map_coordinates(minimum_filter(-dark, 11), points, order=0)
        assert 2 <= len(line) <= 4, "rough lines"
        assert np.mean(-near > 25) > 0.9, line


def test_samples_are_as_described() -> None:
    image, sketches = load_sample("worms_dense")
    assert (image.shape, image.dtype) == ((512, 512), np.uint8)
    assert len(sketches) == 24
    film, sketches = load_sample("worms_swimming")
    assert film.shape == (11, 256, 256)
    assert {line[0, 0] for line in sketches} == {0.0, 5.0}
    np.testing.assert_array_equal(film[5], image[:256, :256])
    with pytest.raises(ValueError, match="worms_dense, worms_swimming"):
        load_sample("wurm")  # pyright: ignore[reportArgumentType]


COUNTS = {"worms_dense": 24, "worms_swimming": 20, "generated": 3}


@pytest.mark.parametrize("key", COUNTS)
def test_a_sample_is_ready_to_refine(
    viewer: Any, dock: SplinesketchDock, npe2pm_installed: None, key: str
) -> None:
    viewer.open_sample("napari-splinesketch", key)
    assert dock.refine.text() == f"Refine {COUNTS[key]} new lines"
    refine(dock)
    assert len(dock.controller.records()) == COUNTS[key]
    if key == "generated":
        truth = viewer.layers["generated truth"]
        assert not truth.visible
        assert truth.name not in [
            dock.sketches.native.itemText(i) for i in range(dock.sketches.native.count())
        ]
        for line, sketch in zip(truth.data, viewer.layers["generated sketches"].data, strict=True):
            assert 1 < average_dtw(line, sketch) < 15


def test_lines_of_a_sample_are_saved_once_they_are_touched(
    viewer: Any, dock: SplinesketchDock, npe2pm_installed: None
) -> None:
    viewer.open_sample("napari-splinesketch", "worms_swimming")
    until(lambda: dock.saver.place is not None, 20)
    place, layer = dock.saver.place, viewer.layers["swimming worms sketches"]
    assert place is not None
    dock.saver.flush()
    assert not saved_files(place.parent)
    layer.data = [line + 0.5 for line in layer.data]
    dock.saver.flush()
    assert saved_files(place.parent, "session.json")

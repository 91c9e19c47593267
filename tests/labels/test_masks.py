import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
import tifffile
from PIL import Image, ImageSequence

from napari_splinesketch import raster
from napari_splinesketch.labels import Label, Labels, write_labels
from napari_splinesketch.raster import rasterise

from .samples import FULL, bent, drawn


def bar(
    ends: list[list[float]], half_width: list[float], *, frame: int = 0, curve: int = 0
) -> Label:
    return Label(frame, curve, np.array(ends), np.array(half_width), np.ones(2), "good")


def brute_force(label: Label, shape: tuple[int, int]) -> np.ndarray:
    """Pixels within the half-width of finely sampled points."""
    t = np.linspace(0, 1, 4001)
    place = np.linspace(0, 1, len(label.points))
    points = np.column_stack([np.interp(t, place, axis) for axis in label.points.T])
    width = np.interp(t, place, label.half_width)
    rows, cols = np.indices(shape)
    inside = np.zeros(shape, bool)
    for (row, col), reach in zip(points, width, strict=True):
        inside |= (rows - row) ** 2 + (cols - col) ** 2 <= reach**2
    return inside


@pytest.mark.parametrize(
    "label",
    [
        bar([[10, 5], [10, 40]], [3.25, 3.25]),
        bar([[5.3, 7.1], [33.9, 40.2]], [4.5, 1.2]),
        bar([[-20, 10], [50, 55]], [2, 2]),
        bar([[20, 20], [20, 20]], [5, 5]),
        bent(points=40),
    ],
    ids=["bar", "taper", "through the image", "a point", "bent"],
)
def test_a_mask_is_all_within_the_half_width(label: Label) -> None:
    shape = (40, 90)
    mask = np.zeros(shape, bool)
    found = rasterise(label.points, label.half_width, shape)
    assert found is not None
    place, depth = found
    mask[place] |= depth >= 0
    expected = brute_force(label, shape)
    # A taper's edge is where the distance equals the half-width at the nearest point of the line,
    # not where the circles' envelope is: they differ by less than a pixel.
    assert (mask ^ expected).sum() <= 0.02 * expected.sum() + 2
    assert not (mask & ~expected).any()


def test_what_has_no_width_or_lies_outside_has_no_mask() -> None:
    for label in (drawn(), bar([[-50, 5], [-30, 5]], [3, 3])):
        assert rasterise(label.points, label.half_width, (40, 40)) is None


def test_a_body_is_looked_at_where_it_lies(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn, seen = [], []
    one, near = raster.rasterise, raster._depth
    monkeypatch.setattr(raster, "rasterise", lambda *body: drawn.append(1) or one(*body))
    monkeypatch.setattr(raster, "_depth", lambda *some: seen.append(near(*some)) or seen[-1])
    lines = [np.array([[row, 10.0], [row + 900, 910.0]]) for row in (50.0, 60, 1100)]
    bodies = [(i, line, np.full(2, 2.0)) for i, line in enumerate(lines, 1)]
    image = raster.label_image(bodies, (2048, 1024))
    assert set(np.unique(image)) == {0, 1, 2, 3}
    assert len(drawn) == 3 * 2, "of four strips, each lies in two"
    assert sum(each.size for each in seen) < 10 * 3 * 1273 * 20, "not all between its ends"


CROSS = Labels(
    (
        bar([[20, 0], [20, 59]], [3, 3], curve=6),
        bar([[0, 30], [39, 30]], [4, 4], curve=0),
        bar([[10, 10], [30, 10]], [2, 2], frame=2, curve=6),
    ),
    shape=(40, 60),
    provenance={"preset": "fast"},
)


def test_a_label_image_has_the_identity_plus_1_and_a_page_for_each_frame(tmp_path: Path) -> None:
    losses = " ".join(write_labels(tmp_path / "a.masks.tif", CROSS))
    assert "overlaps are lost" in losses
    image = tifffile.imread(tmp_path / "a.masks.tif")
    assert (image.shape, image.dtype) == ((3, 40, 60), np.uint16)
    assert set(np.unique(image[0])) == {0, 1, 7}
    assert not image[1].any()
    assert set(np.unique(image[2])) == {0, 7}
    assert image[0, 20, 5] == 7
    assert image[0, 5, 30] == 1
    assert image[0, 20, 30] == 1, "the wider body lies deeper around the crossing"
    with Image.open(tmp_path / "a.masks.tif") as pages:  # knows nothing of tifffile
        for number, page in enumerate(ImageSequence.Iterator(pages)):
            assert np.array_equal(np.asarray(page), image[number])
    with tifffile.TiffFile(tmp_path / "a.masks.tif") as file:
        assert file.series[0].axes == "TYX"
        told = json.loads(file.pages[0].description)  # pyright: ignore
        assert told["provenance"] == {"preset": "fast"}


def test_without_the_image_s_shape_the_masks_reach_as_far_as_the_bodies(tmp_path: Path) -> None:
    labels = dataclasses.replace(CROSS, shape=None)
    losses = " ".join(write_labels(tmp_path / "a.masks.tif", labels))
    assert "size of the image is not known" in losses
    image = tifffile.imread(tmp_path / "a.masks.tif")
    assert image.shape == (3, 44, 63)


def test_bodies_without_width_are_counted(tmp_path: Path) -> None:
    losses = " ".join(write_labels(tmp_path / "a.masks.tif", FULL))
    assert "no outline for 1 curve without a known half-width" in losses
    assert tifffile.imread(tmp_path / "a.masks.tif").shape == (5, 64, 96)


def test_large_identities_take_32_bits(tmp_path: Path) -> None:
    write_labels(tmp_path / "a.masks.tif", Labels((bent(curve=70_000),), shape=(40, 90)))
    image = tifffile.imread(tmp_path / "a.masks.tif")
    assert image.dtype == np.uint32
    assert image.max() == 70_001


TOO_MUCH = {
    "frames": (Labels((bent(frame=10**9),)), "beyond 100000 frames"),
    "identity": (Labels((bent(curve=2**40),)), "does not fit into a pixel"),
    "size": (Labels((bent(),), shape=(10**6, 10**6)), "too large"),
    "unknown size": (Labels((bar([[0, 0], [1e8, 1e8]], [1, 1]),)), "too large"),
}


@pytest.mark.parametrize(("labels", "reason"), TOO_MUCH.values(), ids=TOO_MUCH.keys())
def test_what_no_mask_can_hold_is_refused(tmp_path: Path, labels: Labels, reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        write_labels(tmp_path / "a.masks.tif", labels)
    assert list(tmp_path.iterdir()) == []


def test_no_curves(tmp_path: Path) -> None:
    write_labels(tmp_path / "a.masks.tif", Labels(shape=(5, 7)))
    image = tifffile.imread(tmp_path / "a.masks.tif")
    assert image.shape[-2:] == (5, 7)
    assert not image.any()

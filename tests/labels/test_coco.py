import contextlib
import io
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from napari_splinesketch.labels import Label, Labels, write_labels

from .samples import FULL, bent, drawn

coco = pytest.importorskip("pycocotools.coco")
TWO = Labels((bent(0, 3, points=40), bent(2, 3, points=40, shift=9.0)), shape=(48, 96))


def opened(path: Path, labels: Labels) -> Any:
    write_labels(path, labels)
    with contextlib.redirect_stdout(io.StringIO()):
        return coco.COCO(path)


def test_pycocotools_sees_keypoints_in_x_and_y(tmp_path: Path) -> None:
    read = opened(tmp_path / "a.coco.json", TWO)
    assert read.getImgIds() == [0, 2]
    assert read.loadImgs(2)[0]["height"] == 48
    (annotation,) = read.loadAnns(read.getAnnIds(imgIds=[2]))
    keypoints = np.reshape(annotation["keypoints"], (-1, 3))
    assert np.array_equal(keypoints[:, 1::-1], TWO.labels[1].points)
    assert set(keypoints[:, 2]) == {2}
    assert annotation["num_keypoints"] == 40
    assert annotation["track_id"] == 3
    assert annotation["attributes"]["half_width"] == TWO.labels[1].half_width.tolist()
    (category,) = read.loadCats(read.getCatIds())
    assert len(category["keypoints"]) == 40
    assert category["skeleton"][-1] == [39, 40]


@pytest.mark.filterwarnings("ignore:__array__ implementation:DeprecationWarning")  # pycocotools'
def test_pycocotools_draws_the_body_where_it_is(tmp_path: Path) -> None:
    points = np.column_stack([np.full(30, 24.0), np.linspace(19.75, 80.25, 30)])
    bar = Label(0, 0, points, np.full(30, 5.25), np.ones(30), "good")
    read = opened(tmp_path / "a.coco.json", Labels((bar,), shape=(48, 96)))
    (annotation,) = read.loadAnns(read.getAnnIds(imgIds=[0]))
    mask = read.annToMask(annotation)
    assert mask.shape == (48, 96)
    assert np.argwhere(mask).mean(axis=0) == pytest.approx([24, 50], abs=0.1)
    assert mask.sum() == 61 * 11
    assert annotation["area"] == pytest.approx(60.5 * 10.5)
    assert annotation["bbox"] == pytest.approx([20.25, 19.25, 60.5, 10.5])


def test_bodies_of_different_sampling_are_resampled_and_it_is_said(tmp_path: Path) -> None:
    losses = " ".join(write_labels(tmp_path / "a.coco.json", FULL))
    assert "resampled to 100 points" in losses
    assert "no outline" in losses
    root = json.loads((tmp_path / "a.coco.json").read_text(encoding="utf-8"))
    assert {annotation["num_keypoints"] for annotation in root["annotations"]} == {100}
    sketch = root["annotations"][1]
    assert (sketch["segmentation"], sketch["area"]) == ([], 0)
    assert sketch["attributes"]["half_width"] == [None] * 100
    assert root["info"]["provenance"] == FULL.provenance
    assert root["images"][1]["file_name"] == "Würmer.tif#4"
    assert (root["images"][1]["height"], root["images"][1]["width"]) == (64, 96)


def test_an_unknown_image_size_is_said(tmp_path: Path) -> None:
    (loss, other) = write_labels(tmp_path / "a.coco.json", Labels((drawn(),)))
    assert "no outline" in loss
    assert "size of the image is not known" in other


def test_no_curves(tmp_path: Path) -> None:
    read = opened(tmp_path / "a.coco.json", Labels(shape=(5, 6)))
    assert read.getAnnIds() == []


def test_a_body_far_away_needs_no_pixels(tmp_path: Path) -> None:
    write_labels(tmp_path / "a.coco.json", Labels((replace(bent(), points=bent().points + 1e6),)))
    (image,) = json.loads((tmp_path / "a.coco.json").read_text())["images"]
    assert image["height"] > 1e6

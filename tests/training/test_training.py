"""A training set holds what was accepted, and says what to ignore in a frame."""

import json
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest

from napari_splinesketch.cli import main
from napari_splinesketch.images.frames import checksum
from napari_splinesketch.labels import Label, Labels, read_labels, write_labels
from napari_splinesketch.training import Split, export_training, read_training

SHAPE = (40, 60)
SCHEMA = Path(__file__).parents[2] / "docs" / "training.schema.json"


def body(frame: int, curve: int, row: float, **more: object) -> Label:
    """A straight body along a row, half-width 2."""
    points = np.column_stack([np.full(100, row), np.linspace(10, 50, 100)])
    label = Label(frame, curve, points, np.full(100, 2.0), np.full(100, 0.1), "good")
    return replace(label, **more)  # pyright: ignore[reportArgumentType]


def film(labels: Labels, frames: int) -> np.ndarray:
    """Dark bodies on a bright ground."""
    images = np.random.default_rng(2).normal(100, 3, (frames, *SHAPE))
    for label in labels.labels:
        row = int(label.points[0, 0])
        images[label.frame, row - 2 : row + 3, 10:51] -= 50
    return images.astype(np.float32)


REVIEWED = Labels(
    (
        body(0, 4, 10, review="accepted"),
        body(0, 9, 30),
        body(1, 4, 11, review="rejected"),
        body(2, 4, 12, review="accepted"),
        body(2, 9, 20, review="accepted", status="check"),
        body(3, 4, 13, review="accepted"),
        body(3, 9, 14.0, half_width=np.full(100, np.nan), status="failed"),
    ),
    (0.5, 0.5),
    "µm",
)
IMAGES = film(REVIEWED, 4)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path / "set"


def test_accepted_curves_alone_are_written(folder: Path) -> None:
    export_training(folder, IMAGES, REVIEWED)
    samples = {sample.frame: sample for sample in read_training(folder)}
    assert {frame: list(sample.curve) for frame, sample in samples.items()} == {
        0: [4],
        2: [4, 9],
        3: [4],
    }
    first = samples[0]
    assert np.array_equal(first.image, IMAGES[0])
    assert first.image.dtype == np.float32
    assert np.array_equal(first.points[0], REVIEWED.labels[0].points)
    assert np.array_equal(first.half_width[0], REVIEWED.labels[0].half_width)
    assert np.array_equal(first.sd[0], REVIEWED.labels[0].sd)


def test_masks_tell_bodies_from_background_and_from_what_nobody_accepted(folder: Path) -> None:
    export_training(folder, IMAGES, REVIEWED)
    samples = {sample.frame: sample for sample in read_training(folder)}
    assert set(np.unique(samples[0].mask)) == {0, 1}
    assert samples[0].mask[10, 30] == 1
    assert samples[0].mask[30, 30] == 0
    assert samples[0].ignore[30, 30] and samples[0].ignore[35, 30]  # 2 px and a margin of 3
    assert not samples[0].ignore[36, 30]
    assert not samples[0].ignore[20, 30]
    assert not samples[2].ignore.any()
    assert (samples[2].mask[12, 30], samples[2].mask[20, 30]) == (1, 2)
    # A failed line has no width: the ground about it is left alone, the body beside it is learnt.
    assert samples[3].ignore[20, 30]
    assert samples[3].mask[14, 30] == 1
    assert not samples[3].ignore[14, 30]


def test_whole_frames_alone_where_asked(folder: Path) -> None:
    export_training(folder, IMAGES, REVIEWED, whole_frames=True)
    assert read_training(folder).frames == (2,)


def test_good_ones_where_nobody_reviewed(folder: Path) -> None:
    export_training(folder, IMAGES, REVIEWED, keep="good")
    found = {sample.frame: list(sample.curve) for sample in read_training(folder)}
    assert found == {0: [4, 9], 2: [4], 3: [4]}  # not rejected, not "check"


def test_a_part_is_read_alone_and_frames_are_in_one(folder: Path) -> None:
    labels = Labels(tuple(body(i, 0, 10 + i, review="accepted") for i in range(20)))
    export_training(folder, film(labels, 20), labels, split=Split((0.6, 0.2, 0.2)))
    parts = [set(read_training(folder, part).frames) for part in ("train", "val", "test")]
    assert [len(part) for part in parts] == [12, 4, 4]
    assert set.union(*parts) == set(range(20)) == set(read_training(folder).frames)
    with pytest.raises(TypeError, match=r"place of a frame is slice\(0, 2, None\); give one whole"):
        read_training(folder)[0:2]  # pyright: ignore[reportArgumentType]


def test_the_manifest_fits_its_schema_and_tells_the_truth(tmp_path: Path, folder: Path) -> None:
    path = tmp_path / "labels.csv"
    write_labels(path, REVIEWED)
    manifest = export_training(folder, IMAGES, path, name="film.tif")
    written = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    assert written == json.loads(json.dumps(manifest))
    jsonschema.validate(written, json.loads(SCHEMA.read_text(encoding="utf-8")))
    assert written["image"] == {
        "name": "film.tif",
        "shape": [40, 60],
        "dtype": "float32",
        "polarity": "dark",
        "scale": [0.5, 0.5],
        "units": "µm",
    }
    assert written["labels"]["name"] == "labels.csv"
    totals = [
        sum(part[what] for part in written["counts"].values()) for what in ("frames", "bodies")
    ]
    assert totals == [3, 4]
    rows = (folder / "frames.csv").read_text(encoding="utf-8").splitlines()
    assert rows[0] == "frame,split,bodies,ignored,sha256"
    assert rows[1].startswith("0,") and rows[1].endswith(f",1,1,{checksum(IMAGES[0])}")


def test_the_type_of_the_pixels_is_that_of_the_set_s_images(folder: Path) -> None:
    manifest = export_training(folder, IMAGES.astype(">u2"), REVIEWED)  # as ImageJ writes them
    image = read_training(folder)[0].image
    assert manifest["image"]["dtype"] == image.dtype.name == "uint16"


def test_the_splines_are_sketches_for_a_next_refinement(folder: Path) -> None:
    export_training(folder, IMAGES, REVIEWED)
    lines = read_labels(folder / "splines" / "frame-000000002.npz").labels
    assert [line.status for line in lines] == ["sketch", "sketch"]
    assert np.allclose(lines[1].points, REVIEWED.labels[4].points)


def test_curves_of_few_points_get_a_hundred(folder: Path) -> None:
    short = Label(0, 1, np.array([[5.0, 5], [9, 40]]), np.ones(2), np.ones(2), "good", "accepted")
    export_training(folder, IMAGES, Labels((short,)))
    (sample,) = read_training(folder)
    assert sample.points.shape == (1, 100, 2)
    assert np.allclose(sample.points[0, [0, -1]], short.points)


def test_a_curve_outside_its_frame_is_refused(tmp_path: Path, folder: Path) -> None:
    away = Label(0, 7, np.array([[5.0, 500], [9, 540]]), np.ones(2), np.ones(2), "good", "accepted")
    with pytest.raises(ValueError, match=r"curve 7 lies outside frame 0.* belong to"):
        export_training(folder, IMAGES, Labels((away,)))
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("kind", [np.asarray, list, lambda images: dict(enumerate(images))])
def test_nothing_is_left_where_the_images_end_too_soon(
    tmp_path: Path, folder: Path, kind: Callable[[np.ndarray], Any]
) -> None:
    with pytest.raises(ValueError, match="the labels have a frame 3, and the images none"):
        export_training(folder, kind(IMAGES[:3]), REVIEWED)
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("images", ["film.tif", Path("film.tif"), iter(IMAGES), None])
def test_what_is_no_images_is_said(folder: Path, images: Any) -> None:
    with pytest.raises(ValueError, match=r"images is .*; give an array \(frames, H, W\)"):
        export_training(folder, images, REVIEWED)


def test_labels_are_taken_as_they_are_written(tmp_path: Path, folder: Path) -> None:
    manifest = export_training(folder, IMAGES, list(REVIEWED.labels))
    assert manifest["counts"] == export_training(tmp_path / "b", IMAGES, REVIEWED)["counts"]
    with pytest.raises(ValueError, match=r"labels is 7 .*; give Labels, a refinement"):
        export_training(tmp_path / "c", IMAGES, 7)  # pyright: ignore[reportArgumentType]


def test_which_curves_are_kept_is_one_of_two(tmp_path: Path, folder: Path) -> None:
    with pytest.raises(ValueError, match=r"take all that are good \(keep='good', --keep good\)"):
        export_training(folder, IMAGES, [body(0, 4, 10)])
    keep: Any = "Accepted"
    with pytest.raises(ValueError, match="keep is 'Accepted'; choose one of accepted, good"):
        export_training(folder, IMAGES, REVIEWED, keep=keep)
    assert os.listdir(tmp_path) == []
    with pytest.raises(ValueError, match=r"split is \(1, 0, 0\); give a Split"):
        export_training(folder, IMAGES, REVIEWED, split=(1, 0, 0))  # pyright: ignore[reportArgumentType]


def test_bodies_may_lie_where_pixels_are_missing(folder: Path) -> None:
    images = IMAGES.copy()
    images[0, 5:15] = np.nan
    assert export_training(folder, images, REVIEWED)["image"]["polarity"] == "dark"


def test_only_training_sets_are_replaced_and_only_when_asked(tmp_path: Path, folder: Path) -> None:
    export_training(folder, IMAGES, REVIEWED)
    with pytest.raises(FileExistsError, match=r"exists already.*overwrite=True"):
        export_training(folder, IMAGES, REVIEWED)
    export_training(folder, IMAGES, REVIEWED, whole_frames=True, overwrite=True)
    assert read_training(folder).frames == (2,)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("years of work")
    with pytest.raises(FileExistsError, match="is no training set"):
        export_training(tmp_path / "mine", IMAGES, REVIEWED, overwrite=True)
    assert sorted(os.listdir(tmp_path)) == ["mine", "set"]


def test_what_is_no_training_set_is_said(tmp_path: Path, folder: Path) -> None:
    with pytest.raises(ValueError, match="is no training set"):
        read_training(tmp_path)
    export_training(folder, IMAGES, REVIEWED)
    with pytest.raises(ValueError, match="part is 'both'"):
        read_training(folder, "both")  # pyright: ignore[reportArgumentType]
    manifest = folder / "manifest.json"
    with pytest.raises(ValueError, match=r"manifest\.json is no training set"):
        read_training(manifest)
    manifest.write_text(manifest.read_text().replace('"version": 1', '"version": 2'))
    with pytest.raises(ValueError, match="version 1 at most"):
        read_training(folder)


NEWER = '{"format": "napari-splinesketch training set", "version": "two"}'


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("manifest.json", None, "no training set: it has no manifest.json"),
        ("manifest.json", "{", "is damaged"),
        ("manifest.json", "[]", "expected 'napari-splinesketch training set'"),
        (
            "manifest.json",
            '{"format": "napari-splinesketch training set", "version": "2"}',
            "at most",
        ),
        ("frames.csv", None, "no training set: it has no frames.csv"),
        ("frames.csv", "", "it has no columns frame and split"),
        ("frames.csv", "frame,split\none,train\n", "is damaged.*'one'"),
        ("frames.csv", "split,frame\ntrain\n", "is damaged"),
    ],
)
def test_a_damaged_training_set_is_said(
    folder: Path, name: str, content: str | None, reason: str
) -> None:
    export_training(folder, IMAGES, REVIEWED)
    if content is None:
        (folder / name).unlink()
    else:
        (folder / name).write_text(content)
    with pytest.raises(ValueError, match=reason) as caught:
        read_training(folder)
    assert name in str(caught.value)
    assert str(folder) in str(caught.value)


def test_the_command_says_how_to_accept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    import tifffile

    tifffile.imwrite("film.tif", IMAGES, photometric="minisblack")
    unseen = replace(REVIEWED, labels=tuple(replace(one, review="open") for one in REVIEWED.labels))
    write_labels("labels.csv", unseen)
    assert main(["export-training", "film.tif", "labels.csv", "-o", "set"]) == 2
    assert "no curve is accepted; accept some in the window" in capsys.readouterr().err
    assert main(["export-training", "film.tif", "labels.csv", "-o", "set", "--keep", "good"]) == 0
    assert "train" in capsys.readouterr().out
    write_labels("beyond.csv", Labels((body(9, 0, 5, review="accepted"),)))
    assert main(["export-training", "film.tif", "beyond.csv", "-o", "other"]) == 2
    assert "no frame 9" in capsys.readouterr().err

import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

from napari_splinesketch.labels import Labels, write_labels

from .samples import FULL, bent

sleap_io = pytest.importorskip("sleap_io")
FILM = Labels(
    (bent(0, 3, points=40), bent(0, 8, points=40, shift=5), bent(2, 3, points=40, shift=9.0)),
    provenance={"image": {"name": "film.tif"}},
)


def test_sleap_io_sees_frames_tracks_and_points(tmp_path: Path) -> None:
    (loss,) = write_labels(tmp_path / "a.slp", FILM)
    assert "no half-width" in loss
    read = sleap_io.load_slp(str(tmp_path / "a.slp"), open_videos=False)
    assert [frame.frame_idx for frame in read] == [0, 2]
    assert [[i.track.name for i in frame.instances] for frame in read] == [["3", "8"], ["3"]]
    assert np.array_equal(read[1].instances[0].numpy(), FILM.labels[2].points[:, ::-1])
    assert len(read.skeleton.nodes) == 40
    assert len(read.skeleton.edges) == 39
    assert read.video.filename == "film.tif"
    with h5py.File(tmp_path / "a.slp") as file:
        metadata = file["metadata"].attrs["json"].decode()  # pyright: ignore
    assert ".part" not in metadata, "no path of a temporary file"
    assert read.provenance["napari-splinesketch"]["provenance"] == FILM.provenance


def test_bodies_of_different_sampling_are_resampled_and_it_is_said(tmp_path: Path) -> None:
    losses = " ".join(write_labels(tmp_path / "a.slp", FULL))
    assert "resampled to 100 points" in losses
    read = sleap_io.load_slp(str(tmp_path / "a.slp"), open_videos=False)
    assert {len(i.numpy()) for frame in read for i in frame.instances} == {100}


@pytest.mark.parametrize("points", [400, 401, 550])
def test_more_points_than_a_file_holds_are_refused_in_words(tmp_path: Path, points: int) -> None:
    path, labels = tmp_path / "a.slp", Labels((bent(0, 3, points=points),))
    if points == 400:
        write_labels(path, labels)
        assert len(sleap_io.load_slp(str(path), open_videos=False).skeleton.nodes) == points
        return
    with pytest.raises(ValueError, match=f"at most 400 points a curve, and these have {points}"):
        write_labels(path, labels)
    assert not path.exists()


def test_no_curves(tmp_path: Path) -> None:
    write_labels(tmp_path / "a.slp", Labels())
    assert len(sleap_io.load_slp(str(tmp_path / "a.slp"), open_videos=False)) == 0


def test_without_sleap_io_it_says_how_to_get_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "sleap_io", None)
    with pytest.raises(ValueError, match=r"sleap-io; pip install 'napari-splinesketch\[formats\]'"):
        write_labels(tmp_path / "a.slp", FILM)

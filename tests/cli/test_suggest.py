"""The command that suggests sketches: on films, on one frame, and where something is wrong."""

import json
from pathlib import Path

import numpy as np
import pytest
import tifffile

import napari_splinesketch
from napari_splinesketch.cli import main
from napari_splinesketch.data import load_sample
from napari_splinesketch.labels import read_labels


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A film of three frames, the second of them blank."""
    monkeypatch.chdir(tmp_path)
    frames = load_sample("worms_swimming")[0][:3, 100:200, 60:200].copy()
    frames[1] = 7
    tifffile.imwrite("film.tif", frames, photometric="minisblack")
    return tmp_path


def suggest(*more: str) -> int:
    return main(["suggest", "film.tif", "-o", "lines.csv", *more])


def test_every_frame_gets_its_lines(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert suggest() == 0
    labels = read_labels("lines.csv").labels
    frames = tifffile.imread("film.tif")
    for number, frame in enumerate(frames):
        lines = [label.points for label in labels if label.frame == number]
        wanted = napari_splinesketch.suggest(frame)
        assert len(lines) == len(wanted)
        assert all(np.allclose(a, b) for a, b in zip(lines, wanted, strict=True))
    assert {label.frame for label in labels} == {0, 2}
    assert {label.status for label in labels} == {"sketch"}
    said = capsys.readouterr().out
    assert f"3 frames: {len(labels)} sketches" in said
    assert "frame 1: 0 sketches;" in said
    assert not Path("lines.csv.partial").exists()


def test_an_image_without_bodies_has_no_sketches(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert suggest("--frame", "1", "--json") == 0
    assert json.loads(capsys.readouterr().out)["counts"]["sketch"] == 0
    assert suggest("--frame", "1", "--overwrite") == 0
    assert "1 frame: 0 sketches;" in capsys.readouterr().out


def test_one_frame_and_what_was_asked_for(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def fake(image: np.ndarray, *options: object) -> tuple[np.ndarray, ...]:
        asked.append((image, options))
        return (np.array([[1.0, 2], [3, 4]]),)

    monkeypatch.setattr(napari_splinesketch, "suggest", fake, raising=False)
    more = ("--frame", "2", "--sensitivity", "0.8", "--polarity", "dark", "--half-width", "1.5")
    assert suggest(*more, "--pixel-size", "0.5", "--units", "µm", "--json") == 0
    ((image, options),) = asked
    assert np.array_equal(image, tifffile.imread("film.tif")[2])
    assert options == (0.8, "dark", 1.5)
    said = json.loads(capsys.readouterr().out)
    assert said["counts"]["sketch"] == 1
    assert [frame["frame"] for frame in said["frames"]] == [2]
    labels = read_labels("lines.csv")
    assert (labels.scale, labels.units) == ((0.5, 0.5), "µm")
    assert labels.labels[0].frame == 2


def test_a_frame_that_cannot_be_read_stops_nothing_and_a_run_goes_on(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    real, calls = napari_splinesketch.suggest, []

    def interrupted(image: np.ndarray, *options: object) -> tuple[np.ndarray, ...]:
        calls.append(image)
        if len(calls) == 2:
            raise OSError("the disk is gone")
        if len(calls) == 3:
            raise KeyboardInterrupt
        return real(image, *options)  # pyright: ignore[reportArgumentType]

    monkeypatch.setattr(napari_splinesketch, "suggest", interrupted, raising=False)
    assert suggest() == 130
    assert "--resume" in capsys.readouterr().err
    assert not Path("lines.csv").exists()
    assert suggest() == 2
    assert suggest("--sensitivity", "0.6", "--resume") == 2
    assert "sensitivity" in capsys.readouterr().err
    assert suggest("--resume") == 1
    assert len(calls) == 4
    assert "the disk is gone" in capsys.readouterr().out
    assert {label.frame for label in read_labels("lines.csv").labels} == {0, 2}


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (("--frame", "3"), "film.tif has 3"),
        (("--frame", "-1"), "no frame -1"),
        (("--channel", "1"), "--channel"),
        (("--units", "µm"), "--pixel-size"),
    ],
)
def test_what_cannot_be_done_is_said_at_once(
    folder: Path, capsys: pytest.CaptureFixture[str], more: tuple[str, ...], words: str
) -> None:
    assert suggest(*more) == 2
    assert words in capsys.readouterr().err
    assert sorted(path.name for path in folder.iterdir()) == ["film.tif"]


def test_sensitivity_is_a_share(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        suggest("--sensitivity", "2")
    assert "from 0 to 1" in capsys.readouterr().err


def test_the_end_of_the_name_is_known_before_any_work(folder: Path) -> None:
    assert main(["suggest", "film.tif", "-o", "lines.xyz"]) == 2
    Path("lines.csv").touch()
    assert suggest() == 2

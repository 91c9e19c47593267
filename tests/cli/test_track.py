"""The command that tracks: numbers kept, frames resumed, what is lost reported."""

import json
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile

import napari_splinesketch
from napari_splinesketch import InputError
from napari_splinesketch.batch.frame_task import CurveReport, FrameReport
from napari_splinesketch.batch.partial import Spool
from napari_splinesketch.cli import main, tracking
from napari_splinesketch.cli.report import as_text
from napari_splinesketch.labels import Label, Labels, read_labels, write_labels
from napari_splinesketch.tracking.bodies import INFERRED

from .fakes import curve

LINE = np.array([[12.0, 10], [12, 40]])
OTHER = np.array([[30.0, 10], [30, 44]])


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A dark film of six frames, with two lines in frame 1 and one more in frame 3."""
    monkeypatch.chdir(tmp_path)
    film = np.random.default_rng(0).integers(0, 20, (6, 40, 60), dtype=np.uint8)
    tifffile.imwrite("film.tif", film, photometric="minisblack")
    drawn = [(1, 4, LINE), (1, 9, OTHER), (3, 2, (LINE + OTHER) / 2)]
    sketches = [Label.from_sketch(line, frame=t, identity=i) for t, i, line in drawn]
    write_labels("lines.csv", Labels(tuple(sketches)))
    return tmp_path


@pytest.fixture
def engine(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, dict[str, Any]]]:
    """Stands in for `refine`, with bodies wherever it is told to look; gives its calls."""
    calls: list[tuple[int, dict[str, Any]]] = []

    def fake(image: np.ndarray, lines: list[np.ndarray], preset: str, **options: Any) -> Any:
        from napari_splinesketch.engine.types import Refinement

        from .fakes import MODEL

        calls.append((len(lines), options | {"preset": preset}))
        if np.ptp(image) == 0:
            raise InputError("the image is constant; give one with bodies in it")
        background = image + 30.0
        curves = tuple(curve(np.asarray(line) - 0.5) for line in lines)
        return Refinement(curves, image, background, MODEL, 0.01)

    monkeypatch.setattr(napari_splinesketch, "refine", fake, raising=False)
    return calls


def track(*more: str) -> int:
    return main(["track", "film.tif", "lines.csv", "-o", "labels.csv", *more])


def numbers(path: str = "labels.csv") -> dict[int, list[int]]:
    found: dict[int, list[int]] = {}
    for label in read_labels(path).labels:
        found.setdefault(label.frame, []).append(label.curve)
    return {frame: sorted(ids) for frame, ids in found.items()}


def test_bodies_are_carried_and_newcomers_join(
    folder: Path, engine: list, capsys: pytest.CaptureFixture[str]
) -> None:
    assert track() == 0
    assert numbers() == {1: [4, 9], 2: [4, 9], 3: [2, 4, 9], 4: [2, 4, 9], 5: [2, 4, 9]}
    assert "5 frames: 13 good" in capsys.readouterr().out
    fixed = [len(options["fixed"]) for _, options in engine]
    assert fixed == [0, 0, 0, 1, 0, 2, 0, 2], "what is known well goes first"
    assert not Path("labels.csv.partial").exists()


def test_lines_in_units_become_pixels(
    folder: Path, engine: list, capsys: pytest.CaptureFixture[str]
) -> None:
    y, x = (LINE * (0.5, 0.25)).T.tolist()
    record = {"id": "a", "t": 0, "x": x, "y": y}
    root = {"units": {"t": "s", "x": "mm", "y": "mm"}, "data": record}
    Path("lines.wcon").write_text(json.dumps(root))
    command = ["track", "film.tif", "lines.wcon", "-o", "labels.csv", "--last", "0"]
    assert main([*command, "--pixel-size", "0.5", "0.25", "--units", "mm"]) == 0
    assert "taken as 1 pixel" not in capsys.readouterr().err
    assert np.allclose(read_labels("labels.csv").labels[0].points[[0, -1]], LINE)


def test_lines_after_the_last_frame_are_counted(
    folder: Path, engine: list, capsys: pytest.CaptureFixture[str]
) -> None:
    late = Label.from_sketch(LINE, frame=9, identity=4)
    write_labels("lines.csv", Labels((*read_labels("lines.csv").labels, late)), overwrite=True)
    assert track() == 0
    said = "left out: 1 line in frames after 5, the last one"
    assert said in capsys.readouterr().err


def test_options_reach_the_engine_and_the_last_frame_ends_it(folder: Path, engine: list) -> None:
    options = ("--preset", "fast", "--polarity", "dark", "--half-width", "1.5", "--last", "2")
    assert track(*options, "--pixel-size", "0.5", "--units", "µm") == 0
    assert numbers() == {1: [4, 9], 2: [4, 9]}
    assert read_labels("labels.csv").scale == (0.5, 0.5)
    for _, given in engine:
        assert (given["preset"], given["polarity"], given["half_width"]) == ("fast", "dark", 1.5)


def test_a_bad_frame_is_passed_over(
    folder: Path, engine: list, capsys: pytest.CaptureFixture[str]
) -> None:
    film = tifffile.imread("film.tif")
    film[[2, 3]] = 7
    tifffile.imwrite("film.tif", film, photometric="minisblack")
    assert track("--json") == 1
    assert numbers() == {1: [4, 9], 3: [2], 4: [4, 9], 5: [4, 9]}
    said = json.loads(capsys.readouterr().out)
    errors = {frame["frame"]: frame["error"] for frame in said["frames"]}
    assert "constant" in errors[2]
    assert "constant" in errors[3]
    assert errors[4] is None
    assert said["counts"]["frames not refined"] == 2


@pytest.mark.parametrize("frame", [1, 3])
def test_lines_of_a_bad_frame_come_back_as_drawn(
    folder: Path, engine: list, capsys: pytest.CaptureFixture[str], frame: int
) -> None:
    film = tifffile.imread("film.tif")
    film[frame] = 7
    tifffile.imwrite("film.tif", film, photometric="minisblack")
    assert track("--json") == 1
    drawn = {label.curve: label.points for label in read_labels("lines.csv").labels}
    here = [label for label in read_labels("labels.csv").labels if label.frame == frame]
    assert [label.curve for label in here] == {1: [4, 9], 3: [2]}[frame]
    assert {label.status for label in here} == {"failed"}
    for label in here:
        np.testing.assert_allclose(label.points, drawn[label.curve])
    said = json.loads(capsys.readouterr().out)["frames"][frame - 1]
    failed = [one["curve"] for one in said["curves"] if one["status"] == "failed"]
    assert failed == [label.curve for label in here]


def test_what_is_lost_is_reported(
    folder: Path,
    engine: list,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    whole: Callable[..., Any] = napari_splinesketch.refine

    def upper_half_only(image: np.ndarray, lines: Any, preset: str, **options: Any) -> Any:
        result = whole(image, lines, preset, **options)
        result.background[21:] = image[21:]
        return replace(result, background=result.background)

    monkeypatch.setattr(napari_splinesketch, "refine", upper_half_only, raising=False)
    write_labels("lines.csv", Labels(read_labels("lines.csv").labels[:2]), overwrite=True)
    assert track("--smooth", "off", "--verbose") == 1
    assert numbers() == {1: [4, 9], 2: [4], 3: [4], 4: [4], 5: [4]}
    said = capsys.readouterr().out
    assert "2 missing, 1 lost" in said
    assert "nothing like it is there" in said


def test_what_ends_and_what_comes_into_view_is_said() -> None:
    gone = CurveReport(4, 0.0, None, None, "lost", ("it left the image",))
    one = FrameReport(3, (gone,), notes=("a body came into view at row 2, column 5",))
    said = list(as_text(Spool([one])))
    assert said[1:3] == ["  curve 4 ends: it left the image", f"  {one.notes[0]}"]
    kept = json.loads(json.dumps(asdict(one)))
    assert FrameReport.from_json(kept) == one


def test_an_interrupted_run_goes_on_as_if_nothing_had_been(
    folder: Path,
    engine: list,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert track() == 0
    wanted = Path("labels.csv").read_text(encoding="utf-8")
    Path("labels.csv").unlink()
    calls = len(engine)
    whole: Callable[..., Any] = napari_splinesketch.refine
    left = [4]

    def interrupted(*arguments: Any, **options: Any) -> Any:
        left[0] -= 1
        if not left[0]:
            raise KeyboardInterrupt
        return whole(*arguments, **options)

    monkeypatch.setattr(napari_splinesketch, "refine", interrupted, raising=False)
    assert track() == 130
    assert "--resume" in capsys.readouterr().err
    engine.clear()
    assert track() == 2
    assert track("--preset", "fast", "--resume") == 2
    assert track("--resume") == 0
    assert len(engine) < calls
    assert Path("labels.csv").read_text(encoding="utf-8") == wanted


def test_an_interrupted_run_knows_the_contrast_of_its_bodies(
    folder: Path, engine: list, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole: Callable[..., Any] = napari_splinesketch.refine
    known, go_on = [], tracking.follow

    def interrupted(*arguments: Any, **options: Any) -> Any:
        if len(engine) == 3:
            raise KeyboardInterrupt
        return whole(*arguments, **options)

    def noted(*arguments: Any, **options: Any) -> Any:
        known.append(options["contrast"])
        return go_on(*arguments, **options)

    monkeypatch.setattr(tracking, "follow", noted)
    monkeypatch.setattr(napari_splinesketch, "refine", interrupted, raising=False)
    assert track("--smooth", "off") == 130
    monkeypatch.setattr(napari_splinesketch, "refine", whole, raising=False)
    assert track("--smooth", "off", "--resume") == 0
    assert known == [None, 30.0]


def test_an_interrupted_run_knows_where_its_bodies_were_seen_and_how_bright(
    folder: Path, engine: list, monkeypatch: pytest.MonkeyPatch
) -> None:
    known, usual = list[dict[int, list[int]]](), []

    def fake(frames: Any, bodies: Any, *more: Any, given: Any, **options: Any) -> Any:
        known.append({body.id: [frame for frame, _ in body.seen] for body in bodies})
        usual.append(options["contrast"])
        for frame in frames[:3]:
            given(frame)
            reasons = (INFERRED,) if frame == 2 else ()
            one = replace(curve(LINE), status="check", reasons=reasons)
            yield tracking.Tracked(frame, {} if frame == 1 else {4: one}, contrast=20.0)
        raise KeyboardInterrupt

    monkeypatch.setattr(tracking, "follow", fake)
    assert track() == 130
    assert track("--resume") == 130
    assert known == [{}, {4: [1, 3], 9: [1], 2: [3]}]
    assert usual == [None, 20.0]


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (("--last", "0"), "cannot track from frame 1"),
        (("--last", "6"), "has 6"),
        (("--z", "1"), "--z"),
    ],
)
def test_what_cannot_be_done_is_said_at_once(
    folder: Path, capsys: pytest.CaptureFixture[str], more: tuple[str, ...], words: str
) -> None:
    assert track(*more) == 2
    assert words in capsys.readouterr().err
    assert sorted(path.name for path in folder.iterdir()) == ["film.tif", "lines.csv"]


def test_no_lines_no_tracks(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_labels("lines.csv", Labels(), overwrite=True)
    assert track() == 2
    assert "no line" in capsys.readouterr().err

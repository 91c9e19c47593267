import json
import os
import subprocess
import sys
from dataclasses import fields
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
import tifffile

from napari_splinesketch import InputError, __version__, palette
from napari_splinesketch.cli import main
from napari_splinesketch.cli.commands import COMMANDS, why_no_window
from napari_splinesketch.cli.comparing import compare
from napari_splinesketch.cli.jobs import RefineJob
from napari_splinesketch.labels import Label, Labels, read_labels, write_labels
from napari_splinesketch.labels.format import Format

from .fakes import FakeEngine, film

ROWS = np.linspace(5, 30, 20)


def vertical(col: float, *, frame: int = 0, identity: int = 0) -> Label:
    points = np.column_stack([ROWS, np.full(20, col)])
    return Label.from_sketch(points, frame=frame, identity=identity)


@pytest.fixture(autouse=True)
def inside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_convert_says_what_is_lost(capsys: pytest.CaptureFixture[str]) -> None:
    write_labels("a.csv", Labels((vertical(3, identity=7),)))
    assert main(["convert", "a.csv", "b.zip"]) == 0
    said = capsys.readouterr()
    assert said.out == "1 curve written to b.zip\n"
    assert "32-bit floats" in said.err
    assert np.allclose(read_labels("b.zip").labels[0].points[:, 0], ROWS)


def test_convert_gives_a_pixel_size_and_json(capsys: pytest.CaptureFixture[str]) -> None:
    write_labels("a.shapes.csv", Labels((vertical(3),)))
    arguments = ["convert", "a.shapes.csv", "b.csv", "--pixel-size", "0.5", "--units", "µm"]
    assert main([*arguments, "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"written": "b.csv", "curves": 1, "notes": []}
    assert (read_labels("b.csv").scale, read_labels("b.csv").units) == ((0.5, 0.5), "µm")


def test_lines_in_units_become_pixels(capsys: pytest.CaptureFixture[str]) -> None:
    record = {"id": "a", "t": 0.5, "x": [1, 2], "y": [10, 11]}
    root = {"units": {"t": "s", "x": "mm", "y": "mm"}, "data": [record]}
    Path("a.wcon").write_text(json.dumps(root))
    convert = ["convert", "a.wcon", "b.csv", "--pixel-size"]
    assert main([*convert, "100", "--units", "µm"]) == 2
    assert "the lines are in mm" in capsys.readouterr().err
    assert main([*convert, "0.5", "0.25"]) == 0
    assert "taken as 1 pixel" not in capsys.readouterr().err
    labels = read_labels("b.csv")
    assert np.array_equal(labels.labels[0].points, [[20, 4], [22, 8]])
    assert (labels.scale, labels.units) == ((0.5, 0.25), "mm")


@pytest.mark.parametrize("sizes", [["2"], ["2", "1.5e0"]])
def test_names_may_follow_a_pixel_size(sizes: list[str]) -> None:
    write_labels("a.csv", Labels((vertical(3),), (1, 1), "nm"))
    assert main(["convert", "--pixel-size", *sizes, "a.csv", "b.csv"]) == 0
    labels = read_labels("b.csv")
    assert (labels.scale, labels.units) == ((float(sizes[0]), float(sizes[-1])), "nm")


def test_more_names_than_one_image_has_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):  # the shell makes many names of one with a *
        main(["refine", "a1.png", "a2.png", "a.csv", "-o", "b.csv"])
    reason = "unrecognized arguments: a.csv; of many images, give their folder, or a name with * in"
    assert reason in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["refine", "a1.png", "a.csv", "-o", "b.csv", "--pesret", "paper"])
    assert "unrecognized arguments: --pesret paper\n" in capsys.readouterr().err


@pytest.mark.parametrize("sizes", [["a.csv"], [""], []])
def test_a_pixel_size_that_is_no_number_is_refused(
    sizes: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main(["convert", "a.csv", "b.csv", "--pixel-size", *sizes])
    assert "argument --pixel-size: " in capsys.readouterr().err


@pytest.mark.parametrize("units", ["um", "μm", "microns"])
def test_a_unit_may_be_spelt_in_any_way(units: str) -> None:
    record = {"id": "a", "t": 0.5, "x": [1, 2], "y": [10, 11]}
    root = {"units": {"t": "s", "x": "micrometers", "y": "micrometers"}, "data": [record]}
    Path("a.wcon").write_text(json.dumps(root))
    assert main(["convert", "a.wcon", "b.csv", "--pixel-size", "0.5", "--units", units]) == 0
    assert read_labels("b.csv").units == "µm"


def test_convert_holds_a_frame_at_a_time_and_keeps_the_order(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    labels = tuple(vertical(3 + frame, frame=frame, identity=7) for frame in (0, 4, 5))
    write_labels("a.csv", Labels(labels, (0.5, 0.25), "µm"))
    write_labels("disorder.csv", Labels(labels[::-1]))
    assert main(["convert", "disorder.csv", "b.geojson"]) == 0
    assert [label.frame for label in read_labels("b.geojson").labels] == [5, 4, 0]
    with monkeypatch.context() as patch:
        patch.setattr(Format, "read_whole", None)  # what reads all of a table
        assert main(["convert", "a.csv", "c.geojson"]) == 0
        assert main(["convert", "a.csv", "d.wcon", "--pixel-size", "2", "--units", "mm"]) == 0
    back = read_labels("c.geojson")
    assert ([label.frame for label in back.labels], back.scale) == ([0, 4, 5], (0.5, 0.25))
    assert (read_labels("d.wcon").scale, read_labels("d.wcon").units) == ((2, 2), "mm")


def test_convert_does_not_overwrite_unless_asked(capsys: pytest.CaptureFixture[str]) -> None:
    write_labels("a.csv", Labels((vertical(3),)))
    write_labels("b.csv", Labels())
    assert main(["convert", "a.csv", "b.csv"]) == 2
    assert "exists already" in capsys.readouterr().err
    assert read_labels("b.csv").labels == ()
    assert main(["convert", "a.csv", "b.csv", "--overwrite"]) == 0
    assert len(read_labels("b.csv").labels) == 1


def test_compare_matches_within_frames_only() -> None:
    truth = Labels((vertical(10), vertical(20, identity=1), vertical(30, frame=1)))
    labels = Labels(
        (
            vertical(20.5, identity=5),
            vertical(11, identity=6),
            vertical(30, identity=7),
            vertical(31.5, frame=1),
            vertical(50, frame=2),
        )
    )
    result = compare(labels, truth, tolerance=2.0)
    assert (result.curves, result.truths, result.pairs) == (5, 3, 3)
    assert result.precision == pytest.approx(3 / 5)
    assert result.recall == pytest.approx(1)
    assert result.dtw_median == pytest.approx(1)
    assert result.dtw_mean == pytest.approx(1)
    assert result.normal_distance == pytest.approx(1)
    assert result.end_error == pytest.approx(1)
    assert compare(labels, truth, tolerance=0.7).recall == pytest.approx(1 / 3)


def test_compare_of_nothing() -> None:
    result = compare(Labels(), Labels(), tolerance=1.0)
    assert (result.pairs, result.precision, result.recall) == (0, 1.0, 1.0)
    assert result.dtw_median is None


def test_compare_prints_and_draws(capsys: pytest.CaptureFixture[str]) -> None:
    import imageio.v3

    write_labels("a.csv", Labels((vertical(10.5),)))
    write_labels("t.csv", Labels((vertical(10),)))
    tifffile.imwrite("film.tif", film(1)[0])
    drawn = ["--picture", "p.png", "--image", "film.tif"]
    assert main(["compare", "a.csv", "t.csv", *drawn]) == 0
    out = capsys.readouterr().out
    assert "1 curve, 1 truth, 1 pair within 2 px" in out
    assert "median 0.5 px" in out
    picture = imageio.v3.imread("p.png")
    assert picture.shape[0] % 40 == 0
    for colour in (palette.TRUTH, palette.SKETCH):
        assert (picture == list(bytes.fromhex(colour[1:]))).all(axis=2).any()
    assert main(["compare", "a.csv", "t.csv", "--picture", "p.png"]) == 2
    assert main(["compare", "a.csv", "t.csv", "--picture", "q.png", "--json"]) == 0
    assert '"pairs": 1' in capsys.readouterr().out


def test_a_distance_that_nothing_tells_is_a_dash(capsys: pytest.CaptureFixture[str]) -> None:
    for name, col in (("a.csv", 0), ("t.csv", 5)):
        write_labels(name, Labels((Label.from_sketch(np.array([[0.0, col], [0.0, col + 3]])),)))
    assert main(["compare", "a.csv", "t.csv", "--tolerance", "9"]) == 0
    assert "normal distance – px, end error 5.0 px" in capsys.readouterr().out


def test_a_channel_is_drawn_over(capsys: pytest.CaptureFixture[str]) -> None:
    write_labels("a.csv", Labels((vertical(10),)))
    tifffile.imwrite("two.tif", film(2)[None], imagej=True, metadata={"axes": "TCYX"})
    command = ["compare", "a.csv", "a.csv", "--picture", "p.png", "--image", "two.tif"]
    assert main(command) == 2
    assert "choose one with --channel" in capsys.readouterr().err
    assert main([*command, "--channel", "1"]) == 0


def test_an_image_that_nothing_is_drawn_over_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["compare", "a.csv", "a.csv", "--image", "film.tif"])
    assert "give --picture, too" in capsys.readouterr().err


def test_demo_without_a_display_says_so_and_writes_files(
    monkeypatch: pytest.MonkeyPatch, engine: FakeEngine, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(
        "napari_splinesketch.cli.commands.why_no_window", lambda: "no display was found"
    )
    assert main(["demo"]) == 0
    said = capsys.readouterr()
    assert "no display was found" in said.err
    assert "24 good" in said.out
    assert sorted(os.listdir("splinesketch-demo")) == [
        "labels.csv",
        "overlay.png",
        "reconstruction.tif",
    ]
    assert main(["demo"]) == 0
    assert len(read_labels("splinesketch-demo-2/labels.csv").labels) == 24


def test_demo_keeps_existing_files_unless_asked(
    engine: FakeEngine, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["demo", "--output", "d"]) == 0
    assert main(["demo", "--output", "d"]) == 2
    assert "exists already" in capsys.readouterr().err
    assert main(["demo", "--output", "d", "--overwrite"]) == 0
    assert main(["demo", "--output", "d/labels.csv", "--overwrite"]) == 2
    assert "d/labels.csv is a file; name a folder" in capsys.readouterr().err


def test_no_window_without_a_display(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr("napari_splinesketch.cli.commands.PROBE", "pass")
    monkeypatch.setenv("DISPLAY", ":7")
    assert why_no_window() is None
    monkeypatch.delenv("DISPLAY")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    assert why_no_window() == "no display was found"
    monkeypatch.setenv("WAYLAND_DISPLAY", "wayland-0")
    assert why_no_window() is None


def test_no_window_where_qt_cannot_start(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DISPLAY", ":7")
    for probe in ("import sys; sys.exit('no libEGL\\nhint')", "raise ImportError('no libEGL')"):
        monkeypatch.setattr("napari_splinesketch.cli.commands.PROBE", probe)
        assert "no libEGL; the README" in str(why_no_window())
    monkeypatch.setattr("napari_splinesketch.cli.commands.PROBE", "import os; os.abort()")
    assert "does not say why" in str(why_no_window())


@pytest.mark.slow
def test_the_installed_command_runs_with_the_real_engine(tmp_path: Path) -> None:
    environment = {k: v for k, v in os.environ.items() if "DISPLAY" not in k}
    command = [str(Path(sys.executable).with_name("napari-splinesketch")), "demo"]
    run = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert "no display" in run.stderr
    labels = read_labels(tmp_path / "splinesketch-demo" / "labels.csv").labels
    assert len(labels) == 24
    good = [label for label in labels if label.status == "good"]
    assert len(good) > 12
    assert all(0.3 < np.median(label.half_width) < 3 for label in good)
    reconstruction = tifffile.imread(tmp_path / "splinesketch-demo" / "reconstruction.tif")
    assert reconstruction.shape[-2:] == (512, 512)


def test_help_names_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(["--help"])
    assert caught.value.code == 0
    text = capsys.readouterr().out
    assert all(command in text for command in ("demo", "refine", "convert", "compare"))
    assert "exit codes" in text
    with pytest.raises(SystemExit):
        main(["--version"])
    assert __version__ in capsys.readouterr().out


def test_an_option_is_declared_once_and_checked_wherever_it_comes_from(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(ValueError, match=r"--half-width is -1; give a number above 0"):
        RefineJob(image="a.tif", sketches=Path("a.csv"), output=Path("b.csv"), half_width=-1)
    with pytest.raises(SystemExit):
        main(["refine", "a.tif", "a.csv", "-o", "b.csv", "--half-width", "-1"])
    told = capsys.readouterr().err
    assert "--half-width is -1.0; give a number above 0" in told
    assert told.startswith("usage: napari-splinesketch refine "), "not that of all commands"
    for name, (kind, _) in COMMANDS.items():
        with pytest.raises(SystemExit):
            main([name, "--help"])
        told = capsys.readouterr().out
        for one in fields(kind):
            text, metavar = one.metadata["help"], one.metadata["metavar"]
            assert (f"--{one.name.replace('_', '-')}" if text else metavar) in told
    for wrong in ("--split 0 0 0", "--split nan 0 0", "--block 0", "--seed -1"):
        assert main(f"export-training a.tif a.csv -o b {wrong}".split()) == 2
        told = capsys.readouterr().err
        assert f": {wrong.split()[0]} is " in told
        assert "; give " in told


def test_one_line_a_frame_or_one_a_curve(
    engine: FakeEngine, capsys: pytest.CaptureFixture[str]
) -> None:
    tifffile.imwrite("film.tif", film(2), photometric="minisblack")
    write_labels("a.csv", Labels((vertical(9), vertical(20, identity=1), vertical(9, frame=1))))
    command = ["refine", "film.tif", "a.csv", "-o", "b.csv", "--overwrite"]
    assert main(command) == 0
    said = capsys.readouterr()
    assert [line.split(";")[0] for line in said.out.splitlines()] == [
        "frame 0: 2 good, 0 check, 0 failed",
        "frame 1: 1 good, 0 check, 0 failed",
        "2 frames: 3 good, 0 check, 0 failed",
    ]
    assert said.err == ""
    assert not any(line.endswith(" ") for line in said.out.splitlines())
    assert main([*command, "--verbose"]) == 0
    assert len(capsys.readouterr().out.splitlines()) == 5
    assert main([*command, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["provenance"]["preset"] == "balanced"
    assert told["provenance"]["software"] == f"napari-splinesketch {__version__}"


@pytest.mark.parametrize("error", [InputError("give\nlines"), OSError(5, "disk failure", "a.csv")])
def test_what_the_user_can_put_right_is_one_sentence(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], error: Exception
) -> None:
    monkeypatch.setattr("napari_splinesketch.cli.commands.open_labels", Mock(side_effect=error))
    assert main(["convert", "a.csv", "b.csv"]) == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize("error", [ValueError("of a library"), TypeError("of ours")])
def test_a_fault_is_not_taken_for_a_mistake_of_the_user(
    monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    monkeypatch.setattr("napari_splinesketch.cli.commands.open_labels", Mock(side_effect=error))
    with pytest.raises(type(error), match="of "):
        main(["convert", "a.csv", "b.csv"])

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tifffile

import napari_splinesketch
from napari_splinesketch.cli import main, refining
from napari_splinesketch.labels import Label, Labels, read_labels, write_labels

from .fakes import FakeEngine, film

LINE = np.array([[5.0, 6.0], [25.0, 46.0]])


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A film of four frames with sketches on frames 0, 1 and 3."""
    monkeypatch.chdir(tmp_path)
    tifffile.imwrite("film.tif", film(4), photometric="minisblack")
    keys = [(0, 4), (0, 2), (1, 4), (3, 8)]
    sketches = [Label.from_sketch(LINE + frame, frame=frame, identity=i) for frame, i in keys]
    write_labels("sketches.csv", Labels(tuple(sketches)))
    return tmp_path


def refine(*more: str) -> int:
    return main(["refine", "film.tif", "sketches.csv", "-o", "labels.csv", *more])


def spoil(frame: int) -> None:
    """Make a frame constant, which the engine refuses."""
    frames = tifffile.imread("film.tif")
    frames[frame] = 7
    tifffile.imwrite("film.tif", frames, photometric="minisblack")


def test_frames_with_sketches_are_refined_and_keep_their_numbers(
    folder: Path, engine: FakeEngine, capsys: pytest.CaptureFixture[str]
) -> None:
    assert refine() == 0
    labels = read_labels("labels.csv").labels
    assert [(label.frame, label.curve) for label in labels] == [(0, 4), (0, 2), (1, 4), (3, 8)]
    assert np.allclose(labels[2].points[[0, -1]], LINE + 1.5)
    assert {label.status for label in labels} == {"good"}
    assert [len(sketches) for _, sketches, _, _ in engine.calls] == [2, 1, 1]
    assert np.array_equal(engine.calls[2][0], film(4)[3])
    assert "3 frames: 4 good, 0 check, 0 failed" in capsys.readouterr().out
    assert sorted(os.listdir(folder)) == ["film.tif", "labels.csv", "sketches.csv"]


def test_options_reach_the_engine(folder: Path, engine: FakeEngine) -> None:
    refine("--preset", "fast", "--polarity", "dark", "--half-width", "1.5", "--seed", "3")
    _, _, preset, options = engine.calls[0]
    assert preset == "fast"
    assert options == {"polarity": "dark", "half_width": 1.5, "seed": 3}


def test_pixel_size_is_written(folder: Path, engine: FakeEngine) -> None:
    refine("--pixel-size", "0.5", "0.25", "--units", "µm")
    labels = read_labels("labels.csv")
    assert (labels.scale, labels.units) == ((0.5, 0.25), "µm")


def test_lines_in_units_become_pixels(
    folder: Path, engine: FakeEngine, capsys: pytest.CaptureFixture[str]
) -> None:
    y, x = (LINE * (0.5, 0.25)).T.tolist()
    record = {"id": "a", "t": 0, "x": x, "y": y}
    root = {"units": {"t": "s", "x": "mm", "y": "mm"}, "data": record}
    Path("lines.wcon").write_text(json.dumps(root))
    command = ["refine", "film.tif", "lines.wcon", "-o", "labels.csv", "--pixel-size"]
    assert main([*command, "0.5", "0.25", "--units", "µm"]) == 2
    assert "the lines are in mm; give the size of a pixel in that unit" in capsys.readouterr().err
    assert main([*command, "0.5", "0.25", "--units", "mm"]) == 0
    assert "taken as 1 pixel" not in capsys.readouterr().err
    assert np.array_equal(engine.calls[0][1], [LINE])


def test_the_last_word_on_the_pixel_size_is_the_user_s(folder: Path, engine: FakeEngine) -> None:
    write_labels("sketches.csv", Labels((Label.from_sketch(LINE),), (2, 3), "nm"), overwrite=True)
    refine()
    assert read_labels("labels.csv").scale == (2, 3)
    refine("--pixel-size", "0.5", "--overwrite")
    labels = read_labels("labels.csv")
    assert (labels.scale, labels.units) == ((0.5, 0.5), "nm")
    refine("--pixel-size", "0.5", "--units", "mm", "--overwrite")
    assert read_labels("labels.csv").units == "mm"


def test_the_image_s_own_pixel_size_comes_before_that_of_the_sketches(
    folder: Path, engine: FakeEngine
) -> None:
    metadata = {"axes": "TYX", "unit": "um"}
    tifffile.imwrite("film.tif", film(4), imagej=True, resolution=(4, 2), metadata=metadata)
    write_labels("sketches.csv", Labels((Label.from_sketch(LINE),), (2, 3), "nm"), overwrite=True)
    refine()
    labels = read_labels("labels.csv")
    assert (labels.scale, labels.units) == ((0.5, 0.25), "µm")
    refine("--pixel-size", "0.7", "--overwrite")
    labels = read_labels("labels.csv")
    assert (labels.scale, labels.units) == ((0.7, 0.7), "µm"), "the size is the user's"


@pytest.mark.parametrize(("size", "unit"), [(1e40, "m"), (2.0, "")])
def test_a_pixel_size_that_cannot_be_does_no_harm_to_an_image(
    folder: Path, engine: FakeEngine, size: float, unit: str
) -> None:
    axes = {"axes": "TYX"} | {f"PhysicalSize{axis}": size for axis in "XY"}
    axes |= {f"PhysicalSize{axis}Unit": unit for axis in "XY"}
    tifffile.imwrite("film.tif", film(4), ome=True, metadata=axes)
    assert refine() == 0
    assert read_labels("labels.csv").scale is None
    assert refine("--pixel-size", "0.5", "--overwrite") == 0
    assert read_labels("labels.csv").scale == (0.5, 0.5)


def test_reconstruction_masks_and_overlay(folder: Path, engine: FakeEngine) -> None:
    import imageio.v3

    assert refine("--reconstruction", "r.tif", "--masks", "m.tif", "--overlay", "o.png") == 0
    assert np.allclose(tifffile.imread("r.tif"), film(4)[[0, 1, 3]] + 0.25)
    with tifffile.TiffFile("r.tif") as file:
        assert json.loads(file.pages[0].description)["frames"] == [0, 1, 3]  # pyright: ignore
    masks = tifffile.imread("m.tif")
    assert masks.shape == (4, 40, 60)
    assert [set(np.unique(page)) for page in masks] == [{0, 5}, {0, 5}, {0}, {0, 9}]
    assert masks[1, 16, 28] == 5
    overlay = imageio.v3.imread("o.png")
    zoom = overlay.shape[0] // 40
    assert overlay.shape == (40 * zoom, 60 * zoom, 3)
    blue = (overlay == [0x00, 0x9E, 0x73]).all(axis=2)
    rows, cols = np.nonzero(blue)
    assert abs(rows.mean() / zoom - 16) < 1
    assert abs(cols.mean() / zoom - 27) < 1


def test_a_bad_frame_is_reported_and_the_others_are_done(
    folder: Path, engine: FakeEngine, capsys: pytest.CaptureFixture[str]
) -> None:
    spoil(1)
    assert refine("--json") == 1
    report = json.loads(capsys.readouterr().out)
    assert report["counts"] == {"good": 3, "check": 0, "failed": 0, "frames not refined": 1}
    assert "constant" in report["frames"][1]["error"]
    labels = {(label.frame, label.curve): label for label in read_labels("labels.csv").labels}
    assert labels[1, 4].status == "failed"
    assert np.array_equal(labels[1, 4].points, LINE + 1)
    assert labels[3, 8].status == "good"


def test_a_bad_curve_is_reported_and_the_others_are_done(
    folder: Path, engine: FakeEngine, capsys: pytest.CaptureFixture[str]
) -> None:
    sketches = [Label.from_sketch(line, identity=i) for i, line in enumerate((LINE, LINE / 100))]
    write_labels("sketches.csv", Labels(tuple(sketches)), overwrite=True)
    assert refine("--verbose") == 1
    assert "failed: the sketch is tiny" in capsys.readouterr().out
    assert refine("--overwrite") == 1
    assert "\n  curve 1 failed: the sketch is tiny\n1 frame: " in capsys.readouterr().out
    assert [label.status for label in read_labels("labels.csv").labels] == ["good", "failed"]


def test_a_file_without_lines_is_said(
    folder: Path, engine: FakeEngine, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("sketches.csv").write_text("curve,row,col\n")
    assert refine() == 0
    assert capsys.readouterr().err == "sketches.csv has no line to refine\n"
    assert read_labels("labels.csv").labels == ()


def test_sketches_beyond_the_film_are_reported(
    folder: Path, engine: FakeEngine, capsys: pytest.CaptureFixture[str]
) -> None:
    write_labels("sketches.csv", Labels((Label.from_sketch(LINE, frame=9),)), overwrite=True)
    assert (
        refine("--overlay", "o.png", "--reconstruction", "r.tif", "--masks", "m.tif", "--json") == 1
    )
    said = capsys.readouterr()
    told = json.loads(said.out)
    assert "no frame 9: film.tif has 4" in told["frames"][0]["error"]
    assert told["written"] == ["labels.csv", "m.tif"]
    assert "r.tif is not written: no frame was refined\no.png is not written" in said.err
    assert read_labels("labels.csv").labels[0].status == "failed"


@pytest.mark.parametrize("kind", [RuntimeError, ValueError])
def test_any_error_of_the_engine_is_one_frame_s_error(
    folder: Path,
    engine: FakeEngine,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    kind: type[Exception],
) -> None:
    def broken(image: np.ndarray, *args: object, **options: object) -> object:
        if engine.calls:
            raise kind("RESOURCE_EXHAUSTED:\nout of memory")
        return engine(image, *args, **options)  # pyright: ignore[reportArgumentType]

    monkeypatch.setattr(napari_splinesketch, "refine", broken)
    assert refine("--json") == 1
    done, *frames = json.loads(capsys.readouterr().out)["frames"]
    assert done["error"] is None
    said = f"{kind.__name__}: RESOURCE_EXHAUSTED: out of memory"
    assert {frame["error"] for frame in frames} == {said}


def interrupt_after_two(engine: FakeEngine, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the third frame be where the user presses Ctrl-C."""

    def interrupted(image: np.ndarray, *args: object, **options: object) -> object:
        if len(engine.calls) == 2:
            raise KeyboardInterrupt
        return engine(image, *args, **options)  # pyright: ignore[reportArgumentType]

    monkeypatch.setattr(napari_splinesketch, "refine", interrupted)


def test_an_interrupted_run_is_resumed(
    folder: Path,
    engine: FakeEngine,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    interrupt_after_two(engine, monkeypatch)
    assert refine("--reconstruction", "r.tif") == 130
    assert "--resume" in capsys.readouterr().err
    assert not Path("labels.csv").exists()
    monkeypatch.setattr(napari_splinesketch, "refine", engine)

    assert refine("--reconstruction", "r.tif") == 2
    assert "holds an interrupted run; continue it with --resume" in capsys.readouterr().err
    assert refine("--reconstruction", "r.tif", "--resume", "--preset", "fast") == 2
    assert "differs in preset" in capsys.readouterr().err
    assert len(engine.calls) == 2

    assert refine("--reconstruction", "r.tif", "--resume") == 0
    assert len(engine.calls) == 3
    assert len(read_labels("labels.csv").labels) == 4
    assert np.allclose(tifffile.imread("r.tif"), film(4)[[0, 1, 3]] + 0.25)
    assert not Path("labels.csv.partial").exists()


def test_a_frame_that_can_be_read_by_now_is_done_again(
    folder: Path, engine: FakeEngine, monkeypatch: pytest.MonkeyPatch
) -> None:
    Path("film").mkdir()
    for number, frame in enumerate(film(4)):
        tifffile.imwrite(f"film/{number}.tif", frame)
    whole = Path("film/0.tif").read_bytes()
    Path("film/0.tif").write_bytes(b"still being copied")
    command = ["refine", "film", "sketches.csv", "-o", "labels.csv"]

    def interrupted(*args: object, **options: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(napari_splinesketch, "refine", interrupted)
    assert main(command) == 130
    assert Path("labels.csv.partial/000000/frame-000000000.json").exists()
    Path("film/0.tif").write_bytes(whole)
    monkeypatch.setattr(napari_splinesketch, "refine", engine)
    assert main([*command, "--resume"]) == 0
    assert all(label.status == "good" for label in read_labels("labels.csv").labels)


def test_frames_that_a_power_cut_has_damaged_are_done_again(
    folder: Path, engine: FakeEngine, monkeypatch: pytest.MonkeyPatch
) -> None:
    interrupt_after_two(engine, monkeypatch)
    assert refine() == 130
    kept = Path("labels.csv.partial/000000")
    os.truncate(kept / "frame-000000000.csv", 100)
    os.truncate(kept / "frame-000000001.json", 0)
    monkeypatch.setattr(napari_splinesketch, "refine", engine)
    engine.calls.clear()
    assert refine("--resume") == 0
    assert len(engine.calls) == 3
    assert len(read_labels("labels.csv").labels) == 4


def full(*arguments: object, **options: object) -> None:
    raise OSError(28, "No space left on device", "r.tif")


def test_a_run_whose_last_output_failed_names_it_and_is_resumed(
    folder: Path,
    engine: FakeEngine,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    outputs = ("--masks", "m.tif", "--reconstruction", "r.tif")

    with monkeypatch.context() as patched:
        patched.setattr(refining, "write_reconstruction", full)
        assert refine(*outputs) == 2
    assert f"{folder / 'r.tif'}: no space left on the disk; make some" in capsys.readouterr().err
    assert sorted(os.listdir(folder)) == ["film.tif", "labels.csv.partial", "sketches.csv"]
    assert refine(*outputs, "--resume") == 0
    assert len(engine.calls) == 3
    assert tifffile.imread("r.tif").shape == (3, 40, 60)
    assert sorted(os.listdir(folder)) == [
        "film.tif",
        "labels.csv",
        "m.tif",
        "r.tif",
        "sketches.csv",
    ]


def test_a_disk_that_is_full_from_the_start_is_left_as_it_was(
    folder: Path,
    engine: FakeEngine,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    with monkeypatch.context() as patched:
        patched.setattr(os, "fsync", full)
        assert refine() == 2
    assert "labels.csv.partial: no space left" in capsys.readouterr().err
    assert sorted(os.listdir(folder)) == ["film.tif", "sketches.csv"]
    assert refine("--resume") == 0


def test_an_output_that_somebody_has_changed_meanwhile_is_kept(
    folder: Path,
    engine: FakeEngine,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(refining, "write_reconstruction", full)
    assert refine("--reconstruction", "r.tif") == 2
    Path("labels.csv").write_text("mine")
    assert refine("--reconstruction", "r.tif", "--resume") == 2
    assert "labels.csv exists already" in capsys.readouterr().err
    assert Path("labels.csv").read_text() == "mine"


def test_a_run_is_not_resumed_on_another_film(
    folder: Path,
    engine: FakeEngine,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    interrupt_after_two(engine, monkeypatch)
    assert refine() == 130
    monkeypatch.setattr(napari_splinesketch, "refine", engine)
    tifffile.imwrite("film.tif", film(4) + 1, photometric="minisblack")
    assert refine("--resume") == 2
    assert "frame 0 of film.tif is not the one that the interrupted run" in capsys.readouterr().err
    assert not Path("labels.csv").exists()


# A copy that keeps its time, as those of a backup do, is older than the frame that it replaces.
@pytest.mark.parametrize("ago", [-10, 1000], ids=["written later", "copied"])
def test_a_frame_that_was_replaced_is_not_taken_for_finished(
    folder: Path,
    engine: FakeEngine,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    ago: float,
) -> None:
    Path("frames").mkdir()
    for i, image in enumerate(film(4)):
        tifffile.imwrite(f"frames/{i}.tif", image, photometric="minisblack")
    command = ["refine", "frames", "sketches.csv", "-o", "labels.csv"]
    interrupt_after_two(engine, monkeypatch)
    assert main(command) == 130
    monkeypatch.setattr(napari_splinesketch, "refine", engine)
    tifffile.imwrite("frames/1.tif", film(4)[1] + 1, photometric="minisblack")
    written = time.time() - ago
    os.utime("frames/1.tif", (written, written))
    assert main([*command, "--resume"]) == 2
    assert "frame 1 of frames is not the one that the interrupted run" in capsys.readouterr().err


@pytest.mark.parametrize(("shards", "chunk"), [(None, "c/1/0/0"), ((2, 40, 60), "c/0/0/0")])
def test_a_later_frame_of_a_zarr_that_was_written_again_is_not_taken_for_finished(
    folder: Path,
    engine: FakeEngine,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    shards: tuple[int, ...] | None,
    chunk: str,
) -> None:
    zarr = pytest.importorskip("zarr")
    array = zarr.create_array("film.zarr", data=film(4), chunks=(1, 40, 60), shards=shards)
    command = ["refine", "film.zarr", "sketches.csv", "-o", "labels.csv"]
    interrupt_after_two(engine, monkeypatch)
    assert main(command) == 130
    monkeypatch.setattr(napari_splinesketch, "refine", engine)
    array[1] = 7
    later = time.time() + 10
    os.utime(f"film.zarr/{chunk}", (later, later))
    assert main([*command, "--resume"]) == 2
    assert "frame 1 of film.zarr is not the one that" in capsys.readouterr().err


@pytest.mark.parametrize("ending", [".coco.json", ".masks.tif"])
def test_frames_of_two_sizes_have_no_common_size(
    folder: Path, engine: FakeEngine, capsys: pytest.CaptureFixture[str], ending: str
) -> None:
    Path("frames").mkdir()
    for i, shape in enumerate([(40, 60), (30, 50), (40, 60), (40, 60)]):
        tifffile.imwrite(f"frames/{i}.tif", film(1, shape)[0], photometric="minisblack")
    assert main(["refine", "frames", "sketches.csv", "-o", f"labels{ending}"]) == 0
    assert "the size of the image is not known" in capsys.readouterr().err


@pytest.mark.parametrize("output", ["--masks", "--reconstruction"])
def test_frames_of_two_sizes_have_no_masks_and_no_reconstruction(
    folder: Path, engine: FakeEngine, capsys: pytest.CaptureFixture[str], output: str
) -> None:
    Path("frames").mkdir()
    for i, shape in enumerate([(40, 60), (50, 60), (40, 60), (40, 60)]):
        tifffile.imwrite(f"frames/{i}.tif", film(1, shape)[0], photometric="minisblack")
    command = ["refine", "frames", "sketches.csv", "-o", "labels.csv"]
    assert main([*command, output, "a.tif"]) == 2
    told = capsys.readouterr().err
    assert "frame 1 has 50 x 60 px, and others have 40 x 60" in told
    assert "add --resume and leave them out" in told
    assert not Path("labels.csv").exists()
    count = len(engine.calls)
    assert main([*command, "--resume"]) == 0
    assert len(engine.calls) == count + 2  # not the first of the three again


def test_a_reconstruction_may_be_wanted_later(
    folder: Path, engine: FakeEngine, monkeypatch: pytest.MonkeyPatch
) -> None:
    interrupt_after_two(engine, monkeypatch)
    assert refine() == 130
    monkeypatch.setattr(napari_splinesketch, "refine", engine)
    assert refine("--reconstruction", "r.tif", "--resume") == 0
    assert np.allclose(tifffile.imread("r.tif"), film(4)[[0, 1, 3]] + 0.25)


def test_lines_that_were_reviewed_are_said_to_be_open_again(
    folder: Path, engine: FakeEngine, capsys: pytest.CaptureFixture[str]
) -> None:
    known = Label.from_sketch(LINE)
    known = replace(known, review="accepted", locked=True)
    write_labels("sketches.csv", Labels((known,)), overwrite=True)
    assert refine() == 0
    told = "".join(capsys.readouterr())
    assert "1 reviewed or locked line refined again, and open" in told


AT_A_TERMINAL = """
import sys
import napari_splinesketch
from napari_splinesketch.cli import main
sys.path.insert(0, {folder!r})
from fakes import FakeEngine
napari_splinesketch.refine = FakeEngine()
sys.exit(main({arguments!r}))
"""


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")
def test_a_terminal_shows_a_bar_and_the_output_stays_clean(folder: Path) -> None:
    import fcntl
    import struct
    import termios

    arguments = ["refine", "film.tif", "sketches.csv", "-o", "labels.csv", "--json"]
    code = AT_A_TERMINAL.format(folder=str(Path(__file__).parent), arguments=arguments)
    ours, theirs = os.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 30, 100, 0, 0))
    run = subprocess.run([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=theirs)
    os.close(theirs)
    shown = os.read(ours, 65_536).decode()
    os.close(ours)
    assert run.returncode == 0, shown
    assert "3.0 of 3 frames, " in shown
    assert json.loads(run.stdout)["counts"]["good"] == 4


KILLED = """
import sys, time
import napari_splinesketch
from napari_splinesketch.cli import main
sys.path.insert(0, {folder!r})
from fakes import FakeEngine
fake = FakeEngine()
def slow(*args, **options):
    if len(fake.calls) == 2:
        print("frame 2", flush=True)
        time.sleep(60)
    return fake(*args, **options)
napari_splinesketch.refine = slow
main({arguments!r})
"""


def test_a_killed_run_leaves_no_half_written_file_and_resumes(
    folder: Path, engine: FakeEngine
) -> None:
    arguments = ["refine", "film.tif", "sketches.csv", "-o", "labels.csv"]
    code = KILLED.format(folder=str(Path(__file__).parent), arguments=arguments)
    run = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert run.stdout is not None
    assert run.stdout.readline() == "frame 2\n"
    run.send_signal(signal.SIGKILL)
    run.communicate()
    assert not Path("labels.csv").exists()
    assert refine("--resume") == 0
    assert len(engine.calls) == 1
    assert len(read_labels("labels.csv").labels) == 4


def test_a_damaged_note_of_an_interrupted_run_is_said(
    folder: Path, engine: FakeEngine, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("labels.csv.partial").mkdir()
    Path("labels.csv.partial/run.json").write_text("{")
    assert refine("--resume") == 2
    assert "damaged" in capsys.readouterr().err


REFUSED = {
    "input": (["--overlay", "film.tif"], "film.tif is read by this command"),
    "no library": (
        ["-o", "labels.slp"],
        "SLEAP files need sleap-io; pip install 'napari-splinesketch[formats]'",
    ),
    "no folder": (["--masks", "none/m.tif"], "no such folder"),
    "not a TIFF": (["--masks", "m.png"], "m.png: expected a name that ends with .tif or .tiff"),
    "not a picture": (["--overlay", "o.csv"], "that ends with .png, .jpg or .tif"),
    "same name": (["--masks", "a.tif", "--reconstruction", "a.tif"], "the same name"),
    "units alone": (["--units", "µm"], "--units needs --pixel-size"),
    "three sizes": (["--pixel-size", "1", "2", "3"], "has 3 numbers"),
    "no such pixels": (["--pixel-size", "1e40"], "size of a pixel, from 1e-30 to 1e+30"),
    "too thin": (["--half-width", "0.01"], ": --half-width is 0.01; give 0.2 to 30 px"),
    "too wide": (["--half-width", "1e4"], ": --half-width is 10000.0; give 0.2 to 30 px"),
    "left out": (["--half-width", "1e4"], "or leave it out to have it measured."),
    "seed": (["--seed", "9999999999"], ": --seed is 9999999999; give a whole number up to"),
    "unknown ending": (["-o", "labels.xls"], "no format has this ending"),
    "no such channel": (["--channel", "2"], "no axis"),
}


@pytest.mark.parametrize(("more", "reason"), REFUSED.values(), ids=REFUSED.keys())
def test_what_cannot_work_is_refused_before_any_work(
    folder: Path,
    engine: FakeEngine,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    more: list[str],
    reason: str,
) -> None:
    monkeypatch.setitem(sys.modules, "sleap_io", None)
    assert refine(*more) == 2
    assert reason in capsys.readouterr().err
    assert engine.calls == []
    assert sorted(os.listdir(folder)) == ["film.tif", "sketches.csv"]


@pytest.mark.parametrize(
    "more",
    [
        ["--half-width", "0"],
        ["--half-width", "nan"],
        ["--preset", "best"],
        ["--what"],
    ],
)
def test_wrong_options_are_argparse_s_errors(folder: Path, more: list[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        refine(*more)
    assert caught.value.code == 2


def test_a_pixel_size_that_is_no_number_is_told(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        refine("--pixel-size", "x")
    assert "argument --pixel-size: 'x' is no number" in capsys.readouterr().err


@pytest.mark.parametrize("more", [["-o", "a.csv", "--masks", "a.tif"], ["-o", "a.masks.tif"]])
def test_identities_that_masks_cannot_hold_are_refused_before_any_work(
    folder: Path, engine: FakeEngine, capsys: pytest.CaptureFixture[str], more: list[str]
) -> None:
    write_labels("sketches.csv", Labels((Label.from_sketch(LINE, identity=2**40),)), overwrite=True)
    assert refine(*more) == 2
    assert "identity 1099511627776 does not fit into a pixel" in capsys.readouterr().err
    assert engine.calls == []


def test_an_image_too_large_for_masks_is_refused_before_any_work(
    folder: Path,
    engine: FakeEngine,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("napari_splinesketch.labels.masks.MAX_PIXELS", 2399)
    assert refine("--masks", "a.tif") == 2
    assert "40 × 60 px are too large" in capsys.readouterr().err
    assert engine.calls == []


def test_existing_files_are_replaced_when_asked(folder: Path, engine: FakeEngine) -> None:
    Path("labels.csv").write_text("mine")
    assert refine() == 2
    assert Path("labels.csv").read_text() == "mine"
    assert refine("--overwrite") == 0
    assert len(read_labels("labels.csv").labels) == 4


def test_unreadable_files_are_one_sentence(
    folder: Path, engine: FakeEngine, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("sketches.csv").write_text("a,b\n")
    assert refine() == 2
    error = capsys.readouterr().err
    assert error.startswith(
        "napari-splinesketch refine: sketches.csv, line 1: no column curve, row, col"
    )
    assert "Traceback" not in error
    os.remove("sketches.csv")
    assert refine() == 2
    assert "sketches.csv: No such file" in capsys.readouterr().err


def test_progress_never_falls_and_reaches_every_frame(folder: Path, engine: FakeEngine) -> None:
    from napari_splinesketch.cli.jobs import RefineJob
    from napari_splinesketch.cli.refining import run

    seen: list[tuple[float, int]] = []
    job = RefineJob(image="film.tif", sketches=Path("sketches.csv"), output=Path("labels.csv"))
    run(job, lambda done, total: seen.append((done, total)))
    assert [done for done, _ in seen] == [0.5, 1, 1.5, 2, 2.5, 3]
    assert {total for _, total in seen} == {3}


def test_the_labels_say_where_they_come_from(folder: Path, engine: FakeEngine) -> None:
    import hashlib

    from napari_splinesketch.images.frames import checksum

    refine("--masks", "m.tif")
    with tifffile.TiffFile("m.tif") as file:
        told = json.loads(file.pages[0].description)["provenance"]  # pyright: ignore
    assert told["preset"] == "balanced"
    assert told["image"]["shape"] == [40, 60]
    assert told["image"]["name"] == "film.tif"
    assert list(told["image"]["sha256"]) == ["0", "1", "3"]
    assert told["image"]["sha256"]["1"] == checksum(film(4)[1])
    assert checksum(film(1)[0]) == hashlib.sha256(film(1)[0].astype("<u2").tobytes()).hexdigest()
    assert time.strftime("%Y") in told["date"]


PEAKS = """
import sys
import tracemalloc

import napari_splinesketch
from napari_splinesketch.cli import main
from fakes import FakeEngine

engine = FakeEngine()


def forgetful(*given, **options):
    engine.calls.clear()
    return engine(*given, **options)


napari_splinesketch.refine = forgetful
for image, ending in ((image, ending) for ending in (".csv", ".geojson") for image in sys.argv[1:]):
    if image != sys.argv[1]:  # the first one imports
        tracemalloc.start()
    outputs = ["--reconstruction", f"{image}.r.tif", "--masks", f"{image}.m.tif"]
    command = ["refine", image, f"{image}.sketches.csv", "-o", image + ending, *outputs]
    assert main([*command, "--overwrite"]) == 0
    if image != sys.argv[1]:
        print(tracemalloc.get_traced_memory()[1], file=sys.stderr)
        tracemalloc.stop()
"""


@pytest.mark.slow
def test_memory_does_not_grow_with_the_film(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    images = []
    for count in (3, 15, 45):
        images.append(f"{count}.tif")
        tifffile.imwrite(images[-1], film(count, (64, 64)), photometric="minisblack")
        sketches = [
            Label.from_sketch(LINE, frame=i, identity=j) for i in range(count) for j in (0, 1)
        ]
        write_labels(f"{images[-1]}.sketches.csv", Labels(tuple(sketches)))
    # In a process of its own: other tests leave threads behind, whose memory would be counted too.
    done = subprocess.run(
        [sys.executable, "-c", PEAKS, *images],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), *sys.path])},
        capture_output=True,
        text=True,
        check=True,
    )
    peaks = [int(line) for line in done.stderr.splitlines() if line.isdigit()]
    assert len(peaks) == 4
    # 30 further frames are 250,000 bytes of pixels, twice as much of reconstruction, and labels
    # of 340,000 bytes; tifffile keeps about 2,000 bytes a page.
    for short, long in (peaks[:2], peaks[2:]):
        assert long < short + 130_000

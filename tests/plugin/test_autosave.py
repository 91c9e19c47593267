"""Work that is not lost: saved while it is done, found again, brought back."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
import tifffile
from napari.components import ViewerModel
from npe2 import PluginManifest

from napari_splinesketch.plugin import saver, sessions
from napari_splinesketch.plugin.dock import SplinesketchDock

from .bench import saved_files
from .fakes import FakeEngine
from .hand import QTest, add_dock, click, drawn, refine, until

SCRIPT = Path(__file__).with_name("work_until_killed.py")
LINES = [np.array([[20.0, 20], [20, 60]]), np.array([[50.0, 30], [60, 70], [80, 80]])]
SOON = 20.0


@pytest.fixture(autouse=True)
def napari_s_own_reader(npe2pm: Any) -> None:
    """Let napari open images, which its fixtures prevent."""
    npe2pm.register(PluginManifest.from_distribution("napari"))


def image_file(folder: Path, seed: int = 0, name: str = "worms.tif", **size: Any) -> Path:
    rng = np.random.default_rng(seed)
    shape = size.get("shape", (96, 128))
    tifffile.imwrite(
        folder / name, rng.normal(100, 5, shape).astype(np.float32), photometric="minisblack"
    )
    return folder / name


def saved_in(folder: Path) -> list[Path]:
    return saved_files(folder, "session.json")


def take_away(dock: SplinesketchDock) -> None:
    """Take a dock out of its window, as napari does with one that is closed."""
    dock.setParent(None)
    dock.hide()
    dock.close_work()


def add_lines(layer: Any, lines: list[np.ndarray]) -> None:
    """Draw lines on frame 1."""
    layer.add_paths([np.column_stack([np.ones(len(line)), line]) for line in lines])


def curves_in(folder: Path) -> int:
    found = saved_in(folder)
    return json.loads(found[-1].read_text(encoding="utf-8"))["curves"] if found else 0


def sketches_in(folder: Path) -> int:
    found = saved_in(folder)
    return json.loads(found[-1].read_text(encoding="utf-8"))["sketches"] if found else 0


@pytest.mark.slow
def test_a_killed_process_loses_nothing_older_than_two_seconds(
    tmp_path: Path, viewer: Any, fake: FakeEngine
) -> None:
    path = image_file(tmp_path)
    process = subprocess.Popen([sys.executable, SCRIPT, path], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    said = next(line for line in process.stdout if line.startswith("["))
    next(line for line in process.stdout if line.startswith("kill me"))
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    process.stdout.close()
    lines = json.loads(said)
    viewer.open(path)
    dock = add_dock(viewer)
    until(lambda: dock.offer.isVisible(), SOON)
    assert "3 sketches and 2 curves" in dock.offer.said.text()
    click(dock.offer.resume)
    until(lambda: dock.controller.records() and not dock.controller.progress, SOON)
    until(lambda: "worms curves" in viewer.layers, SOON)
    sketches = dock.controller.sketches
    assert sketches is not None
    for found, line in zip(drawn(sketches), lines, strict=True):
        np.testing.assert_allclose(found, line, atol=2e-3)
    assert [record.review for record in dock.controller.records()] == ["open", "accepted"]
    assert dock.refine.text() == "Refine 1 new line"
    until(lambda: not dock.offer.isVisible(), SOON)


def test_saved_work_goes_on_where_it_was(tmp_path: Path, viewer: Any, fake: FakeEngine) -> None:
    place = {"scale": (1, 0.5, 0.25), "translate": (0, 3, -4), "units": ("s", "um", "um")}
    path = image_file(tmp_path, shape=(3, 96, 128))
    (image,) = viewer.open(path, **place)
    dock = add_dock(viewer)
    viewer.dims.set_point(0, 1)
    click(dock.draw)
    first = cast(Any, dock.controller.sketches)
    add_lines(first, LINES)
    refine(dock)
    until(lambda: curves_in(tmp_path) == 2, SOON)
    wanted, records = drawn(first), dock.controller.records()
    take_away(dock)
    other = ViewerModel()
    other.open(path, **place)
    again = add_dock(other)
    until(lambda: again.offer.isVisible(), SOON)
    click(again.offer.resume)
    until(lambda: again.controller.records() and not again.controller.progress, SOON)
    layer = cast(Any, again.controller.sketches)
    assert layer.name == "worms sketches"
    np.testing.assert_array_equal(layer.scale, image.scale)
    for found, line in zip(drawn(layer), wanted, strict=True):
        np.testing.assert_allclose(found, line, atol=1e-4)
    for found, record in zip(again.controller.records(), records, strict=True):
        np.testing.assert_array_equal(found.curve.points, record.curve.points)
    assert again.refine.text() == "Refine"
    until(lambda: "worms reconstruction" in other.layers, SOON)
    film, wanted_film = (v.layers["worms reconstruction"] for v in (other, viewer))
    np.testing.assert_array_equal(np.asarray(film.data), np.asarray(wanted_film.data))
    np.testing.assert_array_equal(film.translate, wanted_film.translate)
    other.dims.set_point(0, 1)
    add_lines(layer, [LINES[0] + 15])
    until(lambda: sketches_in(tmp_path) == 3, SOON)
    assert len(saved_in(tmp_path)) == 1
    assert [path.name for path in saved_files(tmp_path, "*.npz")] == ["frame-000000001.npz"]
    assert again.controller.work is not None
    assert not again.controller.work.history.done, "Undo does not take yesterday back"


def test_starting_anew_keeps_the_old_files(
    tmp_path: Path, viewer: Any, dock: SplinesketchDock
) -> None:
    path = image_file(tmp_path)
    viewer.open(path)
    viewer.add_shapes(LINES, shape_type=["line", "path"], name="worms sketches")
    refine(dock)
    until(lambda: curves_in(tmp_path) == 2, SOON)
    take_away(dock)
    other = ViewerModel()
    other.open(path)
    again = add_dock(other)
    until(lambda: again.offer.isVisible(), SOON)
    click(again.offer.decline)
    assert not again.offer.isVisible()
    assert len(list(tmp_path.glob("*.splinesketch/1.old/frame-*.json"))) == 1
    third = ViewerModel()
    third.open(path)
    last = add_dock(third)
    until(lambda: last.saver.place, SOON)
    assert not last.offer.isVisible()


def test_another_image_of_the_same_name_is_another_image(
    tmp_path: Path, viewer: Any, dock: SplinesketchDock
) -> None:
    viewer.open(image_file(tmp_path))
    viewer.add_shapes(LINES, shape_type=["line", "path"])
    refine(dock)
    until(lambda: curves_in(tmp_path) == 2, SOON)
    take_away(dock)
    other = ViewerModel()
    other.open(image_file(tmp_path, seed=1))
    again = add_dock(other)
    until(lambda: again.saver.place, SOON)
    assert not again.offer.isVisible()


def test_images_without_a_file_are_kept_with_the_users_data(
    viewer: Any, dock: SplinesketchDock
) -> None:
    home = Path(os.environ["XDG_DATA_HOME"]) / "napari-splinesketch" / "sessions"
    pixels = np.random.default_rng(0).normal(100, 5, (96, 128))
    viewer.add_image(pixels, name="cells")
    QTest.qWait(2 * saver.DELAY_MS)
    assert not home.exists()
    viewer.add_shapes(LINES, shape_type=["line", "path"])
    refine(dock)
    until(lambda: curves_in(home) == 2, SOON)
    other = ViewerModel()
    other.add_image(pixels, name="cells again")
    again = add_dock(other)
    until(lambda: again.offer.isVisible(), SOON)


def test_a_folder_that_cannot_be_written_to_is_said(
    tmp_path: Path, viewer: Any, dock: SplinesketchDock, monkeypatch: pytest.MonkeyPatch
) -> None:
    real, broken = sessions.atomic, [True]

    def full(*arguments: Any, **options: Any) -> Any:
        if broken[0]:
            raise OSError("No space left on device")
        return real(*arguments, **options)

    monkeypatch.setattr(sessions, "atomic", full)
    viewer.open(image_file(tmp_path))
    layer = viewer.add_shapes(LINES, shape_type=["line", "path"])
    layer.data = [line + 1 for line in LINES]
    until(lambda: "No space left" in dock.offer.problem.text(), SOON)
    broken[0] = False
    layer.data = [line + 2 for line in LINES]
    until(lambda: sketches_in(tmp_path) == 2, SOON)
    until(lambda: not dock.offer.isVisible(), SOON)


def test_damaged_work_never_stops_the_dock(
    tmp_path: Path, viewer: Any, dock: SplinesketchDock
) -> None:
    path = image_file(tmp_path)
    viewer.open(path)
    viewer.add_shapes(LINES, shape_type=["line", "path"])
    refine(dock)
    until(lambda: curves_in(tmp_path) == 2, SOON)
    take_away(dock)
    (head,) = saved_in(tmp_path)
    page = head.with_name("frame-000000000.json")
    page.write_bytes(page.read_bytes()[:300])
    other = ViewerModel()
    other.open(path)
    again = add_dock(other)
    until(lambda: again.offer.isVisible(), SOON)
    click(again.offer.resume)
    until(lambda: "kept on disk" in again.notice.text(), SOON)
    assert page.stat().st_size == 300
    head.write_text("{", encoding="utf-8")
    third = ViewerModel()
    third.open(path)
    last = add_dock(third)
    until(lambda: "could not be read" in last.offer.problem.text(), SOON)
    assert last.draw.isEnabled()

"""How things end: cancelled, written, without their layers, with Python."""

import os
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from napari.layers import Image
from napari.layers._source import Source

from napari_splinesketch import raster
from napari_splinesketch.engine.types import Progress
from napari_splinesketch.labels import Label, Labels, read_labels
from napari_splinesketch.labels.formats import WRITERS
from napari_splinesketch.plugin import columns, files

from .bench import SOON, Bench, bench
from .fakes import FakeEngine
from .hand import QTest, until

EXIT = """
import napari, numpy as np
from napari_splinesketch.plugin import engine
engine.warm_up = lambda report: None
from napari_splinesketch.plugin.dock import SplinesketchDock
viewer = napari.Viewer(show=False)
viewer.add_image(np.zeros((60, 70)))
viewer.window.add_dock_widget(SplinesketchDock(viewer))
viewer.add_shapes([[[5, 5], [40, 40]]], shape_type="line", name="sketches")
"""
NO_THREADS = """
import atexit, threading
def refuse(thread): raise RuntimeError("can't create new thread at interpreter shutdown")
atexit.register(setattr, threading.Thread, "start", refuse)
"""  # as Python does since 3.12, before it calls what is registered


@pytest.fixture
def ready(qapp: Any, fake: FakeEngine) -> Any:
    """A bench with an image and two lines."""
    with bench() as made:
        made.image()
        made.sketches()
        yield made


def test_what_has_ended_cannot_be_cancelled(ready: Bench) -> None:
    controller, ended = ready.controller, []
    controller.start(lambda report: 1, ended.append, "Suggesting")
    assert controller.job
    until(lambda: ended, SOON)
    assert not controller.job
    controller.cancel()
    assert controller.notice.text == ""
    assert controller.progress is not None, "it is still being shown"


@pytest.mark.parametrize("name", ["image 0", "sketches"])
def test_a_layer_removed_while_refining_ends_it_at_once(
    ready: Bench, fake: FakeEngine, name: str
) -> None:
    fake.go.clear()
    ready.controller.refine()
    until(lambda: fake.calls, SOON)
    ready.viewer.layers.remove(ready.viewer.layers[name])
    assert ready.controller.progress is None
    assert ready.controller.notice.text == f"{name!r} was removed: what was running on it ended."
    until(lambda: fake.calls[0].get("cancelled"), SOON)
    assert len(ready.viewer.layers) == 1


def test_results_of_an_image_go_with_it(ready: Bench) -> None:
    ready.refine()
    assert len(ready.viewer.layers) > 2
    ready.viewer.layers.remove(ready.viewer.layers["image 0"])
    until(lambda: len(ready.viewer.layers) == 1, SOON)
    assert ready.viewer.layers[0].name == "sketches"


def test_lines_removed_soon_after_undo_end_nothing(ready: Bench) -> None:
    ready.refine()
    ready.controller.undo()
    assert ready.controller.drawing.runs, "what was undone is still being shown"
    ready.viewer.layers.remove(ready.viewer.layers["sketches"])
    assert "ended" not in ready.controller.notice.text


@pytest.mark.parametrize("name", ["image 0", "sketches"])
def test_a_layer_removed_while_curves_are_drawn_leaves_none(ready: Bench, name: str) -> None:
    ready.controller.refine()
    until(lambda: len(ready.viewer.layers) > 2, SOON)
    ready.viewer.layers.remove(ready.viewer.layers[name])
    assert "was removed" in ready.controller.notice.text
    QTest.qWait(150)
    assert len(ready.viewer.layers) == 1
    assert ready.controller.progress is None


def test_rejected_curves_are_left_out_and_counted(ready: Bench, tmp_path: Path) -> None:
    ready.refine()
    controller, path = ready.controller, tmp_path / "a.csv"
    controller.review("rejected", (0, 1))
    controller.export(path)
    ready.rest()
    assert [(one.curve, one.review) for one in read_labels(path).labels] == [(2, "open")]
    assert controller.notice.text == "Saved 1 curve to a.csv, without 1 rejected curve."
    controller.export(tmp_path / "a.masks.tif")
    ready.rest()
    assert set(np.unique(tifffile.imread(tmp_path / "a.masks.tif"))) == {0, 3}
    controller.review("rejected", (0, 2))
    controller.export(tmp_path / "b.csv")
    assert controller.notice.text == "Nothing was saved: 2 curves here, all rejected."
    assert not (tmp_path / "b.csv").exists()


def test_export_leaves_the_window_alive_and_can_be_cancelled(
    ready: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ready.refine()
    threads, go, real = [], threading.Event(), files.write_labels

    def slow(*arguments: Any, **options: Any) -> Any:
        threads.append(threading.current_thread())
        go.wait(SOON)
        return real(*arguments, **options)

    monkeypatch.setattr(files, "write_labels", slow)
    ready.controller.export(tmp_path / "a.masks.tif")
    until(lambda: threads, SOON)
    ready.controller.cancel()
    assert ready.controller.notice.text == "Cancelled. Nothing was written."
    go.set()
    threads[0].join()
    assert threads[0] is not threading.main_thread()
    assert not list(tmp_path.iterdir())


WIDE = Label(0, 1, np.array([[10.0, 10], [3000, 3000]]), np.full(2, 9.0), np.ones(2), "good")


def test_cancel_ends_an_export_within_a_large_mask(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[Any] = []
    shares: list[float] = []
    real = raster.rasterise

    def counted(*given: Any) -> Any:
        drawn.append(given)
        return real(*given)

    def until_there(progress: Progress) -> bool:
        shares.append(progress.fraction)
        return progress.fraction < 0.6

    monkeypatch.setattr(raster, "rasterise", counted)
    labels = Labels((WIDE,), shape=(3072, 3072))
    with pytest.raises(files.CancelledError):
        files.export(tmp_path / "a.masks.tif", labels, until_there)
    cancelled, drawn[:] = len(drawn), []
    assert shares == sorted(shares)
    assert not list(tmp_path.iterdir())
    files.export(tmp_path / "a.masks.tif", labels, lambda progress: True)
    assert 8 < cancelled < len(drawn) - 4


@pytest.mark.parametrize("ending", [writer.suffix for writer in WRITERS])
def test_cancel_at_the_last_moment_leaves_no_file(tmp_path: Path, ending: str) -> None:
    labels = Labels((WIDE,), shape=(3072, 3072))
    asked: list[Progress] = []
    files.export(tmp_path / f"a{ending}", labels, asked.append)
    (tmp_path / f"a{ending}").unlink()
    often, asked[:] = len(asked), []

    def until_the_end(progress: Progress) -> bool:
        asked.append(progress)
        return len(asked) < often

    with pytest.raises(files.CancelledError):
        files.export(tmp_path / f"a{ending}", labels, until_the_end)
    assert asked[-1].fraction == 1.0
    assert not list(tmp_path.iterdir())


def test_an_image_that_is_open_is_not_exported_over(ready: Bench, tmp_path: Path) -> None:
    path, link = tmp_path / "a.masks.tif", tmp_path / "b.masks.tif"
    tifffile.imwrite(path, np.zeros((9, 9), np.uint8))
    before = path.read_bytes()
    link.symlink_to(path)
    image = Image(np.zeros((9, 9)), name="other")
    image._set_source(Source(path=str(path)))
    ready.viewer.add_layer(image)
    first = ready.controller.layers(Image)[-1]
    assert first.name == "image 0"
    ready.controller.image = first
    ready.refine()
    for each in (path, link):
        ready.controller.export(each)
        ready.rest()
        assert ready.controller.notice.text.startswith(f"Not saved: {each.name} is an image")
    assert path.read_bytes() == before


def test_what_cannot_be_shown_ends_what_runs(
    ready: Bench, fake: FakeEngine, monkeypatch: pytest.MonkeyPatch
) -> None:
    ready.refine()
    fake.go.clear()
    ready.controller.refine("all")
    until(lambda: len(fake.calls) == 2, SOON)

    def broken(*arguments: Any, **named: Any) -> Any:
        raise ValueError("napari does not like it")

    with monkeypatch.context() as patched:
        patched.setattr(columns, "rows_of", broken)
        ready.controller.review("accepted", (0, 1))
        until(lambda: ready.controller.progress is None, SOON)
    assert "napari does not like it" in ready.controller.notice.text
    assert not ready.controller.job
    until(lambda: fake.calls[-1].get("cancelled", False), SOON)
    ready.controller.undo()
    ready.rest()
    assert [record.review for record in ready.controller.records()] == ["open"] * 2


def test_what_could_not_be_written_is_said(ready: Bench, tmp_path: Path) -> None:
    ready.refine()
    ready.controller.export(tmp_path / "no such folder" / "a.csv")
    ready.rest()
    said = ready.controller.notice.text
    assert said.startswith("Not saved: ") and "Errno" not in said


@pytest.mark.slow
@pytest.mark.parametrize("late", ["", NO_THREADS])
def test_python_ends_well_with_the_window_open(tmp_path: Path, qapp: Any, late: str) -> None:
    environment = {**os.environ, "XDG_DATA_HOME": str(tmp_path)}
    ended = subprocess.run(
        [sys.executable, "-c", EXIT + late], env=environment, capture_output=True, text=True
    )
    assert ended.returncode == 0, ended.stderr
    assert "deleted" not in ended.stderr
    (head,) = tmp_path.rglob("session.json")
    assert '"sketches": 1' in head.read_text()

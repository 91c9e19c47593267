"""Nothing that the user had is gone: saving, closing, resuming, two windows, damaged files."""

import errno
import gc
import json
import os
import shutil
import subprocess
import sys
import threading
import weakref
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from napari.components import ViewerModel
from napari.layers import Image, Shapes
from napari.layers._source import Source
from napari.utils.key_bindings import coerce_keybinding

from napari_splinesketch.files import BusyError
from napari_splinesketch.plugin import engine, saver
from napari_splinesketch.plugin import sessions as folder
from napari_splinesketch.plugin.layers.drawn import shapes_in

from .bench import LINES, SOON, Bench, bench, saved_files
from .fakes import FakeEngine
from .hand import QTest, until

HEADS = "*.splinesketch/*/session.json"


@pytest.fixture
def home(qapp: Any, fake: FakeEngine) -> Path:
    """Where work is saved on images that came from no file."""
    return Path(os.environ["XDG_DATA_HOME"]) / "napari-splinesketch" / "sessions"


def heads(home: Path) -> list[dict[str, Any]]:
    return [json.loads(path.read_text()) for path in saved_files(home, HEADS)]


def counts(home: Path) -> list[tuple[int, int]]:
    """(sketches, curves) of every session that is offered."""
    return [(head["sketches"], head["curves"]) for head in heads(home)]


def test_resuming_two_layers_keeps_the_curves_of_both(home: Path) -> None:
    with bench() as first:
        first.image()
        for name in ("one", "two"):
            first.sketches(name=name)
            first.refine()
    assert counts(home) == [(2, 2), (2, 2)]
    files = saved_files(home)
    with bench() as again:
        again.image()
        again.resume()
        QTest.qWait(2 * saver.DELAY_MS)
        assert len(again.controller.works) == 2
        assert counts(home) == [(2, 2), (2, 2)]
    assert counts(home) == [(2, 2), (2, 2)]
    assert saved_files(home) == files, "pictures too"


def test_a_layer_that_is_not_chosen_is_saved_as_well(home: Path) -> None:
    with bench() as first:
        first.image()
        one = first.sketches(name="one")
        first.refine()
        first.sketches(LINES[:1], name="two")
        first.saver.flush()
        one.add_paths([LINES[0] + 9])
    assert sorted(counts(home)) == [(1, 0), (3, 2)]


def test_layers_drawn_one_after_the_other_are_all_saved(home: Path) -> None:
    with bench() as first:
        first.image()
        for name in ("one", "two", "three"):
            first.sketches(name=name)
    assert counts(home) == [(2, 0)] * 3


def test_what_is_drawn_while_a_write_is_running_is_written_too(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    go, begun, real = threading.Event(), threading.Event(), folder.Folder.write

    def slow(self: Any, *session: Any) -> None:
        begun.set()
        go.wait(SOON * (threading.current_thread() is not threading.main_thread()))
        real(self, *session)

    with bench() as first:
        first.image()
        layer = first.sketches()
        monkeypatch.setattr(folder.Folder, "write", slow)
        monkeypatch.setattr(engine, "PATIENCE", 0.01)  # far less than the write takes
        until(begun.is_set, SOON)
        layer.add_paths([LINES[0] + 9])
        threading.Timer(0.2, go.set).start()
    QTest.qWait(300)  # nothing is written over it
    assert counts(home) == [(3, 0)]


def test_what_is_drawn_before_the_image_is_known_is_written_too(home: Path) -> None:
    with bench() as first:
        first.image()
        first.sketches()
    assert counts(home) == [(2, 0)]


def test_a_layer_is_saved_before_it_goes(home: Path) -> None:
    with bench() as first:
        first.begin()
        first.viewer.layers.clear()
        QTest.qWait(20)
        assert not first.controller.notice.text, "nor is Undo promised for what it cannot reach"
        assert not first.controller.drawing.runs
    assert counts(home) == [(2, 2)]


def test_a_folder_that_is_away_is_said_and_never_stops_the_dock(home: Path) -> None:
    with bench() as first:
        first.image()
        layer = first.sketches()
        until(lambda: counts(home) == [(2, 0)], SOON)
        away = home.rename(home.with_name("away"))
        layer.add_paths([LINES[0] + 9])
        until(lambda: "could not be saved" in first.saver.problem, SOON)
        assert first.saver.place is None, "nor does the dock say that it is saved there"
        away.rename(home)
        until(lambda: counts(home) == [(3, 0)], SOON)
        home.rename(away)
    assert not counts(home), "and the dock is closed"


def test_an_image_that_could_not_be_read_is_saved_with_the_next_edit(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real, broken = saver._checksums, [True]

    def checksums(*image: Any) -> Any:
        if broken[0]:
            raise OSError("the disk is away")
        return real(*image)

    monkeypatch.setattr(saver, "_checksums", checksums)
    with bench() as first:
        first.image()
        until(lambda: "the disk is away" in first.saver.problem, SOON)
        broken[0] = False
        first.sketches()
        until(lambda: counts(home) == [(2, 0)], SOON)
        until(lambda: not first.saver.problem, SOON)


def test_an_image_that_takes_long_to_read_keeps_no_other_from_being_saved(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real, go = saver._checksums, threading.Event()
    with bench() as first:
        first.image()
        layer = first.sketches()
        until(lambda: counts(home) == [(2, 0)], SOON)
        monkeypatch.setattr(saver, "_checksums", lambda *image: go.wait(SOON) and real(*image))
        first.image(seed=1)
        layer.add_paths([LINES[0] + 9])
        until(lambda: counts(home) == [(3, 0)], SOON / 2)
        go.set()
    assert counts(home) == [(3, 0), (3, 0)], "and this one is, too"


@pytest.mark.slow
@pytest.mark.garbage
def test_removed_images_are_let_go_of(home: Path, fake: FakeEngine) -> None:
    gone = []
    with bench() as first:
        for seed in range(3):
            shape = (96, 128, 3) if seed == 2 else (96, 128)  # one in colour
            gone.append(weakref.ref(first.image(shape, seed)))
            first.sketches(name=f"sketches {seed}")
            first.refine()
            first.viewer.layers.clear()
        fake.calls.clear()
        until(lambda: gc.collect() >= 0 and all(one() is None for one in gone), SOON)


@pytest.mark.garbage
def test_a_closed_dock_hears_nothing_more(home: Path) -> None:
    viewer = ViewerModel()
    with bench(viewer) as first:
        first.begin()
        old, layers = weakref.ref(first.controller), list(viewer.layers)
    del first
    with bench(viewer) as again:
        until(lambda: gc.collect() >= 0 and old() is None, SOON)  # once its threads have ended
        until(lambda: again.saver.place, SOON)
        assert not again.saver.offers(), "it is in the window"
        curves: Any = viewer.layers["sketches curves"]
        again.controller.delete((0, 1))
        until(lambda: len(again.controller.records()) == 1, SOON)
        until(lambda: curves.nshapes == 1, SOON)
        assert list(viewer.layers) == layers
    assert counts(home) == [(2, 1)]


def test_curves_are_drawn_that_were_not_when_the_dock_was_closed(home: Path) -> None:
    viewer = ViewerModel()
    with bench(viewer) as first:
        first.image()
        first.sketches()
        first.controller.refine()
        until(first.controller.records, SOON)
    with bench(viewer) as again:
        until(lambda: not again.controller.drawing.runs, SOON)
        curves: Any = viewer.layers["sketches curves"]
        assert curves.nshapes == 2


def test_lines_removed_while_the_dock_is_closed_are_offered_again(home: Path) -> None:
    viewer = ViewerModel()
    with bench(viewer) as first:
        first.image()
        layer = first.sketches()
        first.refine()
    viewer.layers.remove(layer)
    with bench(viewer) as again:
        assert not again.controller.works
        again.resume()
        assert len(again.controller.records()) == 2
    assert counts(home) == [(2, 2)]


def test_lines_removed_while_the_dock_is_open_are_offered_as_they_were(home: Path) -> None:
    with bench() as made:
        made.image()
        layer = made.sketches(LINES[:1])
        made.refine()
        made.saver.flush()
        layer.add(LINES[1], shape_type="path")
        made.refine()
        made.viewer.layers.remove(layer)
        (head,) = made.saver.offers().values()
        assert (head.sketches, head.curves) == (2, 2)
        made.resume()
        assert len(made.controller.records()) == 2
        assert not made.saver.offers()
    assert counts(home) == [(2, 2)]


def test_results_of_lines_that_were_removed_stay_and_are_taken_up_again(home: Path) -> None:
    with bench() as made:
        made.begin()
        controller, layers = made.controller, made.viewer.layers
        until(lambda: not controller.drawing.runs, SOON)
        curves: Any = layers["sketches curves"]
        made.sketches(LINES[:1], name="others")
        made.refine()
        controller.select([(0, 1)])
        layers.remove(layers["sketches"])
        curves.keymap[coerce_keybinding("Delete")](curves)
        assert len(controller.records()) == 1, "it means no curve of the others"
        there = set(layers)
        made.resume()
        until(lambda: not controller.drawing.runs, SOON)
        assert set(layers) == {*there, layers["sketches"]}, "nothing is there twice"
        assert controller.steps.done == ""
        controller.delete((0, 2))
        until(lambda: curves.nshapes == 1, SOON)
        layers.remove(curves)
        until(lambda: not controller.records(), SOON)
    assert sorted(counts(home)) == [(1, 1), (2, 0)]


def test_results_of_removed_lines_that_went_too_are_made_again(home: Path) -> None:
    with bench() as made:
        made.begin()
        until(lambda: not made.controller.drawing.runs, SOON)
        for name in ("sketches", "sketches curves"):
            made.viewer.layers.remove(made.viewer.layers[name])
        made.resume()
        until(lambda: not made.controller.drawing.runs, SOON)
        curves: Any = made.viewer.layers["sketches curves"]
        assert curves.nshapes == 2
    assert counts(home) == [(2, 2)]


def test_lines_without_curves_are_known_when_the_dock_is_opened_again(home: Path) -> None:
    viewer = ViewerModel()
    with bench(viewer) as first:
        first.image()
        layer = first.sketches(LINES[:1], name="not chosen")
        first.sketches()
        first.saver.flush()
    with bench(viewer) as again:
        until(lambda: again.saver.place, SOON)
        assert not again.saver.offers(), "they are in the window"
        layer.add(LINES[1], shape_type="path")
    assert counts(home) == [(2, 0), (2, 0)]


def test_metadata_of_layers_hold_nothing_but_text(home: Path) -> None:
    with bench() as made:
        made.begin()
        until(lambda: not made.controller.drawing.runs, SOON)
        assert len(made.viewer.layers) > 4
        for layer in made.viewer.layers:
            json.dumps(layer.metadata)


def test_two_windows_never_write_into_one_folder(home: Path) -> None:
    with bench() as first:
        first.image()
        first.sketches(name="mine")
        first.refine()
        first.saver.flush()
        with bench() as second:
            second.image()
            until(second.saver.offers, SOON)
            second.resume()
            assert "open in another window" in second.controller.notice.text
            assert not second.controller.works
            second.sketches(LINES[:1], name="yours")
            second.refine()
            second.saver.flush()
            first.sketches(LINES[:1], name="more")
            first.refine()
            first.saver.flush()
            assert sorted(counts(home)) == [(1, 1), (1, 1), (2, 2)]
    assert sorted(head["layer"] for head in heads(home)) == ["mine", "more", "yours"]
    with bench() as third:
        third.image()
        third.resume()
        assert len(third.controller.works) == 3


HOLD = """
import sys, time
from pathlib import Path
from napari_splinesketch.plugin.sessions import Folder
held = Folder(Path(sys.argv[1]))
print("held", flush=True)
time.sleep(60)
"""


def test_folders_of_processes_that_are_gone_are_taken_over(home: Path) -> None:
    with bench() as first:
        first.image()
        first.sketches()
    (path,) = home.glob("*/*")
    command = [sys.executable, "-c", HOLD, str(path)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "held\n"
    with pytest.raises(BusyError, match=f"process {process.pid} on "):
        folder.Folder(path)
    process.kill()
    process.wait()
    process.stdout.close()
    folder.Folder(path).release()


def test_a_page_beyond_the_film_is_left_out_and_said(home: Path) -> None:
    with bench() as first:
        first.begin()
    (page,) = home.glob("*/*/frame-000000000.json")
    page.with_name("frame-000000007.json").write_text(page.read_text())
    with bench() as again:
        again.image()
        again.resume()
        assert (
            "frame-000000007.json: is beyond the image, of 1 frame" in again.controller.notice.text
        )
        assert len(again.controller.records()) == 2


def test_work_that_went_on_elsewhere_is_offered_once(home: Path, tmp_path: Path) -> None:
    with bench() as first:
        first.begin()
    (page,) = home.glob("*/*/frame-000000000.json")
    page.with_name("frame-000000007.json").write_text(page.read_text())
    for curves in (2, 1):  # it is recovered, and gone on with elsewhere
        with bench() as again:
            again.image()
            until(again.saver.offers, SOON)
            (head,) = again.saver.offers().values()
            assert head.curves == curves
            again.resume()
            assert not again.saver.offers()
            again.controller.delete((0, curves))
    assert [curves for _, curves in counts(home)] == [2, 0], "what is older stays on the disk"
    with bench() as last:
        last.image()
        until(last.saver.offers, SOON)
        last.saver.decline()
        assert not last.saver.offers(), "nor is it offered when what it has become is not wanted"
    with bench() as other:
        other.image()
        until(lambda: other.saver.place, SOON)
        assert not other.saver.offers()


def test_work_that_was_saved_here_and_there_is_offered_once(home: Path, tmp_path: Path) -> None:
    with bench() as first:
        first.image()
        layer = first.sketches()
        for count, folder in enumerate(["", str(tmp_path), ""], 3):
            first.controller.choose(work_folder=folder)
            layer.add_paths([LINES[0] + 9 * count])
            first.saver.flush()
            assert not first.saver.offers(), "it is in the window"
    assert (counts(home), counts(tmp_path)) == ([(3, 0), (5, 0)], [(4, 0)])
    with bench() as again:
        again.image()
        until(again.saver.offers, SOON)
        assert [head.sketches for head in again.saver.offers().values()] == [5]


def test_what_two_windows_made_of_the_same_work_is_all_offered(home: Path) -> None:
    viewer = ViewerModel()
    with bench(viewer) as first:
        first.begin()
    with bench() as other:
        other.image()
        other.resume()
        with bench(viewer) as again:
            again.controller.delete((0, 1))
        other.controller.delete((0, 1), (0, 2))
    with bench() as last:
        last.image()
        until(lambda: len(last.saver.offers()) == 2, SOON)


def test_what_cannot_be_shown_never_stops_the_dock(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with bench() as first:
        first.image()
        first.sketches()
    files = {path: path.read_bytes() for path in saved_files(home)}

    def broken(*arguments: Any, **options: Any) -> Any:
        raise ValueError("napari does not like it")

    monkeypatch.setattr(saver, "add_shapes", broken)
    with bench() as again:
        again.image()
        again.resume()
        assert "napari does not like it" in again.controller.notice.text
        assert again.controller.progress is None
    assert {path: path.read_bytes() for path in files} == files


def test_curves_that_were_all_deleted_can_still_be_restored(home: Path) -> None:
    with bench() as first:
        first.begin()
        first.controller.delete((0, 1), (0, 2))
    with bench() as again:
        again.image()
        again.resume()
        assert len(again.controller.state.deleted) == 2
        assert not again.controller.request().targets
        again.controller.restore((0, 1), (0, 2))
        again.rest()
        assert [record.id for record in again.controller.records()] == [1, 2]


@pytest.mark.parametrize("turned", ["rotate", "shear", "affine"])
def test_flat_lines_over_a_turned_film_come_back_where_they_were(home: Path, turned: str) -> None:
    angle = np.deg2rad(30)
    turn = np.array([[np.cos(angle), -np.sin(angle), 5], [np.sin(angle), np.cos(angle), -7]])
    how = {"rotate": 30, "shear": [0.2], "affine": np.vstack([turn, [0, 0, 1]])}[turned]
    scale = (2.0, 0.5)
    pixels = np.random.default_rng(0).normal(100, 5, (3, 96, 128)).astype(np.float32)
    over: Any = {"affine": np.pad(how, ((1, 0), (1, 0)))} if turned == "affine" else {turned: how}
    if turned == "affine":
        over["affine"][0, 0] = 1
    if turned == "shear":
        over["shear"] = [0, 0, 0.2]

    def film(made: Bench) -> Image:
        image = Image(pixels, scale=(1, *scale), name="film", **over)
        made.viewer.add_layer(image)
        return image

    with bench() as first:
        image = film(first)
        layer = Shapes(LINES, shape_type="path", scale=scale, **{turned: how})
        first.viewer.add_layer(layer)
        before = [line for _, line in shapes_in(first.viewer, layer, image)]
        first.refine()
    with bench() as again:
        image = film(again)
        again.resume()
        layer = again.controller.sketches
        assert layer is not None and layer.ndim == 2
        after = [line for _, line in shapes_in(again.viewer, layer, image)]
        for one, other in zip(before, after, strict=True):
            np.testing.assert_allclose(one, other, atol=1e-3)
        assert not again.controller.request().targets


@pytest.mark.parametrize("inner", [False, True])
@pytest.mark.parametrize("renamed", [False, True])
def test_a_folder_that_is_deleted_or_renamed_is_written_anew(
    home: Path, tmp_path: Path, renamed: bool, inner: bool
) -> None:
    path = tmp_path / "worms.tif"
    with bench() as first:
        begin_on(first, path)
        first.saver.flush()
        (beside,) = tmp_path.glob("*.splinesketch/1" if inner else "*.splinesketch")
        if renamed:
            beside.rename(beside.with_name("mine.splinesketch"))
        else:
            shutil.rmtree(beside)
        first.controller.review("accepted", (0, 1))
        first.saver.flush()
        assert not first.saver.problem
    with bench() as again:
        again.viewer.add_layer(from_file(path))
        again.resume()
        assert [record.review for record in again.controller.records()] == ["accepted", "open"]
        assert len(again.controller.layers(Shapes)) == 1


def test_a_place_that_is_a_link_to_nowhere_is_said(home: Path, tmp_path: Path) -> None:
    home.parent.mkdir(parents=True)
    home.symlink_to(tmp_path / "drive")
    with bench() as first:
        first.begin()
        until(lambda: str(home) in first.saver.problem, SOON)
        (tmp_path / "drive").mkdir()
        until(lambda: not first.saver.problem, SOON)
    assert counts(home) == [(2, 2)]


def test_a_full_disk_is_not_filled_with_folders(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*given: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with bench() as first, monkeypatch.context() as patch:
        patch.setattr(os, "write", full)
        patch.setattr(folder, "atomic", full)
        first.begin()
        until(lambda: first.saver.problem, SOON)
        QTest.qWait(5 * saver.AGAIN_MS)
        (there,) = home.glob("*.splinesketch/*[0-9]")
        patch.undo()
    assert [path.parent for path in saved_files(home, HEADS)] == [there]


@pytest.mark.parametrize("left", [b"", b'{"software": "napari', None])
def test_a_folder_without_a_whole_head_is_offered(home: Path, left: bytes | None) -> None:
    with bench() as first:
        first.begin()
    (head,) = saved_files(home, HEADS)
    head.unlink()  # as it is while a folder is first written
    if left is not None:
        head.write_bytes(left)
    files = {path: path.read_bytes() for path in saved_files(home)}
    with bench() as again:
        again.image()
        again.resume()
        assert "session.json" in again.controller.notice.text
        assert len(again.controller.records()) == again.controller.layers(Shapes)[0].nshapes == 2
    assert files.items() <= {path: path.read_bytes() for path in saved_files(home)}.items()
    with bench() as last:
        last.image()
        until(lambda: last.saver.place, SOON)
        assert len(last.saver.offers()) == 1


def test_a_file_that_is_deleted_is_written_again(home: Path) -> None:
    with bench() as first:
        first.image((2, 96, 128))
        first.sketches()
        first.refine()
        first.saver.flush()
        (page,) = saved_files(home, "frame-every.json")
        page.unlink()
        first.controller.review("accepted", (0, 1))  # in another file
        first.saver.flush()
        assert page.exists()


def test_work_in_a_folder_that_is_read_only_by_now_goes_on_elsewhere(
    home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "worms.tif"
    with bench() as first:
        begin_on(first, path)
    (beside,) = tmp_path.glob("*.splinesketch")
    before = {file: file.read_bytes() for file in saved_files(beside)}
    real, access = folder.owned, os.access

    def owned(wanted: Path) -> Any:
        if tmp_path in Path(wanted).parents:
            raise PermissionError(13, "Permission denied", str(wanted))
        return real(wanted)

    def allowed(wanted: Path, mode: int) -> bool:
        return access(wanted, mode) and not (
            mode & os.W_OK and tmp_path in (wanted, *wanted.parents)
        )

    monkeypatch.setattr(folder, "owned", owned)
    monkeypatch.setattr(os, "access", allowed)
    with bench() as again:
        again.viewer.add_layer(from_file(path))
        again.resume()
        assert len(again.controller.records()) == 2
        assert again.controller.notice.text == ""
        again.controller.delete((0, 1))
    assert {file: file.read_bytes() for file in before} == before
    assert counts(home) == [(2, 1)]
    monkeypatch.undo()
    monkeypatch.setenv("XDG_DATA_HOME", str(home.parents[1]))
    with bench() as later:
        later.viewer.add_layer(from_file(path))
        until(later.saver.offers, SOON)
        (head,) = later.saver.offers().values()
        assert head.curves == 1, "what it has become; the older files stay where they are"
    assert {file: file.read_bytes() for file in before} == before


def test_an_image_with_the_longest_name_is_saved(home: Path, tmp_path: Path) -> None:
    path = tmp_path / f"{'ö' * 120}.tif"
    tifffile.imwrite(path, np.zeros((96, 128), np.float32))
    with bench() as first:
        first.viewer.add_layer(from_file(path))
        first.sketches()
        first.refine()
        first.saver.flush()
        assert first.saver.problem == ""
    assert list(tmp_path.glob("*.splinesketch"))


@pytest.mark.skipif(sys.platform != "linux", reason="other disks refuse such names")
def test_an_image_whose_name_is_no_text_is_saved(home: Path, tmp_path: Path) -> None:
    path = tmp_path / "worms \udcff.tif"  # a name that is not in UTF-8
    tifffile.imwrite(path, np.zeros((96, 128), np.float32))
    with bench() as first:
        first.viewer.add_layer(from_file(path))
        first.sketches(name="lines \udcff")
        first.refine()
        first.saver.flush()
        assert first.saver.problem == ""
    with bench() as again:
        again.viewer.add_layer(from_file(path))
        again.resume()
        assert len(again.controller.records()) == 2


def pyramid(seed: int) -> list[np.ndarray]:
    """Levels of an image of sparse dots, of which every eighth pixel shows none."""
    whole = np.random.default_rng(seed).random((128, 128), np.float32)
    whole[::8, ::8] = 0
    return [whole, whole[::2, ::2], whole[::8, ::8]]


def test_pyramids_are_told_apart_by_more_than_their_smallest_level(home: Path) -> None:
    with bench() as first:
        first.viewer.add_image(pyramid(0), multiscale=True, name="one")
        first.sketches()
        first.refine()
    with bench() as again:
        again.viewer.add_image(pyramid(1), multiscale=True, name="two")
        until(lambda: again.saver.place, SOON)
        assert not again.saver.offers()
    for path in saved_files(home, HEADS):  # as it was written by an earlier version
        head = json.loads(path.read_text())
        assert head["image"].pop("finer")
        path.write_text(json.dumps(head))
    with bench() as again:
        again.viewer.add_image(pyramid(0), multiscale=True, name="one")
        again.resume()
        assert len(again.controller.records()) == 2


def begin_on(made: Bench, path: Path) -> None:
    """Write an image, open it, sketch two bodies and refine them."""
    tifffile.imwrite(path, np.random.default_rng(0).random((96, 128), np.float32))
    made.viewer.add_layer(from_file(path))
    made.sketches()
    made.refine()


def from_file(path: Path) -> Image:
    """An image as napari opens it."""
    image = Image(tifffile.imread(path), name=path.stem)
    image._set_source(Source(path=str(path)))
    return image


def test_lines_that_go_to_another_image_leave_the_saved_work_of_the_first(home: Path) -> None:
    with bench() as first:
        old = first.image()
        first.sketches()
        first.refine()
        first.viewer.layers.remove(old)
        QTest.qWait(20)
        first.image(seed=1)
        first.saver.flush()
        first.saver.flush()
    assert sorted(counts(home)) == [(2, 0), (2, 2)]


def test_a_dock_that_is_opened_again_writes_nothing_anew(home: Path) -> None:
    viewer = ViewerModel()
    with bench(viewer) as first:
        first.begin()
    times = {path: path.stat().st_mtime_ns for path in saved_files(home)}
    assert any(path.suffix == ".npz" for path in times)
    with bench(viewer) as again:
        until(lambda: again.saver.place, SOON)
        again.saver.flush()
        assert {path: path.stat().st_mtime_ns for path in times} == times
    assert {path: path.stat().st_mtime_ns for path in times} == times


def test_work_that_another_window_went_on_with_is_left_to_it(home: Path) -> None:
    viewer = ViewerModel()
    with bench(viewer) as first:
        first.begin()
    with bench() as other:
        other.image()
        other.resume()
        other.controller.delete((0, 1))
    with bench(viewer) as again:
        until(again.saver.offers, SOON)
        again.controller.delete((0, 1), (0, 2))
    assert sorted(counts(home)) == [(2, 0), (2, 1)]


def test_curves_that_cannot_be_brought_back_stay_in_their_files(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with bench() as first:
        first.begin()
    files = {path: path.read_bytes() for path in saved_files(home)}

    def broken(what: str, state: Any) -> None:
        raise ValueError("napari does not like it")

    with bench() as again:
        again.image()
        monkeypatch.setattr(again.controller, "apply", broken)
        again.resume()
        assert "napari does not like it" in again.controller.notice.text
        until(lambda: counts(home) == [(2, 2), (2, 0)], SOON)
    assert {path: path.read_bytes() for path in files} == files


def test_an_image_from_another_file_has_lines_of_its_own(home: Path, tmp_path: Path) -> None:
    for number in range(2):
        tifffile.imwrite(tmp_path / f"{number}.tif", np.full((96, 128), number, np.float32))
    first, second = (from_file(tmp_path / f"{number}.tif") for number in range(2))
    with bench() as made:
        c = made.controller
        made.viewer.add_layer(first)
        lines = made.sketches()
        made.saver.flush()
        assert counts(tmp_path) == [(2, 0)]
        made.viewer.add_layer(second)
        assert (c.image, c.sketches) == (second, None)
        made.saver.flush()
        assert counts(tmp_path) == [(2, 0)], "those of the first image are none of this one's"
        c.draw()
        others = c.sketches
        assert others not in (None, lines)
        c.image = first
        assert c.sketches is lines
        c.image = second
        assert c.sketches is others
        made.viewer.add_image(np.ones((96, 128)), name="filtered")
        assert c.sketches is others, "what was made here may be of the same bodies"
        c.image, c.sketches = second, lines
        lines.add([[5, 10], [5, 60]], shape_type="line")
        made.saver.flush()
        saved = {head["image"]["name"]: head["sketches"] for head in heads(tmp_path)}
        assert saved == {"0": 3}, "of their own image, also where the user has chosen another"
        made.viewer.layers.remove(first)
        c.image, c.sketches = second, lines
        lines.add([[7, 10], [7, 60]], shape_type="line")
        made.saver.flush()
        saved = {head["image"]["name"]: head["sketches"] for head in heads(tmp_path)}
        assert saved == {"0": 3, "1": 4}, "their own is gone: nothing is lost"


def test_lines_whose_image_is_gone_go_to_no_other_by_themselves(home: Path, tmp_path: Path) -> None:
    for number in range(2):
        tifffile.imwrite(tmp_path / f"{number}.tif", np.full((96, 128), number, np.float32))
    first, second = (from_file(tmp_path / f"{number}.tif") for number in range(2))
    with bench() as made:
        for image in (first, second):
            made.viewer.add_layer(image)
            lines = made.sketches()
        made.saver.flush()
        made.viewer.layers.remove(first)
        made.viewer.layers.remove(lines)  # as closing the window does
        assert made.controller.sketches is None
        made.saver.flush()
        assert sorted(head["image"]["name"] for head in heads(tmp_path)) == ["0", "1"]


def test_lines_that_are_pasted_are_saved(home: Path) -> None:
    with bench() as made:
        made.image()
        lines = made.sketches()
        made.saver.flush()
        lines.mode, lines.selected_data = "select", {0}
        lines._copy_data()
        lines._paste_data()
        until(lambda: counts(home) == [(3, 0)], SOON)


def test_results_are_not_drawn_into_after_a_view_in_3d(home: Path) -> None:
    with bench() as made:
        made.begin()
        until(lambda: not made.controller.drawing.runs, SOON)
        work = made.controller.work
        assert work is not None
        for ndisplay in (3, 2):
            made.viewer.dims.ndisplay = ndisplay
            until(lambda: not made.controller.drawing.runs, SOON)
        for role in ("curves", "marks"):
            assert not work.layer(role).editable
        curves = work.layer("curves")
        curves.mode = "select"
        assert curves.mode == "pan_zoom", "a line that is moved there would be no curve"

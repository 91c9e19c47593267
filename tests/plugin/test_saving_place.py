"""Where work is saved is said, can be another folder, or nowhere."""

import json
import os
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from napari.layers import Image
from napari.layers._source import Source

from napari_splinesketch.plugin.dock import SplinesketchDock

from .bench import bench, saved_files
from .fakes import FakeEngine
from .hand import refine, until


def sessions(folder: Path) -> list[Path]:
    return saved_files(folder, "session.json")


def test_saved_work_is_announced_moved_and_switched_off(
    viewer: Any, dock: SplinesketchDock, tmp_path: Path, monkeypatch: Any
) -> None:
    viewer.add_image(np.random.default_rng(0).random((60, 80)), name="cells")
    until(lambda: dock.saver.place is not None, 20)
    first = dock.saver.place
    assert first is not None
    assert dock.saved.text().startswith("Saved in ")
    assert str(first) in dock.saved.toolTip()
    lines = viewer.add_shapes([[[10, 10], [10, 60]]], shape_type="line", name="lines")
    until(lambda: len(sessions(first)) == 1, 20)
    dock.controller.choose(work_folder=str(tmp_path))
    until(lambda: dock.saver.place is not None and dock.saver.place.parent == tmp_path, 20)
    until(lambda: len(sessions(tmp_path)) == 1, 20)
    assert not dock.saver.offers(), "the work that was saved there is in the window"
    refine(dock)
    dock.saver.flush()
    assert len(sessions(first)) == 1, "what was saved stays where it is"
    dock.controller.choose(save_work=False)
    assert dock.saved.text() == "Work is not saved"
    before = {path: path.read_bytes() for path in saved_files(tmp_path)}
    lines.add([[30, 10], [30, 60]], shape_type="line")
    dock.saver.flush()
    assert {path: path.read_bytes() for path in saved_files(tmp_path)} == before
    dock.controller.choose(save_work=True, work_folder="")
    until(lambda: dock.saver.place == first, 20)


def test_saving_that_is_switched_on_again_goes_on_in_its_folder(
    qapp: Any, fake: FakeEngine, plugin_settings: None
) -> None:
    home = Path(os.environ["XDG_DATA_HOME"]) / "napari-splinesketch" / "sessions"
    with bench() as made:
        made.image()
        layer = made.sketches()
        made.refine()
        made.saver.flush()
        made.controller.choose(save_work=False)
        assert made.saver.place is None
        layer.add([[5, 10], [5, 60]], shape_type="line")
        made.saver.flush()
        made.controller.choose(save_work=True)
        made.saver.flush()
        assert made.saver.place is not None
        assert not made.saver.offers(), "what was saved before is in the window"
    assert len(sessions(home)) == 1
    with bench() as again:
        again.image()
        again.resume()
        assert len(again.controller.drawn.lines) == 3


def test_a_folder_that_is_chosen_while_saving_is_off_is_used_when_it_is_on(
    qapp: Any, fake: FakeEngine, plugin_settings: None, tmp_path: Path
) -> None:
    with bench() as made:
        made.begin()
        made.saver.flush()
        made.controller.choose(save_work=False)
        made.controller.choose(work_folder=str(tmp_path))
        made.controller.choose(save_work=True)
        made.saver.flush()
    assert len(sessions(tmp_path)) == 1


def test_saving_that_is_switched_off_leaves_the_folder_to_other_windows(
    qapp: Any, fake: FakeEngine, plugin_settings: None
) -> None:
    home = Path(os.environ["XDG_DATA_HOME"]) / "napari-splinesketch" / "sessions"
    with bench() as first:
        first.begin()
        first.saver.flush()
        first.controller.choose(save_work=False)
        with bench() as second:
            second.image()
            second.resume()
            assert "open in another window" not in second.controller.notice.text
            assert len(second.controller.drawn.lines) == 2
            second.controller.choose(save_work=True)
            second.controller.delete(*second.controller.state.by_key)
            second.saver.flush()
            first.controller.choose(save_work=True)
            first.saver.flush()
        assert len(sessions(home)) == 2, "what either of them has is saved"


def test_the_folder_of_an_image_without_a_file_has_its_name(
    viewer: Any, dock: SplinesketchDock
) -> None:
    viewer.add_image(np.zeros((60, 80), np.float32), name="Plate 3: wild/type \udcff? [1]")
    until(lambda: dock.saver.place is not None, 20)
    assert dock.saver.place is not None
    name = dock.saver.place.name
    assert re.fullmatch(r"Plate 3 wild type 1\.[0-9a-f]{12}\.splinesketch", name)


class Tensor:
    """An array of another library, whose types are not NumPy's."""

    dtype, ndim = SimpleNamespace(name="float32"), 2

    def __init__(self, array: np.ndarray):
        self._array, self.shape, self.size = array, array.shape, array.size

    def __getitem__(self, place: Any) -> np.ndarray:
        return self._array[place]

    def __array__(self, *more: Any, **options: Any) -> np.ndarray:
        return self._array


def test_work_on_an_array_of_another_library_is_saved(viewer: Any, dock: SplinesketchDock) -> None:
    viewer.add_image(Tensor(np.random.default_rng(0).random((60, 80)).astype(np.float32)))
    until(lambda: dock.saver.place or dock.saver.problem, 20)
    assert not dock.saver.problem


@pytest.mark.parametrize("called", ["", "cells of then."])
def test_work_is_found_whatever_its_folder_was_called(
    qapp: Any, fake: FakeEngine, called: str
) -> None:
    home = Path(os.environ["XDG_DATA_HOME"]) / "napari-splinesketch" / "sessions"
    with bench() as first:
        first.begin()
    (folder,) = home.iterdir()
    assert folder.name.startswith("image 0.")
    old = folder.rename(home / (called + ".".join(folder.name.split(".")[1:])))
    with bench() as again:
        again.image().name = "another name"
        again.resume()
        assert len(again.controller.records()) == 2
        assert again.saver.place == old, "it goes on where it was"
        again.controller.delete((0, 1))
    assert json.loads((old / "1" / "session.json").read_text())["curves"] == 1
    assert list(home.iterdir()) == [old]


@pytest.mark.parametrize("folder_first", [True, False])
def test_work_on_a_film_of_pictures_is_found_however_they_are_opened(
    qapp: Any, fake: FakeEngine, tmp_path: Path, folder_first: bool
) -> None:
    folder = tmp_path / "film"
    folder.mkdir()
    (picture := folder / "0.png").touch()
    for known, path in enumerate((folder, picture)[:: 1 if folder_first else -1]):
        with bench() as made:
            made.image((2, 96, 128))._set_source(Source(path=str(path)))
            if known:
                made.resume()
            else:
                made.sketches()
                made.refine()
            assert len(made.controller.records()) == 2
    assert len(sessions(tmp_path)) == 1


def test_nothing_is_written_into_a_zarr_of_which_the_image_is_a_part(
    qapp: Any, fake: FakeEngine, tmp_path: Path
) -> None:
    part = tmp_path / "plate.zarr" / "A" / "1" / "0"
    part.mkdir(parents=True)
    for known in (False, True):
        with bench() as made:
            made.image()._set_source(Source(path=str(part)))
            if known:
                made.resume()
            else:
                made.sketches()
                made.refine()
            assert len(made.controller.records()) == 2
    (saved,) = sessions(tmp_path)
    assert saved.parents[2] == tmp_path
    # As it was saved before.
    inside = saved.parents[1].rename(part.parent / saved.parents[1].name)
    with bench() as made:
        made.image()._set_source(Source(path=str(part)))
        made.resume()
        assert made.saver.place == inside


def test_work_that_was_saved_beside_an_image_is_found_by_a_link_to_it(
    qapp: Any, fake: FakeEngine, tmp_path: Path
) -> None:
    file, link = tmp_path / "data" / "worms.tif", tmp_path / "mine" / "today.tif"
    for path in (file, link):
        path.parent.mkdir()
    link.symlink_to(file)
    with bench() as made:
        made.image()._set_source(Source(path=str(file)))
        made.sketches()
        made.refine()
    with bench() as made:
        made.image()._set_source(Source(path=str(link)))
        made.resume()
        assert len(made.controller.records()) == 2


def test_work_stays_beside_an_image_that_a_script_opened_and_left(
    qapp: Any, fake: FakeEngine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path)
    with bench() as made:
        made.image()._set_source(Source(path="worms.tif"))
        layer = made.sketches()
        made.saver.flush()
        monkeypatch.chdir("elsewhere")
        layer.add_paths([[[70, 20], [70, 60]]])
        made.saver.flush()
    (saved,) = sessions(tmp_path)
    assert saved.parents[2] == tmp_path
    assert '"sketches": 3' in saved.read_text()


def test_work_on_other_pixels_of_an_image_is_found_with_them(qapp: Any, fake: FakeEngine) -> None:
    home = Path(os.environ["XDG_DATA_HOME"]) / "napari-splinesketch" / "sessions"
    with bench() as made:
        image = made.image()
        layer = made.sketches()
        made.refine()
        made.saver.flush()
        first: Any = image.data
        for some in range(3):  # as a filter does that is tried out, or a camera
            image.data = first + some
            made.saver.flush()
        assert len(sessions(home)) == 1, "nothing new was done"
        layer.add_paths([[[5, 10], [5, 60]]])
        made.refine()
    assert len(sessions(home)) == 2
    for there, known in ((first + 2, 3), (first, 2)):
        with bench() as again:
            again.viewer.add_image(there, name="another name")
            again.resume()
            assert len(again.controller.records()) == known


def test_work_on_a_film_that_was_still_being_written_is_offered_with_the_whole_one(
    qapp: Any, fake: FakeEngine, tmp_path: Path
) -> None:
    film, source = np.random.default_rng(0).random((6, 96, 128)), Source(path=f"{tmp_path}/a.zarr")
    begun = film * (np.arange(6) < 2)[:, None, None]
    with bench() as made:
        made.viewer.add_layer(image := Image(begun[:4]))
        image._set_source(source)
        made.sketches()
        made.refine()
    for pixels in (begun, film, film):
        with bench() as made:
            made.viewer.add_layer(image := Image(pixels))
            image._set_source(source)
            made.resume()
            (layer,) = [work.sketches for work in made.controller.works]
            layer.add_paths([[[40, 10], [40, 60]]])
    assert len(layer.data) == 5
    with bench() as made:
        made.viewer.add_layer(image := Image(film + 1))
        image._set_source(source)
        made.sketches()
        made.saver.flush()
        assert not made.saver.offers(), "another film of the same name"


def test_a_film_opens_where_work_begins(viewer: Any, dock: SplinesketchDock) -> None:
    image = viewer.add_image(np.zeros((9, 40, 50)), name="film")
    assert viewer.dims.current_step[0] == 0, "not in the middle"
    viewer.dims.set_point(0, 4)
    lines = [[[t, 5, 5], [t, 30, 30]] for t in (7, 2)]
    viewer.add_shapes(lines, shape_type="line", name="film sketches")
    assert viewer.dims.current_step[0] == 2
    viewer.dims.set_point(0, 4)
    viewer.add_image(np.zeros((9, 40, 50)), name="another")
    assert viewer.dims.current_step[0] == 4, "not while there is more in the window"
    assert image in viewer.layers

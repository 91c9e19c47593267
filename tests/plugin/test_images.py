"""Images of every kind go in, and the results lie on them."""

import shutil
from pathlib import Path
from typing import Any

import dask.array as da
import numpy as np
import pytest
from dask.delayed import delayed
from napari.layers import Image
from napari.utils.notifications import notification_manager

from napari_splinesketch.plugin.dock import SplinesketchDock
from napari_splinesketch.plugin.layers import space
from napari_splinesketch.plugin.layers.space import ruler_of
from napari_splinesketch.plugin.plots import profiles

from .fakes import FakeEngine
from .hand import click, outlines, refine, refine_all, until

CHUNKS: Any = 64
LINE = np.array([[60.0, 70], [90, 130]])
PLACE = {"scale": (0.5, 2.0), "translate": (3.0, -4.0), "rotate": 12.0, "units": ("um", "um")}


def refined(viewer: Any, dock: SplinesketchDock, image: Any) -> tuple[Any, Any]:
    """Refine a line drawn in a layer of its own; give curve and reconstruction."""
    click(dock.draw)
    viewer.layers[f"{image.name} sketches"].add(LINE, shape_type="line")
    refine(dock)
    return viewer.layers[f"{image.name} curves"], viewer.layers[f"{image.name} reconstruction"]


def test_colour_is_said_once(viewer: Any, dock: SplinesketchDock, fake: FakeEngine) -> None:
    data = np.random.default_rng(0).integers(0, 255, (120, 160, 3), dtype=np.uint8)
    image = viewer.add_image(data, rgb=True, name="photo", **PLACE)
    notification_manager.records.clear()
    curves, reconstruction = refined(viewer, dock, image)
    refine_all(dock)
    said = [record.message for record in notification_manager.records]
    assert len([message for message in said if "luminance" in message]) == 1
    assert fake.calls[0]["image"].shape == (120, 160)
    assert reconstruction.data.shape == (120, 160)
    np.testing.assert_allclose(curves.data[0][[0, -1]], LINE, atol=1e-4)


def levels() -> list[Any]:
    fine = np.random.default_rng(0).random((400, 640)).astype(np.float32)
    return [da.from_array(fine, chunks=CHUNKS), da.from_array(fine[::2, ::2], chunks=CHUNKS)]


@pytest.mark.parametrize("coarse", [False, True])
def test_multiscale(
    viewer: Any,
    dock: SplinesketchDock,
    fake: FakeEngine,
    monkeypatch: pytest.MonkeyPatch,
    coarse: bool,
) -> None:
    monkeypatch.setattr(space, "LARGEST_BLOCK", 20_000 if coarse else 2**24)
    image = viewer.add_image(levels(), multiscale=True, name="slide", **PLACE)
    curves, reconstruction = refined(viewer, dock, image)
    step = 2 if coarse else 1
    assert fake.calls[0]["image"].size < 400 * 640 / 2 / step**2
    np.testing.assert_allclose(curves.data[0][[0, -1]], LINE, atol=1e-4)
    # Pixels of the reconstruction lie on the image's, whatever their size.
    line = fake.calls[0]["lines"][0]
    there = [reconstruction.data_to_world(point) for point in line]
    np.testing.assert_allclose(there, [image.data_to_world(point) for point in LINE], atol=1e-6)
    (pieces,) = outlines(viewer.layers["slide outlines"])
    assert np.ptp(pieces[:, 0] @ [2, -1]) == pytest.approx(4 * step * 5**0.5, rel=1e-3)


def test_a_lazy_film(viewer: Any, dock: SplinesketchDock, fake: FakeEngine) -> None:
    made = []

    def frame(block_info: Any = None) -> np.ndarray:
        made.append(block_info[None]["chunk-location"][0])
        return np.full(block_info[None]["chunk-shape"], made[-1] + 0.5)

    film = da.map_blocks(
        frame, chunks=((1,) * 9, (200,), (300,)), dtype=float, meta=np.empty((0, 0, 0))
    )
    viewer.add_image(film, name="film", contrast_limits=(0, 9), cache=False)
    shapes = viewer.add_shapes(LINE, shape_type="line", name="film sketches")
    viewer.dims.set_point(0, 7)
    until(lambda: {0, 4, 8} <= set(made))  # by which saved work tells the film
    made.clear()
    refine(dock)
    assert set(made) <= {7}
    assert (fake.calls[0]["image"] == 7.5).all()
    viewer.dims.set_point(0, 2)
    refine(dock)
    curves = viewer.layers["film curves"]
    frames = [int(curve[0, 0]) for curve in curves.data]
    assert dict(zip(frames, curves.features["id"], strict=True)) == {7: 1, 2: 2}
    reconstruction = viewer.layers["film reconstruction"]
    reconstruction.visible = True
    assert reconstruction.data.shape[0] == 9
    assert np.nanmax(reconstruction.data[7]) == 7.5
    assert np.nanmax(reconstruction.data[2]) == 2.5
    assert shapes.ndim == 2


@pytest.mark.parametrize("dtype", [bool, np.uint16, np.int32, np.float16, np.float64])
def test_every_real_type(viewer: Any, dock: SplinesketchDock, fake: FakeEngine, dtype: Any) -> None:
    image = viewer.add_image(np.eye(150, 160).astype(dtype), name="x", contrast_limits=(0, 1))
    refined(viewer, dock, image)
    assert fake.calls[0]["image"].dtype == dtype


@pytest.mark.parametrize("opened", [True, False])
def test_a_zarr_that_was_deleted_meanwhile_is_not_refined_as_empty(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine, tmp_path: Path, opened: bool
) -> None:
    zarr, path = pytest.importorskip("zarr"), tmp_path / "film.zarr"
    pixels = np.random.default_rng(0).random((2, 40, 60), np.float32)
    array = zarr.create_array(path, data=pixels, chunks=(1, 40, 60))
    lazy = da.from_zarr(str(path)) if opened else array
    layer = Image(lazy, name="film", cache=False)
    if opened:
        layer._source = layer.source.copy(update={"path": str(path)})
    viewer.add_layer(layer)
    viewer.add_shapes([[[0, 10, 10], [0, 20, 50]]], shape_type="line", name="film sketches")
    viewer.dims.set_point(0, 0)
    refine(dock)
    assert "Refined 1 curve" in dock.controller.notice.text
    shutil.rmtree(path)
    dock.controller.refine("all")
    until(lambda: not dock.controller.progress)
    said = dock.controller.notice.text
    assert "Frame 0 of 'film' could not be read" in said
    assert str(path) in said
    assert "open the image again" in said
    assert len(fake.calls) == 1


def test_channels_in_the_last_axis_are_columns_like_others(
    viewer: Any, dock: SplinesketchDock
) -> None:
    viewer.add_image(np.zeros((40, 60, 4)), rgb=False)
    viewer.add_shapes([[[3, 10, 1], [3, 50, 2]]], shape_type="line", name="channels sketches")
    refine(dock)
    assert "could not be shown" not in dock.controller.notice.text
    assert viewer.layers["channels reconstruction"].data.shape[-1] == 4


def test_a_frame_that_cannot_be_read_any_more_is_named(
    viewer: Any,
    dock: SplinesketchDock,
    fake: FakeEngine,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
) -> None:
    pixels = np.random.default_rng(0).random((40, 60), np.float32)
    frames = []
    for number in range(3):
        np.save(tmp_path / f"{number}.npy", pixels)
        read = delayed(np.load)(tmp_path / f"{number}.npy")
        frames.append(da.from_delayed(read, pixels.shape, pixels.dtype))
    viewer.add_image(da.stack(frames), name="film", cache=False)
    viewer.add_shapes([[[1, 10, 10], [1, 20, 50]]], shape_type="line", name="film sketches")
    viewer.dims.set_point(0, 1)
    refine(dock)
    for path in tmp_path.iterdir():
        path.unlink()
    controller, said = dock.controller, list[str]()
    for act in (
        lambda: controller.refine("all"),
        controller.suggestions.suggest,
        dock.eyes.entries["residual"].trigger,
        lambda: controller.actions.run("next_frame"),
    ):
        act()
        until(lambda: not (controller.progress or controller.drawing.runs), 20)
        said.append(controller.notice.text)
    assert ["Frame 1 of 'film' could not be read" in text for text in said[:3]] == [True] * 3
    assert "Frame 2 of 'film' could not be read" in said[3]
    assert all("its file is there and whole" in text for text in said)
    assert not any("Errno" in text for text in said)
    assert controller.frame == 1, "napari could not show another one"
    ((record,), work) = controller.records(), controller.work
    assert work is not None
    plot, why = profiles(work, record, ruler_of(work.image))
    assert not isinstance(plot, str)
    assert str(why).startswith("Frame 1 of 'film' could not be read")
    assert not [each for each in caplog.records if each.exc_info]

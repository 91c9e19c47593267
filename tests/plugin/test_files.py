"""Labels in napari's own menus, and the manifest that puts them there."""

import json
import math
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from napari.layers import Layer, Shapes
from napari.settings import get_settings
from napari.utils.notifications import notification_manager
from npe2 import PluginManager, PluginManifest, io_utils

import napari_splinesketch
from napari_splinesketch.engine import spline
from napari_splinesketch.labels import Label, Labels, LabelsError, read_labels, write_labels
from napari_splinesketch.labels.format import Format
from napari_splinesketch.labels.formats import READERS, WRITERS
from napari_splinesketch.labels.types import LabelStatus
from napari_splinesketch.plugin.dock import SplinesketchDock
from napari_splinesketch.plugin.files import (
    _napari_s_own,
    get_reader,
    layer_of_labels,
    open_tables,
    read,
    read_with,
    records_of,
    write,
)
from napari_splinesketch.plugin.layers.drawn import shapes_in
from napari_splinesketch.plugin.layers.space import go_to_frame
from napari_splinesketch.tracking.over_time import curvature_of

from .bench import bench
from .fakes import FakeEngine
from .hand import assert_drawn, click, refine, rest, until

MANIFEST = Path(napari_splinesketch.__file__).with_name("napari.yaml")
PLUGIN = "napari-splinesketch"
LINES = [np.array([[2.0, 20.0, 20], [2, 20, 60]]), np.array([[1.0, 50, 30], [1, 80, 80]])]

SHAPES = "index,shape-type,vertex-index,axis-0,axis-1\n0,line,0,1,2\n0,line,1,3,4\n"


@pytest.fixture
def labels() -> Labels:
    rng = np.random.default_rng(3)
    kinds: list[tuple[int, int, LabelStatus]] = [(0, 3, "good"), (2, 3, "check"), (2, 9, "failed")]
    made = [
        Label(frame, number, rng.random((7, 2)) * 50, rng.random(7), rng.random(7), status)
        for frame, number, status in kinds
    ]
    return Labels(tuple(made), scale=(0.5, 2.0), units="µm")


def saved(labels: Labels, path: Path, name: str = "a") -> list[str]:
    """Save labels as napari does: through a layer; give what the user is told."""
    data, meta, kind = layer_of_labels(labels, name)
    layer: Any = Layer.create(data, meta, kind)  # pyright: ignore[reportArgumentType]
    before = len(notification_manager.records)
    io_utils.write(path, [layer], plugin_name=PLUGIN)
    return [record.message for record in notification_manager.records[before:]]


def same(a: Labels, b: Labels) -> None:
    assert (a.scale, a.units) == (b.scale, b.units)
    for one, other in zip(a.labels, b.labels, strict=True):
        assert (one.frame, one.curve, one.status) == (other.frame, other.curve, other.status)
        for name in ("points", "half_width", "sd"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_the_manifest_is_valid_and_its_commands_exist() -> None:
    manifest = PluginManifest.from_file(MANIFEST)
    manifest.validate_imports()
    assert manifest.name == "napari-splinesketch"
    commands = {command.id for command in manifest.contributions.commands or []}
    samples: list[Any] = manifest.contributions.sample_data or []
    assert {sample.key for sample in samples} == {"worms_dense", "worms_swimming", "generated"}
    assert {sample.command for sample in samples} <= commands


def test_napari_finds_the_installed_plugin() -> None:
    manager = PluginManager()
    manager.discover(include_npe1=False)
    assert "napari-splinesketch" in manager


def test_what_is_read_and_saved_again_is_the_same(tmp_path: Path, labels: Labels) -> None:
    path = str(tmp_path / "a.csv")
    write_labels(path, labels)
    reader = get_reader(path)
    assert reader is not None
    data, meta, kind = reader(path)[0]
    layer = Layer.create(data, meta, kind)  # pyright: ignore[reportArgumentType]
    assert isinstance(layer, Shapes)
    assert layer.name == "a"
    np.testing.assert_array_equal(layer.scale, [1, 0.5, 2])
    assert [str(unit) for unit in layer.units] == ["pixel", "micrometer", "micrometer"]
    assert list(layer.features["status"]) == ["good", "check", "failed"]
    out, attributes, _ = layer.as_layer_data_tuple()
    again = str(tmp_path / "b.csv")
    assert write(again, out, dict(attributes)) == [again]
    same(read_labels(again), labels)


def test_a_line_that_was_moved_is_saved_as_a_sketch(tmp_path: Path, labels: Labels) -> None:
    path = str(tmp_path / "a.csv")
    write_labels(path, labels)
    data, meta, kind = read(path)[0]
    data[1] = data[1] + [0.0, 1, 1]
    layer: Any = Layer.create(data, meta, kind)  # pyright: ignore[reportArgumentType]
    out, attributes, _ = layer.as_layer_data_tuple()
    write(path, out, dict(attributes))
    found = read_labels(path).labels
    assert [label.status for label in found] == ["good", "sketch", "failed"]
    np.testing.assert_allclose(found[1].points, labels.labels[1].points + 1, rtol=1e-6)


def test_a_curve_is_saved_whole_under_a_number_that_the_user_gave_it(
    tmp_path: Path, labels: Labels
) -> None:
    path = str(tmp_path / "a.csv")
    write_labels(path, labels)
    layer: Any = Layer.create(*read(path)[0])  # pyright: ignore[reportArgumentType]
    layer.features.iloc[1, 0] = 7  # as napari's table of features does it
    out, attributes, _ = layer.as_layer_data_tuple()
    write(path, out, dict(attributes))
    first, second, third = labels.labels
    wanted = sorted([first, replace(second, curve=7), third], key=lambda a: (a.frame, a.curve))
    same(read_labels(path), replace(labels, labels=tuple(wanted)))


@pytest.mark.parametrize("read_before", [0, 3])
def test_lines_drawn_beside_those_of_a_file_are_saved(
    tmp_path: Path, labels: Labels, read_before: int
) -> None:
    path = str(tmp_path / "a.csv")
    write_labels(path, replace(labels, labels=labels.labels[:read_before]))
    layer: Any = Layer.create(*read(path)[0])  # pyright: ignore[reportArgumentType]
    for row in (5, 9):  # napari gives them the number of the last line, or none
        layer.add_lines(np.array([[2.0, row, 4], [2, row, 40]])[:, -layer.ndim :])
    out, attributes, _ = layer.as_layer_data_tuple()
    write(path, out, dict(attributes))
    found = read_labels(path).labels
    assert [label.status for label in found[read_before:]] == ["sketch", "sketch"]
    same(Labels(found[:read_before]), Labels(labels.labels[:read_before]))


def test_a_unit_that_napari_does_not_know_keeps_nothing_closed(
    tmp_path: Path, labels: Labels
) -> None:
    path = str(tmp_path / "a.csv")
    write_labels(path, replace(labels, units="reference frame"))
    layer: Any = Layer.create(*read(path)[0])  # pyright: ignore[reportArgumentType]
    np.testing.assert_array_equal(layer.scale, [1, 0.5, 2])
    assert [str(unit) for unit in layer.units] == ["pixel"] * 3
    out, attributes, _ = layer.as_layer_data_tuple()
    write(path, out, dict(attributes))
    same(read_labels(path), replace(labels, units="reference frame"))


def test_features_of_the_user_s_own_are_no_numbers(tmp_path: Path) -> None:
    path = str(tmp_path / "a.csv")
    features = {"id": ["worm A", "worm B"]}
    layer = Shapes([line[:, 1:] for line in LINES], shape_type="line", features=features)
    out, attributes, _ = layer.as_layer_data_tuple()
    write(path, out, dict(attributes))
    assert [label.curve for label in read_labels(path).labels] == [1, 2]


def test_any_lines_can_be_saved_as_sketches(tmp_path: Path) -> None:
    kinds: Any = ["line", "rectangle", "path"]
    layer = Shapes(
        [[[0, 0], [9, 9]], [[1, 1], [4, 5]], [[2, 2], [3, 9], [7, 7]]],
        shape_type=kinds,
        scale=(0.5, 0.5),
        units=("um", "um"),
    )
    path = str(tmp_path / "a.csv")
    out, attributes, _ = layer.as_layer_data_tuple()
    write(path, out, dict(attributes))
    labels = read_labels(path)
    assert [(label.curve, label.status) for label in labels.labels] == [
        (1, "sketch"),
        (3, "sketch"),
    ]
    assert (labels.scale, labels.units) == ((0.5, 0.5), "µm")


def test_the_manifest_offers_every_format() -> None:
    contributions: Any = PluginManifest.from_file(MANIFEST).contributions
    (writer, _), (reader,) = contributions.writers, contributions.readers
    offered = [each.suffix for each in WRITERS]
    assert writer.filename_extensions == offered
    assert {"." + pattern.rpartition(".")[2] for pattern in reader.filename_patterns} == {
        "." + ending.rpartition(".")[2] for each in READERS for ending in each.endings
    }


@pytest.mark.parametrize("writer", WRITERS, ids=lambda writer: writer.suffix)
def test_every_format_is_saved_with_what_it_loses(
    tmp_path: Path, labels: Labels, npe2pm_installed: None, writer: Format
) -> None:
    if writer.needs:
        pytest.importorskip(writer.needs.replace("-", "_"))
    said = saved(labels, tmp_path / f"a{writer.suffix}")
    direct = tmp_path / f"b{writer.suffix}"
    lost = write_labels(direct, labels)
    assert (tmp_path / f"a{writer.suffix}").stat().st_size == pytest.approx(
        direct.stat().st_size, rel=0.05
    )
    assert len(said) == bool(lost)
    for text in lost:
        assert text[1:].removesuffix(".") in said[0]


@pytest.mark.parametrize("name", ["a.csv", "a.geojson", "a.json", "a.zip", "a.wcon", "w.json"])
def test_every_format_is_opened(
    tmp_path: Path, labels: Labels, npe2pm_installed: None, name: str
) -> None:
    path = tmp_path / name
    written = {"a.json": "a.geojson", "w.json": "a.wcon"}.get(name, name)
    write_labels(tmp_path / written, labels)
    (tmp_path / written).rename(path)
    layers = io_utils.read([str(path)], stack=False, plugin_name=PLUGIN)
    layer: Any = Layer.create(*layers[0])  # pyright: ignore[reportArgumentType]
    assert layer.name == path.stem
    assert list(layer.features["id"]) == [3, 3, 9]
    assert list(layer.features["status"]) == ["good", "check", "failed"]
    for line, label in zip(layer.data, labels.labels, strict=True):
        np.testing.assert_allclose(line[:, 0], label.frame)
        np.testing.assert_allclose(line[:, 1:], label.points, rtol=1e-5)


@pytest.mark.parametrize("name", ["splines.npy", "my_splines.npz"])
def test_predicted_splines_are_opened(tmp_path: Path, npe2pm_installed: None, name: str) -> None:
    splines = np.random.default_rng(1).random((2, 3, 5, 2)) * 40
    write_array(tmp_path / name, splines)
    layers: Any = io_utils.read([str(tmp_path / name)], stack=False, plugin_name=PLUGIN)
    assert list(layers[0][1]["features"]["id"]) == [0, 1, 2, 0, 1, 2]
    np.testing.assert_allclose(layers[0][0][1][:, 1:], splines[0, 1, :, ::-1])


def test_what_is_left_out_of_a_file_is_said(tmp_path: Path, npe2pm_installed: None) -> None:
    square = {"type": "Polygon", "coordinates": [[[0, 0], [0, 1], [1, 1], [0, 0]]]}
    path = tmp_path / "cells.geojson"
    path.write_text(json.dumps({"type": "Feature", "geometry": square, "properties": {}}))
    before = len(notification_manager.records)
    layers = io_utils.read([str(path)], stack=False, plugin_name=PLUGIN)
    layer: Any = Layer.create(*layers[0])  # pyright: ignore[reportArgumentType]
    assert layer.nshapes == 0
    (said,) = notification_manager.records[before:]
    assert (
        said.message
        == "cells.geojson: Left out 1 Polygon: only lines of two or more points can be sketches."
    )


def test_provenance_and_the_size_of_the_image_survive(
    tmp_path: Path, labels: Labels, npe2pm_installed: None
) -> None:
    known = replace(labels, shape=(64, 96), provenance={"preset": "fast"})
    assert not saved(known, tmp_path / "a.geojson")
    found = read_labels(tmp_path / "a.geojson")
    assert (found.shape, found.provenance) == ((64, 96), {"preset": "fast"})


def test_a_file_that_napari_could_not_ask_for_is_not_replaced(
    tmp_path: Path, labels: Labels
) -> None:
    data, meta, _ = layer_of_labels(labels, "a")
    attributes = Layer.create(data, meta, "shapes").as_layer_data_tuple()[1]
    assert write(str(tmp_path / "a"), data, dict(attributes)) == [str(tmp_path / "a.csv")]
    (tmp_path / "a.csv").write_text("mine")
    with pytest.raises(FileExistsError, match="choose another name"):
        write(str(tmp_path / "a"), data, dict(attributes))
    assert (tmp_path / "a.csv").read_text() == "mine"
    with pytest.raises(RuntimeError, match=r"no format has this ending.*\.geojson"):
        write(str(tmp_path / "a.txt"), data, dict(attributes))


def test_what_cannot_be_saved_is_said_by_save(tmp_path: Path, npe2pm_installed: None) -> None:
    layer = Shapes([np.zeros((2, 4))], shape_type="line")
    with pytest.raises(RuntimeError, match="a time and a plane"):
        layer.save(str(tmp_path / "a.csv"), plugin=PLUGIN)


def write_array(path: Path, array: np.ndarray) -> None:
    if path.suffix == ".npz":
        np.savez_compressed(path, splines=array)
    else:
        np.save(path, array)


def write_zip(path: Path) -> None:
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("readme.txt", "nothing")


FOREIGN: dict[str, Callable[[Path], Any]] = {
    "shapes.csv": lambda path: path.write_text(SHAPES),
    "table.csv": lambda path: path.write_text("curve,area\n1,2\n"),
    "empty.csv": lambda path: path.touch(),
    "settings.json": lambda path: path.write_text('{"units": "um", "Features": [1]}'),
    "units.json": lambda path: path.write_text('{"units": {"length": "um"}, "data": []}'),
    "labels.coco.json": lambda path: path.write_text('{"annotations": []}'),
    "archive.zip": write_zip,
    "broken.zip": lambda path: path.write_bytes(b"PK\x03\x04"),
    "envi.roi": lambda path: path.write_text("; ENVI output of ROIs"),
    "splines.npy": lambda path: np.save(path, np.zeros((9, 8))),
    "text.npy": lambda path: path.write_text("no array"),
    "image.tif": lambda path: path.write_bytes(b"II*\x00"),
    "labels.masks.tif": lambda path: write_labels(path, Labels(shape=(4, 5))),
}


@pytest.mark.parametrize("name", FOREIGN)
def test_files_of_others_are_left_to_them(tmp_path: Path, name: str) -> None:
    FOREIGN[name](tmp_path / name)
    for given in (str(tmp_path / name), [str(tmp_path / name)]):
        assert get_reader(given) is (_napari_s_own if name.endswith(".csv") else None)


@pytest.mark.parametrize("name", ["image.tif", "image.npy", "stack.npz", "image.ome.tif"])
def test_napari_never_asks_who_should_read_an_image(npe2pm_installed: None, name: str) -> None:
    readers = PluginManager.instance().iter_compatible_readers([name])
    assert PLUGIN not in {reader.plugin_name for reader in readers}


def test_a_malformed_file_is_named_with_line_and_reason(tmp_path: Path, labels: Labels) -> None:
    path = tmp_path / "a.csv"
    write_labels(path, labels)
    lines = path.read_text().splitlines()
    lines[3] = lines[3].replace(",good", ",splendid")
    path.write_text("\n".join(lines))
    reader = get_reader(str(path))
    assert reader is not None
    with pytest.raises(LabelsError, match="line 4"):
        reader(str(path))


def test_through_the_window(
    viewer: Any, dock: SplinesketchDock, tmp_path: Path, npe2pm_installed: None
) -> None:
    viewer.add_image(
        np.random.default_rng(0).random((3, 96, 128)),
        name="film",
        scale=(1, 0.5, 2),
        units=("s", "um", "um"),
    )
    viewer.add_shapes(LINES, shape_type="line", name="film sketches", scale=(1, 0.5, 2))
    for frame in (1, 2):
        viewer.dims.set_point(0, frame)
        refine(dock)
    exported, saved = tmp_path / "exported.csv", tmp_path / "saved.csv"
    dock.controller.export(exported)
    rest(dock)
    viewer.layers.selection.active = viewer.layers["film curves"]
    viewer.layers.save(str(saved), selected=True, plugin="napari-splinesketch")
    same(read_labels(saved), read_labels(exported))
    labels = read_labels(exported)
    assert (labels.scale, labels.units) == ((0.5, 2.0), "µm")
    assert [label.frame for label in labels.labels] == [1, 2]
    (opened,) = viewer.open(str(saved), plugin="napari-splinesketch")
    for curve, there in zip(viewer.layers["film curves"].data, opened.data, strict=True):
        assert len(there) == 100
        assert_drawn(curve, np.asarray(there, dtype=float))
        np.testing.assert_allclose(
            opened.data_to_world(there[-1])[-2:],
            viewer.layers["film curves"].data_to_world(curve[-1])[-2:],
        )


def test_all_layers_are_saved_though_some_are_vectors(
    viewer: Any, dock: SplinesketchDock, tmp_path: Path, npe2pm: Any
) -> None:
    for each in ("napari", PLUGIN):
        npe2pm.register(PluginManifest.from_distribution(each))
    viewer.add_image(np.random.default_rng(0).random((96, 128)), name="worms")
    viewer.add_shapes([LINES[0][:, 1:]], shape_type="line", name="worms sketches")
    refine(dock)
    assert any(layer._type_string == "vectors" for layer in viewer.layers)
    folder = tmp_path / "all"
    viewer.add_vectors(np.zeros((1, 2, 2)), name="arrows")
    viewer.layers.save(str(folder))
    assert notification_manager.records[-1].message.startswith("Left out: arrows. ")
    written = {path.name for path in folder.iterdir()}
    assert {"worms.tif", "worms sketches.csv", "worms curves.csv"} <= written


@pytest.mark.parametrize(("name", "plugin"), [("film.csv", None), ("film.shapes.csv", "napari")])
def test_labels_are_opened_without_a_question_and_gone_on_with(
    viewer: Any,
    dock: SplinesketchDock,
    tmp_path: Path,
    npe2pm: Any,
    name: str,
    plugin: str | None,
) -> None:
    for each in ("napari", PLUGIN):
        npe2pm.register(PluginManifest.from_distribution(each))
    get_settings().plugins.extension2reader = {}
    before = len(notification_manager.records)
    open_tables()
    open_tables()
    (said,) = notification_manager.records[before:]
    assert "now opens tables (*.csv)" in said.message, "once"
    viewer.add_image(np.random.default_rng(0).random((3, 96, 128)), name="film")
    viewer.add_shapes(LINES, shape_type="line", name="film sketches")
    for frame in (1, 2):
        viewer.dims.set_point(0, frame)
        refine(dock)
    dock.controller.review("accepted", (1, 1))
    dock.controller.lock(True, (2, 2))
    before = dock.controller.records()
    for ending in ("csv", "shapes.csv"):
        dock.controller.export(tmp_path / f"film.{ending}")
        rest(dock)
    (tmp_path / "shapes.csv").write_text(SHAPES)
    (shapes,) = viewer.open(tmp_path / "shapes.csv", plugin=None)
    assert shapes.nshapes == 1, "napari's own tables are opened as ever"
    viewer.open(tmp_path / name, **({} if plugin else {"plugin": None}))
    assert dock.offer.labels.text() == "Continue with 2 curves"
    click(dock.offer.labels)
    until(dock.controller.records)
    rest(dock)
    after = dock.controller.records()
    for one, other in zip(before, after, strict=True):
        for what in ("id", "frame", "review", "locked"):
            assert getattr(one, what) == getattr(other, what)
        assert one.curve.status == other.curve.status
        np.testing.assert_array_equal(one.curve.points, other.curve.points)
        ends = [curve.knots[[0, -1]] for curve in (one.curve, other.curve)]
        np.testing.assert_allclose(ends[0], ends[1], atol=0.5)
    assert dock.offer.labels.isHidden()
    assert not dock.controller.request().targets
    assert dock.export.isEnabled()


def test_curves_that_are_gone_on_with_have_as_many_knots_as_they_need() -> None:
    turn = np.linspace(6, 6 * np.pi, 400)[:, None]
    spiral = 128 + 5.5 * turn * np.hstack([np.sin(turn), np.cos(turn)])
    lines = enumerate((spiral, LINES[0][:, 1:]))
    made = [Label(0, i, p, np.full(len(p), 3.0), np.full(len(p), 3.0), "good") for i, p in lines]
    (winding, straight), notes = records_of(Labels(tuple(made)), 1)
    assert (winding.id, straight.id) == (1, 2)
    assert notes == ["curve numbers are one higher here than in the file, which counts from 0"]
    drawn = spline.sample(winding.curve.knots, 900)[:, :2]
    assert spline.apart(winding.curve.points, drawn).mean() < 0.5
    assert len(winding.curve.knots) >= 24
    assert len(straight.curve.knots) == 8


def test_curves_that_are_gone_on_with_bend_as_before() -> None:
    at = np.array([0, 8, 21, 30, 45, 52, 67, 80])  # knots need not be evenly spaced
    knots = np.column_stack([30 + 9 * np.sin(at / 14), at])
    points = spline.sample(knots, 100)
    label = Label(0, 1, points, np.full(100, 3.0), np.full(100, 0.1), "good")
    (record,), _ = records_of(Labels((label,)), 1)
    before = replace(record.curve, knots=np.column_stack([knots, np.full(8, 3.0)]))
    bends, bent = (curvature_of(curve, 100) for curve in (record.curve, before))
    assert np.abs(bends - bent).mean() < 0.03 * np.abs(bent).mean()


PLACES: dict[str, dict[str, Any]] = {
    "pixel size": {"scale": (0.2, 0.3), "units": ("um", "um")},
    "moved": {"translate": (100, 50)},
    "turned": {"scale": (0.5, 2), "rotate": 25, "shear": [0.2], "affine": np.diag([1.1, 0.9, 1])},
}


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("name", ["a.csv", "a.zip", "table.csv"])
@pytest.mark.parametrize("image_first", [True, False])
@pytest.mark.filterwarnings("ignore:Inconsistent units across layers")
def test_labels_lie_on_the_image_in_its_pixels(
    viewer: Any,
    dock: SplinesketchDock,
    tmp_path: Path,
    npe2pm_installed: None,
    labels: Labels,
    place: str,
    name: str,
    image_first: bool,
) -> None:
    (one, *_) = labels.labels
    known = Labels((replace(one, points=one.points * 0.4),), scale=(0.5, 2.0), units="µm")
    points = known.labels[0].points
    if name == "table.csv":
        rows = "".join(f"3,{row},{col}\n" for row, col in points)
        (tmp_path / name).write_text(f"curve,row,col\n{rows}")
    else:
        write_labels(tmp_path / name, known)

    def image() -> None:
        viewer.add_image(np.zeros((40, 60)), **PLACES[place])

    steps = [image, lambda: viewer.open(tmp_path / name, plugin=PLUGIN)]
    for step in steps if image_first else steps[::-1]:
        step()
    (line,) = dock.controller.drawn.lines
    np.testing.assert_allclose(line, points, atol=1e-4)
    if name != "table.csv":
        viewer.layers[-1].scale = (7, 7)
        dock.saver.take_up()
        until(lambda: dock.controller.records() and not dock.controller.progress)
        assert not dock.controller.request().targets, "the curve has its line"
        (line,) = dock.controller.drawn.lines
        np.testing.assert_allclose(line, points, atol=1e-4)


def test_lines_of_a_file_lie_on_whichever_image_is_chosen(qapp: Any, labels: Labels) -> None:
    (known, *_) = labels.labels
    line = Label.from_sketch(known.points, frame=0, identity=1)
    data, meta, _ = layer_of_labels(Labels((line,)), "labels")
    with bench() as made:
        images = [made.image()]
        layer = Shapes(data, **meta)
        made.viewer.add_layer(layer)
        images.append(made.image(seed=1))
        images[1].scale = np.array([0.5, 0.5])
        for image in (*images, *images):
            made.controller.image = image
            ((_, points),) = shapes_in(made.viewer, layer, image)
            np.testing.assert_allclose(points, line.points, atol=1e-4)


@pytest.mark.parametrize("axes", [(), (3,), (2, 3)])
def test_labels_lie_in_their_frames_of_the_image(
    viewer: Any,
    dock: SplinesketchDock,
    tmp_path: Path,
    npe2pm_installed: None,
    labels: Labels,
    axes: tuple[int, ...],
) -> None:
    write_labels(tmp_path / "a.csv", labels)
    place = np.full(len(axes), 4.0)
    viewer.add_image(np.zeros((*axes, 60, 60)), translate=(*place, 7, 9), scale=(*place, 1, 1))
    viewer.open(tmp_path / "a.csv", plugin=PLUGIN)
    work: Any = dock.controller.work
    shapes = shapes_in(viewer, work.sketches, work.image)
    last = max(math.prod(axes) - 1, 0)
    assert [frame for frame, _ in shapes] == [min(label.frame, last) for label in labels.labels]
    assert dock.controller.frame == 0
    for (_, line), label in zip(shapes, labels.labels, strict=True):
        np.testing.assert_allclose(line, label.points, atol=1e-4)


@pytest.mark.parametrize("kind", ["curve", "sketch"])
@pytest.mark.parametrize("axes", [(3,), (2, 3)])
def test_lines_of_the_first_frame_are_in_no_other(
    qapp: Any, fake: FakeEngine, labels: Labels, axes: tuple[int, ...], kind: str
) -> None:
    (known, *_) = labels.labels
    known = known if kind == "curve" else Label.from_sketch(known.points, frame=0, identity=1)
    data, meta, _ = layer_of_labels(Labels((known,)), "labels")
    with bench() as made:
        image = made.image((*axes, 96, 128))
        made.viewer.add_layer(Shapes(data, **meta))
        made.saver.take_up()
        until(lambda: not made.controller.progress)
        (line,) = made.controller.drawn.lines
        np.testing.assert_allclose(line, known.points, atol=1e-4)
        assert len(made.controller.request().targets) == (kind == "sketch")
        go_to_frame(made.viewer, image, math.prod(axes) - 1)
        assert not made.controller.drawn.lines


def test_suggested_lines_stay_where_curves_of_a_file_are_gone_on_with(
    qapp: Any, fake: FakeEngine, labels: Labels
) -> None:
    data, meta, _ = layer_of_labels(labels, "labels")
    with bench() as made:
        made.image((3, 96, 128))
        made.viewer.add_layer(layer := Shapes(data, **meta))
        c = made.controller
        c.apply("Suggest lines", c.state.suggested(1, [np.array([[50.0, 60], [80, 90]])]))
        until(lambda: layer.nshapes == 4)
        made.saver.take_up()
        until(lambda: c.records() and not c.drawing.runs)
        assert layer.nshapes == 4


def test_curves_beyond_an_image_of_times_and_planes_are_left_in_the_file(
    viewer: Any, dock: SplinesketchDock, tmp_path: Path, npe2pm_installed: None, labels: Labels
) -> None:
    far = replace(labels.labels[1], frame=99)
    write_labels(tmp_path / "a.csv", Labels((*labels.labels, far)))
    viewer.add_image(np.zeros((2, 2, 60, 60)), name="film")
    viewer.open(tmp_path / "a.csv", plugin=PLUGIN)
    click(dock.offer.labels)
    until(lambda: dock.controller.records() and not dock.controller.progress)
    assert [record.frame for record in dock.controller.records()] == [0, 2, 2]
    assert "Left in the file: 1 curve beyond the last frame." in dock.notice.text()
    viewer.dims.set_point((0, 1), (1, 1))
    assert not dock.controller.drawn.lines, "its line is in none of the frames"


def test_a_path_without_a_plugin_means_napari_s_own_reader(
    viewer: Any, npe2pm: Any, tmp_path: Path, labels: Labels
) -> None:
    for each in ("napari", PLUGIN):
        npe2pm.register(PluginManifest.from_distribution(each))
    for ending in ("csv", "shapes.csv"):
        write_labels(tmp_path / f"a.{ending}", labels)
    (layer,) = viewer.open(tmp_path / "a.shapes.csv")
    assert layer.source.reader_plugin == "napari"
    same(read_with(layer), labels)
    np.testing.assert_array_equal(layer.scale, (1.0, 0.5, 2.0))
    with pytest.raises(ValueError, match="returned no data"):
        viewer.open(tmp_path / "a.csv")


def test_curves_that_are_gone_on_with_are_not_refined_again(qapp: Any, fake: FakeEngine) -> None:
    line = np.array([[100.02499999, 20.0], [100.02499999, 90.0]])
    labels = Labels((Label(0, 1, line, np.full(2, 3.0), np.full(2, 0.1), "good"),))
    data, meta, _ = layer_of_labels(labels, "labels")
    with bench() as made:
        made.image((200, 128))
        made.viewer.add_layer(Shapes(data, **meta))
        made.saver.take_up()
        assert made.controller.progress, "the window goes on meanwhile"
        until(made.controller.records)
        assert len(made.controller.records()) == 1
        assert not made.controller.request().targets, "whatever a layer rounds its points to"


@pytest.mark.parametrize("scale", [(1, 1), (0.3, 0.7)])
def test_curves_that_are_resumed_are_not_refined_again(
    qapp: Any, fake: FakeEngine, scale: tuple[float, float]
) -> None:
    places = np.random.default_rng(0).uniform(5, 90, (40, 30, 2))
    with bench() as made:
        image = made.image()
        image.scale = np.array(scale)
        made.sketches([np.sort(line, axis=0) * scale for line in places])
        made.refine()
        assert not made.controller.request().targets
        made.saver.flush()
    with bench() as again:
        again.image().scale = np.array(scale)
        again.resume()
        assert len(again.controller.records()) == 40
        assert not again.controller.request().targets

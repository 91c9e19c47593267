"""Our files, after another program has changed lines in them."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import roifile

from napari_splinesketch.labels import Label, Labels, read_labels, write_labels

from .samples import bent, drawn, same_keys, same_points, same_sd, same_widths

Line = dict[str, Any]
"""A line as another program has it: `xy`, `frame`, and what else the file says of it."""
Edit = Callable[[list[Line]], object]
GIVEN = Labels((bent(0, 5), drawn(0, 9), bent(4, 5, points=35, shift=1 / 7)))


def in_imagej(path: Path, edit: Edit) -> None:
    """Open ROIs in the ROI Manager, edit them and save them."""
    rois = roifile.roiread(path)
    assert isinstance(rois, list)
    lines = [{"xy": r.coordinates(), "frame": r.t_position - 1, "props": r.props} for r in rois]
    edit(lines)
    made = []
    for line in lines:
        roi = roifile.ImagejRoi.frompoints(line["xy"])
        roi.roitype, roi.t_position = roifile.ROI_TYPE.POLYLINE, line["frame"] + 1
        roi.props = line.get("props", "")
        made.append(roi)
    roifile.roiwrite(path, made, mode="w")


def in_qupath(path: Path, edit: Edit) -> None:
    """Import GeoJSON, edit it and export it: two decimals, texts only, no members of others."""
    lines = []
    for feature in json.loads(path.read_text("utf-8"))["features"]:
        geometry, metadata = feature["geometry"], feature["properties"]["metadata"]
        texts = {key: text for key, text in metadata.items() if isinstance(text, str)}
        plane = geometry["plane"]
        lines.append({"xy": np.array(geometry["coordinates"]), "frame": plane["t"], "m": texts})
    edit(lines)
    made = []
    for line in lines:
        geometry = {"type": "LineString", "coordinates": np.round(line["xy"], 2).tolist()}
        if line["frame"]:
            geometry["plane"] = {"c": -1, "z": 0, "t": line["frame"]}
        properties = {"objectType": "annotation"} | ({"metadata": line["m"]} if "m" in line else {})
        made.append({"type": "Feature", "geometry": geometry, "properties": properties})
    path.write_text(json.dumps({"type": "FeatureCollection", "features": made}))


def in_qgis(path: Path, edit: Edit) -> None:
    """Edit a layer of GeoJSON and save it: objects are texts, geometries have no planes."""
    lines = []
    for feature in json.loads(path.read_text("utf-8"))["features"]:
        columns = {
            key: json.dumps(value) if isinstance(value, dict) else value
            for key, value in feature["properties"].items()
        }
        xy = np.array(feature["geometry"]["coordinates"])
        lines.append({"xy": xy, "frame": feature["geometry"]["plane"]["t"], "columns": columns})
    empty = dict.fromkeys(lines[0]["columns"])
    edit(lines)
    made = []
    for line in lines:
        geometry = {"type": "MultiLineString", "coordinates": [line["xy"].tolist()]}
        columns = line.get("columns", empty)
        made.append({"type": "Feature", "properties": columns, "geometry": geometry})
    path.write_text(json.dumps({"type": "FeatureCollection", "name": "a", "features": made}))


PROGRAMS = {"ImageJ": (".zip", in_imagej), "QuPath": (".geojson", in_qupath)}
PROGRAMS |= {"QGIS": (".geojson", in_qgis)}


def changed(index: int, **values: Callable[[Any], Any]) -> Edit:
    """Change members of a line."""

    def edit(lines: list[Line]) -> None:
        for name, change in values.items():
            lines[index][name] = change(lines[index][name])

    return edit


def with_vertex(xy: np.ndarray) -> np.ndarray:
    return np.insert(xy, 3, xy[2:4].mean(0) + 1, axis=0)


def with_moved_vertex(xy: np.ndarray) -> np.ndarray:
    return xy + np.eye(len(xy))[:, [0]] * [0.4, 0]


POINTS = {
    "a vertex more": with_vertex,
    "a vertex less": lambda xy: np.delete(xy, 3, axis=0),
    "a vertex moved": with_moved_vertex,
    "moved as a whole": lambda xy: xy + np.array([1.0, 0.5]),
    "turned about its middle": lambda xy: (xy - xy.mean(0)) @ [[0, 1], [-1, 0]] + xy.mean(0),
    "from its other end": lambda xy: xy[::-1],
}


def opened(program: str, folder: Path, edit: Edit) -> Labels:
    ending, edited = PROGRAMS[program]
    path = folder / f"a{ending}"
    write_labels(path, GIVEN)
    edited(path, edit)
    return read_labels(path)


@pytest.mark.parametrize("program", PROGRAMS)
def test_what_was_not_changed_comes_back_in_full(tmp_path: Path, program: str) -> None:
    back = opened(program, tmp_path, lambda lines: None)
    assert same_points(GIVEN, back, tolerance=0.006)
    assert same_keys(GIVEN, back)
    assert same_widths(GIVEN, back)
    assert same_sd(GIVEN, back)
    assert back.notes == ()


@pytest.mark.parametrize("program", PROGRAMS)
@pytest.mark.parametrize("change", POINTS.values(), ids=POINTS)
def test_a_line_that_was_changed_is_a_sketch(
    tmp_path: Path, program: str, change: Callable[[np.ndarray], np.ndarray]
) -> None:
    back = opened(program, tmp_path, changed(0, xy=change))
    assert same_keys(Labels(GIVEN.labels[1:]), Labels(back.labels[:2]))
    assert same_widths(Labels(GIVEN.labels[1:]), Labels(back.labels[:2]))
    sketch = back.labels[2]
    assert (sketch.frame, sketch.curve, sketch.status) == (0, 5, "sketch")
    expected = change(GIVEN.labels[0].points[:, ::-1])[:, ::-1]
    assert np.allclose(sketch.points, expected, atol=0.006)
    assert np.isnan(sketch.half_width).all()
    assert np.isinf(sketch.sd).all()
    assert back.notes == (
        "1 line changed in another program: read as drawn, without half-width and standard error",
    )


@pytest.mark.parametrize("program", PROGRAMS)
def test_deleted_and_added_lines(tmp_path: Path, program: str) -> None:
    def edit(lines: list[Line]) -> None:
        lines[0] = {"xy": np.array([[1.0, 2], [30, 4]]), "frame": 0}

    back = opened(program, tmp_path, edit)
    assert [label.curve for label in back.labels] == [9, 5, 10]
    assert [label.status for label in back.labels] == ["sketch", "good", "sketch"]
    assert back.notes == ()


@pytest.mark.parametrize("program", PROGRAMS)
@pytest.mark.parametrize("order", [1, -1], ids=["copy last", "copy first"])
@pytest.mark.parametrize("moved", [3, 0], ids=["moved", "in its place"])
def test_a_copy_is_a_line_of_its_own(
    tmp_path: Path, program: str, order: int, moved: float
) -> None:
    def edit(lines: list[Line]) -> None:
        lines.append({**lines[0], "xy": lines[0]["xy"] + moved})
        lines[:] = lines[::order]

    back = opened(program, tmp_path, edit)
    assert [label.curve for label in back.labels if label.frame == 0 and label.sd[0] < 1] == [5]
    assert back.labels[-1].curve == 10
    assert back.labels[-1].status == "sketch"


@pytest.mark.parametrize("program", ["ImageJ", "QuPath"])
def test_a_line_in_another_frame_is_a_sketch_there(tmp_path: Path, program: str) -> None:
    back = opened(program, tmp_path, lambda lines: lines.append({**lines[0], "frame": 2}))
    keys = [(label.frame, label.curve, label.status) for label in back.labels]
    assert keys == [(0, 5, "good"), (0, 9, "sketch"), (4, 5, "good"), (2, 5, "sketch")]


def test_imagej_moves_lines_of_a_stack_without_times_into_planes(tmp_path: Path) -> None:
    write_labels(tmp_path / "a.zip", GIVEN)
    rois = roifile.roiread(tmp_path / "a.zip")
    assert isinstance(rois, list)
    for plane, roi in zip((1, 1, 5), rois, strict=True):  # as the ROI Manager's Update does
        roi.position, roi.t_position, roi.z_position = 0, 1, plane
    copy = roifile.ImagejRoi.frombytes(rois[0].tobytes())
    copy.z_position, copy.name = 3, "copy"
    roifile.roiwrite(tmp_path / "a.zip", [*rois, copy], mode="w")
    back = read_labels(tmp_path / "a.zip")
    keys = [(label.frame, label.curve, label.status) for label in back.labels]
    assert keys == [(0, 5, "good"), (0, 9, "sketch"), (4, 5, "good"), (2, 5, "sketch")]


@pytest.mark.parametrize("ending", [".geojson", ".zip", ".wcon", ".coco.json"])
def test_places_far_away_are_not_taken_for_changed_ones(tmp_path: Path, ending: str) -> None:
    far = replace(bent(), points=bent().points + np.array([123_456.7, 98_765.4]))
    write_labels(tmp_path / f"a{ending}", Labels((far,)))
    assert read_labels(tmp_path / f"a{ending}").labels[0].status == "good"


@pytest.mark.parametrize("ending", [".wcon", ".coco.json"])
def test_other_formats_see_changed_lines_too(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"a{ending}"
    label = Label(0, 7, bent(points=4).points, np.ones(4), np.ones(4), "good", "accepted")
    write_labels(path, Labels((label,)))
    root = json.loads(path.read_text("utf-8"))
    if ending == ".wcon":
        root["data"][0]["x"][0][1] += 1
    else:
        root["annotations"][0]["keypoints"][3:6] = [0, 0, 0]  # a point that was deleted
    path.write_text(json.dumps(root))
    back = read_labels(path)
    (sketch,) = back.labels
    assert (sketch.curve, sketch.status, sketch.review) == (7, "sketch", "open")
    assert len(sketch.points) == (4 if ending == ".wcon" else 3)
    assert "1 line changed" in back.notes[0]


def test_files_of_version_0_2_are_read(tmp_path: Path) -> None:
    write_labels(tmp_path / "a.geojson", GIVEN)
    root = json.loads((tmp_path / "a.geojson").read_text("utf-8"))
    for feature in root["features"]:
        own = json.loads(feature["properties"].pop("metadata")["splinesketch"])
        del own["checksum"]
        feature["properties"]["splinesketch"] = own
    (tmp_path / "a.geojson").write_text(json.dumps(root))
    back = read_labels(tmp_path / "a.geojson")
    assert same_keys(GIVEN, back)
    assert same_widths(GIVEN, back)

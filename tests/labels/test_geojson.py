import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

from napari_splinesketch.labels import Labels, LabelsError, read_labels, write_labels

from .samples import FULL, same_keys, same_points, same_sd, same_widths


def test_everything_round_trips(tmp_path: Path) -> None:
    assert write_labels(tmp_path / "a.geojson", FULL) == ()
    back = read_labels(tmp_path / "a.geojson")
    assert same_points(FULL, back, tolerance=1e-12)
    assert same_keys(FULL, back)
    assert same_widths(FULL, back)
    assert same_sd(FULL, back)
    assert (back.scale, back.units, back.shape) == (FULL.scale, FULL.units, FULL.shape)
    assert back.provenance == FULL.provenance


def test_the_largest_number_that_a_label_can_have_round_trips(tmp_path: Path) -> None:
    labels = Labels((replace(FULL.labels[0], curve=2**63 - 1),))
    write_labels(tmp_path / "a.geojson", labels)
    assert same_keys(labels, read_labels(tmp_path / "a.geojson"))


def test_another_program_sees_x_and_y_from_the_corner(tmp_path: Path) -> None:
    write_labels(tmp_path / "a.geojson", FULL)
    collection = json.loads((tmp_path / "a.geojson").read_text(encoding="utf-8"))
    feature = collection["features"][2]
    line = shapely.from_geojson(json.dumps(feature["geometry"]))
    points = FULL.labels[2].points
    assert np.allclose(line.xy, points[:, ::-1].T + 0.5)
    assert line.length == pytest.approx(FULL.labels[2].arc_length[-1])
    assert feature["geometry"]["plane"] == {"c": -1, "z": 0, "t": 4}
    assert feature["properties"]["objectType"] == "annotation"
    assert feature["properties"]["classification"] == {"name": "good", "color": [0, 158, 115]}
    measurements = feature["properties"]["measurements"]
    assert measurements["Half-width px, mean"] == pytest.approx(FULL.labels[2].half_width.mean())
    assert "Half-width px, mean" not in collection["features"][1]["properties"]["measurements"]


FOREIGN = {
    "type": "FeatureCollection",
    "features": [
        {
            "type": "Feature",
            "id": "PathAnnotationObject",
            "geometry": {
                "type": "LineString",
                "coordinates": [[10.5, 20.5], [30.5, 25.5]],
                "plane": {"c": -1, "z": 0, "t": 3},
            },
            "properties": {"isLocked": False},
        },
        {
            "type": "Feature",
            "geometry": {"type": "MultiLineString", "coordinates": [[[1, 2], [3, 4, 9]]] * 2},
            "properties": None,
        },
        {"type": "Feature", "geometry": {"type": "Polygon", "coordinates": [[]]}},
        {"type": "Feature", "geometry": {"type": "Point", "coordinates": [0, 0]}},
    ],
}


@pytest.mark.parametrize("wrap", [lambda c: c, lambda c: c["features"]], ids=["whole", "array"])
def test_lines_of_other_programs_are_sketches(tmp_path: Path, wrap) -> None:
    (tmp_path / "a.json").write_text(json.dumps(wrap(FOREIGN)))
    labels = read_labels(tmp_path / "a.json")
    assert [(label.frame, label.curve) for label in labels.labels] == [(3, 0), (0, 1), (0, 2)]
    assert np.array_equal(labels.labels[0].points, [[20, 10], [25, 30]])
    assert np.array_equal(labels.labels[1].points, [[1.5, 0.5], [3.5, 2.5]])
    assert {label.status for label in labels.labels} == {"sketch"}
    assert labels.notes == (
        "left out 1 Point, 1 Polygon: only lines of two or more points can be sketches",
    )


@pytest.mark.parametrize(("times", "frames"), [((0, 0), [4, 7]), ((0, 3), [0, 3])])
def test_lines_on_planes_without_times_are_in_the_frame_of_their_plane(
    tmp_path: Path, times: tuple[int, int], frames: list[int]
) -> None:
    lines = [
        {"type": "LineString", "coordinates": LINE, "plane": {"c": -1, "z": z, "t": t}}
        for z, t in zip((4, 7), times, strict=True)
    ]
    (tmp_path / "a.geojson").write_text(json.dumps(lines))
    assert [label.frame for label in read_labels(tmp_path / "a.geojson").labels] == frames


def feature(coordinates: object, **properties: object) -> dict[str, object]:
    geometry = {"type": "LineString", "coordinates": coordinates}
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def test_lines_in_collections_of_geometries(tmp_path: Path) -> None:
    lines = {"type": "MultiLineString", "coordinates": [LINE, LINE]}
    inner = {"type": "GeometryCollection", "geometries": [lines, {"type": "Point"}]}
    outer = {"type": "GeometryCollection", "geometries": [feature(LINE)["geometry"], inner]}
    for _ in range(300):  # however deep
        outer = {"type": "GeometryCollection", "geometries": [outer]}
    planes = {"type": "Feature", "geometry": outer | {"plane": {"t": 2}}}
    (tmp_path / "a.geojson").write_text(json.dumps(planes))
    labels = read_labels(tmp_path / "a.geojson")
    assert [(label.frame, label.curve) for label in labels.labels] == [(2, 0), (2, 1), (2, 2)]
    assert "left out 1 Point" in labels.notes[0]
    (tmp_path / "a.json").write_text(json.dumps(inner))
    assert len(read_labels(tmp_path / "a.json").labels) == 2


@pytest.mark.parametrize("short", [[[0, 0]], []], ids=["one point", "no points"])
def test_a_line_that_is_too_short_costs_no_other(tmp_path: Path, short: list[object]) -> None:
    parts = {"type": "MultiLineString", "coordinates": [short, LINE]}
    lines = [feature(short), feature(LINE), {"type": "Feature", "geometry": parts}]
    (tmp_path / "a.geojson").write_text(json.dumps(lines))
    labels = read_labels(tmp_path / "a.geojson")
    assert [label.curve for label in labels.labels] == [0, 1]
    assert labels.notes == (
        "left out 2 LineStrings: only lines of two or more points can be sketches",
    )


OURS = {"frame": 0, "curve": 1, "status": "good", "half_width": [1, 1], "sd": [1, None]}
LINE = [[0, 0], [1, 1]]
MALFORMED = {
    "not an object": (3, "", "expected an object"),
    "no type": ({}, "", "has no 'type'"),
    "no features": ({"type": "FeatureCollection"}, "", "has no 'features'"),
    "features no array": ({"type": "FeatureCollection", "features": {}}, "features", "an array"),
    "no coordinates": ({"type": "LineString"}, "", "has no 'coordinates'"),
    "a word": (feature([[0, "x"], [1, 1]]), "geometry.coordinates[0][1]", "expected a number"),
    "a truth": (feature([[0, True], [1, 1]]), "geometry.coordinates[0][1]", "expected a number"),
    "NaN": (feature([[0, float("nan")], [1, 1]]), "geometry.coordinates[0][1]", "finite"),
    "NaN in provenance": (
        {
            "type": "FeatureCollection",
            "features": [],
            "splinesketch": {"provenance": {"x": np.nan}},
        },
        "splinesketch",
        "not JSON compliant",
    ),
    "huge": (feature([[0, 10**400], [1, 1]]), "geometry.coordinates[0][1]", "finite"),
    "one number": (feature([[0], [1, 1]]), "geometry.coordinates[0]", "expected [x, y]"),
    "short width": (
        feature(LINE, splinesketch={**OURS, "half_width": [1]}),
        "properties.splinesketch",
        "half_width has shape (1,); expected (2,)",
    ),
    "status": (
        feature(LINE, splinesketch={**OURS, "status": "ok"}),
        "properties.splinesketch",
        "status is 'ok'",
    ),
    "fractional frame": (
        feature(LINE, splinesketch={**OURS, "frame": 0.5}),
        "properties.splinesketch.frame",
        "expected a whole number",
    ),
    "twice": ([feature(LINE, splinesketch=OURS)] * 2, "[1].geometry.coordinates", "occurs twice"),
    "scale": (
        {"type": "FeatureCollection", "features": [], "splinesketch": {"scale": [1]}},
        "splinesketch",
        "scale is [1]; expected (y, x) size of a pixel",
    ),
    "units alone": (
        {"type": "FeatureCollection", "features": [], "splinesketch": {"units": "µm"}},
        "splinesketch",
        "scale is None",
    ),
    "provenance": (
        {"type": "FeatureCollection", "features": [], "splinesketch": {"provenance": 3}},
        "splinesketch.provenance",
        "expected an object",
    ),
}


@pytest.mark.parametrize(("value", "place", "reason"), MALFORMED.values(), ids=MALFORMED.keys())
def test_a_malformed_file_names_place_and_reason(
    tmp_path: Path, value: object, place: str, reason: str
) -> None:
    (tmp_path / "bad.geojson").write_text(json.dumps(value))
    with pytest.raises(LabelsError) as caught:
        read_labels(tmp_path / "bad.geojson")
    assert caught.value.place == place
    assert reason in caught.value.reason


POINT = '{"type": "Point"}, '
NO_JSON = {
    "cut": ('{"type":\n "Feat', "line 2, column 2"),
    "empty": ("", "line 1, column 1"),
    "deep": ("[" * 100_000, ""),
    "digits": ("1" * 10_000, ""),
    "cut in a number": ('[{"type": "Point"},\n -', "line 2, column 2"),
    "two values": ('{"type": "Point"}\n{}', "line 2, column 1"),
    "no comma": ('{"type": "Point" "a": 0}', "line 1, column 18"),
    "no name": ('{"type": "Point", 5: 0}', "line 1, column 19"),
    "far down": (f"[{POINT * 9000}\n\n  [0, ?]]", "line 3, column 7"),
    "far right": (f'{{"features": [{" " * 100_000}[0, ?]]}}', "line 1, column 100019"),
}


@pytest.mark.parametrize(("text", "place"), NO_JSON.values(), ids=NO_JSON.keys())
def test_what_is_no_json_is_said(tmp_path: Path, text: str, place: str) -> None:
    (tmp_path / "bad.geojson").write_text(text)
    with pytest.raises(LabelsError, match="not JSON") as caught:
        read_labels(tmp_path / "bad.geojson")
    assert caught.value.place == place

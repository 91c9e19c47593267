import json
import zipfile
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from napari_splinesketch.labels import Labels, LabelsError, read_labels, write_labels

from .samples import FILM, FULL, same_keys, same_points, same_sd, same_widths

NUMBERS = {"type": "array", "items": {"type": ["number", "null"]}}
RECORD = {
    "type": "object",
    "required": ["id", "t", "x", "y"],
    "properties": {
        "id": {"type": "string"},
        "t": NUMBERS,
        "x": {"type": "array", "items": NUMBERS},
        "y": {"type": "array", "items": NUMBERS},
    },
}
RULES = {
    "type": "object",
    "required": ["units", "data"],
    "properties": {
        "units": {
            "type": "object",
            "required": ["t", "x", "y"],
            "additionalProperties": {"type": "string"},
        },
        "metadata": {
            "properties": {"software": {"properties": {"featureID": {"type": "string"}}}},
        },
        "data": {"type": "array", "items": RECORD},
    },
}
"""The rules of the published schema that concern what we write."""


def test_everything_round_trips(tmp_path: Path) -> None:
    assert write_labels(tmp_path / "a.wcon", FULL) == ()
    back = read_labels(tmp_path / "a.wcon")
    assert same_points(FULL, back, tolerance=1e-12)
    assert same_keys(FULL, back)
    assert same_widths(FULL, back)
    assert same_sd(FULL, back)
    assert (back.scale, back.units, back.shape) == (FULL.scale, FULL.units, FULL.shape)
    assert back.provenance == FULL.provenance


def test_pixels_round_trip_bit_for_bit(tmp_path: Path) -> None:
    write_labels(tmp_path / "a.wcon", FILM)
    back = read_labels(tmp_path / "a.wcon")
    assert same_points(FILM, back)
    assert back.scale is None


def test_the_file_follows_the_published_rules(tmp_path: Path) -> None:
    write_labels(tmp_path / "a.wcon", FULL)
    root = json.loads((tmp_path / "a.wcon").read_text(encoding="utf-8"))
    jsonschema.validate(root, RULES)
    assert root["units"] == {"t": "1", "x": "um", "y": "um"}
    record = root["data"][2]
    assert (record["id"], record["t"]) == ("5", [4])
    assert np.allclose(record["x"][0], FULL.labels[2].points[:, 1] * 0.25)
    assert np.allclose(record["y"][0], FULL.labels[2].points[:, 0] * 0.5)


def test_a_file_of_another_program(tmp_path: Path) -> None:
    foreign = {
        "units": {"t": "s", "x": "mm", "y": "mm"},
        "data": [
            {"id": "b", "t": 0.3, "x": [1, 2, 3], "y": [4, 5, 7]},
            {"id": "a", "t": [0.1, 0.3], "x": [[1, 2], [5, 6]], "y": [[3, 4], [7, 8]]},
            {"id": "c", "t": [0.1], "x": [9], "y": [9]},
        ],
    }
    (tmp_path / "a.json").write_text(json.dumps(foreign))
    labels = read_labels(tmp_path / "a.json")
    keys = [(label.frame, label.curve) for label in labels.labels]
    assert keys == [(1, 0), (0, 1), (1, 1)]
    assert np.array_equal(labels.labels[0].points, [[4, 1], [5, 2], [7, 3]])
    assert (labels.scale, labels.units) == ((1.0, 1.0), "mm")
    assert labels.notes == (
        "left out 1 animal: only lines of two or more points can be sketches",
        "the file has no pixel size: 1 mm is taken as 1 pixel",
    )


@pytest.mark.parametrize(
    ("origin", "shift"),
    [
        ({"ox": 10, "oy": 20}, (20, 10)),
        ({"ox": [10], "oy": [20]}, (20, 10)),
        ({"cx": [1.5], "cy": [4]}, (0, 0)),
        ({"cx": [1.5], "cy": [4], "ox": 10, "oy": 20}, (20, 10)),
    ],
    ids=["origin", "origin in an array", "centroid", "origin and centroid"],
)
def test_the_origin_is_added(
    tmp_path: Path, origin: dict[str, object], shift: tuple[float, float]
) -> None:
    record = {"id": "1", "t": [0], "x": [[1, 2]], "y": [[3, 5]], **origin}
    root = {"units": {"t": "s", "x": "1", "y": "1"}, "data": record}
    (tmp_path / "a.wcon").write_text(json.dumps(root))
    labels = read_labels(tmp_path / "a.wcon")
    assert np.array_equal(labels.labels[0].points, np.array([[3, 1], [5, 2]]) + shift)
    assert labels.scale is None


def test_lines_with_a_centroid_are_where_the_format_s_own_examples_have_them(
    tmp_path: Path,
) -> None:
    # "All four test files starting with offset_ should represent the same spine points":
    # github.com/openworm/tracker-commons, tests/offset_*.wcon, of which these are the first animals
    line = {"id": "1", "t": [0], "x": [[6.5, 7, 7.5]], "y": [[8.3, 8, 7.6]]}
    moved = line | {"x": [[4.5, 5, 5.5]], "y": [[4.3, 4, 3.6]], "ox": [2], "oy": [4]}
    records = [
        line,
        line | {"cx": [7], "cy": [8]},
        moved,
        moved | {"cx": [5], "cy": [4]},
    ]
    for record in records:
        root = {"units": {"t": "s", "x": "mm", "y": "mm"}, "data": [record]}
        (tmp_path / "a.wcon").write_text(json.dumps(root))
        points = read_labels(tmp_path / "a.wcon").labels[0].points
        assert np.allclose(points, [[8.3, 6.5], [8, 7], [7.6, 7.5]])


@pytest.mark.parametrize(
    ("x", "y", "units"),
    [
        ("micrometers", "micrometers", "µm"),
        ("microns", "um", "µm"),
        ("pixels", "pixels", None),
        ("mm", "mm", "mm"),
    ],
)
def test_names_of_units(tmp_path: Path, x: str, y: str, units: str | None) -> None:
    record = {"id": "1", "t": [0], "x": [[1, 2]], "y": [[3, 5]]}
    (tmp_path / "a.wcon").write_text(
        json.dumps({"units": {"t": "s", "x": x, "y": y}, "data": [record]})
    )
    labels = read_labels(tmp_path / "a.wcon")
    assert labels.units == units
    assert (labels.notes == ()) == (units is None)


def test_missing_points_are_left_out(tmp_path: Path) -> None:
    record = {"id": 1, "t": [0], "x": [[1, None, 2]], "y": [[3, 4, 5]]}
    root = {"units": {"t": "s", "x": "1", "y": "1"}, "data": [record]}
    (tmp_path / "a.wcon").write_text(json.dumps(root))
    assert np.array_equal(read_labels(tmp_path / "a.wcon").labels[0].points, [[3, 1], [5, 2]])


def test_times_without_a_line_count_as_frames(tmp_path: Path) -> None:
    xs, ys = [[1, 2], [None, None], [5, 6]], [[3, 5], [None, None], [7, 8]]
    for last, notes in ((2, 0), (4, 1)):
        record = {"id": 1, "t": [0, 1, last], "x": xs, "y": ys}
        (tmp_path / "a.wcon").write_text(json.dumps({"units": UNITS, "data": [record]}))
        labels = read_labels(tmp_path / "a.wcon")
        assert [label.frame for label in labels.labels] == [0, 2]
        assert sum("not evenly spaced" in note for note in labels.notes) == notes


def test_missing_origins_leave_out_their_lines_only(tmp_path: Path) -> None:
    xs, ys = [[1, 2], None, [5, 6]], [[3, 5], None, [7, 8]]
    record = {"id": 1, "t": [0, 1, 2], "x": xs, "y": ys, "ox": [0, None, 1], "oy": [0, None, 1]}
    (tmp_path / "a.wcon").write_text(json.dumps({"units": UNITS, "data": [record]}))
    labels = read_labels(tmp_path / "a.wcon").labels
    assert [label.points.tolist() for label in labels] == [[[3, 1], [5, 2]], [[8, 6], [9, 7]]]


def packed(path: Path, **files: object) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("__MACOSX/._a.wcon", "what macOS packs with each file")
        for name, root in files.items():
            archive.writestr(f"films/{name}.wcon", json.dumps(root))
    return path


@pytest.mark.parametrize("name", ["a.wcon.zip", "a.zip", "A.WCON.ZIP"])
def test_a_packed_file(tmp_path: Path, name: str) -> None:
    root = {"units": UNITS, "data": [GOOD]}
    labels = read_labels(packed(tmp_path / name, a=root)).labels
    assert [label.points.tolist() for label in labels] == [[[3, 1], [4, 2]]]


def test_packed_files_that_cannot_be_read_say_why(tmp_path: Path) -> None:
    root = {"units": UNITS, "data": [GOOD]}
    for name, files, reason in (
        ("two.wcon.zip", {"a": root, "b": root}, r"two\.wcon\.zip: holds 2 WCON files; unpack"),
        ("none.wcon.zip", {}, r"none\.wcon\.zip: holds no WCON files \(files with the ending"),
        ("bad.wcon.zip", {"a": {"units": UNITS}}, r"bad\.wcon\.zip: has no 'data'"),
    ):
        with pytest.raises(LabelsError, match=reason):
            read_labels(packed(tmp_path / name, **files))
    (tmp_path / "cut.wcon.zip").write_bytes(b"PK\x03\x04")
    with pytest.raises(LabelsError, match=r"cut\.wcon\.zip: not a zip of WCON files"):
        read_labels(tmp_path / "cut.wcon.zip")


def test_a_file_that_goes_on_in_others_says_so(tmp_path: Path) -> None:
    root = {"units": UNITS, "data": [GOOD], "files": {"this": "_0", "next": ["_1"]}}
    (tmp_path / "a_0.wcon").write_text(json.dumps(root))
    assert "the others are not read" in read_labels(tmp_path / "a_0.wcon").notes[0]


UNITS = {"t": "s", "x": "mm", "y": "mm"}
GOOD = {"id": "1", "t": [0], "x": [[1, 2]], "y": [[3, 4]]}
MALFORMED = {
    "no data": ({"units": UNITS}, "", "has no 'data'"),
    "no units": ({"data": [GOOD]}, "", "has no 'units'"),
    "two units": ({"units": {**UNITS, "y": "m"}, "data": [GOOD]}, "units", "one unit"),
    "no id": ({"units": UNITS, "data": [{"t": [0]}]}, "data[0]", "has no 'id'"),
    "times": (
        {"units": UNITS, "data": [{**GOOD, "t": [0, 1]}]},
        "data[0]",
        "t, x and y have 2, 1 and 1 elements",
    ),
    "short y": ({"units": UNITS, "data": [{**GOOD, "y": [[3]]}]}, "data[0].y[0]", "that of x is 2"),
    "origin": (
        {"units": UNITS, "data": [{**GOOD, "ox": [1, 2]}]},
        "data[0].ox",
        "its length is 2; expected 1",
    ),
    "twice": ({"units": UNITS, "data": [GOOD, GOOD]}, "data[1]", "occurs twice"),
    "our id": (
        {"units": UNITS, "data": [{**GOOD, "id": "x"}], "@splinesketch": {}},
        "data[0].id",
        "whole number",
    ),
    "our frame": (
        {"units": UNITS, "data": [{**GOOD, "t": [0.5]}], "@splinesketch": {}},
        "data[0].t",
        "whole number",
    ),
    "our width": (
        {
            "units": UNITS,
            "data": [
                {
                    **GOOD,
                    "@splinesketch": {"half_width_px": [-1, 1], "sd_px": [1, 1], "status": "good"},
                }
            ],
        },
        "data[0]",
        "half_width is negative",
    ),
}


@pytest.mark.parametrize(("value", "place", "reason"), MALFORMED.values(), ids=MALFORMED.keys())
def test_a_malformed_file_names_place_and_reason(
    tmp_path: Path, value: object, place: str, reason: str
) -> None:
    (tmp_path / "bad.wcon").write_text(json.dumps(value))
    with pytest.raises(LabelsError) as caught:
        read_labels(tmp_path / "bad.wcon")
    assert caught.value.place == place
    assert reason in caught.value.reason


def test_no_curves(tmp_path: Path) -> None:
    write_labels(tmp_path / "a.wcon", Labels())
    assert read_labels(tmp_path / "a.wcon").labels == ()

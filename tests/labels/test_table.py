import csv
import os
import stat
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from napari_splinesketch import read_labels, write_labels
from napari_splinesketch.labels import Label, Labels, LabelsError
from napari_splinesketch.labels.types import MAX_COORDINATE, STATUSES

HEADER = "frame,curve,point,row,col,half_width,sd,arc_length,status"
UNITS_HEADER = HEADER + ",y,x,half_width_units,units"
LINE = Label(
    3,
    7,
    np.array([[0.1, 2.0], [3.1, 6.0]]),
    np.array([1.5, 1.25]),
    np.array([0.05, np.inf]),
    "good",
)

coordinates = st.floats(-MAX_COORDINATE, MAX_COORDINATE)
widths = st.floats(0, MAX_COORDINATE) | st.just(np.nan)
errors = st.floats(0) | st.just(np.nan)


@st.composite
def label_strategy(draw: st.DrawFn, frame: int, curve: int) -> Label:
    size = draw(st.integers(2, 6))
    points = draw(st.lists(st.tuples(coordinates, coordinates), min_size=size, max_size=size))
    columns = [draw(st.lists(kind, min_size=size, max_size=size)) for kind in (widths, errors)]
    width, sd = (np.array(column) for column in columns)
    return Label(frame, curve, np.array(points), width, sd, draw(st.sampled_from(STATUSES)))


@st.composite
def labels_strategy(draw: st.DrawFn) -> Labels:
    whole = st.integers(0, 2**63 - 1)
    keys = draw(st.lists(st.tuples(whole, whole), unique=True, max_size=4))
    labels = tuple(draw(label_strategy(*key)) for key in keys)
    sizes = st.floats(1e-6, 1e6)
    scale = draw(st.none() | st.tuples(sizes, sizes))
    units = draw(st.none() | st.sampled_from(["µm", "nm", 'inch, "', "mm"])) if scale else None
    return Labels(labels, scale, units)


def assert_same(one: Labels, other: Labels) -> None:
    assert len(one.labels) == len(other.labels)
    for a, b in zip(one.labels, other.labels, strict=True):
        assert (a.frame, a.curve, a.status) == (b.frame, b.curve, b.status)
        for name in ("points", "half_width", "sd"):
            a_bits, b_bits = (np.nan_to_num(getattr(c, name), nan=-1.0) for c in (a, b))
            assert a_bits.tobytes() == b_bits.tobytes(), name


@given(labels=labels_strategy())
def test_what_is_written_is_read_back_bit_for_bit(
    tmp_path_factory: pytest.TempPathFactory, labels: Labels
) -> None:
    path = tmp_path_factory.mktemp("table") / "labels.csv"
    write_labels(path, labels)
    back = read_labels(path)
    assert_same(labels, back)
    assert back.units == (labels.units if back.scale else None)
    if back.scale and labels.scale:
        far = max(np.abs(label.points).min() for label in labels.labels)
        if far > 1e-3:
            assert back.scale == pytest.approx(labels.scale, rel=1e-12)


def test_the_header_and_a_row_are_as_documented(tmp_path: Path) -> None:
    write_labels(tmp_path / "px.csv", Labels((LINE,)))
    assert (tmp_path / "px.csv").read_text().splitlines() == [
        HEADER,
        "3,7,0,0.1,2.0,1.5,0.05,0.0,good",
        "3,7,1,3.1,6.0,1.25,inf,5.0,good",
    ]


def test_units_add_physical_columns(tmp_path: Path) -> None:
    write_labels(tmp_path / "um.csv", Labels((LINE,), (0.5, 0.25), "µm"))
    frame = pd.read_csv(tmp_path / "um.csv")
    assert list(frame.columns) == UNITS_HEADER.split(",")
    assert np.allclose(frame.y, [0.05, 1.55])
    assert np.allclose(frame.x, [0.5, 1.5])
    assert set(frame.units) == {"µm"}
    back = read_labels(tmp_path / "um.csv")
    assert (back.scale, back.units) == ((0.5, 0.25), "µm")


@pytest.mark.parametrize("scale", [(0.325, 0.325), (1 / 3, 0.1), (2.0, 1e-9), (0.1 + 0.2, 7.0)])
def test_the_scale_is_read_back_exactly(tmp_path: Path, scale: tuple[float, float]) -> None:
    points = np.random.default_rng(0).uniform(0, 512, (50, 2))
    label = Label(0, 0, points, np.ones(50), np.ones(50), "good")
    write_labels(tmp_path / "a.csv", Labels((label,), scale, "m"))
    assert read_labels(tmp_path / "a.csv").scale == scale


def test_no_curves_at_all(tmp_path: Path) -> None:
    assert write_labels(tmp_path / "none.csv", Labels()) == ()
    assert (tmp_path / "none.csv").read_text() == HEADER + "\n"
    assert read_labels(tmp_path / "none.csv").labels == ()


def test_losses_are_said(tmp_path: Path) -> None:
    labels = Labels((LINE,), provenance={"preset": "fast"})
    (loss,) = write_labels(tmp_path / "a.csv", labels)
    assert "provenance" in loss
    (loss,) = write_labels(tmp_path / "b.csv", Labels((), (1.0, 2.0), "µm"))
    assert "scale" in loss


def test_columns_may_be_reordered_and_added(tmp_path: Path) -> None:
    write_labels(tmp_path / "a.csv", Labels((LINE,), (0.5, 0.25), "µm"))
    frame = pd.read_csv(tmp_path / "a.csv")
    frame["mine"] = "x"
    frame[frame.columns[::-1]].to_csv(tmp_path / "b.csv")
    assert_same(read_labels(tmp_path / "b.csv"), Labels((LINE,)))


@pytest.mark.parametrize("end", ["\r\n", "\r"], ids=["of Windows", "of old"])
def test_a_byte_order_mark_and_other_line_ends_are_read(tmp_path: Path, end: str) -> None:
    rows = [HEADER, "3,7,0,0.1,2,1.5,0.05,0,good", "3,7,1,3.1,6,1.25,inf,5,good", ""]
    (tmp_path / "a.csv").write_bytes(b"\xef\xbb\xbf" + end.join(rows).encode())
    assert_same(read_labels(tmp_path / "a.csv"), Labels((LINE,)))


@pytest.mark.parametrize(
    ("text", "frame"),
    [
        ("curve,row,col\n5,1,2\n5,3,4.5\n", 0),
        ("frame,curve,row,col\n7,5,1,2\n7,5,3,4.5\n", 7),
        ("curve,col,row,half_width,sd\n5,2,1,,\n5,4.5,3,,\n", 0),
        (f"{UNITS_HEADER},locked\n" + ",5,,1,2,,,,,,,,,\n,5,,3,4.5,,,,,,,,,\n", 0),
        ("curve, row, col\n5, 1, 2\n5, 3, 4.5\n", 0),
        ("curve,row,col\n5,1,2\n5,3,4.5\n\n,,\n", 0),
        ("curve,row,col,,\n5,1,2,,\n5,3,4.5,,\n", 0),
        ("curve ,row\t, col \n5,1,2\n5,3,4.5\n", 0),
    ],
    ids=[
        *("no frame", "frame", "empty fields", "all empty", "spaces", "empty rows below"),
        *("empty columns beside", "spaces after names"),
    ],
)
def test_a_sketch_needs_places_only(tmp_path: Path, text: str, frame: int) -> None:
    (tmp_path / "a.csv").write_text(text)
    points = np.array([[1, 2], [3, 4.5]])
    sketch = Label.from_sketch(points, frame=frame, identity=5)
    assert_same(read_labels(tmp_path / "a.csv"), Labels((sketch,)))


def test_sketches_are_added_to_a_table_in_a_spreadsheet(tmp_path: Path) -> None:
    judged = replace(LINE, review="accepted", locked=True)
    write_labels(tmp_path / "a.csv", Labels((judged,), (0.5, 0.25), "µm"))
    new = pd.DataFrame({"frame": 3, "curve": 8, "row": [1.0, 5.0], "col": [2.0, 9.0]})
    pd.concat([pd.read_csv(tmp_path / "a.csv"), new]).to_csv(tmp_path / "b.csv", index=False)
    back = read_labels(tmp_path / "b.csv")
    sketch = Label.from_sketch(new[["row", "col"]].to_numpy(), frame=3, identity=8)
    assert_same(back, Labels((judged, sketch)))
    assert [(label.review, label.locked) for label in back.labels] == [
        ("accepted", True),
        ("open", False),
    ]
    assert (back.scale, back.units) == ((0.5, 0.25), "µm")


ROW0, ROW1 = "0,0,0,1.0,2.0,1.0,0.1,0.0,good", "0,0,1,4.0,6.0,1.0,0.1,5.0,good"
MALFORMED = {
    "empty": ("", 1, "nothing is in it; expected a table of curves"),
    "semicolons": ("curve;row;col\n0;1;2\n0;3;4\n", 1, "curve, row, col, separated by commas"),
    "another table": ("time,x,y\n", 1, "no column curve"),
    "missing column": (HEADER.replace(",col", "") + "\n", 1, "no column col;"),
    "double column": (HEADER + ",row\n", 1, "column row occurs twice"),
    "short row": (f"{HEADER}\n{ROW0}\n0,0,1\n", 3, "3 fields; the header has 9"),
    "blank line": (f"{HEADER}\n{ROW0}\n\n{ROW1}\n", 3, "0 fields"),
    "a word": (f"{HEADER}\n{ROW0.replace('2.0', 'two')}\n", 2, "col is 'two'; expected a number"),
    "fractional frame": (f"{HEADER}\n0.5{ROW0[1:]}\n", 2, "frame is '0.5'"),
    "negative curve": (f"{HEADER}\n0,-1{ROW0[3:]}\n", 2, "curve is '-1'"),
    "huge frame": (f"{HEADER}\n{'9' * 19}{ROW0[1:]}\n{'9' * 19}{ROW1[1:]}\n", 2, "2^63"),
    "point missing": (f"{HEADER}\n{ROW0}\n{ROW1.replace('0,0,1', '0,0,2')}\n", 3, "point is 2"),
    "one point": (f"{HEADER}\n{ROW0}\n", 2, "curve 0 of frame 0: one row; expected at least 2"),
    "rows of two curves mixed": (
        "curve,row,col\n1,0,0\n2,0,0\n1,1,1\n2,1,1\n",
        2,
        "curve 1 of frame 0: one row; expected at least 2, which follow one another",
    ),
    "infinite place": (f"{HEADER}\n{ROW0.replace('2.0', 'inf')}\n{ROW1}\n", 2, "finite"),
    "negative width": (f"{HEADER}\n{ROW0}\n{ROW1.replace('6.0,1', '6.0,-1')}\n", 2, "negative"),
    "unknown status": (f"{HEADER}\n{ROW0[:-4]}ok\n{ROW1[:-4]}ok\n", 2, "status is 'ok'"),
    "status changes": (f"{HEADER}\n{ROW0}\n{ROW1[:-4]}check\n", 3, "status differs"),
    "curve again": (
        "\n".join([HEADER, ROW0, ROW1, "1" + ROW0[1:], "1" + ROW1[1:], ROW0]),
        6,
        "curve 0 occurs twice in frame 0",
    ),
    "units change": (
        f"{UNITS_HEADER}\n{ROW0},1,2,1,µm\n{ROW1},4,6,1,nm\n",
        3,
        "units differs from 'µm' on line 2",
    ),
    "edited by hand": (
        f"{UNITS_HEADER}\n{ROW0},1,2,1,µm\n{ROW1},5,6,1,µm\n",
        2,
        "y is not row times one scale",
    ),
    "mirrored": (f"{UNITS_HEADER}\n{ROW0},1,-2,1,µm\n{ROW1},4,-6,1,µm\n", 2, "x is not col"),
    "no such scale": (
        f"{UNITS_HEADER}\n{ROW0},1e-40,2e-40,1,µm\n{ROW1},4e-40,6e-40,1,µm\n",
        2,
        "scale is (1e-40, ",
    ),
    "no such units": (f"{UNITS_HEADER}\n{ROW0},1,2,1,\x07\n{ROW1},4,6,1,\x07\n", 2, "units"),
    "open quote": (f'{HEADER}\n"{ROW0}\n', 2, "not a line of a CSV table"),
}


@pytest.mark.parametrize(("text", "line", "reason"), MALFORMED.values(), ids=MALFORMED.keys())
def test_a_malformed_table_names_file_line_and_reason(
    tmp_path: Path, text: str, line: int, reason: str
) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(LabelsError) as caught:
        read_labels(path)
    assert isinstance(caught.value, ValueError)
    assert str(caught.value).startswith(f"{path}, line {line}: ")
    assert reason in str(caught.value)


def test_bytes_that_are_no_text(tmp_path: Path) -> None:
    (tmp_path / "bad.csv").write_bytes(HEADER.encode() + b"\n\xff\xfe\x00")
    with pytest.raises(LabelsError, match="UTF-8"):
        read_labels(tmp_path / "bad.csv")


def test_an_existing_file_is_kept_unless_asked(tmp_path: Path) -> None:
    path = tmp_path / "labels.csv"
    path.write_text("mine")
    with pytest.raises(FileExistsError, match="exists already"):
        write_labels(path, Labels((LINE,)))
    assert path.read_text() == "mine"
    write_labels(path, Labels((LINE,)), overwrite=True)
    assert_same(read_labels(path), Labels((LINE,)))


def test_a_failed_write_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "labels.csv"
    path.write_text("mine")

    def broken(*args: object) -> None:
        raise OSError("disk full")

    monkeypatch.setattr("napari_splinesketch.labels.table._columns", broken)
    with pytest.raises(OSError, match="disk full"):
        write_labels(path, Labels((LINE,)), overwrite=True)
    assert path.read_text() == "mine"
    assert os.listdir(tmp_path) == ["labels.csv"]


def test_a_written_file_has_ordinary_permissions(tmp_path: Path) -> None:
    (tmp_path / "plain").touch()
    write_labels(tmp_path / "labels.csv", Labels((LINE,)))
    modes = {stat.S_IMODE((tmp_path / name).stat().st_mode) for name in ("plain", "labels.csv")}
    assert len(modes) == 1


def test_reading_holds_no_more_than_the_labels(
    tmp_path: Path, peak_memory: Callable[..., float]
) -> None:
    points = np.random.default_rng(0).uniform(0, 512, (100, 2))
    ones = np.ones(100)
    write_labels(
        tmp_path / "many.csv",
        Labels(tuple(Label(0, i, points, ones, ones, "good") for i in range(200))),
    )
    size = (tmp_path / "many.csv").stat().st_size
    assert peak_memory(lambda: read_labels(tmp_path / "many.csv"), size) < size


def test_python_csv_reads_it(tmp_path: Path) -> None:
    write_labels(tmp_path / "a.csv", Labels((LINE,)))
    with (tmp_path / "a.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["col"]) for row in rows] == [2.0, 6.0]


def test_an_underscore_is_in_no_number(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("curve,row,col\n0,1_5,2\n0,3,4\n")
    with pytest.raises(LabelsError, match="line 2: row is '1_5'; expected a number"):
        read_labels(tmp_path / "a.csv")

import dataclasses
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from napari_splinesketch.labels import Labels, LabelsError, read_labels, write_labels

from .samples import FILM, FULL, bent, same_keys, same_points, same_widths


def test_all_but_standard_errors_round_trips(tmp_path: Path) -> None:
    losses = write_labels(tmp_path / "a.swc", FULL)
    assert [loss.partition(":")[0] for loss in losses] == [
        "SWC has no place for standard errors",
        "SWC has no frames",
        "SWC has no unknown radius",
    ]
    back = read_labels(tmp_path / "a.swc")
    assert same_points(FULL, back, tolerance=1e-12)
    assert same_keys(FULL, back)
    assert same_widths(FULL, back, tolerance=1e-12)
    assert all(np.all(np.isinf(label.sd)) for label in back.labels)
    assert (back.scale, back.units, back.shape) == (FULL.scale, FULL.units, FULL.shape)
    assert back.provenance == FULL.provenance


def test_pixels_round_trip_bit_for_bit(tmp_path: Path) -> None:
    write_labels(tmp_path / "a.swc", FILM)
    back = read_labels(tmp_path / "a.swc")
    assert same_points(FILM, back)
    assert same_widths(FILM, back)


def test_pandas_reads_the_table(tmp_path: Path) -> None:
    label = bent(points=7)
    square = Labels((label, bent(curve=3, points=4, shift=20.0)), (0.5, 0.5), "µm")
    write_labels(tmp_path / "a.swc", square)
    columns = ["id", "type", "x", "y", "z", "radius", "parent"]
    table = pd.read_csv(tmp_path / "a.swc", sep=" ", comment="#", names=columns)
    assert list(table.id) == list(range(1, 12))
    assert list(table.parent) == [-1, 1, 2, 3, 4, 5, 6, -1, 8, 9, 10]
    assert np.array_equal(table.x[:7], label.points[:, 1] * 0.5)
    assert np.array_equal(table.y[:7], label.points[:, 0] * 0.5)
    assert np.allclose(table.radius[:7], label.half_width * 0.5)
    assert set(table.z) == {0}


BRANCHED = """# a neuron
1 1 10 20 0 2 -1
2 3 11 21 0 1.5 1

3 3 12 23 1 0 2
4 3 13 25 0 1 3
5 3 8 23 0 1 2
6 3 7 26 0 1 5
7 3 100 100 0 1 -1
"""


def test_a_tree_of_another_program_is_cut_at_its_branchings(tmp_path: Path) -> None:
    (tmp_path / "a.swc").write_text(BRANCHED)
    labels = read_labels(tmp_path / "a.swc")
    lines = [label.points.tolist() for label in labels.labels]
    assert lines == [
        [[20, 10], [21, 11]],
        [[21, 11], [23, 12], [25, 13]],
        [[21, 11], [23, 8], [26, 7]],
    ]
    assert [label.curve for label in labels.labels] == [0, 1, 2]
    assert np.array_equal(labels.labels[1].half_width, [1.5, np.nan, 1], equal_nan=True)
    assert labels.notes == (
        "left out 1 trees of a single point",
        "left out z: curves lie in the image's plane",
    )


def test_samples_may_come_in_any_order(tmp_path: Path) -> None:
    (tmp_path / "a.swc").write_text("3 0 5 6 0 1 2\n1 0 1 2 0 1 -1\n2 0 3 4 0 1 1\n")
    labels = read_labels(tmp_path / "a.swc")
    assert labels.labels[0].points.tolist() == [[2, 1], [4, 3], [6, 5]]


MALFORMED = {
    "short": ("1 0 1 2 0 1\n", "line 1", "6 fields; expected id type x y z radius parent"),
    "a word": ("1 0 x 2 0 1 -1\n", "line 1", "x is 'x'; expected a number"),
    "not a number": ("1 0 nan 2 0 1 -1\n", "line 1", "x is 'nan'"),
    "fractional id": ("1.5 0 1 2 0 1 -1\n", "line 1", "whole numbers"),
    "negative id": ("-1 0 1 2 0 1 -1\n", "line 1", "whole numbers"),
    "id twice": ("1 0 1 2 0 1 -1\n1 0 1 2 0 1 -1\n", "line 2", "id 1 occurs twice"),
    "no parent": ("1 0 1 2 0 1 -1\n2 0 1 2 0 1 9\n", "line 2", "there is no parent 9"),
    "ring": ("1 0 1 2 0 1 2\n2 0 1 2 0 1 1\n", "line 1", "in a ring"),
    "own parent": ("1 0 1 2 0 1 1\n", "line 1", "in a ring"),
    "far": ("1 0 1e10 2 0 1 -1\n2 0 1 2 0 1 1\n", "line 1", "within"),
    "comment": ("# splinesketch {\n", "line 1", "not JSON"),
    "about": (
        '# splinesketch {"curve": 1, "frame": 0, "status": "?"}\n1 0 1 2 0 1 -1\n2 0 1 3 0 1 1\n',
        "line 2",
        "status is '?'",
    ),
    "numbers": (
        '# splinesketch {"curve": "x", "frame": 0}\n1 0 1 2 0 1 -1\n2 0 1 3 0 1 1\n',
        "line 1.curve",
        "expected a number",
    ),
}


@pytest.mark.parametrize(("text", "place", "reason"), MALFORMED.values(), ids=MALFORMED.keys())
def test_a_malformed_file_names_place_and_reason(
    tmp_path: Path, text: str, place: str, reason: str
) -> None:
    (tmp_path / "bad.swc").write_text(text)
    with pytest.raises(LabelsError) as caught:
        read_labels(tmp_path / "bad.swc")
    assert caught.value.place == place
    assert reason in caught.value.reason


def test_a_curve_given_twice_is_refused(tmp_path: Path) -> None:
    write_labels(tmp_path / "a.swc", Labels((bent(), bent(curve=1))))
    text = (tmp_path / "a.swc").read_text().replace('"curve": 1', '"curve": 0')
    (tmp_path / "a.swc").write_text(text)
    with pytest.raises(LabelsError, match="curve 0 occurs twice in frame 0"):
        read_labels(tmp_path / "a.swc")


def test_long_provenance_can_be_read_back(tmp_path: Path) -> None:
    provenance = {"sha256": {str(frame): "0" * 64 for frame in range(2000)}}
    labels = dataclasses.replace(FULL, provenance=provenance)
    write_labels(tmp_path / "a.swc", labels)
    assert read_labels(tmp_path / "a.swc").provenance == provenance


def test_no_curves(tmp_path: Path) -> None:
    write_labels(tmp_path / "a.swc", Labels())
    assert read_labels(tmp_path / "a.swc").labels == ()

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from napari_splinesketch.labels import Labels, LabelsError, read_labels, write_labels

from .samples import FILM, bent, same_keys, same_points, same_sd, same_widths

HEADER = "index,shape-type,vertex-index,axis-0,axis-1"
SHAPES = f"""{HEADER},axis-2
0,path,0,1.0,2.1234567,3.0
0,path,1,1.0,4.0,5.0
0,path,2,1.0,7.0,8.1
1,rectangle,0,0.0,2.0,3.0
1,rectangle,1,0.0,6.0,5.0
2,line,0,1.9999999,2.0,3.0
2,line,1,2.0000001,4.0,5.0
3,polygon,0,0.0,2.0,3.0
4,path,0,0.0,2.0,3.0
5,rectangle,0,0.0,2.0,3.0
"""


def test_lines_and_paths_are_sketches_and_the_rest_is_named(tmp_path: Path) -> None:
    (tmp_path / "shapes.csv").write_text(SHAPES)
    labels = read_labels(tmp_path / "shapes.csv")
    assert [(label.frame, label.curve) for label in labels.labels] == [(1, 0), (2, 2)]
    assert np.array_equal(labels.labels[0].points, [[2.1234567, 3], [4, 5], [7, 8.1]])
    assert {label.status for label in labels.labels} == {"sketch"}
    assert labels.notes[0].startswith("left out 1 point, 1 polygon, 2 rectangles:")


def test_a_film_round_trips_bit_for_bit_with_all_that_a_table_holds(tmp_path: Path) -> None:
    labels = [replace(one, review="accepted", locked=True) for one in FILM.labels]
    film = Labels(tuple(labels), (0.5, 0.25), "µm", provenance={"preset": "fast"})
    losses = write_labels(tmp_path / "a.shapes.csv", film)
    (loss,) = losses
    assert loss.endswith("CSV: no place for provenance (version, settings, image, date)")
    back = read_labels(tmp_path / "a.shapes.csv")
    assert same_points(film, back)
    assert same_keys(film, back)
    assert same_widths(film, back)
    assert same_sd(film, back)
    assert (back.scale, back.units) == (film.scale, film.units)
    assert {(label.review, label.locked) for label in back.labels} == {("accepted", True)}


def test_one_image_has_two_axes_and_pandas_reads_them(tmp_path: Path) -> None:
    labels = Labels((bent(points=3),))
    write_labels(tmp_path / "a.shapes.csv", labels)
    frame = pd.read_csv(tmp_path / "a.shapes.csv")
    assert ",".join(frame.columns[:5]) == HEADER
    assert np.allclose(frame[["axis-0", "axis-1"]], labels.labels[0].points, rtol=1e-15, atol=0)
    assert same_points(labels, read_labels(tmp_path / "a.shapes.csv"))


def test_no_curves(tmp_path: Path) -> None:
    write_labels(tmp_path / "a.shapes.csv", Labels())
    assert read_labels(tmp_path / "a.shapes.csv").labels == ()


MALFORMED = {
    "four axes": (f"{HEADER},axis-2,axis-3\n", 1, "expected axis-0 and axis-1"),
    "axis missing": (f"{HEADER},axis-3\n", 1, "expected axis-0 and axis-1"),
    "unknown type": (f"{HEADER}\n0,star,0,1,2\n0,star,1,1,3\n", 2, "shape-type is 'star'"),
    "type changes": (f"{HEADER}\n0,line,0,1,2\n0,path,1,1,3\n", 3, "differs from 'line'"),
    "vertex missing": (f"{HEADER}\n0,line,0,1,2\n0,line,2,1,3\n", 3, "vertex-index is 2"),
    "shape again": (
        f"{HEADER}\n0,path,0,1,2\n0,path,1,1,3\n1,line,0,1,2\n0,path,2,5,5\n",
        5,
        "curve 0 occurs twice",
    ),
    "between frames": (f"{HEADER},axis-2\n0,path,0,1,2,3\n0,path,1,2,2,3\n", 2, "several frames"),
    "negative frame": (f"{HEADER},axis-2\n0,path,0,-1,2,3\n0,path,1,-1,2,3\n", 2, "axis-0 is -1"),
    "no frame": (f"{HEADER},axis-2\n0,path,0,inf,2,3\n0,path,1,inf,2,3\n", 2, "axis-0 is inf"),
    "not finite": (f"{HEADER}\n0,path,0,nan,2\n0,path,1,1,3\n", 2, "finite"),
    "a word": (f"{HEADER}\n0,path,0,x,2\n", 2, "axis-0 is 'x'"),
}


@pytest.mark.parametrize(("text", "line", "reason"), MALFORMED.values(), ids=MALFORMED.keys())
def test_a_malformed_file_names_line_and_reason(
    tmp_path: Path, text: str, line: int, reason: str
) -> None:
    (tmp_path / "bad.csv").write_text(text)
    with pytest.raises(LabelsError) as caught:
        read_labels(tmp_path / "bad.csv")
    assert f"bad.csv, line {line}: " in str(caught.value)
    assert reason in str(caught.value)

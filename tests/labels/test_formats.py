import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import roifile

from napari_splinesketch.labels import Labels, LabelsError, read_labels, write_labels
from napari_splinesketch.labels.format import Format
from napari_splinesketch.labels.formats import FORMATS, WRITERS, claiming, writer_of

from .samples import FULL, bent, same_keys, same_points, same_sd, same_widths


def test_an_unknown_ending_is_refused_and_the_known_ones_are_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"labels\.txt: no format has this ending.*labels CSV"):
        write_labels(tmp_path / "labels.txt", Labels())
    (tmp_path / "labels.txt").write_text("")
    with pytest.raises(LabelsError, match=r"not a file of labels; expected one of .*\.csv"):
        read_labels(tmp_path / "labels.txt")


@pytest.mark.parametrize(("name", "kind"), [("a.swc", "SWC"), ("A.SLP", "SLEAP")])
def test_what_is_only_written_is_said(tmp_path: Path, name: str, kind: str) -> None:
    (tmp_path / name).write_text("")
    with pytest.raises(LabelsError, match=f"{kind} can be written only; expected one of"):
        read_labels(tmp_path / name)


def test_the_longest_ending_decides_and_case_does_not_matter() -> None:
    assert writer_of("a.shapes.csv").name == "napari Shapes CSV"
    assert writer_of("A.SHAPES.CSV").name == "napari Shapes CSV"
    assert writer_of("shapes.csv").name == "labels CSV"


def test_a_name_that_is_read_as_one_format_is_not_written_in_another(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"a\.wcon\.zip: WCON is written with the ending \.wcon$"):
        write_labels(tmp_path / "a.wcon.zip", Labels())
    assert not list(tmp_path.iterdir())
    assert writer_of("a.zip").name == "ImageJ ROIs"


def test_names_and_endings_are_unique() -> None:
    assert len({form.name for form in FORMATS}) == len(FORMATS)
    assert len({writer.suffix for writer in WRITERS}) == len(WRITERS)


@pytest.mark.parametrize("form", FORMATS, ids=lambda form: form.name)
def test_a_format_does_what_it_says(form: Format) -> None:
    path = Path(f"a{form.suffix}")
    if form.read is None:
        with pytest.raises(ValueError, match=f"{form.name} can be written only"):
            form.read_whole(path)
    if form.write is None:
        with pytest.raises(ValueError, match=f"{form.name} can be read only"):
            form.write_whole(path, FULL)
    assert form.read or form.write
    assert all(ending == ending.lower() for ending in form.endings)


@pytest.mark.parametrize("writer", WRITERS, ids=lambda writer: writer.name)
def test_no_writer_overwrites_unless_asked(tmp_path: Path, writer) -> None:
    path = tmp_path / f"labels{writer.suffix}"
    path.write_text("mine")
    with pytest.raises(FileExistsError, match=r"exists already.*overwrite=True"):
        write_labels(path, Labels())
    assert path.read_text() == "mine"
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


def test_a_missing_file_is_the_systems_own_error(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        read_labels(tmp_path / "none.csv")


@pytest.mark.parametrize("name", ["a.csv", "a.geojson", "a.wcon", "a.coco.json"])
def test_what_the_user_said_of_a_curve_is_kept(tmp_path: Path, name: str) -> None:
    reviews = ("accepted", "open", "rejected")
    labels = [
        replace(one, review=r, locked=r == "open")
        for one, r in zip(FULL.labels, reviews, strict=True)
    ]
    told = write_labels(tmp_path / name, replace(FULL, labels=tuple(labels)))
    assert not any("accepted" in sentence for sentence in told)
    back = read_labels(tmp_path / name).labels
    assert tuple(one.review for one in back) == reviews
    assert [one.locked for one in back] == [False, True, False]
    write_labels(tmp_path / name, FULL, overwrite=True)
    back = read_labels(tmp_path / name).labels
    assert {(one.review, one.locked) for one in back} == {("open", False)}


@pytest.mark.parametrize("said", [{"review": "accepted"}, {"locked": True}])
@pytest.mark.parametrize("name", ["a.swc", "a.zip", "a.masks.tif"])
def test_formats_without_a_place_for_it_say_so(
    tmp_path: Path, name: str, said: dict[str, Any]
) -> None:
    judged = replace(FULL, labels=(replace(FULL.labels[0], **said),))
    told = write_labels(tmp_path / name, judged)
    assert any("no place for what you accepted" in sentence for sentence in told)


@pytest.mark.parametrize("writer", WRITERS, ids=lambda writer: writer.name)
def test_a_name_that_is_no_text_stops_no_writer(tmp_path: Path, writer: Format) -> None:
    name = "w\udcff\n.tif"  # as Python gives a file name that is not in UTF-8
    labels = replace(FULL, provenance={"image": {"name": name}})
    write_labels(tmp_path / f"a{writer.suffix}", labels)
    if writer.read:
        assert len(read_labels(tmp_path / f"a{writer.suffix}").labels) == 3


BOTH = [form for form in WRITERS if form.read]


@pytest.mark.parametrize("form", BOTH, ids=lambda form: form.name)
def test_a_file_without_curves_is_read_as_none(tmp_path: Path, form: Format) -> None:
    path = tmp_path / f"a{form.suffix}"
    write_labels(path, [])
    assert claiming(path)
    assert read_labels(path).labels == ()


def test_coco_is_read_back_as_it_was_written(tmp_path: Path) -> None:
    labels = replace(
        FULL, labels=(bent(0, 5), replace(bent(4, 9, shift=0.1), sd=np.full(20, np.inf)))
    )
    write_labels(tmp_path / "a.coco.json", labels)
    back = read_labels(tmp_path / "a.coco.json")
    assert (back.scale, back.units, back.shape) == (FULL.scale, FULL.units, FULL.shape)
    assert back.provenance == FULL.provenance
    assert same_points(back, labels)
    assert same_keys(back, labels)
    assert same_widths(back, labels)
    assert same_sd(back, labels)


def test_coco_of_other_programs_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.coco.json"
    path.write_text('{"images": [{"id": 7}], "annotations": [{"image_id": 7, "keypoints": []}]}')
    with pytest.raises(LabelsError, match=r"annotations\[0\]: not written by napari-splinesketch"):
        read_labels(path)


def test_some_of_a_file_s_labels_keep_frame_number_and_review(tmp_path: Path) -> None:
    some = [replace(label, review="accepted") for label in FULL.labels if label.frame]
    write_labels(tmp_path / "a.csv", some)
    back = read_labels(tmp_path / "a.csv").labels
    assert [(label.frame, label.curve, label.review) for label in back] == [(4, 5, "accepted")]


def test_sketches_are_written_too(tmp_path: Path) -> None:
    lines = [[[0, 1], [2, 3.5]], np.array([[4, 5], [6, 7], [8, 9]])]
    write_labels(tmp_path / "a.csv", (line for line in lines))
    back = read_labels(tmp_path / "a.csv").labels
    assert [label.points.tolist() for label in back] == [np.array(line).tolist() for line in lines]
    assert [(label.frame, label.curve, label.status) for label in back] == [
        (0, 0, "sketch"),
        (0, 1, "sketch"),
    ]


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        (None, "labels is None .*; give Labels, a refinement, or a list of curves or of sketches"),
        ("a.csv", "labels is 'a.csv'"),
        ({0: [[1, 2], [3, 4]]}, "labels is {0: "),
        (np.zeros((2, 2)), r"labels is array.*shape \(2,\)"),
        ([[[0, 0]]], r"points have shape \(1, 2\); expected \(N, 2\) with N at least 2"),
    ],
)
def test_what_is_no_labels_is_said(tmp_path: Path, given: Any, reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        write_labels(tmp_path / "a.csv", given)
    assert not any(tmp_path.iterdir())


def test_a_table_says_where_a_review_is_wrong(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    write_labels(path, Labels((replace(bent(), review="accepted"),)))
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("accepted", "liked"), encoding="utf-8")
    with pytest.raises(LabelsError, match="line 2: curve 0 of frame 0: review is 'liked'"):
        read_labels(path)
    path.write_text(text.replace("accepted", "open", 1), encoding="utf-8")
    with pytest.raises(LabelsError, match="line 3: review differs from 'open' on line 2"):
        read_labels(path)


@pytest.mark.parametrize("ending", [".zip", ".geojson"])
def test_lines_added_elsewhere_get_new_numbers(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"a{ending}"
    ours = [replace(FULL.labels[0], curve=number) for number in (1, 3)]
    write_labels(path, Labels(tuple(ours)))
    points = [[1.0, 2], [3, 4.5]]
    if ending == ".zip":
        roi = roifile.ImagejRoi.frompoints(points)
        roi.roitype = roifile.ROI_TYPE.POLYLINE
        written: Any = roifile.roiread(path)
        roifile.roiwrite(path, [roi, *written], mode="w")
    else:
        root = json.loads(path.read_text(encoding="utf-8"))
        root["features"].insert(0, {"type": "LineString", "coordinates": points})
        path.write_text(json.dumps(root))
    numbers = [(label.curve, label.status) for label in read_labels(path).labels]
    assert numbers == [(1, ours[0].status), (3, ours[1].status), (4, "sketch")]


def test_a_table_says_where_a_lock_is_wrong(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    write_labels(path, Labels((replace(bent(), locked=True),)))
    lines = path.read_text(encoding="utf-8").splitlines()
    assert lines[0].endswith(",locked")
    path.write_text("\n".join([lines[0], *(line[:-1] + "2" for line in lines[1:])]))
    with pytest.raises(LabelsError, match="line 2: curve 0 of frame 0: locked is 2; expected 1"):
        read_labels(path)
    path.write_text("\n".join([*lines[:2], lines[2][:-1] + "0", *lines[3:]]))
    with pytest.raises(LabelsError, match="line 3: locked differs from 1 on line 2"):
        read_labels(path)


def test_the_page_on_files_lists_every_format() -> None:
    page = (Path(__file__).parents[2] / "docs" / "files.md").read_text(encoding="utf-8")
    table = page.partition("| format | ends with")[2].partition("\n\n")[0]
    told = [[cell.strip() for cell in row.split("|")[1:-1]] for row in table.splitlines()[2:]]
    assert [row[0].partition("]")[0].strip("[") for row in told] == [form.name for form in FORMATS]
    assert [row[1:] for row in told] == [
        [
            ", ".join(f"`{ending}`" for ending in form.endings),
            "yes" if form.read else "no",
            "yes" if form.write else "no",
            form.needs,
        ]
        for form in FORMATS
    ]


def test_a_number_of_numpy_s_is_refused_by_its_kind(tmp_path: Path) -> None:
    labels = replace(FULL, provenance={"blur": np.float32(1.5)})
    with pytest.raises(ValueError, match="JSON holds no float32"):
        write_labels(tmp_path / "a.geojson", labels)
    assert not list(tmp_path.iterdir())

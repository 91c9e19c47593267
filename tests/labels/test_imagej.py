import struct
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import roifile

from napari_splinesketch.labels import Label, Labels, LabelsError, read_labels, write_labels

from .samples import FULL, bent, same_keys, same_points, same_sd, same_widths


def test_all_that_rois_can_hold_round_trips(tmp_path: Path) -> None:
    losses = " ".join(write_labels(tmp_path / "a.zip", FULL))
    assert all(word in losses for word in ("32-bit", "scale", "provenance"))
    back = read_labels(tmp_path / "a.zip")
    assert same_points(FULL, back, tolerance=1e-5)
    assert same_keys(FULL, back)
    assert same_widths(FULL, back)
    assert same_sd(FULL, back)


def test_coordinates_of_32_bits_round_trip_bit_for_bit(tmp_path: Path) -> None:
    points = bent().points.astype(np.float32)
    labels = Labels((Label.from_sketch(points),))
    write_labels(tmp_path / "a.zip", labels)
    assert same_points(labels, read_labels(tmp_path / "a.zip"))


def test_roifile_sees_polylines_in_x_and_y_with_frames_from_1(tmp_path: Path) -> None:
    write_labels(tmp_path / "a.zip", FULL)
    rois = roifile.roiread(tmp_path / "a.zip")
    assert isinstance(rois, list)
    assert len(rois) == 3
    roi = rois[2]
    assert roi.roitype == roifile.ROI_TYPE.POLYLINE
    assert (roi.position, roi.t_position, roi.name) == (5, 5, "4-5")
    points = FULL.labels[2].points
    assert np.abs(roi.coordinates() - points[:, ::-1]).max() < 1e-5
    assert roi.float_stroke_width == pytest.approx(2 * np.median(FULL.labels[2].half_width))
    assert roi.properties["splinesketch.status"] == "good"
    assert rois[1].float_stroke_width == 0


def seen_by_imagej(roi: bytes) -> dict[str, Any]:
    """What ImageJ's own RoiDecoder takes from a ROI, by the offsets it documents."""

    def number(kind: str, at: int) -> Any:
        return struct.unpack_from(f">{kind}", roi, at)[0]

    def text(second: int) -> str:
        offset, length = number("i", second), number("i", second + 4)
        return roi[offset : offset + 2 * length].decode("utf-16-be")

    count, second = number("H", 16), number("i", 60)
    whole = np.frombuffer(roi, ">i2", 2 * count, 64).reshape(2, count)
    exact = np.frombuffer(roi, ">f4", 2 * count, 64 + 4 * count).reshape(2, count)
    return {
        "magic": roi[:4],
        "type": roi[6],
        "subpixel": bool(number("h", 50) & 128),
        "whole": np.array([number("h", 10), number("h", 8)]) + whole.T,
        "xy": exact.T,
        "position": number("i", 56),
        "frame": number("i", second + 12),
        "width": number("f", second + 36),
        "name": text(second + 16),
        "properties": dict(line.split(": ") for line in text(second + 40).splitlines()),
    }


def test_imagej_sees_sub_pixel_polylines_where_its_decoder_looks(tmp_path: Path) -> None:
    write_labels(tmp_path / "a.zip", FULL)
    with zipfile.ZipFile(tmp_path / "a.zip") as file:
        names = file.namelist()
        seen = [seen_by_imagej(file.read(name)) for name in names]
    for roi, label in zip(seen, FULL.labels, strict=True):
        assert (roi["magic"], roi["type"], roi["subpixel"]) == (b"Iout", 5, True)
        assert np.array_equal(roi["xy"], label.points[:, ::-1].astype(np.float32))
        assert np.abs(roi["whole"] - label.points[:, ::-1]).max() <= 1
        assert (roi["position"], roi["frame"]) == (label.frame + 1, label.frame + 1)
        known = np.isfinite(label.half_width).all()
        assert roi["width"] == pytest.approx(2 * np.median(label.half_width) if known else 0)
        assert roi["name"] == f"{label.frame}-{label.curve}"
        properties = roi["properties"]
        assert properties["splinesketch.curve"] == str(label.curve)
        assert properties["splinesketch.status"] == label.status
        for name, values in (("half_width", label.half_width), ("sd", label.sd)):
            told = [float(word) for word in properties[f"splinesketch.{name}"].split()]
            assert np.array_equal(told, values, equal_nan=True)


@pytest.mark.parametrize(
    "points",
    [[[-6000.0, 70000.0], [5.5, 6.25]], [[-1e9, 1e9], [0.0, 1.0]]],
    ids=["beyond 16 bits", "at the limit"],
)
def test_places_far_away_round_trip(tmp_path: Path, points: list[list[float]]) -> None:
    labels = Labels((Label.from_sketch(np.array(points)),))
    write_labels(tmp_path / "a.zip", labels)
    assert same_points(labels, read_labels(tmp_path / "a.zip"))


def test_more_points_than_16_bits_count_round_trip(tmp_path: Path) -> None:
    points = np.random.default_rng(0).integers(0, 4000, (70_000, 2)) / 4
    labels = Labels((Label.from_sketch(points),))
    write_labels(tmp_path / "a.zip", labels)
    assert same_points(labels, read_labels(tmp_path / "a.zip"))


def roi(kind: roifile.ROI_TYPE, **fields: int) -> roifile.ImagejRoi:
    made = roifile.ImagejRoi.frompoints([[10, 20], [30, 25], [40, 20]], name="mine")
    made.roitype = kind
    for name, value in fields.items():
        setattr(made, name, value)
    return made


def test_rois_of_other_programs_are_sketches(tmp_path: Path) -> None:
    kinds = roifile.ROI_TYPE
    line = roifile.ImagejRoi()
    line.roitype, line.x1, line.y1, line.x2, line.y2 = kinds.LINE, 1.5, 2.5, 3.5, 4.5
    rois = [
        roi(kinds.POLYLINE, position=3),
        roi(kinds.FREELINE, t_position=2, position=9),
        line,
        roi(kinds.POLYGON),
        roi(kinds.POINT),
        roi(kinds.POLYLINE, z_position=4),
        roi(kinds.POLYLINE, t_position=6, z_position=4),
    ]
    for i, one in enumerate(rois):
        one.name = str(i)
    roifile.roiwrite(tmp_path / "a.zip", rois, mode="w")
    labels = read_labels(tmp_path / "a.zip")
    keys = [(label.frame, label.curve, label.status) for label in labels.labels]
    assert keys == [(t, i, "sketch") for i, t in enumerate((2, 1, 0, 3, 5))]
    assert labels.labels[0].points.tolist() == [[20, 10], [25, 30], [20, 40]]
    assert labels.labels[2].points.tolist() == [[2.5, 1.5], [4.5, 3.5]]
    assert labels.notes == (
        "left out 1 point, 1 polygon: only lines of two or more points can be sketches",
    )


@pytest.mark.parametrize(
    ("positions", "frames"),
    [
        ([(1, 5), (1, 7)], [4, 6]),
        ([(1, 5), (3, 7)], [0, 2]),
        ([(1, 1), (1, 1)], [0, 0]),
    ],
    ids=["planes", "times and planes", "channels"],
)
def test_a_hyperstack_without_times_has_its_lines_in_their_planes(
    tmp_path: Path, positions: list[tuple[int, int]], frames: list[int]
) -> None:
    # In hyperstacks, ImageJ gives all three positions, 1 along an axis that there is not.
    kind = roifile.ROI_TYPE.POLYLINE
    rois = [roi(kind, c_position=2, t_position=t, z_position=z) for t, z in positions]
    archive(tmp_path / "a.zip", a=rois[0].tobytes(), b=rois[1].tobytes())
    assert [label.frame for label in read_labels(tmp_path / "a.zip").labels] == frames


def test_a_line_that_is_too_short_costs_no_other(tmp_path: Path) -> None:
    short = roifile.ImagejRoi.frompoints([[10, 20]])
    short.roitype = roifile.ROI_TYPE.POLYLINE
    archive(tmp_path / "a.zip", a=short.tobytes(), b=roi(roifile.ROI_TYPE.FREELINE).tobytes())
    labels = read_labels(tmp_path / "a.zip")
    assert [label.curve for label in labels.labels] == [0]
    assert labels.notes == (
        "left out 1 polyline: only lines of two or more points can be sketches",
    )


def test_a_single_roi(tmp_path: Path) -> None:
    roi(roifile.ROI_TYPE.POLYLINE).tofile(tmp_path / "a.roi")
    assert len(read_labels(tmp_path / "a.roi").labels) == 1


def archive(path: Path, **entries: bytes) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, content in entries.items():
            file.writestr(f"{name}.roi", content)
    return path


def test_other_files_in_the_zip_are_not_touched(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as file:
        file.writestr("../../evil.txt", "x")
        file.writestr("../evil.roi", roi(roifile.ROI_TYPE.POLYLINE).tobytes())
        file.writestr("__MACOSX/._evil.roi", "what macOS packs with each file")
    assert len(read_labels(tmp_path / "a.zip").labels) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["a.zip"]


def test_a_zip_bomb_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    one = roi(roifile.ROI_TYPE.POLYLINE).tobytes()
    monkeypatch.setattr("napari_splinesketch.labels.format.MAX_BYTES", int(1.5 * len(one)))
    archive(tmp_path / "b.zip", a=one, b=one)
    with pytest.raises(LabelsError, match=r"b\.zip, b\.roi: too large when unpacked"):
        read_labels(tmp_path / "b.zip")


def test_broken_files_are_said(tmp_path: Path) -> None:
    (tmp_path / "a.zip").write_bytes(b"PK\x03\x04 no zip")
    with pytest.raises(LabelsError, match=r"a\.zip: not a zip of ImageJ ROIs"):
        read_labels(tmp_path / "a.zip")
    archive(tmp_path / "b.zip", x=b"Iout" + bytes(10))
    with pytest.raises(LabelsError, match=r"b\.zip, x\.roi: not an ImageJ ROI"):
        read_labels(tmp_path / "b.zip")


def test_damaged_properties_are_said(tmp_path: Path) -> None:
    for props, reason in (
        ("splinesketch.curve: x\n", "damaged .*'x'"),
        ("splinesketch.curve\n", "properties splinesketch.* are damaged"),
        (
            "splinesketch.curve: 1\nsplinesketch.half_width: 1\nsplinesketch.sd: 1 1 1\n",
            "damaged .*status",
        ),
        (
            "splinesketch.curve: 1\nsplinesketch.half_width: 1\nsplinesketch.sd: 1 1 1\n"
            "splinesketch.status: good\n",
            "half_width has shape",
        ),
    ):
        broken = roi(roifile.ROI_TYPE.POLYLINE)
        broken.props = props
        archive(tmp_path / "a.zip", x=broken.tobytes())
        with pytest.raises(LabelsError, match=rf"a\.zip, x\.roi: .*{reason}"):
            read_labels(tmp_path / "a.zip")


def test_the_same_curve_of_version_0_2_twice_is_refused(tmp_path: Path) -> None:
    write_labels(tmp_path / "a.zip", Labels((bent(),)))
    with zipfile.ZipFile(tmp_path / "a.zip") as file:
        old = roifile.ImagejRoi.frombytes(file.read(file.namelist()[0]))
    old.props = "".join(line for line in old.props.splitlines(True) if "checksum" not in line)
    archive(tmp_path / "b.zip", a=old.tobytes(), b=old.tobytes())
    with pytest.raises(LabelsError, match=r"b\.zip, b\.roi: curve 0 occurs twice"):
        read_labels(tmp_path / "b.zip")


def test_entries_of_one_name_are_all_read(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as file, pytest.warns(match="Duplicate name"):
        for _ in range(3):
            file.writestr("mine.roi", roi(roifile.ROI_TYPE.POLYLINE).tobytes())
    assert [label.curve for label in read_labels(tmp_path / "a.zip").labels] == [0, 1, 2]


def test_a_zip_without_a_roi_is_refused(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as file:
        file.writestr("readme.txt", "nothing")
    with pytest.raises(LabelsError, match=r"a\.zip: holds no ImageJ ROI"):
        read_labels(tmp_path / "a.zip")


@pytest.mark.parametrize("kind", ["ours", "a line"])
def test_a_roi_that_is_cut_anywhere_is_refused(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "a.roi"
    if kind == "ours":
        write_labels(tmp_path / "a.zip", Labels((bent(points=4),)))
        with zipfile.ZipFile(tmp_path / "a.zip") as file:
            whole = file.read(file.namelist()[0])
    else:
        line = roifile.ImagejRoi()
        line.roitype, line.x2, line.y2, line.name = roifile.ROI_TYPE.LINE, 3.5, 4.5, "mine"
        whole = line.tobytes()
    path.write_bytes(whole)
    assert len(read_labels(path).labels) == 1
    for size in range(len(whole)):
        path.write_bytes(whole[:size])
        with pytest.raises(LabelsError, match="not an ImageJ ROI"):
            read_labels(path)


def test_a_frame_beyond_what_imagej_counts_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="more than an ImageJ ROI can hold"):
        write_labels(tmp_path / "a.zip", Labels((bent(frame=2**31),)))
    assert list(tmp_path.iterdir()) == []

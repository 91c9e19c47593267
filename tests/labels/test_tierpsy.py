import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from napari_splinesketch.labels import Labels, write_labels

from .samples import bent, drawn

h5py = pytest.importorskip("h5py")
FILM = Labels(
    (bent(0, 8, points=400), bent(0, 3, points=400, shift=5), bent(2, 3, points=400, shift=9.0)),
    (0.5, 0.5),
    "µm",
)


def test_h5py_sees_the_skeletons_sorted_by_worm_and_frame(tmp_path: Path) -> None:
    losses = " ".join(write_labels(tmp_path / "a_skeletons.hdf5", FILM))
    assert "49 points" in losses
    assert "scale" not in losses
    ordered = [FILM.labels[i] for i in (1, 2, 0)]
    with h5py.File(tmp_path / "a_skeletons.hdf5") as file:
        rows = file["trajectories_data"]
        assert rows["worm_index_joined"].tolist() == [3, 3, 8]
        assert rows["frame_number"].tolist() == [0, 2, 0]
        assert rows["skeleton_id"].tolist() == [0, 1, 2]
        assert rows["is_good_skel"].tolist() == [1, 1, 1]
        assert rows.attrs["microns_per_pixel"] == 0.5
        skeleton = file["skeleton"][:]
        assert (skeleton.shape, skeleton.dtype) == ((3, 49, 2), np.float32)
        for i, label in enumerate(ordered):
            assert np.abs(skeleton[i, [0, -1]] - label.points[[0, -1], ::-1]).max() < 1e-4
            assert file["skeleton_length"][i] == pytest.approx(label.arc_length[-1], rel=1e-3)
            assert file["contour_width"][i, 0] == pytest.approx(2 * label.half_width[0], rel=1e-5)
        sides = file["contour_side1"][:] - file["contour_side2"][:]
        assert np.allclose(np.linalg.norm(sides, axis=2), file["contour_width"][:], atol=1e-4)
        middle = file["width_midbody"][0]
        assert abs(middle - file["contour_width"][0, 24]) < 0.5
        area = np.trapezoid(2 * ordered[0].half_width, ordered[0].arc_length)
        assert file["contour_area"][0] == pytest.approx(area, rel=0.02)
        steps = np.linalg.norm(np.diff(skeleton, axis=1), axis=2)
        assert np.ptp(steps[0]) < 0.01 * steps[0].mean()


AS_TIERPSY_READS = """
import pandas, sys, tables
with pandas.HDFStore(sys.argv[1], "r") as store:
    table = store["/trajectories_data"]
with tables.open_file(sys.argv[1]) as file:
    rows = file.get_node("/trajectories_data")
    where = rows.read_where("worm_index_joined == 3", field="skeleton_id")
    unit = rows._v_attrs["microns_per_pixel"]
    shape = file.get_node("/skeleton")[0:2, :, :].shape
print(list(table.frame_number), where.tolist(), float(unit), shape, sorted(table.columns)[:3])
"""


def test_pandas_and_pytables_open_it_as_tierpsy_does(tmp_path: Path) -> None:
    pytest.importorskip("tables")
    path = tmp_path / "a_skeletons.hdf5"
    write_labels(path, FILM)
    command = [sys.executable, "-I", "-c", AS_TIERPSY_READS, str(path)]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert run.stdout == "[0, 2, 0] [0, 1] 0.5 (2, 49, 2) ['area', 'coord_x', 'coord_y']\n"


def test_what_cannot_be_kept_is_said(tmp_path: Path) -> None:
    labels = Labels((drawn(),), (0.5, 0.25), "µm", provenance={"preset": "fast"})
    losses = " ".join(write_labels(tmp_path / "a_skeletons.hdf5", labels))
    for word in ("square pixels", "NaN", "provenance", "standard errors"):
        assert word in losses
    with h5py.File(tmp_path / "a_skeletons.hdf5") as file:
        assert np.isnan(file["contour_width"][:]).all()
        assert file["trajectories_data"]["is_good_skel"].tolist() == [0]
        assert file["trajectories_data"].attrs["microns_per_pixel"] == 1.0


def test_numbers_beyond_32_bits_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="up to 2147483647"):
        write_labels(tmp_path / "a_skeletons.hdf5", Labels((bent(curve=2**31),)))


def test_no_curves(tmp_path: Path) -> None:
    write_labels(tmp_path / "a_skeletons.hdf5", Labels())
    with h5py.File(tmp_path / "a_skeletons.hdf5") as file:
        assert file["skeleton"].shape == (0, 49, 2)
        assert len(file["trajectories_data"]) == 0


def test_without_h5py_it_says_how_to_get_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(ValueError, match="pip install h5py"):
        write_labels(tmp_path / "a_skeletons.hdf5", FILM)

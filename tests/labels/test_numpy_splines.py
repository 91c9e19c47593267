import pickle
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import psutil
import pytest

from napari_splinesketch.labels import LabelsError, read_labels

SPLINES = np.random.default_rng(0).uniform(0, 100, (3, 4, 9, 2)).astype(np.float32)


def test_frames_and_numbers_are_kept_and_x_comes_first(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", SPLINES)
    labels = read_labels(tmp_path / "a.npy").labels
    assert [(label.frame, label.curve) for label in labels] == [
        (f, s) for f in range(3) for s in range(4)
    ]
    assert np.array_equal(labels[5].points, SPLINES[1, 1, :, ::-1])
    assert labels[0].status == "sketch"


def test_one_frame_and_packed_arrays(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", SPLINES[0])
    np.savez(tmp_path / "b.npz", anything=SPLINES[0])
    np.savez_compressed(tmp_path / "c.npz", splines=SPLINES[0], scores=np.ones(4))
    for name in ("a.npy", "b.npz", "c.npz"):
        labels = read_labels(tmp_path / name).labels
        assert [(label.frame, label.curve) for label in labels] == [(0, s) for s in range(4)]


def as_documented(path: Path) -> dict[tuple[int, int], np.ndarray]:
    """What `docs/files.md` says of these files, read with NumPy alone."""
    found = np.load(path, allow_pickle=False)
    if path.suffix == ".npz":
        found = found[found.files[0] if len(found.files) == 1 else "splines"]
    frames = found[None] if found.ndim == 3 else found
    lines = {
        (frame, number): spline[np.isfinite(spline).all(axis=1)][:, [1, 0]].astype(float)
        for frame, splines in enumerate(frames)
        for number, spline in enumerate(splines)
    }
    return {key: line for key, line in lines.items() if len(line) > 1}


WRITERS: dict[str, Callable[[Path, np.ndarray], object]] = {
    "plain.npy": np.save,
    "by_column.npy": lambda path, array: np.save(path, np.asfortranarray(array)),
    "big_endian.npy": lambda path, array: np.save(path, array.astype(">f8")),
    "one_frame.npy": lambda path, array: np.save(path, array[0]),
    "single.npz": lambda path, array: np.savez(path, whatever=array),
    "packed.npz": lambda path, array: np.savez_compressed(path, scores=array[0], splines=array),
}


@pytest.mark.parametrize("name", WRITERS)
def test_a_reader_that_knows_only_the_documentation_sees_the_same(
    tmp_path: Path, name: str
) -> None:
    splines = SPLINES.copy()
    splines[0, 2, 4:6], splines[1, 3, 1:] = np.nan, np.inf
    WRITERS[name](tmp_path / name, splines)
    ours = {(one.frame, one.curve): one.points for one in read_labels(tmp_path / name).labels}
    theirs = as_documented(tmp_path / name)
    assert ours.keys() == theirs.keys()
    assert all(np.array_equal(ours[key], theirs[key]) for key in ours)


def test_points_that_are_not_finite_are_left_out(tmp_path: Path) -> None:
    splines = SPLINES.copy()
    splines[0, 0, 3:5] = np.nan
    splines[0, 1] = np.nan
    splines[2, 3, 1:, 0] = np.inf
    np.save(tmp_path / "a.npy", splines)
    labels = read_labels(tmp_path / "a.npy")
    assert len(labels.labels[0].points) == 7
    assert len(labels.labels) == 10
    assert labels.notes == ("left out 2 splines: only lines of two or more points can be sketches",)


def test_nothing_is_unpickled(tmp_path: Path) -> None:
    class Evil:
        def __reduce__(self) -> tuple[object, tuple[object, ...]]:
            return (tmp_path / "evil").write_text, ("x",)

    evil = np.array([Evil()], dtype=object)
    np.save(tmp_path / "a.npy", evil, allow_pickle=True)
    np.savez(tmp_path / "b.npz", splines=evil, allow_pickle=True)
    (tmp_path / "c.npy").write_bytes(pickle.dumps(Evil()))
    for name in ("a.npy", "b.npz", "c.npy"):
        with pytest.raises(LabelsError):
            read_labels(tmp_path / name)
    assert not (tmp_path / "evil").exists()


def claim(path: Path, shape: tuple[int, ...], packed: bool) -> None:
    """Write an array that claims a shape but holds nothing."""
    with (path.with_suffix(".npy")).open("wb") as file:
        np.lib.format.write_array_header_1_0(
            file, {"descr": "<f4", "fortran_order": False, "shape": shape}
        )
    if packed:
        with zipfile.ZipFile(path, "w") as archive:
            archive.write(path.with_suffix(".npy"), "splines.npy")


@pytest.mark.parametrize("name", ["a.npy", "a.npz"])
@pytest.mark.parametrize(
    "shape",
    [(10**6, 10**6, 100, 2), (10**30, 1, 1, 2), (5, 4, 9, 2), (-1, 4, 9, 2), (5, -1, -1, 2)],
)
def test_an_array_that_claims_too_much_is_refused(
    tmp_path: Path, name: str, shape: tuple[int, ...]
) -> None:
    claim(tmp_path / name, shape, packed=name.endswith("npz"))
    with pytest.raises(LabelsError):
        read_labels(tmp_path / name)


def test_what_cannot_be_read_whole_is_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", SPLINES)
    (tmp_path / "a.npy").write_bytes((tmp_path / "a.npy").read_bytes() * 2)
    with pytest.raises(LabelsError, match="continues after its last number"):
        read_labels(tmp_path / "a.npy")


WRONG = {
    "flat": (np.ones(4), r"shape \(4,\)"),
    "three coordinates": (np.ones((2, 3, 4, 3)), "expected numbers of shape"),
    "one line": (np.ones((4, 2)), r"of shape \(splines, points, 2\) or \(frames, splines, points"),
    "words": (np.full((2, 3, 4, 2), "x"), "expected numbers"),
    "complex": (np.ones((2, 3, 4, 2), complex), "expected numbers"),
    "far": (np.full((1, 1, 3, 2), 1e12), "frame 0, spline 0: .*within"),
}


@pytest.mark.parametrize(("array", "reason"), WRONG.values(), ids=WRONG.keys())
def test_other_arrays_are_refused(tmp_path: Path, array: np.ndarray, reason: str) -> None:
    np.save(tmp_path / "a.npy", array)
    with pytest.raises(LabelsError, match=reason):
        read_labels(tmp_path / "a.npy")


def test_a_choice_of_arrays_is_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", a=SPLINES, b=SPLINES)
    with pytest.raises(LabelsError, match=r"holds a, b; expected one array"):
        read_labels(tmp_path / "a.npz")
    np.savez(tmp_path / "b.npz")
    with pytest.raises(LabelsError, match="holds nothing"):
        read_labels(tmp_path / "b.npz")


def test_a_zip_of_something_else_is_refused_in_words(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("a.roi", b"Iout")
    with pytest.raises(LabelsError, match=r"a\.npz: array of shape \(\)"):
        read_labels(tmp_path / "a.npz")


def test_a_damaged_archive_is_closed(tmp_path: Path) -> None:
    (tmp_path / "a.npz").write_bytes(b"PK\x03\x04" + bytes(50))
    with pytest.raises(LabelsError) as held:
        read_labels(tmp_path / "a.npz")
    still_open = [file.path for file in psutil.Process().open_files()]
    assert str(tmp_path / "a.npz") not in still_open, held

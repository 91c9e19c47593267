"""Every reader, on valid files with bytes flipped, cut off or put in."""

import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from napari_splinesketch.labels import Labels, LabelsError, read_labels, write_labels
from napari_splinesketch.labels.formats import READERS, reader_of
from napari_splinesketch.labels.shapes_csv import HEADER

from .samples import FULL, bent

SPLINES = np.random.default_rng(0).uniform(0, 100, (2, 3, 5, 2))


def written(ending: str) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        write_labels(folder / f"a{ending}", FULL)
        return folder / f"a{ending}"

    return write


def renamed(ending: str) -> Callable[[Path], Path]:
    return lambda folder: written(ending)(folder).rename(folder / "a.json")


def single_roi(folder: Path) -> Path:
    write_labels(folder / "b.zip", Labels((bent(),)))
    with zipfile.ZipFile(folder / "b.zip") as archive:
        (folder / "a.roi").write_bytes(archive.read(archive.namelist()[0]))
    return folder / "a.roi"


def stored_zip(folder: Path) -> Path:
    """ROIs that are not compressed, so that flipped bytes get past the unpacking."""
    content = single_roi(folder).read_bytes()
    with zipfile.ZipFile(folder / "a.zip", "w") as archive:
        archive.writestr("x.roi", content)
    return folder / "a.zip"


def packed(name: str) -> Callable[[Path], Path]:
    """A WCON file in a zip that is not compressed."""

    def write(folder: Path) -> Path:
        with zipfile.ZipFile(folder / name, "w") as archive:
            archive.writestr("a.wcon", written(".wcon")(folder).read_bytes())
        return folder / name

    return write


def of_napari(name: str) -> Callable[[Path], Path]:
    """A Shapes CSV as napari saves it, without the columns that we add."""

    def write(folder: Path) -> Path:
        rows = (f"{i},path,{j},{i + j},{3 * j}.5\n" for i in range(3) for j in range(5))
        (folder / name).write_text(f"{','.join(HEADER)}\n{''.join(rows)}")
        return folder / name

    return write


def npy(folder: Path) -> Path:
    np.save(folder / "a.npy", SPLINES)
    return folder / "a.npy"


def npz(folder: Path) -> Path:
    np.savez(folder / "a.npz", splines=SPLINES)
    return folder / "a.npz"


VALID: dict[tuple[str, str], Callable[[Path], Path]] = {
    ("labels CSV", ".csv"): written(".csv"),
    ("napari Shapes CSV", ".csv"): of_napari("a.csv"),
    ("napari Shapes CSV", ".shapes.csv"): of_napari("a.shapes.csv"),
    ("GeoJSON", ".geojson"): written(".geojson"),
    ("GeoJSON", ".json"): renamed(".geojson"),
    ("ImageJ ROIs", ".zip"): stored_zip,
    ("ImageJ ROIs", ".roi"): single_roi,
    ("WCON", ".wcon"): written(".wcon"),
    ("COCO keypoints", ".coco.json"): written(".coco.json"),
    ("WCON", ".json"): renamed(".wcon"),
    ("WCON", ".wcon.zip"): packed("a.wcon.zip"),
    ("WCON", ".zip"): packed("a.zip"),
    ("NumPy splines", ".npy"): npy,
    ("NumPy splines", ".npz"): npz,
}


def test_every_reader_is_here() -> None:
    assert set(VALID) == {(form.name, ending) for form in READERS for ending in form.endings}


@st.composite
def damage(draw: st.DrawFn) -> Callable[[bytes], bytes]:
    """Give a function that flips, cuts or repeats some bytes."""
    places = draw(st.lists(st.floats(0, 1, exclude_max=True), min_size=1, max_size=4))
    values = draw(st.binary(min_size=len(places), max_size=len(places)))
    kind = draw(st.sampled_from(["flip", "flip", "flip", "cut", "repeat"]))

    def apply(content: bytes) -> bytes:
        at = [int(place * len(content)) for place in places]
        if kind == "cut":
            return content[: at[0]]
        if kind == "repeat":
            return content[: at[0]] + content[at[-1] :]
        changed = bytearray(content)
        for place, value in zip(at, values, strict=True):
            changed[place] = value
        return bytes(changed)

    return apply


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", VALID, ids=" ".join)
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(spoil=damage())
def test_damaged_files_are_read_or_refused_but_never_crash(
    name: tuple[str, str], tmp_path: Path, spoil: Callable[[bytes], bytes]
) -> None:
    folder = tmp_path / "valid"
    if not folder.exists():
        folder.mkdir()
        VALID[name](folder)
    valid = next(path for path in folder.iterdir() if path.name.startswith("a."))
    path = tmp_path / valid.name
    path.write_bytes(spoil(valid.read_bytes()))
    try:
        assert isinstance(read_labels(path), Labels)
    except LabelsError as error:
        assert str(error).startswith(str(path))


@pytest.mark.parametrize("name", VALID, ids=" ".join)
def test_valid_files_are_read(name: tuple[str, str], tmp_path: Path) -> None:
    path = VALID[name](tmp_path)
    assert reader_of(path).name == name[0]
    assert len(read_labels(path).labels) >= 1


@pytest.mark.parametrize("ending", [ending for _, ending in VALID])
@pytest.mark.parametrize("content", [b"", b"\x00" * 100, b"PK\x05\x06" + bytes(18), b"[[[[" * 50])
def test_nonsense_is_refused_or_holds_no_curves(
    tmp_path: Path, ending: str, content: bytes
) -> None:
    path = tmp_path / f"a{ending}"
    path.write_bytes(content)
    try:
        assert read_labels(path).labels == ()
    except LabelsError as error:
        assert str(error).startswith(str(path))

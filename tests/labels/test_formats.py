from pathlib import Path

import pytest

from napari_splinesketch.labels import Labels, LabelsError, read_labels, write_labels
from napari_splinesketch.labels.formats import READERS, WRITERS, writer_of


def test_an_unknown_ending_is_refused_and_the_known_ones_are_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"labels\.txt: no format has this ending.*labels CSV"):
        write_labels(tmp_path / "labels.txt", Labels())
    (tmp_path / "labels.txt").write_text("")
    with pytest.raises(LabelsError, match=r"not a file of labels; expected one of .*\.csv"):
        read_labels(tmp_path / "labels.txt")


def test_the_longest_ending_decides_and_case_does_not_matter() -> None:
    assert writer_of("a.shapes.csv").name == "napari Shapes CSV"
    assert writer_of("A.SHAPES.CSV").name == "napari Shapes CSV"
    assert writer_of("shapes.csv").name == "labels CSV"


def test_names_and_endings_are_unique() -> None:
    assert len({writer.name for writer in WRITERS}) == len(WRITERS)
    assert len({writer.suffix for writer in WRITERS}) == len(WRITERS)
    assert len({reader.name for reader in READERS}) == len(READERS)


@pytest.mark.parametrize("writer", WRITERS, ids=lambda writer: writer.name)
def test_no_writer_overwrites_unless_asked(tmp_path: Path, writer) -> None:
    path = tmp_path / f"labels{writer.suffix}"
    path.write_text("mine")
    with pytest.raises(FileExistsError, match="exists already"):
        write_labels(path, Labels())
    assert path.read_text() == "mine"
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


def test_a_missing_file_is_the_systems_own_error(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        read_labels(tmp_path / "none.csv")

"""What no reader may do, whatever the format."""

import os
from pathlib import Path

import pytest

from napari_splinesketch.files import checksum_of_file, printable
from napari_splinesketch.labels import LabelsError, read_labels
from napari_splinesketch.labels.formats import READERS, open_labels

ENDINGS = sorted({ending for reader in READERS for ending in reader.endings})


@pytest.mark.parametrize("read", [read_labels, open_labels, checksum_of_file])
@pytest.mark.parametrize("ending", ENDINGS)
def test_only_files_are_read(tmp_path: Path, ending: str, read) -> None:
    names = ("folder", "pipe", "device")
    folder, pipe, device = (tmp_path / f"{name}{ending}" for name in names)
    folder.mkdir()
    os.mkfifo(pipe)
    device.symlink_to("/dev/zero")
    for path in (folder, pipe, device):
        error = ValueError if read is checksum_of_file else LabelsError
        with pytest.raises(error, match="expected a file"):
            read(path)


def test_text_of_a_file_never_reaches_the_terminal_raw(tmp_path: Path) -> None:
    assert printable("Würmer 1.csv") == "Würmer 1.csv"
    assert printable("a\n\x1b[2J\u202e\x9b\udcff") == r"a\n\x1b[2J\u202e\x9b\udcff"
    path = tmp_path / "a\x1b[31m\n.geojson"
    path.write_text('{"type": "\\u001b[2J\\n"}', encoding="utf-8")
    with pytest.raises(LabelsError) as caught:
        read_labels(path)
    assert str(caught.value).isprintable()
    assert caught.value.path == str(path)

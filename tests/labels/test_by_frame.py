"""Tables frame by frame: the memory of one, the same labels."""

from collections.abc import Callable
from pathlib import Path
from typing import Literal

import numpy as np
import pytest

from napari_splinesketch.batch.frame_task import FrameReport
from napari_splinesketch.batch.partial import Partial
from napari_splinesketch.labels import Labels, LabelsError, read_labels, table, write_labels
from napari_splinesketch.labels.formats import open_labels
from napari_splinesketch.labels.types import ByFrame, in_frames

from .samples import FULL, bent, same_keys, same_points


def by_frame(path: Path) -> ByFrame:
    return in_frames(open_labels(path))


def test_a_table_is_read_frame_by_frame_with_its_scale(tmp_path: Path) -> None:
    path = tmp_path / "labels.csv"
    table.write(path, FULL)
    found = by_frame(path)
    assert found.frames.tolist() == [0, 4]
    assert (found.head.scale, found.head.units) == (FULL.scale, FULL.units)
    given = [label for labels in found.read() for label in labels]
    assert same_keys(Labels(tuple(given)), FULL)
    assert same_points(Labels(tuple(given)), FULL)


def test_frames_in_no_order_are_put_in_order(tmp_path: Path) -> None:
    path = tmp_path / "labels.csv"
    table.write(path, Labels((bent(3, 1), bent(0, 2), bent(3, 0))))
    found = by_frame(path)
    assert found.frames.tolist() == [0, 3]
    assert [[label.curve for label in labels] for labels in found.read()] == [[2], [1, 0]]


def test_mistakes_are_found_before_the_first_frame_is_given(tmp_path: Path) -> None:
    text = table.text(Labels((bent(0, 1), bent(0, 2))))
    again = "".join(text.splitlines(keepends=True)[1:21])
    _refused(tmp_path, text + again, "curve 1 occurs twice in frame 0", 42)
    header, one = table.text(Labels((bent(0, 1),), (0.5, 0.5), "µm")).split("\n", 1)
    other = table.text(Labels((bent(1, 1),), (0.25, 0.5), "µm")).split("\n", 1)[1]
    _refused(tmp_path, f"{header}\n{one}{other}", "y is not row times one scale", 22)


def _refused(folder: Path, text: str, reason: str, line: int) -> None:
    (folder / "spoilt.csv").write_text(text, encoding="utf-8")
    with pytest.raises(LabelsError, match=reason) as caught:
        by_frame(folder / "spoilt.csv")
    assert caught.value.place == f"line {line}"


def test_tables_are_joined_without_a_change(tmp_path: Path) -> None:
    kept = Partial(tmp_path / "run.csv", {}, resume=False)
    for number, label in enumerate(FULL.labels):
        part = Labels((label,), FULL.scale, FULL.units)
        kept.save(FrameReport(number, (), None, 0.0), part, None)
    kept.join(tmp_path / "all.csv", range(3), FULL.scale)
    assert (tmp_path / "all.csv").read_text() == table.text(FULL)
    kept.join(tmp_path / "none.csv", [], None)
    assert read_labels(tmp_path / "none.csv").labels == ()
    with pytest.raises(LabelsError, match="not the columns expected"):
        kept.join(tmp_path / "mixed.csv", range(3), None)


def test_a_long_table_takes_the_memory_of_one_frame(
    tmp_path: Path, peak_memory: Callable[..., float]
) -> None:
    path = tmp_path / "labels.csv"

    def how_many() -> int:
        return sum(map(len, by_frame(path).read()))

    peaks = []
    for count in (100, 500):
        write_labels(path, Labels(tuple(bent(i, 0) for i in range(count))), overwrite=True)
        assert how_many() == count
        peaks.append(peak_memory(how_many, enough=peaks[0] + 20_000 if peaks else 0))
    assert peaks[1] < peaks[0] + 20_000  # 400 further frames are 250,000 bytes


@pytest.mark.parametrize("order", ["C", "F"])
def test_arrays_are_read_frame_by_frame(tmp_path: Path, order: Literal["C", "F"]) -> None:
    splines = np.random.default_rng(0).uniform(0, 100, (5, 3, 4, 2))
    splines[1] = splines[3, 0] = np.nan
    splines = np.asarray(splines, ">f4", order=order)
    np.save(tmp_path / "a.npy", splines)
    np.savez_compressed(tmp_path / "a.npz", splines=splines, scores=np.ones(5))
    for name in ("a.npy", "a.npz"):
        found, whole = by_frame(tmp_path / name), read_labels(tmp_path / name)
        assert found.frames.tolist() == [0, 2, 3, 4]
        assert found.head.notes == whole.notes != ()
        given = Labels(tuple(found.labels))
        assert same_keys(given, whole)
        assert same_points(given, whole)


def test_a_long_array_takes_the_memory_of_one_frame(
    tmp_path: Path, peak_memory: Callable[..., float]
) -> None:
    def how_many() -> int:
        return sum(1 for _ in by_frame(tmp_path / "a.npy").labels)

    peaks = []
    for count in (20, 400):
        splines = np.random.default_rng(0).uniform(0, 100, (count, 1, 50, 2))
        np.save(tmp_path / "a.npy", splines)
        assert how_many() == count
        peaks.append(peak_memory(how_many, enough=peaks[0] + 20_000 if peaks else 0))
    assert peaks[1] < peaks[0] + 20_000  # 380 further frames are 300,000 bytes


def test_an_array_of_no_numbers_has_no_frames(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.ones((10**9, 0, 1, 2)))
    assert len(by_frame(tmp_path / "a.npy").frames) == 0

"""Labels of a film, written from what is read frame by frame: the same files, bounded memory."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from napari_splinesketch.labels import Label, Labels, write_labels
from napari_splinesketch.labels.format import Format
from napari_splinesketch.labels.formats import WRITERS
from napari_splinesketch.labels.json_tree import write_json
from napari_splinesketch.labels.types import ByFrame, in_frames

from .samples import FULL, bent, drawn

CHECKSUMS = {"0": "ab", "3": "cd"}
STREAMED = [writer for writer in WRITERS if not writer.needs]


@st.composite
def films(draw: st.DrawFn) -> Labels:
    """A few bodies on rising frames, sketches among them, and what a run says of them."""
    keys = draw(st.sets(st.tuples(st.integers(0, 9), st.integers(0, 70_000)), max_size=5))
    kinds = st.sampled_from([bent, drawn, lambda *key: bent(*key, points=9)])
    labels = [draw(kinds)(*key) for key in sorted(keys)]
    shape = draw(st.sampled_from([None, (48, 96)]))
    scale, units = draw(st.sampled_from([(None, None), ((0.5, 0.25), "µm")]))
    source = {"preset": "fast", "image": {"name": "Würmer.tif", "sha256": CHECKSUMS}}
    return Labels(tuple(labels), scale, units, shape, draw(st.sampled_from([{}, source])))


def streamed(labels: Labels) -> ByFrame:
    """The same labels as a run has them: of all frames, only one is held at a time."""
    found = in_frames(labels)

    def read() -> Iterator[tuple[Label, ...]]:
        yield from found.read()

    return ByFrame(found.frames, found.head, read)


@pytest.mark.parametrize("writer", STREAMED, ids=lambda writer: writer.name)
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(labels=films())
def test_the_files_are_those_of_labels_in_memory(
    tmp_path: Path, writer: Format, labels: Labels
) -> None:
    whole, film = (tmp_path / f"{name}{writer.suffix}" for name in ("whole", "film"))
    lost = write_labels(whole, labels, overwrite=True)
    assert write_labels(film, streamed(labels), overwrite=True) == lost
    assert film.read_bytes() == whole.read_bytes()


def test_libraries_that_want_all_at_once_get_it(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    pytest.importorskip("sleap_io")
    names = [str(tmp_path / f"{name}.slp") for name in ("whole", "film")]
    write_labels(names[0], FULL)
    write_labels(names[1], streamed(FULL))
    with h5py.File(names[0]) as whole, h5py.File(names[1]) as film:
        assert set(whole) == set(film)
        for name in ("points", "instances"):
            assert whole[name][:].tobytes() == film[name][:].tobytes()


def test_json_is_the_same_with_iterators_in_it(tmp_path: Path) -> None:
    plain = {"a": [1, {"b": [2.5, None]}], "é": {"x": {}, "y": {"1": "ß"}}, "z": [], "n": {1: 2}}
    write_json(tmp_path / "a.json", plain | {"a": iter(plain["a"]), "z": iter(())})
    told = (tmp_path / "a.json").read_text(encoding="utf-8")
    assert told == json.dumps(plain, ensure_ascii=False, separators=(",", ":")) + "\n"
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_json(tmp_path / "b.json", {"a": iter([float("nan")])})


def test_a_film_that_ends_in_the_middle_leaves_no_file(tmp_path: Path) -> None:
    def read() -> Iterator[tuple[Label, ...]]:
        yield (bent(0, 1),)
        raise OSError("the disk is gone")

    film = ByFrame(np.array([0, 1]), Labels(), read)
    for writer in WRITERS:
        with pytest.raises(OSError, match="the disk is gone"):
            write_labels(tmp_path / f"a{writer.suffix}", film)
    assert list(tmp_path.iterdir()) == []


PEAKS = """
import gc, sys, tracemalloc
from dataclasses import replace
import numpy as np
from napari_splinesketch.labels import Labels, write_labels
from napari_splinesketch.labels.types import ByFrame
from samples import drawn

body = replace(drawn(), points=[[3, 2], [6, 11]], half_width=[1.5, 1.5])

def film(count):
    head = Labels(shape=(10, 14))
    read = lambda: ((replace(body, frame=frame),) for frame in range(count))
    return ByFrame(np.arange(count), head, read)


for suffix in sys.argv[1:]:
    write_labels(f"imports{suffix}", film(3))
    peaks = []
    for count in (200, 1000):
        gc.collect()  # when it comes by itself, it is a matter of chance how much has piled up
        tracemalloc.start()
        write_labels(f"{count}{suffix}", film(count))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    print(suffix, *peaks)
"""
A_FRAME = {
    ".zip": 600,  # the list of its entries
}
"""Bytes that a further frame of one body may take; 100 where nothing else is said."""


@pytest.mark.slow
def test_memory_does_not_grow_with_the_film(tmp_path: Path) -> None:
    # In a process of its own: other tests leave threads behind, whose memory would be counted too.
    here = str(Path(__file__).parent)
    run = subprocess.run(
        [sys.executable, "-c", PEAKS, *(writer.suffix for writer in STREAMED)],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([here, *sys.path])},
        capture_output=True,
        text=True,
        check=True,
    )
    lines = run.stdout.splitlines()
    for line in lines:
        suffix, short, long = line.split()
        growth = (int(long) - int(short)) / 800
        assert growth < A_FRAME.get(suffix, 100), f"{line}: {growth:.0f} bytes a frame"
    assert len(lines) == len(STREAMED)

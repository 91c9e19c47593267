"""Splines as arrays, as detectors predict them: read only, as sketches."""

import math
import os
import zipfile
from array import array
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import IO

import numpy as np
from jaxtyping import Shaped

from napari_splinesketch.engine.types import Array
from napari_splinesketch.labels.files import LabelsError, blamed
from napari_splinesketch.labels.stream import ByFrame
from napari_splinesketch.labels.types import Label, Labels

NAME = "splines"
MAX_NUMBERS = 2**24
"""Largest array that is held; labels of it take up to two hundred bytes for each number."""


def read(path: str | os.PathLike[str]) -> Labels:
    """Read an array (frames, splines, points, 2) or (splines, points, 2) of (x, y), px.

    A .npz with several arrays must name this one "splines". Points that are not finite are left
    out, and so are splines with fewer than two; the others keep their number as identity.
    """
    labels, empty = [], 0
    for splines, left_out in _frames(Path(path), MAX_NUMBERS):
        labels += splines
        empty += left_out
    return Labels(tuple(labels), notes=_notes(empty))


def by_frame(path: str | os.PathLike[str]) -> ByFrame:
    """Read an array of any number of frames once, and be ready to give them one by one."""
    frames, empty = array("q"), 0
    for splines, left_out in _frames(Path(path)):
        frames.extend(label.frame for label in splines[:1])
        empty += left_out
    head = Labels(notes=_notes(empty))
    return ByFrame(np.array(frames), head, partial(_read_frames, Path(path)))


def _read_frames(path: Path) -> Iterator[tuple[Label, ...]]:
    return (tuple(splines) for splines, _ in _frames(path) if splines)


def _notes(empty: int) -> tuple[str, ...]:
    return (f"left out {empty} splines of fewer than two finite points",) if empty else ()


def _frames(path: Path, most: float = math.inf) -> Iterator[tuple[list[Label], int]]:
    """Give the splines of each frame, and the number of those left out."""
    for frame, splines in enumerate(_arrays(path, most)):
        labels = []
        for number, spline in enumerate(splines):
            points = np.asarray(spline, dtype=np.float64)[:, ::-1]
            points = points[np.isfinite(points).all(axis=1)]
            if len(points) > 1:
                place = f"frame {frame}, spline {number}"
                with blamed(lambda reason, place=place: LabelsError(path, place, reason)):
                    labels.append(Label.from_sketch(points, frame=frame, identity=number))
        yield labels, len(splines) - len(labels)


def _arrays(path: Path, most: float) -> Iterator[Shaped[Array, "splines points 2"]]:
    """Read the array of each frame; at most so many numbers in all, and `MAX_NUMBERS` at a time."""
    try:
        with _opened(path) as file:
            shape, by_column, dtype = _header(file)
            _check(path, shape, dtype)
            *frames, splines, points, _ = shape
            at_a_time = math.prod(shape) if by_column else splines * points * 2
            if at_a_time > MAX_NUMBERS or math.prod(shape) > most:
                reason = f"array of shape {shape}: at most {MAX_NUMBERS} numbers are read"
                raise LabelsError(path, "", f"{reason} at a time")
            if not at_a_time:
                return
            if by_column:  # the numbers of a frame do not lie together
                whole = _numbers(file, at_a_time, dtype).reshape(shape, order="F")
                yield from whole.reshape(-1, splines, points, 2)
            else:
                for _ in range(math.prod(frames)):
                    yield _numbers(file, at_a_time, dtype).reshape(splines, points, 2)
    except LabelsError:
        raise
    except Exception as error:  # NumPy and zipfile raise anything on broken files
        raise LabelsError(path, "", f"not an array of NumPy's ({error})") from None


@contextmanager
def _opened(path: Path) -> Iterator[IO[bytes]]:
    """Open a file, or its array where it is packed."""
    if path.suffix.lower() == ".npy":
        with path.open("rb") as file:
            yield file
        return
    with zipfile.ZipFile(path) as archive:
        names = [name for name in archive.namelist() if name.endswith(".npy")]
        if len(names) > 1:
            names = [name for name in names if name == f"{NAME}.npy"]
        if len(names) != 1:
            found = ", ".join(archive.namelist()[:10]) or "nothing"
            reason = f"holds {found}; expected one array, or one named {NAME}"
            raise LabelsError(path, "", reason)
        with archive.open(names[0]) as file:
            yield file


def _header(file: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype]:
    if np.lib.format.read_magic(file) == (1, 0):
        return np.lib.format.read_array_header_1_0(file)
    return np.lib.format.read_array_header_2_0(file)


def _numbers(file: IO[bytes], count: int, dtype: np.dtype) -> Shaped[Array, " N"]:
    return np.frombuffer(file.read(count * dtype.itemsize), dtype, count)


def _check(path: Path, shape: tuple[int, ...], dtype: np.dtype) -> None:
    """Refuse what is no array of splines, before it takes any memory."""
    if len(shape) not in (3, 4) or shape[-1] != 2 or dtype.kind not in "fiu":
        raise LabelsError(
            path,
            "",
            f"array of shape {shape} and type {dtype}; expected numbers of shape "
            "(frames, splines, points, 2), (x, y) last",
        )

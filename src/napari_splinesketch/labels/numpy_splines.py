"""Splines as arrays, as detectors predict them: read only, as sketches."""

import math
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import IO

import numpy as np
from jaxtyping import Shaped

from napari_splinesketch.engine.types import Array
from napari_splinesketch.labels.format import Format, LabelsError, Source, blamed, open_regular
from napari_splinesketch.labels.imagej import name_in_zip
from napari_splinesketch.labels.types import Label

NAME = "splines"
MOST = 2**24
"""Largest array that is held; labels of it take up to two hundred bytes for each number."""


def read(source: Source) -> Iterator[Label]:
    """Read an array (frames, splines, points, 2) or (splines, points, 2) of (x, y), px.

    A .npz with several arrays must name this one "splines". Points that are not finite are left
    out, and so are splines with fewer than two; the others keep their number as identity.
    """
    for frame, splines in enumerate(_arrays(source.path, math.inf if source.by_frame else MOST)):
        for number, spline in enumerate(splines):
            points = np.asarray(spline, dtype=np.float64)[:, ::-1]
            points = points[np.isfinite(points).all(axis=1)]
            source.place = f"frame {frame}, spline {number}"
            if len(points) > 1:
                yield Label.from_sketch(points, frame=frame, identity=number)
            else:
                source.left_out["spline"] += 1


def _arrays(path: Path, most: float) -> Iterator[Shaped[Array, "splines points 2"]]:
    """Read the array of each frame: at most `most` numbers in all, and `MOST` at a time."""
    # NumPy and zipfile raise anything on broken files.
    error = partial(LabelsError, path, "")
    broken = blamed(lambda why: error(f"not an array of NumPy's ({why})"), Exception)
    with broken, _opened(path) as file:
        shape, by_column, dtype = _header(file)
        if not _is_splines(shape) or min(shape) < 0 or dtype.kind not in "fiu":
            reason = f"array of shape {shape} and type {dtype}; expected numbers of shape "
            raise error(f"{reason}(frames, splines, points, 2), (x, y) last")
        block = shape if by_column else shape[-3:]  # by column, frames are not contiguous
        at_a_time = math.prod(block)
        if at_a_time > MOST or math.prod(shape) > most:
            reason = f"array of shape {shape}: at most {MOST} numbers are read at a time"
            raise LabelsError(path, "", reason)
        for _ in range(math.prod(shape) // max(at_a_time, 1)):
            numbers = np.frombuffer(file.read(at_a_time * dtype.itemsize), dtype, at_a_time)
            found = numbers.reshape(block, order="F" if by_column else "C")
            yield from found.reshape(-1, *shape[-3:])
        if file.read(1):  # an archive checks its sum here, too
            raise ValueError("it continues after its last number")


@contextmanager
def _opened(path: Path) -> Iterator[IO[bytes]]:
    """Open a file, or the array inside it if it is packed."""
    if path.suffix.lower() == ".npy":
        with open_regular(path) as file:
            yield file
        return
    with open_regular(path) as whole, zipfile.ZipFile(whole) as archive:
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


def _is_splines(shape: tuple[int, ...]) -> bool:
    return len(shape) in (3, 4) and shape[-1] == 2


def claims(ending: str, head: bytes) -> bool:
    """Whether this is an array of points, by its shape, or an archive, by its first file."""
    if ending == ".npz":
        return name_in_zip(head).endswith(b".npy")
    with suppress(Exception):  # NumPy raises anything on broken headers
        return _is_splines(_header(BytesIO(head))[0])
    return False


FORMAT = Format("NumPy splines", (".npy", ".npz"), read, claims=claims, by_frame=True)

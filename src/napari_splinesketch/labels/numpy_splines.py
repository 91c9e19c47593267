"""Splines as arrays, as detectors predict them: read only, as sketches."""

import math
import os
import zipfile
from pathlib import Path

import numpy as np
from jaxtyping import Shaped

from napari_splinesketch.engine.types import Array
from napari_splinesketch.labels.files import LabelsError, blamed
from napari_splinesketch.labels.types import Label, Labels

NAME = "splines"
MAX_NUMBERS = 2**24
"""Largest array that is read; labels of it take up to two hundred bytes for each number."""


def read(path: str | os.PathLike[str]) -> Labels:
    """Read an array (frames, splines, points, 2) or (splines, points, 2) of (x, y), px.

    A .npz with several arrays must name this one "splines". Points that are not finite are left
    out, and so are splines with fewer than two; the others keep their number as identity.
    """
    array = _load(Path(path))
    labels, empty = [], 0
    for frame, splines in enumerate(array if array.ndim == 4 else array[None]):
        for number, spline in enumerate(splines):
            points = np.asarray(spline, dtype=np.float64)[:, ::-1]
            points = points[np.isfinite(points).all(axis=1)]
            if len(points) < 2:
                empty += 1
                continue
            place = f"frame {frame}, spline {number}"
            with blamed(lambda reason, place=place: LabelsError(path, place, reason)):
                labels.append(Label.from_sketch(points, frame=frame, identity=number))
    notes = (f"left out {empty} splines of fewer than two finite points",) if empty else ()
    return Labels(tuple(labels), notes=notes)


def _load(path: Path) -> Shaped[Array, "..."]:
    try:
        if path.suffix.lower() == ".npy":
            array = np.load(path, mmap_mode="r", allow_pickle=False)
            _check(path, array.shape, array.dtype)
            return array
        with zipfile.ZipFile(path) as archive:
            return _member(path, archive)
    except LabelsError:
        raise
    except Exception as error:  # NumPy and zipfile raise anything on broken files
        raise LabelsError(path, "", f"not an array of NumPy's ({error})") from None


def _member(path: Path, archive: zipfile.ZipFile) -> Shaped[Array, "..."]:
    names = [name for name in archive.namelist() if name.endswith(".npy")]
    if len(names) > 1:
        names = [name for name in names if name == f"{NAME}.npy"]
    if len(names) != 1:
        found = ", ".join(archive.namelist()[:10]) or "nothing"
        raise LabelsError(path, "", f"holds {found}; expected one array, or one named {NAME}")
    with archive.open(names[0]) as file:
        version = np.lib.format.read_magic(file)
        header = np.lib.format.read_array_header_1_0
        if version != (1, 0):
            header = np.lib.format.read_array_header_2_0
        shape, _, dtype = header(file)
    _check(path, shape, dtype)
    with archive.open(names[0]) as file:
        return np.lib.format.read_array(file, allow_pickle=False)


def _check(path: Path, shape: tuple[int, ...], dtype: np.dtype) -> None:
    """Refuse what is no array of splines, before it takes any memory."""
    if len(shape) not in (3, 4) or shape[-1] != 2 or dtype.kind not in "fiu":
        raise LabelsError(
            path,
            "",
            f"array of shape {shape} and type {dtype}; expected numbers of shape "
            "(frames, splines, points, 2), (x, y) last",
        )
    if math.prod(shape) > MAX_NUMBERS:
        raise LabelsError(
            path, "", f"array of shape {shape}: at most {MAX_NUMBERS} numbers are read"
        )

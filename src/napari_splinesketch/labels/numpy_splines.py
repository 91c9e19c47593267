"""Splines as arrays, as detectors predict them: read only, as sketches."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from jaxtyping import Shaped

from napari_splinesketch.engine.types import Array, InputError
from napari_splinesketch.labels.format import Format, LabelsError, Source, blamed, open_regular
from napari_splinesketch.labels.types import Label

NAME = "splines"


def read(source: Source) -> Iterator[Label]:
    """Read an array (frames, splines, points, 2) or (splines, points, 2) of (x, y), px.

    A .npz with several arrays must name this one "splines". Points that are not finite are left
    out, and so are splines with fewer than two; the others keep their number as identity.
    """
    # NumPy raises anything on broken files.
    with blamed(lambda why: source.error(f"not an array of NumPy's ({why})"), Exception):
        array = _array(source.path)
    if array.ndim not in (3, 4) or array.shape[-1] != 2 or array.dtype.kind not in "fiu":
        reason = f"array of shape {array.shape} and type {array.dtype}; expected numbers of shape "
        shapes = "(splines, points, 2) or (frames, splines, points, 2)"
        raise source.error(f"{reason}{shapes}, (x, y) last")
    film = array if array.ndim == 4 else array[None]
    for frame, splines in enumerate(film if film.size else ()):
        for number, spline in enumerate(splines):
            points = np.asarray(spline, dtype=np.float64)[:, ::-1]
            points = points[np.isfinite(points).all(axis=1)]
            source.place = f"frame {frame}, spline {number}"
            if len(points) > 1:
                yield Label.from_sketch(points, frame=frame, identity=number)
            else:
                source.left_out["spline"] += 1


def _array(path: Path) -> Shaped[Array, "..."]:
    """Open the array of a file, which is not held in memory, or of an archive, which is."""
    with open_regular(path) as file:
        if file.read(2) != b"PK":
            found = np.load(path, mmap_mode="r")
            if found.offset + found.nbytes < path.stat().st_size:
                raise InputError("it continues after its last number")
            return found
        file.seek(0)
        found = np.load(file)
        names = [NAME] if NAME in found else list(found)
        if len(names) != 1:
            holds = ", ".join(names[:10]) or "nothing"
            raise LabelsError(path, "", f"holds {holds}; expected one array, or one named {NAME}")
        return np.asarray(found[names[0]])  # bytes, where it is a zip of something else


MARKS = {".npy": rb"\A\x93NUMPY[^\n]*'shape': *\((\d+, *){2,3}2,?\)", ".npz": rb"\.npy\Z"}
"""Of an array of points, by its shape, and of an archive of arrays."""
FORMAT = Format("NumPy splines", MARKS, read, by_frame=True)

"""Reconstructions as compressed files, to the last bit; read as if anybody had written them."""

from pathlib import Path
from typing import Any

import numpy as np

from napari_splinesketch.labels import LabelsError
from napari_splinesketch.labels.files import atomic
from napari_splinesketch.plugin.adapter.film import Patch
from napari_splinesketch.plugin.adapter.pixels import Grid


def write_patch(path: Path, patch: Patch) -> None:
    """Write a picture of part of a frame, whole or not at all."""
    place = np.stack([patch.grid.origin, patch.grid.step])
    arrays: dict[str, Any] = {"place": place, "pixels": patch.pixels}
    if patch.background is not None:
        arrays["background"] = patch.background
    with atomic(path, overwrite=True) as temporary:
        np.savez_compressed(temporary, **arrays)


def read_patch(path: Path) -> Patch | None:
    """Read a picture; None where there is none.

    Raises
    ------
    LabelsError
        Where there is a file, but no such picture in it.
    """
    if not path.exists():
        return None
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            place, pixels = file["place"], file["pixels"]
            background = file["background"] if "background" in file else None
    except Exception as error:  # NumPy and zipfile raise nearly anything for a spoilt file
        raise LabelsError(path, "", f"is no picture that was saved ({error})") from None
    ground = pixels if background is None else background
    if place.shape != (2, 2) or not np.isfinite(place).all() or not (place[1] > 0).all():
        raise LabelsError(path, "place", "expected an origin and a positive step")
    for name, picture in (("pixels", pixels), ("background", ground)):
        right = picture.ndim == 2 and picture.size and picture.dtype.kind == "f"
        if not right or picture.shape != pixels.shape:
            raise LabelsError(path, name, "expected numbers in rows and columns")
    return Patch(Grid(place[0], place[1]), pixels, background)

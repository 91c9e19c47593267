"""Reading a training set back, one frame at a time."""

import json
import os
from collections.abc import Callable, Mapping
from csv import DictReader
from dataclasses import dataclass
from numbers import Integral
from pathlib import Path
from typing import Any, TextIO

import numpy as np
import tifffile
from jaxtyping import Bool, Float, Int, Real, UInt16

from napari_splinesketch.engine.types import Array, InputError
from napari_splinesketch.training.export import FORMAT, FRAMES, MANIFEST, VERSION, file_name
from napari_splinesketch.training.split import PARTS, Part


@dataclass(frozen=True, eq=False)
class Sample:
    """A frame to train on; N bodies."""

    frame: int
    """Its number in the film."""
    image: Real[Array, "H W"]
    """(H, W): its pixels, as they were."""
    points: Float[Array, "N 100 2"]
    """(N, 100, 2): centrelines, row and col, px."""
    half_width: Float[Array, "N 100"]
    """(N, 100): distance to the edge, px."""
    sd: Float[Array, "N 100"]
    """(N, 100): standard error of `points` along the normal, px."""
    curve: Int[Array, " N"]
    """(N,): identities."""
    mask: UInt16[Array, "H W"]
    """(H, W): 1 inside the first body, 2 inside the second, ...; 0 elsewhere."""
    ignore: Bool[Array, "H W"]
    """(H, W): what is neither body nor background, because nobody accepted the curves there."""


@dataclass(frozen=True, eq=False)
class TrainingSet:
    """Frames to train on; each is read when it is needed."""

    folder: Path
    manifest: Mapping[str, Any]
    """What it says of all of them."""
    frames: tuple[int, ...]
    """Their numbers."""

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, index: int) -> Sample:
        """Read a frame, by its place in `frames`."""
        if not isinstance(index, Integral):
            raise TypeError(f"the place of a frame is {index!r}; give one whole number")
        frame = self.frames[index]
        name = file_name(frame)
        with np.load(self.folder / "splines" / f"{name}.npz", allow_pickle=False) as splines:
            return Sample(
                frame,
                tifffile.imread(self.folder / "images" / f"{name}.tif"),
                splines["splines"][..., ::-1],
                splines["half_width"],
                splines["sd"],
                splines["curve"],
                tifffile.imread(self.folder / "masks" / f"{name}.tif"),
                tifffile.imread(self.folder / "ignore" / f"{name}.tif") > 0,
            )


def read_training(folder: str | os.PathLike[str], part: Part | None = None) -> TrainingSet:
    """Open a training set.

    Parameters
    ----------
    folder
        As `export_training` made it.
    part
        "train", "val" or "test"; None takes all.

    Raises
    ------
    InputError
        Where the folder is no training set, damaged, or of a newer version.
    """
    if part not in (None, *PARTS):
        raise InputError(f"part is {part!r}; choose one of {', '.join(PARTS)}, or None for all")
    folder = Path(folder)
    manifest = _read(folder / MANIFEST, json.load)
    known = isinstance(manifest, dict) and manifest.get("format") == FORMAT
    if not known or manifest.get("version", 0) not in range(VERSION + 1):
        raise InputError(f"{folder / MANIFEST}: expected {FORMAT!r}, version {VERSION} at most")

    def numbers(table: TextIO) -> tuple[int, ...]:
        rows = DictReader(table)
        if not {"frame", "split"} <= set(rows.fieldnames or ()):
            raise InputError("it has no columns frame and split")
        return tuple(int(row["frame"]) for row in rows if part in (None, row["split"]))

    return TrainingSet(folder, manifest, _read(folder / FRAMES, numbers))


def _read(path: Path, read: Callable[[TextIO], Any]) -> Any:
    """Read a file of a training set; InputError where it is not there or damaged."""
    try:
        with path.open(encoding="utf-8", newline="") as file:
            return read(file)
    except (FileNotFoundError, NotADirectoryError):
        raise InputError(f"{path.parent} is no training set: it has no {path.name}") from None
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path} is damaged ({error}); write the training set again") from None

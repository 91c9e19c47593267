"""Where the work on an image is kept, and how the image is known again."""

import hashlib
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from napari.layers import Image
from platformdirs import user_data_path

SUFFIX = ".splinesketch"
LOOKED_AT = 2**20
"""Most pixels of a frame that tell one image from another."""
LONGEST_NAME = 255
"""Of a file or folder, bytes; disks take no longer ones."""
DIGITS = 12
"""Of the checksum, in a folder's name."""


@dataclass(frozen=True, eq=False)
class Picture:
    """What tells an image from others, not yet read: reading may be slow and belongs in a thread.

    Attributes
    ----------
    name
        The layer's name.
    path
        Its file; None for an image that came from no file.
    pixels
        The array, the coarsest level of a multiscale one: NumPy, dask, zarr, ...
    frames
        How many of its axes come before rows and columns.
    """

    name: str
    path: Path | None
    pixels: Any
    frames: int

    @classmethod
    def of(cls, image: Image) -> "Picture":
        """Take what is needed of a layer."""
        source = image.source.path
        pixels = image.data[-1] if image.multiscale else image.data  # pyright: ignore
        return cls(image.name, Path(source) if source else None, pixels, image.ndim - 2)

    def checksum(self) -> str:
        """Tell the image by shape, type and some pixels of its first, middle and last frame."""
        shape = tuple(map(int, self.pixels.shape))
        digest = hashlib.sha256(repr((shape, np.dtype(self.pixels.dtype).str)).encode())
        leading, (rows, columns) = shape[: self.frames], shape[self.frames : self.frames + 2]
        step = max(1, int(np.ceil(np.sqrt(rows * columns / LOOKED_AT))))
        count = int(np.prod(leading)) if leading else 1
        for frame in sorted({0, count // 2, count - 1}):
            index = tuple(int(i) for i in np.unravel_index(frame, leading)) if leading else ()
            part = np.asarray(
                self.pixels[(*index, slice(None, None, step), slice(None, None, step))]
            )
            digest.update(np.ascontiguousarray(part).tobytes())
        return digest.hexdigest()

    def describe(self, checksum: str) -> dict[str, object]:
        """Give what is written down of the image."""
        return {
            "name": self.name,
            "path": str(self.path) if self.path else None,
            "shape": [int(size) for size in self.pixels.shape],
            "sha256": checksum,
        }

    def folders(self, checksum: str, chosen: str = "") -> tuple[Path, ...]:
        """Give the folders where work on it lies; the first is for new work.

        That is where the user wants it, or beside the file, or with the user's own data where that
        is not possible. What lies in the others, because it was different once, is found as well.
        """
        ending = f"{checksum[:DIGITS]}{SUFFIX}"
        at_home = user_data_path("napari-splinesketch") / "sessions" / ending
        name = f"{self.path.name if self.path else 'image'}.{ending}"
        name = name if len(os.fsencode(name)) <= LONGEST_NAME else ending
        wanted = (Path(chosen).expanduser() / name,) if chosen else ()
        if self.path is None:
            return (*wanted, at_home)
        beside = self.path.with_name(name)
        writable = os.access(beside if beside.is_dir() else beside.parent, os.W_OK)
        return (*wanted, *((beside, at_home) if writable else (at_home, beside)))

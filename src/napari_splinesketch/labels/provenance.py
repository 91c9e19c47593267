"""Where labels come from: what the formats that can carry it are given."""

import hashlib
from datetime import UTC, datetime

import numpy as np
from jaxtyping import Real

from napari_splinesketch import __version__
from napari_splinesketch.engine.types import Array
from napari_splinesketch.labels.json_tree import Members


def provenance(
    *,
    image: str,
    shape: tuple[int, ...],
    dtype: str,
    checksums: Members,
    preset: str,
    options: dict[str, object],
) -> dict[str, object]:
    """Describe a refinement: version, date, image and settings.

    Parameters
    ----------
    image
        Name of the image.
    shape
        (H, W) of a frame, px.
    dtype
        Of the pixels.
    checksums
        Of each refined frame, as `checksum` gives them.
    preset
        Name of the preset.
    options
        What was chosen beside it, such as polarity and half-width.
    """
    return {
        "software": f"napari-splinesketch {__version__}",
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "preset": preset,
        "options": options,
        "image": {
            "name": image,
            "shape": list(shape),
            "dtype": dtype,
            "sha256": checksums,
        },
    }


def checksum(frame: Real[Array, "H W"]) -> str:
    """SHA-256 of a frame's pixels, row by row, little-endian, in hexadecimal digits."""
    frame = np.ascontiguousarray(frame, dtype=frame.dtype.newbyteorder("<"))
    return hashlib.sha256(frame.tobytes()).hexdigest()

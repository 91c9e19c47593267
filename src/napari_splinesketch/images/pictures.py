"""Pictures of curves over their image, and TIFFs of reconstructions."""

import os
from collections.abc import Iterable, Sequence

import numpy as np
import tifffile
from jaxtyping import Float, Real, UInt8
from PIL import Image, ImageDraw, ImageFont

from napari_splinesketch import palette
from napari_splinesketch.geometry import edges
from napari_splinesketch.labels import Label

SIDE = 2048
STRIP = 256
"""Rows that are stretched to 8 bits at a time."""


def write_overlay(
    path: str | os.PathLike[str],
    frame: Real[np.ndarray, "H W"],
    labels: Sequence[Label],
    truth: Sequence[Label] = (),
) -> None:
    """Draw curves and their outlines over a frame, as PNG, JPEG or TIFF by the name's ending.

    Curves are coloured by status and numbered by identity; those of `truth` are drawn thin and in a
    colour of their own.
    """
    zoom = max(1, SIDE // max(frame.shape))
    picture = Image.fromarray(grey(frame)).convert("RGB")
    if zoom > 1:
        size = frame.shape[1] * zoom, frame.shape[0] * zoom
        picture = picture.resize(size, Image.Resampling.BOX)
    pen = ImageDraw.Draw(picture)
    font = ImageFont.load_default(size=12 + 2 * zoom)
    thick = 1 + zoom // 4
    for label in truth:
        pen.line(_place(label.points, zoom), fill=palette.TRUTH, width=thick)
    for label in labels:
        colour = palette.LABEL[label.status]
        pen.line(_place(label.points, zoom), fill=colour, width=thick)
        if np.all(np.isfinite(label.half_width)):
            for edge in edges(label.points, label.half_width):
                pen.line(_place(edge, zoom), fill=colour, width=1)
        corner = _place(label.points[:1], zoom)[0]
        pen.text(corner, str(label.curve), "white", font, stroke_width=2, stroke_fill="black")
    picture.save(path)


def _place(points: Float[np.ndarray, "N 2"], zoom: int) -> list[tuple[float, float]]:
    """Take (row, col) with pixel centres at integers to (x, y) of the enlarged picture."""
    return [(float(col), float(row)) for row, col in (points + 0.5) * zoom - 0.5]


def grey(frame: Real[np.ndarray, "H W"]) -> UInt8[np.ndarray, "H W"]:
    """Stretch a frame to 8 bits, leaving out the brightest and darkest half percent."""
    frame = frame.view(np.uint8) if frame.dtype == bool else frame
    finite = frame[np.isfinite(frame)] if frame.dtype.kind == "f" else frame
    low, high = np.percentile(finite, [0.5, 99.5]) if finite.size else (0.0, 1.0)
    stretched = np.empty(frame.shape, np.uint8)
    for top in range(0, len(frame), STRIP):  # images are large
        values = np.clip(frame[top : top + STRIP].astype(np.float64), low, high) - low
        stretched[top : top + STRIP] = 255 * np.nan_to_num(values / max(high - low, 1e-12))
    return stretched


def write_reconstruction(
    path: str | os.PathLike[str],
    pages: Iterable[Real[np.ndarray, "H W"]],
    shape: tuple[int, int],
    frames: Sequence[int],
) -> None:
    """Write reconstructions as a 32-bit TIFF, in the image's own intensity units.

    The pages, of one shape, are read one by one; the file's description lists their `frames`.
    """
    tifffile.imwrite(
        path,
        (np.asarray(page, dtype=np.float32) for page in pages),
        shape=(len(frames), *shape),
        dtype=np.float32,
        metadata={"axes": "TYX", "frames": list(frames)},
        photometric="minisblack",
    )

"""Masks as TIFF: a label image of each frame."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import tifffile
from jaxtyping import Integer

from napari_splinesketch.engine.types import Array, InputError
from napari_splinesketch.labels.format import Format
from napari_splinesketch.labels.types import AnyLabels, in_frames
from napari_splinesketch.raster import label_image

MAX_PIXELS = 2**28
MAX_FRAMES = 100_000


def write(path: Path, labels: AnyLabels) -> None:
    """Write a label image: page i is frame i, a pixel's value the body's identity plus 1.

    Where bodies overlap, the pixel belongs to the one in which it lies deeper.
    """
    frames, shape = in_frames(labels), drawn_shape(labels)
    count, dtype = page_count(labels), np.uint16
    if labels.facts.highest >= np.iinfo(dtype).max:
        dtype = np.uint32
    given, drawn = frames.read(), np.zeros(count, bool)
    drawn[frames.frames] = True

    def tell(frame: int, share: float) -> None:
        frames.tell((frame + share) / count)

    def pages() -> Iterator[Integer[Array, "H W"]]:
        for frame in range(count):
            of_frame = next(given) if drawn[frame] else ()
            bodies = [(label.curve + 1, label.points, label.half_width) for label in of_frame]
            yield label_image(bodies, shape, dtype, partial(tell, frame))

    description = {"axes": "TYX", "provenance": dict(labels.head.provenance)}
    if labels.head.scale:
        description |= {"scale": labels.head.scale, "units": labels.head.units}
    tifffile.imwrite(
        path,
        pages(),
        shape=(count, *shape),
        dtype=dtype,
        metadata=description,
        compression="zlib",
        photometric="minisblack",
    )


def page_count(labels: AnyLabels) -> int:
    """Count the pages of masks; InputError where masks cannot hold a frame or an identity."""
    frames, highest = in_frames(labels).frames, labels.facts.highest
    count = int(frames[-1]) + 1 if len(frames) else 1
    if count > MAX_FRAMES:
        raise InputError(f"frame {count - 1} is beyond {MAX_FRAMES} frames, the most of masks")
    if highest >= np.iinfo(np.uint32).max:
        raise InputError(f"identity {highest} does not fit into a pixel; number curves from 0")
    return count


def image_shape(labels: AnyLabels) -> tuple[int, int]:
    """Give the shape of the image, or one that holds all bodies if it is not known."""
    height, width = labels.head.shape or labels.facts.reach
    return int(height), int(width)


def drawn_shape(labels: AnyLabels) -> tuple[int, int]:
    """Give the shape of an image that is to be drawn; InputError where it is too large."""
    height, width = image_shape(labels)
    if height * width > MAX_PIXELS:
        size = f"{height} × {width} px are too large to be drawn, {MAX_PIXELS} at most"
        raise InputError(f"{size}; leave masks out, or give the image's shape if it is smaller")
    return height, width


LOSSES = (
    "no centrelines, half-widths, standard errors or status",
    "review",
    "one body per pixel, so overlaps are lost",
    "width",
    "shape",
)
NAME = "masks, one label image per frame"
FORMAT = Format(NAME, {".masks.tif": b""}, write=write, losses=LOSSES)

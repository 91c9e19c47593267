"""Masks as TIFF: a label image of each frame."""

import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import tifffile
from jaxtyping import Integer

from napari_splinesketch.engine.types import Array
from napari_splinesketch.labels.format import Format, without_place
from napari_splinesketch.labels.json_tree import held
from napari_splinesketch.labels.raster import rasterise
from napari_splinesketch.labels.stream import AnyLabels, ByFrame, facts_of, in_frames
from napari_splinesketch.labels.types import Label

MAX_PIXELS = 2**28
MAX_FRAMES = 100_000
STRIP = 2**19
"""Pixels of a label image that are drawn at a time."""


def write(path: Path, labels: AnyLabels) -> None:
    """Write a label image: page i is frame i, a pixel's value the body's identity plus 1.

    Where bodies overlap, the pixel belongs to the one that lies deeper around it.
    """
    frames = in_frames(labels)
    shape, highest = image_shape(labels), facts_of(labels).highest
    count = int(frames.frames[-1]) + 1 if len(frames.frames) else 1
    if count > MAX_FRAMES:
        raise ValueError(
            f"frame {count - 1} is beyond {MAX_FRAMES} frames, the most that masks hold"
        )
    if highest >= np.iinfo(np.uint32).max:
        raise ValueError(f"identity {highest} does not fit into a pixel; number curves from 0")
    dtype = np.dtype("<u2" if highest < np.iinfo(np.uint16).max else "<u4")
    every = enumerate(_every(frames, count))

    def packed() -> Iterator[bytes]:
        for frame, of_frame in every:
            for top, strip in _strips(of_frame, shape, dtype):
                frames.tell((frame + top / shape[0]) / count)
                yield zlib.compress(strip.tobytes())

    description = {"axes": "TYX", "provenance": held(dict(labels.provenance))}
    if labels.scale:
        description |= {"scale": labels.scale, "units": labels.units}
    tifffile.imwrite(
        path,
        packed(),
        shape=(count, *shape),
        dtype=dtype,
        metadata=description,
        byteorder="<",
        compression="zlib",
        rowsperstrip=_height(shape),
        photometric="minisblack",
    )


def _every(frames: ByFrame, count: int) -> Iterator[tuple[Label, ...]]:
    """Give the labels of every frame, of most of them perhaps none."""
    given = frames.read()
    coming = next(given, ())
    for frame in range(count):
        if coming and coming[0].frame == frame:
            yield coming
            coming = next(given, ())
        else:
            yield ()


def losses(labels: AnyLabels) -> tuple[str, ...]:
    """Say what a label image has no place for."""
    lost = [
        "masks keep no centrelines, half-widths, standard errors or status",
        *without_place("a label image", labels, "review"),
        "a label image keeps one body a pixel: overlaps are lost",
    ]
    empty = facts_of(labels).without_width
    if empty:
        lost.append(f"{empty} curves have no known half-width, so their masks are empty")
    if labels.shape is None:
        lost.append("the size of the image is not known: the masks end where the bodies do")
    return tuple(lost)


def image_shape(labels: AnyLabels) -> tuple[int, int]:
    """Give the shape of the image, or what holds all bodies where it is not known."""
    shape = labels.shape
    if shape is None:
        height, width = facts_of(labels).reach
        shape = int(height), int(width)
    if shape[0] * shape[1] > MAX_PIXELS:
        raise ValueError(
            f"masks of {shape[0]} × {shape[1]} px are too large; give the image's shape"
        )
    return shape


def label_image(
    labels: Sequence[Label], shape: tuple[int, int], dtype: type[np.unsignedinteger] = np.uint32
) -> Integer[Array, "H W"]:
    """Draw the bodies of one frame, each with its identity plus 1; 0 is background."""
    image = np.empty(shape, dtype)
    for top, strip in _strips(labels, shape, np.dtype(dtype)):
        image[top : top + len(strip)] = strip
    return image


def _height(shape: tuple[int, int]) -> int:
    return min(max(1, STRIP // shape[1]), shape[0])


def _strips(
    labels: Sequence[Label], shape: tuple[int, int], dtype: np.dtype
) -> Iterator[tuple[int, Integer[Array, "h W"]]]:
    """Draw a label image some rows at a time; give the first row of each strip with it."""
    height = _height(shape)
    for top in range(0, shape[0], height):
        strip = np.zeros((min(height, shape[0] - top), shape[1]), dtype)
        deepest = np.full(strip.shape, -1, np.float32)
        for label in labels:
            patch = rasterise(label, shape, (top, top + height))
            if patch is None:
                continue
            rows, cols = patch.place
            place = slice(rows.start - top, rows.stop - top), cols
            ours = patch.inside & (patch.depth > deepest[place])
            strip[place][ours] = label.curve + 1
            deepest[place][ours] = patch.depth[ours]
        yield top, strip


FORMAT = Format("masks, a label image a frame", (".masks.tif",), write=write, losses=losses)

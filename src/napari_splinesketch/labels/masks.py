"""Masks as TIFF: a label image of each frame, or one mask for each body."""

import os
from collections.abc import Iterator, Sequence

import numpy as np
import tifffile
from jaxtyping import Integer, UInt8

from napari_splinesketch.engine.types import Array
from napari_splinesketch.labels.files import atomic
from napari_splinesketch.labels.json_tree import held
from napari_splinesketch.labels.raster import rasterise
from napari_splinesketch.labels.stream import AnyLabels, ByFrame, facts_of, in_frames
from napari_splinesketch.labels.types import Label

MAX_PIXELS = 2**28
MAX_FRAMES = 100_000
NOT_KEPT = "masks keep no centrelines, half-widths, standard errors or status"


def write(path: str | os.PathLike[str], labels: AnyLabels, *, overwrite: bool = False) -> None:
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
    dtype = np.uint16 if highest < np.iinfo(np.uint16).max else np.uint32
    pages = (label_image(of_frame, shape).astype(dtype) for of_frame in _every(frames, count))
    _write(path, pages, (count, *shape), dtype, _description(labels, "TYX"), overwrite)


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


def write_stack(
    path: str | os.PathLike[str], labels: AnyLabels, *, overwrite: bool = False
) -> None:
    """Write one page for each body, 255 inside, so that overlaps are kept.

    The description of the file lists frame and identity of each page.
    """
    shape = image_shape(labels)
    bodies = [{"frame": label.frame, "curve": label.curve} for label in labels.labels]
    pages = (_mask(label, shape) for label in labels.labels) if bodies else iter([_blank(shape)])
    description = {**_description(labels, "IYX"), "bodies": bodies}
    _write(path, pages, (max(len(bodies), 1), *shape), np.uint8, description, overwrite)


def losses(labels: AnyLabels) -> tuple[str, ...]:
    """Say what a label image has no place for."""
    return (*stack_losses(labels), "a label image keeps one body a pixel: overlaps are lost")


def stack_losses(labels: AnyLabels) -> tuple[str, ...]:
    """Say what a stack of masks has no place for."""
    lost = [NOT_KEPT]
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


def label_image(labels: Sequence[Label], shape: tuple[int, int]) -> Integer[Array, "H W"]:
    """Draw the bodies of one frame, each with its identity plus 1; 0 is background."""
    image = np.zeros(shape, np.uint32)
    deepest = np.zeros(shape, np.float32)
    for label in labels:
        patch = rasterise(label, shape)
        if patch is None:
            continue
        ours = patch.inside & ((patch.depth > deepest[patch.place]) | (image[patch.place] == 0))
        image[patch.place][ours] = label.curve + 1
        deepest[patch.place][ours] = patch.depth[ours]
    return image


def _mask(label: Label, shape: tuple[int, int]) -> UInt8[Array, "H W"]:
    mask = _blank(shape)
    patch = rasterise(label, shape)
    if patch is not None:
        mask[patch.place][patch.inside] = 255
    return mask


def _blank(shape: tuple[int, int]) -> UInt8[Array, "H W"]:
    return np.zeros(shape, np.uint8)


def _description(labels: AnyLabels, axes: str) -> dict[str, object]:
    """Collect what tifffile writes into the file's description, as JSON."""
    description: dict[str, object] = {"axes": axes, "provenance": held(dict(labels.provenance))}
    if labels.scale:
        description |= {"scale": labels.scale, "units": labels.units}
    return description


def _write(
    path: str | os.PathLike[str],
    pages: Iterator[Array],
    shape: tuple[int, int, int],
    dtype: type,
    description: dict[str, object],
    overwrite: bool,
) -> None:
    with atomic(path, overwrite=overwrite) as temporary:
        tifffile.imwrite(
            temporary,
            pages,
            shape=shape,
            dtype=dtype,
            metadata=description,
            compression="zlib",
            photometric="minisblack",
        )

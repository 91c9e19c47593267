"""Masks as TIFF: a label image of each frame, or one mask for each body."""

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
import tifffile
from jaxtyping import Integer, UInt8

from napari_splinesketch.engine.types import Array
from napari_splinesketch.labels.files import atomic
from napari_splinesketch.labels.raster import rasterise
from napari_splinesketch.labels.types import Label, Labels

MAX_PIXELS = 2**28
MAX_FRAMES = 100_000
NOT_KEPT = "masks keep no centrelines, half-widths, standard errors or status"


def write(path: str | os.PathLike[str], labels: Labels, *, overwrite: bool = False) -> None:
    """Write a label image: page i is frame i, a pixel's value the body's identity plus 1.

    Where bodies overlap, the pixel belongs to the one that lies deeper around it.
    """
    frames: dict[int, list[Label]] = {}
    for label in labels.labels:
        frames.setdefault(label.frame, []).append(label)
    write_frames(
        path,
        replace(labels, shape=image_shape(labels)),
        lambda frame: frames.get(frame, []),
        last=max(frames, default=0),
        highest=max((label.curve for label in labels.labels), default=0),
        overwrite=overwrite,
    )


def write_frames(
    path: str | os.PathLike[str],
    head: Labels,
    labels_of: Callable[[int], Sequence[Label]],
    *,
    last: int,
    highest: int,
    overwrite: bool = False,
) -> None:
    """Write a label image as `write` does, holding the labels of one frame at a time.

    Parameters
    ----------
    path
        The TIFF.
    head
        What the labels share, of which the image's shape is needed.
    labels_of
        Gives the labels of a frame.
    last
        The last frame.
    highest
        The largest identity.
    overwrite
        Replace an existing file.
    """
    shape = image_shape(head)
    if last >= MAX_FRAMES:
        raise ValueError(f"frame {last} is beyond {MAX_FRAMES} frames, the most that masks hold")
    if highest >= np.iinfo(np.uint32).max:
        raise ValueError(f"identity {highest} does not fit into a pixel; number curves from 0")
    dtype = np.uint16 if highest < np.iinfo(np.uint16).max else np.uint32
    pages = (label_image(labels_of(i), shape).astype(dtype) for i in range(last + 1))
    _write(path, pages, (last + 1, *shape), dtype, _description(head, "TYX"), overwrite)


def write_stack(path: str | os.PathLike[str], labels: Labels, *, overwrite: bool = False) -> None:
    """Write one page for each body, 255 inside, so that overlaps are kept.

    The description of the file lists frame and identity of each page.
    """
    shape = image_shape(labels)
    pages = (_mask(label, shape) for label in labels.labels) if labels.labels else [_blank(shape)]
    bodies = [{"frame": label.frame, "curve": label.curve} for label in labels.labels]
    description = {**_description(labels, "IYX"), "bodies": bodies}
    size = (max(len(labels.labels), 1), *shape)
    _write(path, iter(pages), size, np.uint8, description, overwrite)


def losses(labels: Labels) -> tuple[str, ...]:
    """Say what a label image has no place for."""
    return (*stack_losses(labels), "a label image keeps one body a pixel: overlaps are lost")


def stack_losses(labels: Labels) -> tuple[str, ...]:
    """Say what a stack of masks has no place for."""
    lost = [NOT_KEPT]
    empty = sum(not np.all(np.isfinite(label.half_width)) for label in labels.labels)
    if empty:
        lost.append(f"{empty} curves have no known half-width, so their masks are empty")
    if labels.shape is None:
        lost.append("the size of the image is not known: the masks end where the bodies do")
    return tuple(lost)


def image_shape(labels: Labels) -> tuple[int, int]:
    """Give the shape of the image, or what holds all bodies where it is not known."""
    shape = labels.shape
    if shape is None:
        reach = [_reach(label) for label in labels.labels]
        size = np.max([*reach, (1.0, 1.0)], axis=0)
        shape = int(size[0]), int(size[1])
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


def _reach(label: Label) -> tuple[float, float]:
    far = label.points.max(axis=0) + np.nan_to_num(label.half_width).max()
    return np.ceil(far[0]) + 1, np.ceil(far[1]) + 1


def _description(labels: Labels, axes: str) -> dict[str, object]:
    """Collect what tifffile writes into the file's description, as JSON."""
    description: dict[str, object] = {"axes": axes, "provenance": dict(labels.provenance)}
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

"""TIFF, ImageJ hyperstacks and OME-TIFF, read one frame at a time."""

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from functools import lru_cache
from pathlib import Path

import numpy as np
import tifffile

from napari_splinesketch.engine.types import InputError
from napari_splinesketch.images.frames import Frames, Scale, choose_planes, in_one_unit
from napari_splinesketch.labels.types import unit_of

COLOURS = {tifffile.PHOTOMETRIC.RGB, tifffile.PHOTOMETRIC.YCBCR}
ALPHAS = {tifffile.EXTRASAMPLE.ASSOCALPHA, tifffile.EXTRASAMPLE.UNASSALPHA}


@contextmanager
def open_tiff(path: Path, channel: int | None, z: int | None) -> Iterator[Frames]:
    """Open the first image of a TIFF."""
    with ExitStack() as inside:
        try:
            file = inside.enter_context(tifffile.TiffFile(path))
            series, size = file.series[0], _scale(file)
        except Exception as error:  # tifffile raises anything on a broken file
            raise InputError(f"{path}: cannot be read as TIFF ({error})") from error
        own = _channel(series, path.name, channel)
        planes = _frames(file, series, path, channel if own is None else None, z)
        yield Frames(path.name, *planes, *size, channel=own)


def _channel(series: tifffile.TiffPageSeries, name: str, channel: int | None) -> int | None:
    """Give the channel that is wanted of pixels that hold several; None for all, as colours."""
    many, page = series.axes.endswith("YXS") and "C" not in series.axes, series.keyframe
    colours = page.photometric in COLOURS and series.shape[-1] in (3, 4)
    clear = series.shape[-1] == 2 and set(page.extrasamples) & ALPHAS
    if many and (channel is not None or not (colours or clear)):
        choose_planes(name, "C", series.shape[-1:], channel, None)
        return channel
    return None


def _frames(
    file: tifffile.TiffFile,
    series: tifffile.TiffPageSeries,
    path: Path,
    channel: int | None,
    z: int | None,
) -> tuple[int, Callable[[int], np.ndarray]]:
    """Count the frames, and give what reads one."""
    axes, shape = series.axes, series.shape
    colour = "S" if axes.endswith("YXS") else ""
    if not axes.endswith("YX" + colour):
        raise InputError(f"{path}: axes are {axes}; expected rows and columns (YX) last")
    # Other kinds say of themselves which images they hold, such as a slide and its label.
    plain, last = series.kind in ("generic", "shaped"), 2 + len(colour)
    if plain:
        _require_one_size(path, file.series)
    size = shape[-last:]
    parts = [series]  # or frames that were appended, one by one or some at a time
    if plain or shape == size:
        alike = [one for one in file.series if one.shape[-last:] == size]
        parts = [part for part in alike if plain or part.shape == size]
        kinds = dict.fromkeys(str(part.dtype) for part in parts)
        if len(kinds) > 1 and any(part.shape != size for part in parts):
            said = ", ".join(kinds)
            raise InputError(f"{path}: its stacks are {said}; save those of one type as a file")
    planes = [choose_planes(path.name, p.axes[:-last], p.shape[:-last], channel, z) for p in parts]
    ends = np.cumsum([count for count, _ in planes])
    # Pages that are compressed in one way are a part, whatever is between them.
    some = parts if len(parts) > 1 else []  # to go through the pages of a long film takes a while
    pages = [page.index for part in some for page in part.pages if page is not None]
    order = np.argsort(pages) if len(pages) == ends[-1] else np.arange(ends[-1])
    stack = lru_cache(1)(lambda part: parts[part].asarray())

    def read(index: int) -> np.ndarray:
        index = int(order[index])
        part = int(np.searchsorted(ends, index, side="right"))
        series, place = parts[part], planes[part][1](index - int(ends[part]) + planes[part][0])
        if series.dataoffset is None and series.keyframe.shape != size:
            return stack(part)[place]
        number = int(np.ravel_multi_index(place, series.shape[:-last])) if place else 0
        if series.dataoffset is None:
            return series.asarray(key=number)
        # Mapped again each time: what stays mapped counts as memory of the process. One frame
        # only: a file that was cut off has the first ones.
        kind = series.dtype.newbyteorder(file.byteorder)
        length = kind.itemsize * math.prod(size)
        start = series.dataoffset + number * length
        if path.stat().st_size < start + length:
            raise EOFError("the file ends before it; copy it again")
        return np.array(np.memmap(path, kind, "r", start, size))

    return int(ends[-1]), read


def _require_one_size(path: Path, every: Sequence[tifffile.TiffPageSeries]) -> None:
    """Refuse pages of different sizes; smaller ones after all others are thumbnails."""
    size = every[0].keyframe.shape
    count = sum(len(one.pages) for one in every if one.keyframe.shape == size)
    others = [one.keyframe for one in every if one.keyframe.shape != size]
    if any(
        page.index < count or max(np.subtract(page.shape[:2], size[:2])) >= 0 for page in others
    ):
        shapes = dict.fromkeys([size, *(page.shape for page in others)])
        said = ", ".join(" x ".join(map(str, shape)) for shape in shapes)
        raise InputError(f"{path}: its pages are {said}; save those of one size as a file")


def _scale(file: tifffile.TiffFile) -> Scale:
    """Size of a pixel as OME or ImageJ wrote it."""
    if file.ome_metadata:
        with suppress(Exception):  # a bad description does no harm to the pixels
            image = tifffile.xml2dict(file.ome_metadata)["OME"]["Image"]
            pixels = (image[0] if isinstance(image, list) else image)["Pixels"]
            sizes = [pixels[f"PhysicalSize{axis}"] for axis in "YX"]
            units = [unit_of(str(pixels.get(f"PhysicalSize{axis}Unit", "µm"))) for axis in "YX"]
            if min(sizes) > 0:
                return in_one_unit(sizes, units)
    elif file.imagej_metadata:
        unit = str(file.imagej_metadata.get("unit", ""))
        x, y = file.series[0].keyframe.resolution
        if unit and unit != "pixel" and x > 0 and y > 0:
            return (1 / y, 1 / x), unit_of(unit)
    return None, None

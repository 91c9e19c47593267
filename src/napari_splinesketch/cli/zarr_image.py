"""OME-Zarr (and plain Zarr arrays), read one frame at a time."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from napari_splinesketch.cli.images import Frames, ImageError, choose_planes

SHORT = {"micrometer": "µm", "nanometer": "nm", "millimeter": "mm", "meter": "m"}


@contextmanager
def open_zarr(path: Path, channel: int | None, z: int | None) -> Iterator[Frames]:
    """Open the finest level of an OME-Zarr image, or a Zarr array (frames, rows, columns)."""
    try:
        import zarr
    except ImportError:
        raise ImageError(f"{path}: Zarr needs a library; pip install zarr") from None
    try:
        node: Any = zarr.open(str(path), mode="r")
        scale = units = None
        axes = "TCZYX"
        if isinstance(node, zarr.Group):
            image = _image(node.attrs)
            level = image["datasets"][0]
            axes = "".join(axis["name"] for axis in image["axes"]).upper()
            scale, units = _scale(image["axes"], level)
            node = node[level["path"]]
        shape, leading = tuple(node.shape), len(node.shape) - 2
        axes = axes if len(axes) == len(shape) else "T" * leading + "YX"
    except Exception as error:  # zarr raises anything on a broken store
        raise ImageError(f"{path}: cannot be read as OME-Zarr ({error})") from error
    if leading < 0 or not axes.endswith("YX"):
        raise ImageError(f"{path}: axes are {axes}; expected rows and columns (y, x) last")
    count, place = choose_planes(path.name, axes[:leading], shape[:leading], channel, z)
    yield Frames(path.name, count, lambda i: np.asarray(node[place(i)]), scale, units)


def _image(attributes: Mapping[str, Any]) -> Mapping[str, Any]:
    """Find the description of the image, in the version 0.5 place or the one before it."""
    multiscales = attributes.get("ome", attributes).get("multiscales")
    if not multiscales:
        raise ValueError("no multiscales metadata: give the folder of one image")
    return multiscales[0]


def _scale(
    axes: list[dict[str, str]], level: Mapping[str, Any]
) -> tuple[tuple[float, float], str] | tuple[None, None]:
    for transformation in level.get("coordinateTransformations", ()):
        if transformation.get("type") == "scale":
            y, x = transformation["scale"][-2:]
            unit = axes[-1].get("unit")
            if unit and unit == axes[-2].get("unit"):
                return (float(y), float(x)), SHORT.get(unit, unit)
    return None, None

"""OME-Zarr (and plain Zarr arrays), in a folder or behind a URL, read one frame at a time."""

import asyncio
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import PurePath
from typing import Any

import numpy as np
import zarr
from zarr.abc.store import ByteRequest
from zarr.core.buffer import Buffer, BufferPrototype
from zarr.storage import FsspecStore

from napari_splinesketch.engine.types import InputError
from napari_splinesketch.files import INSTALL
from napari_splinesketch.images.frames import Frames, Scale, choose_planes, in_one_unit, is_url
from napari_splinesketch.labels.types import unit_of

SHORT = {"nanometer": "nm", "millimeter": "mm", "meter": "m"}
COLUMNS = 5  # least columns of frames: a last axis of fewer is one of colours
PAUSES = (1.0, 5.0)  # before a server that failed is asked again, s
PATIENCE = 30.0  # how long a server may take to send a file of metadata, s
SLOWEST = 100_000  # the lowest average rate at which a chunk may come after that, bytes per second


class SilentServerError(ConnectionError):
    """A server that does not send what was requested."""


class RemoteStore(FsspecStore):
    """A store behind a URL that gives up on servers that stall or drip."""

    patience = PATIENCE
    """How long a file may take, s."""

    async def get(
        self, key: str, prototype: BufferPrototype, byte_range: ByteRequest | None = None
    ) -> Buffer | None:
        """Read a file, or a part of one; SilentServerError where that takes too long."""
        try:
            return await asyncio.wait_for(super().get(key, prototype, byte_range), self.patience)
        except TimeoutError:
            raise SilentServerError(
                f"the server sends nothing, or next to nothing, of {key}; try again later, or "
                "copy the image to this machine"
            ) from None


@contextmanager
def open_zarr(address: str, channel: int | None, z: int | None) -> Iterator[Frames]:
    """Open the finest level of an OME-Zarr image, or a Zarr array (frames, rows, columns).

    The address is a folder, or a URL that fsspec knows, such as https://... or s3://...; channel
    and plane are as in `open_frames`.
    """
    try:
        node: Any = _open(address)
        scale = units = None
        axes = "TCZYX"
        if isinstance(node, zarr.Group):
            attributes: Any = node.attrs
            # In the version 0.5 place, or the one before it.
            images = attributes.get("ome", attributes).get("multiscales")
            if not images:
                raise InputError("no multiscales metadata: give the folder of one image")
            image, level = images[0], images[0]["datasets"][0]
            # Version 0.3 has names only, and those before it always have these five.
            named = image.get("axes", "tczyx")
            known = [{"name": axis} if isinstance(axis, str) else axis for axis in named]
            axes = "".join(axis["name"] for axis in known).upper()
            scale, units = _scale(known, level, image)
            node = node[level["path"]]
        if is_url(address):
            chunk_bytes = math.prod(node.shards or node.chunks) * node.dtype.itemsize
            node.store.patience = PATIENCE + chunk_bytes / SLOWEST
        shape, leading = tuple(node.shape), len(node.shape) - 2
        axes = axes if len(axes) == len(shape) else "T" * leading + "YX"
    except ImportError as error:  # fsspec says which one
        needed = f"for https and s3, {INSTALL.format('remote')}"
        raise InputError(f"{address}: needs a library ({error}); {needed}") from None
    except Exception as error:  # zarr raises anything on a broken store, and where none answers
        remedy = "; check the address, and whether its server answers" if is_url(address) else ""
        raise InputError(f"{address}: cannot be read as OME-Zarr ({error}){remedy}") from error
    if leading < 0 or not axes.endswith("YX") or (leading and shape[-1] < COLUMNS):
        what = f"axes are {axes} of {shape}"
        raise InputError(f"{address}: {what}; expected rows and columns (y, x) last")
    name = PurePath(address.split("?")[0]).name
    count, place = choose_planes(name, axes[:leading], shape[:leading], channel, z)

    def read(index: int) -> np.ndarray:
        if not is_url(address):
            _open(address)  # an error where it was deleted: what is missing would be read as empty
        return np.asarray(node[place(index)])

    patient = _patient(read, address, lambda: _open(address))
    yield Frames(name, count, patient if is_url(address) else read, scale, units)


def _open(address: str) -> Any:
    remote = is_url(address)
    return zarr.open(RemoteStore.from_url(address, read_only=True) if remote else address, mode="r")


def _patient(
    read: Callable[[int], np.ndarray], address: str, ask: Callable[[], object]
) -> Callable[[int], np.ndarray]:
    """Try a frame again where a server fails; ConnectionError where it does not answer at all."""

    def read_again(index: int, pauses: Sequence[float] = PAUSES) -> np.ndarray:
        try:
            return read(index)
        except SilentServerError:  # that was long enough
            raise
        except Exception:  # every kind of store has its own
            if not pauses:
                try:
                    ask()
                except Exception as error:
                    raise ConnectionError(f"{address} does not answer any more ({error})") from None
                raise
        time.sleep(pauses[0])
        return read_again(index, pauses[1:])

    return read_again


def _scale(axes: Sequence[Mapping[str, str]], *described: Mapping[str, Any]) -> Scale:
    """Multiply the scales of a level and of the whole image."""
    steps = (step for each in described for step in each.get("coordinateTransformations", ()))
    scales = [step["scale"][-2:] for step in steps if step.get("type") == "scale"]
    units = [axis.get("unit", "") for axis in axes[-2:]]
    if not scales or not all(units):
        return None, None
    named = [SHORT.get(unit, unit_of(unit)) for unit in units]
    return in_one_unit(np.prod(scales, axis=0).tolist(), named)

"""Stores behind a URL: no wait is endless, and no file is larger than the metadata promise."""

import asyncio
import bz2
import lzma
import math
import zlib
from contextlib import suppress
from contextvars import ContextVar
from functools import partial
from typing import Any

import imagecodecs
import zarr
from zarr.abc.store import ByteRequest
from zarr.core.buffer import Buffer, BufferPrototype
from zarr.storage import FsspecStore

from napari_splinesketch.images.frames import SilentServerError

PATIENCE = 30.0
"""How long a server may take to connect, and how long it may then send nothing, s."""
SLOWEST = 100_000
"""The lowest average rate at which a chunk may come, bytes per second."""
METADATA = 2**24
"""Largest file of metadata, and what a chunk may have beyond twice its pixels, bytes."""
_limit = ContextVar("limit", default=METADATA)


class RemoteStore(FsspecStore):
    """A store that gives up on servers that stall, drip, or never end."""

    chunk_bytes = 0
    """Bytes of a chunk's pixels; known once the array is open."""

    async def get(
        self, key: str, prototype: BufferPrototype, byte_range: ByteRequest | None = None
    ) -> Buffer | None:
        """Read a file, or a part of one; SilentServerError where that takes too long."""
        limit = METADATA + 2 * self.chunk_bytes
        _limit.set(limit)
        patience = PATIENCE + self.chunk_bytes / SLOWEST
        try:
            found = await asyncio.wait_for(super().get(key, prototype, byte_range), patience)
        except TimeoutError:
            raise SilentServerError(
                f"the server sends nothing, or next to nothing, of {key}; try again later, or "
                "copy the image to this machine"
            ) from None
        if found is not None and self.chunk_bytes:
            data = found.to_bytes()
            if len(data) > limit or unpacked_size(data, limit) > limit:
                raise too_much(limit, key)
        return found


def too_much(limit: int, key: str) -> ValueError:
    """Make the error of a file that holds more than it may."""
    return ValueError(
        f"{key} holds more than {limit} bytes, which is more than the metadata promise; the image "
        "is damaged, or its server is wrong"
    )


def open_remote(address: str) -> Any:
    """Open a group or an array of Zarr behind a URL."""
    options: dict[str, Any] = {}
    if address.startswith(("http://", "https://")):
        options["get_client"] = _client
    return zarr.open(RemoteStore.from_url(address, options, read_only=True), mode="r")


def bound(array: zarr.Array[Any]) -> None:
    """Limit the chunks of an array to what their pixels need."""
    store = array.store
    if isinstance(store, RemoteStore):
        store.chunk_bytes = math.prod(array.shards or array.chunks) * array.dtype.itemsize


async def _client(**options: Any) -> Any:
    """Make the session in which fsspec asks a web server."""
    import aiohttp

    class Bounded(aiohttp.ClientResponse):
        async def read(self) -> bytes:
            if self._body is None:
                parts: list[bytes] = []
                size = 0
                async for part in self.content.iter_any():
                    parts.append(part)
                    size += len(part)
                    if size > _limit.get():
                        self.close()
                        raise too_much(_limit.get(), self.url.path)
                self._body = b"".join(parts)
            return self._body

    waits = aiohttp.ClientTimeout(total=None, sock_connect=PATIENCE, sock_read=PATIENCE)
    return aiohttp.ClientSession(**{"timeout": waits, "response_class": Bounded, **options})


def unpacked_size(data: bytes, limit: int) -> int:
    """Give the size of a chunk when unpacked, or any number beyond the limit.

    0 where it is not packed, is damaged, or is packed in a way that cannot swell much.
    """
    if data.startswith(b"\x28\xb5\x2f\xfd"):
        try:
            return len(imagecodecs.zstd_decode(data, out=limit))
        except imagecodecs.ZstdError as error:  # or damaged, or the index of a shard follows
            return limit + 1 if "too small" in str(error) else 0
    if len(data) >= 16 and data[0] <= 4 and int.from_bytes(data[12:16], "little") == len(data):
        return int.from_bytes(data[4:8], "little")  # Blosc
    with suppress(OSError, zlib.error, lzma.LZMAError, EOFError):  # not packed, or damaged
        for magic, unpacker in (
            (b"\x1f\x8b", partial(zlib.decompressobj, 31)),
            (b"\x78", zlib.decompressobj),
            (b"BZh", bz2.BZ2Decompressor),
            (b"\xfd7zXZ", lzma.LZMADecompressor),
        ):
            if data.startswith(magic):
                return len(unpacker().decompress(data, limit + 1))
    return 0

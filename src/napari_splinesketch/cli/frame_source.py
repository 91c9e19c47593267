"""Frames as another process finds them: it opens the image once, and reads frame by frame."""

import secrets
import threading
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Real

from napari_splinesketch.cli.images import Frames, ImageError, is_url, open_frames


class UnreachableError(ImageError):
    """An image that cannot be opened from here, or is another one than expected."""


@dataclass(frozen=True)
class Source:
    """An image or film by its name.

    Attributes
    ----------
    pattern
        What `open_frames` takes.
    channel, z
        As there.
    count
        The number of frames it has.
    run
        Tells one run from the next: the image may have changed between them.
    """

    pattern: str
    channel: int | None
    z: int | None
    count: int
    run: str = field(default_factory=lambda: secrets.token_hex(8))

    @classmethod
    def of(cls, pattern: str, channel: int | None, z: int | None, images: Frames) -> "Source":
        """Name an open image so that other processes find it, whatever folder they are in."""
        if not is_url(pattern):
            pattern = str(Path(pattern).absolute())
        return cls(pattern, channel, z, images.count)

    def read(self, frame: int) -> Real[np.ndarray, "H W"]:
        """Read a frame; UnreachableError where the image is not to be found."""
        with _opened.lock:
            return _opened.images(self)[frame]


class _Opened:
    """The image that this process reads from; opened when it is first asked for."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self._inside = ExitStack()
        self._source: Source | None = None

    def images(self, source: Source) -> Frames:
        if source != self._source:
            self._inside.close()
            self._source = None
            try:
                found = open_frames(source.pattern, channel=source.channel, z=source.z)
                self._images = self._inside.enter_context(found)
            except (ImageError, OSError) as error:
                raise UnreachableError(str(error)) from None
            if self._images.count != source.count:
                counts = f"{self._images.count} frames; expected {source.count}"
                self._inside.close()
                raise UnreachableError(f"{source.pattern} has {counts}")
            self._source = source
        return self._images


_opened = _Opened()

"""AVI, MP4 and other films, read one frame at a time."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import imageio.v3

from napari_splinesketch.images.frames import Frames, ImageError


@contextmanager
def open_film(path: Path) -> Iterator[Frames]:
    """Open a film; its frames are counted from 0."""
    try:
        import av  # noqa: F401  (imageio's own message does not say how to install it)
    except ImportError:
        raise ImageError(f"{path}: films need a library; pip install av") from None
    try:
        film = imageio.v3.imopen(path, "r", plugin="pyav")
        count = film.properties().n_images or 0
    except Exception as error:  # PyAV raises anything on a broken file
        raise ImageError(f"{path}: cannot be read as a film ({error})") from error
    with film:
        if not count:
            count = sum(1 for _ in imageio.v3.imiter(path, plugin="pyav"))
        yield Frames(path.name, count, lambda index: film.read(index=index))

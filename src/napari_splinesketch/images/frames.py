"""Images for the command line: files, folders and films, read one frame at a time."""

import hashlib
import os
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass
from glob import escape, glob
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Real

from napari_splinesketch.engine.types import InputError
from napari_splinesketch.files import INSTALL, is_inside, same_file, special

LUMINANCE = np.array([0.2125, 0.7154, 0.0721], dtype=np.float32)
TIFFS = (".tif", ".tiff", ".lsm", ".stk")
STILLS = (".png", ".jpg", ".jpeg", ".bmp")
DEPTH = 24  # place in a PNG of the byte that tells the bits of a number
FILMS = (".avi", ".mp4", ".mov", ".mkv", ".webm")
METRES = {"pm": 1e-12, "Å": 1e-10, "nm": 1e-9, "µm": 1e-6, "mm": 1e-3, "cm": 0.01, "m": 1.0}
Scale = tuple[tuple[float, float], str] | tuple[None, None]
"""(y, x) size of a pixel, and its unit."""


@dataclass(frozen=True, eq=False)
class Frames:
    """The frames of one image or film."""

    name: str
    count: int
    read: Callable[[int], np.ndarray]
    """Reads frame i: (H, W), or (H, W, 3 or 4) colour."""
    scale: tuple[float, float] | None = None
    """(y, x) size of a pixel in `units`, or None."""
    units: str | None = None
    files: Sequence[Path] = ()
    """The file of each frame, where each has one of its own."""
    channel: int | None = None
    """Which of the colours is wanted, from 0; None for luminance."""

    def __getitem__(self, index: int) -> Real[np.ndarray, "H W"]:
        """Read a frame; colour becomes luminance (Rec. 709), or one of its channels."""
        if not 0 <= index < self.count:
            raise InputError(f"no frame {index}: {self.name} has {self.count}, counted from 0")
        try:
            pixels = np.asarray(self.read(index))
        except ConnectionError:  # not the frame's fault: the next one would fail too
            raise
        except Exception as error:  # image libraries raise anything on a broken file
            raise InputError(f"{self.name}, frame {index}: cannot be read ({error})") from error
        if self.channel is not None:
            return pixels[..., self.channel]
        if pixels.ndim == 3 and pixels.shape[2] in (3, 4):
            return pixels[..., :3].astype(np.float32) @ LUMINANCE
        if pixels.ndim == 3 and pixels.shape[2] == 2:  # grey and how opaque it is
            return pixels[..., 0]
        if pixels.ndim != 2:
            raise InputError(f"{self.name}, frame {index}: shape {pixels.shape}; expected (H, W)")
        return pixels


def checksum(frame: Real[np.ndarray, "H W"]) -> str:
    """SHA-256 of a frame's pixels, row by row, little-endian, in hexadecimal digits."""
    frame = np.ascontiguousarray(frame, dtype=frame.dtype.newbyteorder("<"))
    return hashlib.sha256(frame.tobytes()).hexdigest()


def open_frames(
    pattern: str, *, channel: int | None = None, z: int | None = None
) -> AbstractContextManager[Frames]:
    """Open a file, a folder with one image a frame, a glob such as "day1/*.png", or a URL.

    `channel` of a multi-channel image, and plane `z` where there are times as well, count from 0.
    """
    path = Path(pattern)
    if not pattern:
        raise InputError("the image has no name; give a file, a folder, a glob or a URL")
    if path.is_file():
        return _file(path, channel, z)
    if is_url(pattern) or _is_zarr(path):
        try:
            from napari_splinesketch.images.zarr_image import open_zarr
        except ImportError:
            needed = INSTALL.format("remote" if is_url(pattern) else "formats")
            raise InputError(f"{pattern}: Zarr needs a library; {needed}") from None
        return open_zarr(pattern, channel, z)
    return _folder(pattern, channel, z)


def is_url(pattern: str) -> bool:
    """Whether a name is an address on the network."""
    return "://" in pattern


def is_part_of(path: Path, pattern: str) -> bool:
    """Whether a file is, or would become, a part of the image of this name."""
    if is_url(pattern) or not pattern:
        return False
    image = Path(pattern)
    if image.is_file() or _is_zarr(image):
        return same_file(path, image) or is_inside(path, image)
    if path.suffix.lower() not in TIFFS + STILLS:
        return False
    folder, name = (image, "*") if image.is_dir() else (image.parent, image.name)
    folders = [folder] if folder.is_dir() else map(Path, glob(str(folder)))
    becomes = (each / path.name for each in folders if path.match(name))
    return any(same_file(path, one) for one in (*_matching(pattern), *becomes))


def _is_zarr(path: Path) -> bool:
    return any((path / name).is_file() for name in (".zgroup", ".zarray", "zarr.json"))


def _file(path: Path, channel: int | None, z: int | None) -> AbstractContextManager[Frames]:
    suffix = path.suffix.lower()
    if path.exists() and (kind := special(path)):  # to open a pipe may take for ever
        raise InputError(f"{path}: {kind}; expected a file")
    if suffix in TIFFS:
        from napari_splinesketch.images.tiff import open_tiff

        return open_tiff(path, channel, z)
    if suffix in STILLS + FILMS:
        return _still_or_film(path, suffix in FILMS, channel, z)
    allowed = ", ".join((*TIFFS, *STILLS, *FILMS))
    rest = f"{allowed}, OME-Zarr or a folder; save other images as TIFF"
    raise InputError(f"{path}: not an image; expected one of {rest}")


@contextmanager
def _still_or_film(path: Path, moves: bool, channel: int | None, z: int | None) -> Iterator[Frames]:
    import imagecodecs
    import imageio.v3

    if moves and not find_spec("av"):  # imageio's own message does not say how to install it
        raise InputError(f"{path}: films need a library; {INSTALL.format('formats')}")
    plugin: Any = "pyav" if moves else "pillow"
    with ExitStack() as inside:
        try:
            path.open("rb").close()  # imageio does not say why it cannot open a file
            file: Any = inside.enter_context(imageio.v3.imopen(path, "r", plugin=plugin))
            count = (file.properties().n_images or 0) if moves else 1
            inks = not moves and file.metadata(index=0)["mode"] == "CMYK"
            first = None if moves else file.read(index=0, mode="RGB" if inks else None)
            if first is not None and first.ndim == 3 and path.suffix.lower() == ".png":
                content = path.read_bytes()
                if content[DEPTH] == 16:  # of which Pillow keeps 8
                    first = imagecodecs.png_decode(content)
        except Exception as error:  # image libraries raise anything on a broken file
            kind = "a film" if moves else path.suffix[1:].upper()
            why = f"{path}: cannot be read as {kind} ({error}); save it again"
            raise InputError(why) from error
        count = count or sum(1 for _ in imageio.v3.imiter(path, plugin=plugin))
        deep = moves and str(file.metadata()["video_format"]).startswith("gray1")
        colours = first.shape[2:] if first is not None else () if deep else (3,)
        if channel is not None or z is not None:
            choose_planes(path.name, "S" * len(colours), colours, channel, z)
        form = "gray16le" if deep else "rgb24"
        read = _numbered(file, form) if first is None else lambda index: first
        yield Frames(path.name, count, read, channel=channel)


def _numbered(film: Any, form: str) -> Callable[[int], np.ndarray]:
    """Read frames by number: times are not even in every film. Past a damaged one, by time."""
    even = False

    def read(index: int) -> np.ndarray:
        nonlocal even
        try:
            return film.read(index=index, constant_framerate=even, format=form)
        except StopIteration:
            raise EOFError("the film ends before it") from None
        except Exception:
            even = True
            raise

    return read


@contextmanager
def _folder(pattern: str, channel: int | None, z: int | None) -> Iterator[Frames]:
    folder = Path(pattern)
    # Hidden files are no frames: macOS puts one beside each file.
    shown = (path for path in _matching(pattern) if not path.name.startswith("."))
    paths = sorted((path for path in shown if path.suffix.lower() in TIFFS + STILLS), key=_natural)
    if not paths:
        raise InputError(f"{pattern}: no such image, and no folder or glob with images in it")

    def read(index: int) -> np.ndarray:
        with _file(paths[index], channel, z) as frames:
            if frames.count != 1:
                many = f"{paths[index]} has {frames.count} frames; expected one per file"
                raise InputError(f"{many}: give that file alone to read them")
            return frames[0]

    scale, units = None, None
    for path in paths:  # the first that can be read tells the size of a pixel
        try:
            with _file(path, channel, z) as frames:
                scale, units = frames.scale, frames.units
            break
        except InputError:
            if path == paths[-1]:
                raise
    yield Frames(folder.absolute().name, len(paths), read, scale, units, paths)


def _matching(pattern: str) -> list[Path]:
    """Give what is in a folder, or fits a glob: the brackets of a folder there are its name."""
    if os.path.isdir(pattern):
        return [*Path(pattern).iterdir()]
    folder, name = os.path.split(pattern)
    known = os.path.isdir(folder)
    return [*map(Path, glob(os.path.join(escape(folder) if known else folder, name)))]


def _natural(path: Path) -> tuple[list[list[tuple[int, str]]], Path]:
    """Sort frame_2 before frame_10, folder by folder; the same wherever disks list them."""
    names = (re.split(r"(\d+)", name) for name in path.parts)
    return [[(int(n), "") if n.isdecimal() else (-1, n) for n in name] for name in names], path


def in_one_unit(sizes: Sequence[float], units: Sequence[str]) -> Scale:
    """Give the (y, x) size of a pixel in the unit of y; nothing where that cannot be."""
    y, x = sizes
    if units[0] != units[1]:
        if not METRES.keys() >= {*units}:
            return None, None
        x *= METRES[units[1]] / METRES[units[0]]
    return (float(y), float(x)), units[0]


def choose_planes(
    name: str, axes: str, shape: tuple[int, ...], channel: int | None, z: int | None
) -> tuple[int, Callable[[int], tuple[int, ...]]]:
    """Find out which of an image's leading axes, of a letter each such as "TCZ", are frames.

    Gives their number, and what maps the number of one to its index along each of these axes.
    """
    stacked = [i for i, size in enumerate(shape) if size > 1 and axes[i] not in "CS"]
    if "Z" not in axes and len(stacked) > 1:  # no name tells which of them --z is to choose from
        last = max(stacked, key=lambda i: (axes[i] != "T", i))
        axes = f"{axes[:last]}Z{axes[last + 1 :]}"
    chosen = {"C": channel, "S": channel, "Z": z}
    for option, wanted, names in (("--channel", channel, "CS"), ("--z", z, "Z")):
        if wanted is not None and not set(names) & set(axes):
            raise InputError(f"{name} has no axis for {option}; leave it out")
    place = [0] * len(axes)
    frames = None
    for at, (axis, size) in enumerate(zip(axes, shape, strict=True)):
        wanted = chosen.get(axis)
        if wanted is not None and not 0 <= wanted < size:
            raise InputError(f"{name} has {size} along axis {axis}; there is no {wanted}")
        if wanted is not None:
            place[at] = wanted
        elif size > 1 and axis in "CS":
            kind = "channels" if axis == "C" else "colour planes"
            more = "" if axis == "C" else "; if they are frames, save them as grey ones"
            raise InputError(f"{name} has {size} {kind}; choose one with --channel, from 0{more}")
        elif size > 1 and frames is not None:
            remedy = "choose one plane with --z" if z is None else "save one as an image of its own"
            raise InputError(f"{name} has two axes of frames, {axes[frames]} and {axis}; {remedy}")
        elif size > 1:
            frames = at

    def at_frame(index: int) -> tuple[int, ...]:
        return tuple(index if at == frames else fixed for at, fixed in enumerate(place))

    return (1 if frames is None else shape[frames]), at_frame

"""Where things are: layers' coordinates, units, frames and pixels, seen from the image.

A layer's `data_to_world` speaks the layer's own unit; the window draws every layer in the smallest
unit of all of them, and in none where they do not match. So it is here.
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pint
from jaxtyping import Float, Int, Real
from napari.components import ViewerModel
from napari.experimental import unlink_layers
from napari.layers import Image, Layer
from napari.utils.transforms import CompositeAffine

from napari_splinesketch.engine.spline import arc_length
from napari_splinesketch.engine.types import Curve, InputError
from napari_splinesketch.files import reason_of
from napari_splinesketch.geometry import width_growth
from napari_splinesketch.grids import Grid, slices
from napari_splinesketch.images.frames import LUMINANCE, is_url
from napari_splinesketch.labels.types import unit_of
from napari_splinesketch.plugin.model import Line, lengths_of

Points = Float[np.ndarray, "N D"]
Pair = Float[np.ndarray, "2"]  # (row, col)
Corner = Int[np.ndarray, "2"]
WHOLE_FRAME = 2**22  # frames in memory of up to this many pixels are given whole
LARGEST_BLOCK = 2**24  # px: of a larger one a coarser level of a multiscale image is read
BEYOND = 2**31  # more than the times of any image
MARGIN = 64  # kept around the sketches beside the length of the longest, px


@dataclass(frozen=True)
class Ruler:
    """Turns pixels into the image's unit, by the (y, x) size of a pixel; "px" where it has none."""

    scale: tuple[float, float] = (1.0, 1.0)
    unit: str = "px"

    @property
    def pixel(self) -> float:
        """Size of a pixel: the mean of both directions."""
        return (self.scale[0] * self.scale[1]) ** 0.5

    def along(self, points: Line) -> Float[np.ndarray, " P"]:
        """Distance from the first point along a line of (row, col), px, in the unit."""
        return arc_length(points * self.scale)

    def across(self, curve: Curve, values: Float[np.ndarray, " P"]) -> Float[np.ndarray, " P"]:
        """Turn distances from a curve, px, into the unit, whichever way it runs."""
        return values * width_growth(curve.points, self.scale)


def to_pixels(viewer: ViewerModel, layer: Layer, image: Layer, points: Points) -> Points:
    """Take (N, layer.ndim) points of a layer's data to pixels of an image, frame axes first.

    The viewer's units decide, and its sliders for axes that `layer` lacks.
    """
    world = to_world(viewer, layer, points)
    missing = image.ndim - layer.ndim
    if missing > 0:
        here = np.array(viewer.dims.point[-image.ndim :][:missing])
        world = np.hstack([np.broadcast_to(here, (len(world), missing)), world])
    return from_world(viewer, image, world[:, -image.ndim :])


def to_world(viewer: ViewerModel, layer: Layer, points: Points) -> Points:
    """Take (N, D) points of a layer's data to the window's world."""
    linear, offset = _affine(viewer, layer)
    return np.asarray(points) @ linear.T + offset


def from_world(viewer: ViewerModel, layer: Layer, world: Points) -> Points:
    """Take (N, D) points of the window's world to a layer's data."""
    linear, offset = _affine(viewer, layer)
    return np.linalg.solve(linear, (world - offset).T).T


def _affine(
    viewer: ViewerModel, layer: Layer
) -> tuple[Float[np.ndarray, "D D"], Float[np.ndarray, " D"]]:
    """Matrix and offset from a layer's data to the world, by its corner and the unit vectors."""
    factors = _factors(viewer, layer)
    corners = [layer.data_to_world(point) for point in np.eye(layer.ndim + 1, layer.ndim, -1)]
    offset, *ends = np.array(corners) * factors
    return np.column_stack(ends) - offset[:, None], offset


def _factors(viewer: ViewerModel, layer: Layer) -> Float[np.ndarray, " D"]:
    """Units of the window in one of a layer's, for each axis of the layer."""
    own, window = layer.units, viewer.layers.extent.units
    units = window[-layer.ndim :] if window and len(window) >= layer.ndim else own
    convert = pint.get_application_registry().convert
    return np.array([convert(1.0, *pair) for pair in zip(own, units, strict=True)])


def plane_problem(viewer: ViewerModel, image: Image | None) -> str:
    """Why the window does not show an image's own (row, col) plane, or nothing."""
    if image is None:
        return "Open an image: drop a file on the window, or File > Open Sample."
    if viewer.dims.ndisplay != 2:
        return "Sketches live in 2-D: switch the view from 3-D to 2-D."
    shown = {axis - viewer.dims.ndim for axis in viewer.dims.displayed}
    if shown != {-2, -1}:
        return "The sliders are rolled: show the last two axes of the image."
    return ""


def current_frame(viewer: ViewerModel, image: Image) -> int:
    """Index of the frame in view, counted over all axes before (row, col); 0 without any."""
    # As napari does, to the last digit: between two frames, that decides which of them is shown.
    here = np.array(viewer.dims.point)[-image.ndim :] / _factors(viewer, image)
    point = image.world_to_data(here)[None]
    point[:, :-2] = np.minimum(point[:, :-2], np.subtract(frame_shape(image), 1))
    return frame_numbers(image, point)[0]


def go_to_frame(viewer: ViewerModel, image: Image, frame: int) -> None:
    """Show a frame."""
    (world,) = to_world(viewer, image, in_stack(image, frame, np.zeros((1, 2))))
    first = viewer.dims.ndim - image.ndim
    viewer.dims.set_point(range(first, first + image.ndim - 2), world[:-2].tolist())


def frame_count(image: Image) -> int:
    """How many frames an image has."""
    return int(np.prod(frame_shape(image), dtype=int))


class Times(NamedTuple):
    """How many times an image has, and how many frames lie from one to the next."""

    number: int
    step: int = 1
    others: tuple[tuple[str, int, int], ...] = ()  # axes: name, and the same two numbers

    def place(self, frame: int) -> str:
        """Say which frame, by its time and its places on other axes: "3", or "3, z 5"."""
        others = [f"{name} {frame // step % number}" for name, number, step in self.others]
        return ", ".join([str(frame // self.step % self.number), *others])

    def of(self, frame: int) -> range:
        """Give the frames at all times that share a frame's place on the other axes."""
        first = frame - frame // self.step % self.number * self.step
        return range(first, first + self.number * self.step, self.step)


def times_of(image: Image | None) -> Times:
    """Find the axis of time, of those longer than 1: the one called "t" or "time", or the first.

    Without an image, any.
    """
    if image is None:
        return Times(BEYOND)
    shape = frame_shape(image)
    # napari numbers axes that have no name: -4.
    names = [name if name[-1:].isalpha() else "plane" for name in image.axis_labels]
    steps = [int(np.prod(shape[i + 1 :], dtype=int)) for i in range(len(shape))]
    axes = [axis for axis in zip(names, shape, steps, strict=False) if axis[1] > 1] or [("", 1, 1)]
    time = next((axis for axis in axes if axis[0].lower() in ("t", "time")), axes[0])
    return Times(*time[1:], tuple([axis for axis in axes if axis is not time]))


def size_of(image: Image) -> tuple[int, int]:
    """(H, W) of an image at full resolution, px."""
    height, width = image.level_shapes[0][image.ndim - 2 : image.ndim]
    return int(height), int(width)


class View(NamedTuple):
    """What the canvas shows of an image: part of a frame, px, and a screen pixel's (row, col)."""

    frame: int
    low: Pair
    high: Pair
    pixel: Pair


def view_of(viewer: ViewerModel, image: Image) -> View:
    """Say what the canvas shows of an image."""
    camera, world = viewer.scene.camera, np.zeros((4, viewer.dims.ndim))
    corners = np.array(viewer.canvas.size) * [(-1, -1), (-1, 1), (1, -1), (1, 1)]
    world[:, viewer.dims.displayed[-2:]] = np.array(camera.center)[-2:] + corners / 2 / camera.zoom
    seen = from_world(viewer, image, world[:, -image.ndim :])[:, -2:]
    low, high = seen.min(axis=0), seen.max(axis=0)
    return View(current_frame(viewer, image), low, high, screen_pixel(viewer, image))


def look_at(viewer: ViewerModel, image: Image, frame: int, points: Line) -> None:
    """Go to a frame and bring some points, px, to the middle, but not what is beyond the image."""
    view, last = view_of(viewer, image), np.subtract(size_of(image), 1)
    half = np.minimum((view.high - view.low) / 2, last / 2)
    middle = np.clip((points.min(axis=0) + points.max(axis=0)) / 2, half, last - half)
    world = np.zeros(viewer.dims.ndim)
    (world[-image.ndim :],) = to_world(viewer, image, in_stack(image, frame, middle[None]))
    go_to_frame(viewer, image, frame)
    down_right = list(viewer.dims.displayed[-2:])  # napari may have them transposed
    viewer.scene.camera.center = (0.0, *world[down_right].tolist())


def screen_pixel(viewer: ViewerModel, layer: Layer) -> Pair:
    """(row, col) that a pixel of the screen covers, px of an image, or units of a layer's data."""
    size = np.linalg.norm(_affine(viewer, layer)[0][:, -2:], axis=0)
    return 1 / (size * viewer.scene.camera.zoom)


def frame_numbers(image: Image, pixels: Points) -> list[int]:
    """Frame of each (N, image.ndim) point; what is beyond the last frame stays beyond it."""
    leading = frame_shape(image)
    if not leading:
        return [0] * len(pixels)
    index = np.round(pixels[:, :-2]).astype(int).T
    shape = (BEYOND, *leading[1:])
    return np.asarray(np.ravel_multi_index(tuple(index), shape, mode="clip")).tolist()


def frame_shape(image: Image) -> tuple[int, ...]:
    """Lengths of the axes before (row, col)."""
    return tuple(int(size) for size in image.level_shapes[0][: image.ndim - 2])


def in_stack(image: Image, frame: int | Sequence[int], points: Line) -> Points:
    """Put (row, col) points into a frame, or each into its own: data coordinates of the image."""
    shape = frame_shape(image)
    index = np.array(np.unravel_index(frame, (BEYOND, *shape[1:]))).T if shape else np.zeros(0)
    return np.hstack([np.broadcast_to(index, (len(points), len(shape))), points])


def placement(image: Image, ndim: int | None = None, grid: Grid | None = None) -> dict[str, Any]:
    """Give the keywords that make a new layer, of as many axes or `ndim`, lie on the image.

    Its pixels are the image's own, or those of a grid.
    """
    own = CompositeAffine(image.scale, image.translate, rotate=image.rotate, shear=image.shear)
    count = ndim or image.ndim
    more = max(count - image.ndim, 0)
    last: Any = np.arange(image.ndim + more)[-count:]
    whole, affine = (t.expand_dims(range(more)).set_slice(last) for t in (own, image.affine))
    placed = {name: getattr(whole, name) for name in ("scale", "translate", "rotate", "shear")}
    units = (*["pixel"] * more, *image.units[-count:])
    labels = (*["frame"] * more, *image.axis_labels[-count:])
    placed |= {"affine": affine, "units": units, "axis_labels": labels}
    if grid is not None:
        first = np.append(np.zeros(image.ndim - 2), grid.origin)
        size = np.append(np.ones(image.ndim - 2), grid.step)
        corner = image.affine.inverse(image.data_to_world(first))
        placed |= {"scale": image.scale * size, "translate": corner}
    return placed


def place(layer: Layer, image: Image, grid: Grid | None) -> bool:
    """Lay a layer of as many axes on an image, as above; say whether it has lain elsewhere."""
    wanted = placement(image, grid=grid)
    before = {name: getattr(layer, name) for name in wanted}
    for each in (wanted, before):
        each["affine"] = each["affine"].affine_matrix
    moved = [name for name in wanted if not np.array_equal(before[name], wanted[name])]
    if moved:  # or those that the user linked it with would follow, and the image run away
        unlink_layers([layer], moved)
    for name in moved:  # napari draws everything again for each
        setattr(layer, name, wanted[name])
    return bool(moved)


def ruler_of(image: Image | None) -> Ruler:
    """Give what measures in an image's own unit, or in pixels where it has none."""
    if image is None:
        return Ruler()
    size, unit = pixel_size(image.scale.tolist(), image.units)
    return Ruler(size, unit) if size and unit else Ruler()


def pixel_size(
    scale: Sequence[float], units: Sequence[pint.Unit]
) -> tuple[tuple[float, float] | None, str | None]:
    """(y, x) size of a pixel and its unit, of a layer's scale and units; None without."""
    unit_y, unit_x = units[-2:]
    size_y, size_x = (abs(float(size)) for size in scale[-2:])
    if not unit_y.is_compatible_with(unit_x):
        return None, None
    if str(unit_y) == "pixel":
        return (None if size_y == size_x == 1 else (size_y, size_x)), None
    convert = pint.get_application_registry().convert
    return (size_y, convert(size_x, unit_x, unit_y)), unit_of(f"{unit_y:~P}")


@dataclass(frozen=True, eq=False)
class Block:
    """Part of one frame, the `key` of an array-like `level`; to be read in a thread."""

    grid: Grid
    level: Any
    key: tuple[int | slice, ...]
    rgb: bool
    name: str
    zarr: str  # its folder, or nothing if it is not read from one

    @property
    def whole(self) -> bool:
        """Whether it is all of the frame."""
        sizes = self.level.shape[len(self.key) - 2 : len(self.key)]
        return self.key[-2:] == tuple(slice(0, int(size)) for size in sizes)

    def read(self) -> Real[np.ndarray, "H W"]:
        """Read the pixels, a colour image as luminance; the array is the caller's own."""
        try:
            if self.zarr:
                os.stat(self.zarr)  # an error where it was deleted: it would be read as empty
            pixels = np.array(self.level[self.key])
        except Exception as error:  # image libraries raise anything on a broken file
            why = f"could not be read ({reason_of(error)}); see that its file is there and whole"
            raise InputError(f"{self.name} {why}, or open the image again.") from error
        return pixels[..., :3].astype(np.float32) @ LUMINANCE if self.rgb else pixels


def block_around(image: Image, frame: int, lines: Sequence[Line]) -> Block:
    """Choose what to read of a frame for some sketches, px, at the finest level not too large."""
    shapes, levels = _levels(image)
    points = np.clip(np.concatenate(lines), 0, shapes[0] - 1)
    margin = MARGIN + lengths_of(lines).max()
    low, high = np.maximum(points.min(0) - margin, 0), np.minimum(points.max(0) + margin, shapes[0])
    sizes = [np.prod((high - low) * shape / shapes[0]) for shape in shapes]
    fine = next((i for i, size in enumerate(sizes) if size <= LARGEST_BLOCK), len(sizes) - 1)
    step, shape = shapes[0] / shapes[fine], shapes[fine]
    start = np.floor(low / step).astype(int)
    stop = np.minimum(np.ceil(high / step), shape).astype(int)
    if isinstance(levels[fine], np.ndarray) and np.prod(shape) <= WHOLE_FRAME:
        start, stop = np.zeros(2, int), shape
    return _block(image, frame, fine, start, stop)


def block_on(image: Image, frame: int, grid: Grid, shape: tuple[int, ...]) -> Block | None:
    """Find the pixels that (H, W) places on a grid stand for; None if the image has none now."""
    shapes, _ = _levels(image)
    start = np.rint((grid.origin - (grid.step - 1) / 2) / grid.step).astype(int)
    stop = start + shape
    fits = np.isclose(shapes[0] / shapes, grid.step) & (start >= 0) & (stop <= shapes)
    levels = np.flatnonzero(fits.all(axis=1)).tolist()
    return _block(image, frame, levels[0], start, stop) if levels else None


def _levels(image: Image) -> tuple[Int[np.ndarray, "L 2"], Any]:
    """(rows, columns) of each level of an image, and the levels, the finest first."""
    shapes = image.level_shapes[:, image.ndim - 2 : image.ndim]
    return shapes, image.data if image.multiscale else [image.data]


def _block(image: Image, frame: int, number: int, start: Corner, stop: Corner) -> Block:
    shapes, levels = _levels(image)
    level, step = levels[number], shapes[0] / shapes[number]
    # Pixel 0 of a coarser level covers the first `step` pixels: its centre is not theirs.
    grid = Grid(step * start + (step - 1) / 2, step)
    leading = np.array(frame_shape(image), dtype=int)
    index = np.array(np.unravel_index(frame, leading), dtype=int)
    index = index * level.shape[: len(index)] // leading  # a level may have fewer frames
    name = f"Frame {times_of(image).place(frame)} of " * (frame_count(image) > 1) + repr(image.name)
    path = str(image.source.path or getattr(getattr(level, "store", None), "root", ""))
    zarr = "" if isinstance(level, np.ndarray) or is_url(path) or ".zarr" not in path else path
    return Block(grid, level, (*index.tolist(), *slices(start, stop)), image.rgb, name, zarr)

"""Layers that are made of what is known: one table says what of, and how.

Reconstruction, outlines, halos and marks are always there; residual, background, uncertainty and
masks are made when the user asks for them, and follow what is known while they are in view.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float, Integer, Shaped
from napari.layers import Image, Labels, Points, Shapes, Vectors
from napari.utils.colormaps import Colormap
from napari.utils.transforms import Affine

from napari_splinesketch import palette
from napari_splinesketch.grids import (
    Along,
    Grid,
    Patch,
    across,
    alone,
    around_all,
    mean_across,
    slices,
)
from napari_splinesketch.plugin.columns import colours_of
from napari_splinesketch.plugin.layers import looks, space
from napari_splinesketch.plugin.layers.slot import Made, Maker, in_vectors
from napari_splinesketch.plugin.model import Record, by_frame
from napari_splinesketch.raster import label_image

if TYPE_CHECKING:
    from napari_splinesketch.plugin.layers.results import Work

DIVERGING = Colormap(["#0072b2", "#f7f7f7", "#d55e00"], name="residual")
"""Blue, white, vermilion: told apart by everybody; white where the model is right."""
TYPICAL = 0.995
"""Share of the residuals that the colours span."""
BODY = "body"
"""Name of the axis along which a stack has its bodies."""
THIN = 0.5
"""Breadth of outlines and halos, relative to a curve's line."""

HALO = 2.0
"""Breadth of halos at least, px of the screen."""
KEPT = 4
"""Planes that are remembered: the one in view is read again with every change of the look."""


class Planes:
    """Array-like (*leading, H, W) of which `plane` makes (H, W) when napari asks for one.

    Planes are numbered over all leading axes. dask would do the same, at 10 ms for each plane.
    """

    def __init__(
        self, shape: tuple[int, ...], dtype: Any, plane: Callable[[int], Shaped[np.ndarray, "H W"]]
    ):
        self.shape, self.ndim, self.size = shape, len(shape), int(np.prod(shape))
        self.dtype = np.dtype(dtype)
        self._plane = lru_cache(KEPT)(plane)

    def __getitem__(self, key: Any) -> Shaped[np.ndarray, ...]:
        """Read like a NumPy array, making only the planes asked for."""
        key = key if isinstance(key, tuple) else (key,)
        at = key.index(Ellipsis) if Ellipsis in key else len(key)
        every = [slice(None)] * (self.ndim - len(key) + (at < len(key)))
        key, leading = (*key[:at], *every, *key[at + 1 :]), self.shape[:-2]
        numbers = np.arange(int(np.prod(leading))).reshape(leading)[key[:-2]]
        planes = np.array([self._plane(int(n)) for n in numbers.ravel()], dtype=self.dtype)
        whole = planes.reshape(*numbers.shape, *self.shape[-2:])
        return whole[(*[slice(None)] * numbers.ndim, *key[-2:])]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Shaped[np.ndarray, ...]:
        """Make all planes."""
        return self[()].astype(dtype or self.dtype)

    def __len__(self) -> int:
        return self.shape[0]


def film_of(
    pictures: Mapping[int, Patch],
    leading: tuple[int, ...],
    make: Callable[[int, Patch], Float[np.ndarray, "H W"]] = lambda frame, patch: patch.pixels,
) -> tuple[Planes, Grid]:
    """Put the frames that are known on one grid; NaN elsewhere.

    Of the `pictures` by frame, those on another step than the last one are left out; `make` gives
    the pixels that are shown of one. `leading` are the lengths of the axes before (row, col).
    """
    step = list(pictures.values())[-1].grid.step
    same = {n: p for n, p in pictures.items() if np.allclose(p.grid.step, step)}
    grid, first, ends = around_all(list(same.values()))
    places = dict(zip(same, map(slices, first, ends), strict=True))
    shape = (*leading, *np.max(ends, axis=0).tolist())

    def plane(number: int) -> Float[np.ndarray, "H W"]:
        frame = np.full(shape[-2:], np.nan, dtype=np.float32)
        if number in same:
            frame[places[number]] = make(number, same[number])
        return frame

    return Planes(shape, np.float32, plane), grid


def _patches(work: Work) -> list[Any]:
    return list(work.state.patches.items())


def _curves(work: Work) -> list[Any]:
    return [record.curve for record in work.records]


def _like(image: Image) -> dict[str, Any]:
    """Give the keywords that make pictures in an image's own units look like it."""
    low, high = image.contrast_limits
    look = {} if image.rgb else {"colormap": image.colormap.name, "gamma": image.gamma}
    return look | {"contrast_limits": (float(low or 0), float(high or 0))}


def _film(
    work: Work, patches: Sequence[tuple[int, Patch]], look: dict[str, Any], *make: Any
) -> Made | None:
    """Pictures of the frames that are known."""
    if not patches:
        return None
    film, grid = film_of(dict(patches), space.frame_shape(work.image), *make)
    return Made(film, space.placement_on(work.image, grid.origin, grid.step), look)


def _rest(
    image: Image, frame: int, grid: Grid, model: Float[np.ndarray, "H W"]
) -> Float[np.ndarray, "H W"]:
    """Image minus reconstruction; NaN where the image has other pixels by now."""
    block = space.block_on(image, frame, grid, model.shape)
    return np.full(model.shape, np.nan) if block is None else block.read() - model


def _residual(work: Work, patches: list[tuple[int, Patch]]) -> Made | None:
    def rest(frame: int, patch: Patch) -> Float[np.ndarray, "H W"]:
        return _rest(work.image, frame, patch.grid, patch.pixels)

    last = np.array([np.abs(rest(*known)) for known in patches[-1:]])
    last = last[np.isfinite(last)]
    most = (float(np.quantile(last, TYPICAL)) if last.size else 0.0) or 1.0
    look = {"colormap": DIVERGING, "contrast_limits": (-most, most)}
    return _film(work, patches, look, rest)


def _background(work: Work, patches: list[tuple[int, Patch]]) -> Made | None:
    known = [(frame, patch) for frame, patch in patches if patch.background is not None]
    return _film(work, known, _like(work.image), lambda frame, patch: patch.background)


def _chosen(work: Work) -> list[Any]:
    """The selected curve, if it is a single one, and the picture of its frame."""
    chosen, patches = work.selected, work.state.patches
    known = len(chosen) == 1 and chosen[0].frame in patches
    return [chosen[0].frame, chosen[0].curve, patches[chosen[0].frame]] if known else []


def _body(work: Work, chosen: list[Any]) -> Made | None:
    if not chosen:
        return None
    frame, curve, patch = chosen
    others = [r.curve for r in work.records if r.frame == frame and r.curve is not curve]
    draw = partial(alone, curve=curve, others=others)
    return _film(work, [(frame, patch)], _like(work.image), lambda frame, patch: draw(patch))


def _ribbon(work: Work, _: object) -> Made | None:
    drawn = [(record.frame, looks.ribbon(record.curve)) for record in work.records]
    lines = [(frame, line) for frame, line in drawn if line is not None]
    if not lines:
        return None
    look = {"edge_color": palette.UNCERTAIN, "edge_width": 0.4 * looks.breadth(_curves(work))}
    return Made(in_vectors(work.image, lines)[0], {}, look)


def _wide(work: Work) -> list[Record]:
    return [record for record in work.records if looks.has_outline(record.curve)]


def _outlines(work: Work, _: object) -> Made:
    known = _wide(work)
    lines = [looks.outline(record.curve) for record in known]
    return _around(work, known, lines, colours_of(known, work.look))


def _halos(work: Work, _: object) -> Made:
    """Lines outside the selected bodies: napari marks them in some of its tools only."""
    curves = [record.curve for record in work.selected]
    gap = looks.gap(curves, work.screen)
    lines = looks.coarse([looks.halo(curve, gap) for curve in curves])
    colours = [palette.MOVING] * len(curves)
    return _around(work, work.selected, lines, colours, HALO * work.screen)


def _around(
    work: Work,
    records: Sequence[Record],
    lines: Sequence[looks.Line],
    colours: Sequence[str],
    least: float = 0.0,
) -> Made:
    """Show lines around bodies in the colours of their curves, so broad at least."""
    frames = [record.frame for record in records]
    data, counts = in_vectors(work.image, list(zip(frames, lines, strict=True)))
    if not records:
        return Made(data)
    width = max(THIN * looks.breadth([record.curve for record in records]), least)
    look = {"edge_width": width, "edge_color": np.repeat(looks.rgba(colours), counts, axis=0)}
    return Made(data, look)


def _in_view(work: Work) -> list[tuple[Record, tuple[float, ...]]]:
    """The curves whose marks are in view, and where these stand."""
    found = looks.readable(work.records, space.view_of(work.viewer, work.image))
    return [(record, tuple(place.tolist())) for record, place in found]


def _marks(work: Work, marked: list[tuple[Record, tuple[float, ...]]]) -> Made:
    places = np.array([place for _, place in marked]).reshape(-1, 2)
    text = {
        "string": [looks.mark_of(record) for record, _ in marked],
        "color": [looks.COLOURS[record.curve.status] for record, _ in marked],
        "size": 10,
        "anchor": "center",
    }
    frame = marked[0][0].frame if marked else 0
    return Made(space.in_stack(work.image, frame, places), {"text": text})


def _moving(work: Work, _: object) -> Made | None:
    """Lines that are not there yet; hidden at first, as to add a layer takes long enough."""
    if not work.moving:
        return None
    look = {"edge_width": looks.line_width(space.size_of(work.image)), "edge_color": palette.MOVING}
    return Made(in_vectors(work.image, work.moving)[0], {"visible": True}, look)


def _masks(work: Work, _: object) -> Made:
    """Label image of each frame: a pixel's value is the number of its curve."""
    return Made(_planes(work, (), by_frame(work.records)), space.placement(work.image))


def _stack(work: Work, _: object) -> Made | None:
    """One mask for each curve, along an axis of their own in front: overlaps are kept."""
    image, numbers = work.image, sorted({record.id for record in work.records})
    if not numbers:
        return None
    records = {numbers.index(r.id) * space.frame_count(image) + r.frame: [r] for r in work.records}
    own = Affine(
        scale=image.scale, translate=image.translate, rotate=image.rotate, shear=image.shear
    ).expand_dims([0])
    place = {name: getattr(own, name) for name in ("scale", "translate", "rotate", "shear")}
    place |= {"affine": image.affine.expand_dims([0]), "units": ("pixel", *image.units)}
    place |= {"axis_labels": (BODY, *image.axis_labels)}
    return Made(_planes(work, (len(numbers),), records), place)


def _planes(work: Work, more: tuple[int, ...], records: Mapping[int, list[Record]]) -> Planes:
    """Draw the masks of some curves, plane by plane, with more axes in front."""
    size = space.size_of(work.image)

    def mask(plane: int) -> Integer[np.ndarray, "H W"]:
        here = [(r.id, r.curve.points, r.curve.half_width) for r in records.get(plane, ())]
        return label_image(here, size, np.int32)

    return Planes((*more, *space.frame_shape(work.image), *size), np.int32, mask)


MAKERS: dict[str, Maker] = {
    "reconstruction": Maker(Image, "reconstruction", _patches,
                            lambda work, patches: _film(work, patches, _like(work.image))),
    "outlines": Maker(Vectors, "outlines",
                      lambda work: [work.look, *[r.curve for r in _wide(work)]], _outlines),
    "selected": Maker(Vectors, "selected",
                      lambda work: [(r.curve, work.screen) for r in work.selected], _halos),
    "marks": Maker(Points, "marks", _in_view, _marks),
    "preview": Maker(Vectors, "on the way", lambda work: [id(work.moving)], _moving),
    "residual": Maker(Image, "residual", _patches, _residual, "Residual",
                      "Image minus model: blue below, white right, orange above"),
    "background": Maker(Image, "background", _patches, _background, "Background",
                        "What the model has behind the bodies"),
    "body": Maker(Image, "selected body", _chosen, _body, "Selected body alone",
                  "The selected curve's body on the background",
                  "Select one curve first: its body is shown alone."),
    "ribbon": Maker(Vectors, "uncertainty", _curves, _ribbon, "Uncertainty",
                    "Lines at twice the standard error to both sides of each curve",
                    "No standard errors are known: the preset Paper gives none."),
    "masks": Maker(Labels, "masks", _curves, _masks, "Masks",
                   "A Labels layer: pixels have their curve's number"),
    "stack": Maker(Labels, "masks, one a body", _curves, _stack, "One mask for each body",
                   "A stack with a mask for each curve: overlaps are kept"),
    # Lines of their own, some at a time.
    "curves": Maker(Shapes, "curves", _curves, lambda work, curves: None),
}  # fmt: skip


def residual_along(image: Image, patch: Patch, record: Record) -> Along | None:
    """Average image minus reconstruction across a body; None where the image is not there.

    Only the pixels around the body are read.
    """
    points = patch.grid.to_block(record.curve.points)
    half_width = record.curve.half_width / patch.grid.size
    places = across(points, half_width)
    low = np.clip(np.floor(places.min((0, 1))).astype(int), 0, patch.pixels.shape)
    high = np.clip(np.ceil(places.max((0, 1))).astype(int) + 1, 0, patch.pixels.shape)
    if (high <= low).any():
        return None
    grid = Grid(patch.grid.to_image(low), patch.grid.step)
    rest = _rest(image, record.frame, grid, patch.pixels[slices(low, high)])
    return None if np.isnan(rest).all() else mean_across(rest, points - low, half_width)

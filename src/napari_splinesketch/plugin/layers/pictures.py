"""Layers that are made of what is known: one table says what of, and how.

Reconstruction, outlines and halos are always there; residual, background, uncertainty and masks
are made when the user asks for them, and follow what is known while they are in view.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float, Integer
from napari.layers import Image, Labels, Vectors
from napari.utils.colormaps import Colormap
from napari.utils.transforms import Affine

from napari_splinesketch import palette
from napari_splinesketch.grids import Along, Grid, Patch, across, alone, mean_across
from napari_splinesketch.plugin.columns import colours_of
from napari_splinesketch.plugin.layers.looks import (
    Line,
    breadth,
    coarse,
    halo,
    has_outline,
    outline,
    rgba,
    ribbon,
)
from napari_splinesketch.plugin.layers.pixels import Film, Planes, block_on
from napari_splinesketch.plugin.layers.slot import Made, Maker, in_vectors
from napari_splinesketch.plugin.layers.space import (
    frame_count,
    frame_shape,
    placement,
    placement_on,
    size_of,
)
from napari_splinesketch.plugin.model import Record, by_frame
from napari_splinesketch.raster import label_image

if TYPE_CHECKING:
    from napari_splinesketch.plugin.keeper import Work

DIVERGING = Colormap(["#0072b2", "#f7f7f7", "#d55e00"], name="residual")
"""Blue, white, vermilion: told apart by everybody; white where the model is right."""
TYPICAL = 0.995
"""Share of the residuals that the colours span."""
BODY = "body"
"""Name of the axis along which a stack has its bodies."""
THIN, GAP = 0.5, 1.2
"""Breadth of outlines and halos, and from a body's edge to its halo, relative to a curve's line."""


def _patches(work: Work) -> list[Any]:
    return list(work.state.patches.values())


def _curves(work: Work) -> list[Any]:
    return [record.curve for record in work.records]


def _chosen(work: Work) -> list[Any]:
    chosen = work.selected
    return [chosen[0].curve, work.state.patches.get(chosen[0].frame)] if len(chosen) == 1 else []


def _like(image: Image) -> dict[str, Any]:
    """Give the keywords that make pictures in an image's own units look like it."""
    low, high = image.contrast_limits
    look = {} if image.rgb else {"colormap": image.colormap.name, "gamma": image.gamma}
    return look | {"contrast_limits": (float(low or 0), float(high or 0))}


def _film(work: Work, patches: Any, look: dict[str, Any], *make: Any) -> Made | None:
    """Pictures of the frames that are known."""
    if not patches:
        return None
    film = Film(patches, frame_shape(work.image), *make)
    return Made(film, placement_on(work.image, film.grid.origin, film.grid.step), look)


def _residual(work: Work) -> Made | None:
    def rest(frame: int, patch: Patch) -> Float[np.ndarray, "H W"]:
        """Image minus reconstruction; NaN where the image has other pixels by now."""
        shape = patch.pixels.shape
        block = block_on(work.image, frame, patch.grid, shape)
        return np.full(shape, np.nan) if block is None else block.read() - patch.pixels

    most = 0.0
    for frame, patch in list(work.state.patches.items())[-1:]:
        last = np.abs(rest(frame, patch))
        last = last[np.isfinite(last)]
        most = float(np.quantile(last, TYPICAL)) if last.size else 0.0
    look = {"colormap": DIVERGING, "contrast_limits": (-(most or 1.0), most or 1.0)}
    return _film(work, work.state.patches, look, rest)


def _background(work: Work) -> Made | None:
    known = {f: p for f, p in work.state.patches.items() if p.background is not None}
    return _film(work, known, _like(work.image), lambda frame, patch: patch.background)


def _body(work: Work) -> Made | None:
    chosen = work.selected[0] if len(work.selected) == 1 else None
    patch = work.state.patches.get(chosen.frame) if chosen else None
    if chosen is None or patch is None:
        return None
    others = [r.curve for r in work.records if r.frame == chosen.frame and r is not chosen]
    return _film(
        work,
        {chosen.frame: patch},
        _like(work.image),
        lambda frame, patch: alone(patch, chosen.curve, others),
    )


def _ribbon(work: Work) -> Made | None:
    drawn = [(record.frame, ribbon(record.curve)) for record in work.records]
    lines = [(frame, line) for frame, line in drawn if line is not None]
    if not lines:
        return None
    width = 0.4 * breadth(_curves(work))
    look = {"edge_color": palette.UNCERTAIN, "edge_width": width}
    return Made(in_vectors(work.image, lines)[0], {}, look)


def _wide(work: Work) -> list[Record]:
    return [record for record in work.records if has_outline(record.curve)]


def _outlines(work: Work) -> Made:
    known = _wide(work)
    lines = [outline(record.curve) for record in known]
    return _around(work, known, lines, colours_of(known, work.layers.look))


def _halos(work: Work) -> Made:
    """Lines outside the selected bodies: napari marks them in some of its tools only."""
    curves = [record.curve for record in work.selected]
    lines = coarse([halo(curve, GAP * breadth(curves)) for curve in curves])
    return _around(work, work.selected, lines, [palette.MOVING] * len(curves))


def _around(
    work: Work, records: Sequence[Record], lines: Sequence[Line], colours: Sequence[str]
) -> Made:
    """Show lines around bodies, each in the frame of its curve and in its colour."""
    data, counts = in_vectors(
        work.image, [(record.frame, line) for record, line in zip(records, lines, strict=True)]
    )
    if not records:
        return Made(data)
    width = THIN * breadth([record.curve for record in records])
    look = {"edge_width": width, "edge_color": np.repeat(rgba(colours), counts, axis=0)}
    return Made(data, look)


def _masks(work: Work) -> Made | None:
    """Label image of each frame: a pixel's value is the number of its curve."""
    size, leading = size_of(work.image), frame_shape(work.image)
    plane = partial(_mask, by_frame(work.records), size)
    return Made(Planes((*leading, *size), np.int32, plane), placement(work.image))


def _stack(work: Work) -> Made | None:
    """One mask for each curve, along an axis of their own: overlaps are kept."""
    size, leading, count = size_of(work.image), frame_shape(work.image), frame_count(work.image)
    numbers = sorted({record.id for record in work.records})
    if not numbers:
        return None
    records = {numbers.index(r.id) * count + r.frame: [r] for r in work.records}
    planes = Planes((len(numbers), *leading, *size), np.int32, partial(_mask, records, size))
    return Made(planes, _placement_of_stack(work.image))


def _mask(
    records: Mapping[int, list[Record]], size: tuple[int, int], plane: int
) -> Integer[np.ndarray, "H W"]:
    here = [(r.id, r.curve.points, r.curve.half_width) for r in records.get(plane, ())]
    return label_image(here, size, np.int32)


def _placement_of_stack(image: Image) -> dict[str, Any]:
    """Lie on the image, with one more axis in front."""
    own = Affine(
        scale=image.scale, translate=image.translate, rotate=image.rotate, shear=image.shear
    ).expand_dims([0])
    return {
        **{name: getattr(own, name) for name in ("scale", "translate", "rotate", "shear")},
        "affine": image.affine.expand_dims([0]),
        "units": ("pixel", *image.units),
        "axis_labels": (BODY, *image.axis_labels),
    }


MAKERS: dict[str, Maker] = {
    "reconstruction": Maker(Image, "reconstruction", _patches,
                            lambda work: _film(work, work.state.patches, _like(work.image))),
    "outlines": Maker(Vectors, "outlines",
                      lambda work: [work.layers.look, *[r.curve for r in _wide(work)]], _outlines),
    "selected": Maker(Vectors, "selected",
                      lambda work: [record.curve for record in work.selected], _halos),
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
    block = block_on(image, record.frame, grid, tuple(high - low))
    if block is None:
        return None
    rest = block.read() - patch.pixels[low[0] : high[0], low[1] : high[1]]
    return mean_across(rest, points - low, half_width)

"""What the layers that the user asks for are made of."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Literal, Protocol, cast

import numpy as np
from jaxtyping import Float, Integer
from napari.layers import Image, Labels, Layer, Shapes
from napari.utils.colormaps import Colormap
from napari.utils.transforms import Affine

from napari_splinesketch import palette
from napari_splinesketch.labels import Label
from napari_splinesketch.labels.masks import label_image
from napari_splinesketch.labels.raster import rasterise
from napari_splinesketch.plugin.adapter.bodies import alone
from napari_splinesketch.plugin.adapter.film import Computed, Film, Patch
from napari_splinesketch.plugin.adapter.look import breadth, ribbon
from napari_splinesketch.plugin.adapter.pixels import block_on
from napari_splinesketch.plugin.adapter.planes import Planes
from napari_splinesketch.plugin.adapter.roles import Known, look_of
from napari_splinesketch.plugin.adapter.space import (
    frame_shape,
    in_stack,
    placement,
    placement_on,
)
from napari_splinesketch.plugin.records import Record

Proof = Literal["residual", "background", "body", "ribbon", "masks", "stack"]
DIVERGING = Colormap(["#0072b2", "#f7f7f7", "#d55e00"], name="residual")
"""Blue, white, vermilion: told apart by everybody; white where the model is right."""
TYPICAL = 0.995
"""Share of the residuals that the colours span."""
BODY = "body"
"""Name of the axis along which a stack has its bodies."""


class Proven(Known, Protocol):
    """What is known of an image, and what of it is looked at."""

    @property
    def chosen(self) -> Record | None:
        """The record whose body is shown alone."""
        ...


@dataclass(frozen=True, eq=False)
class Made:
    """Data of a layer, where they lie and how they look."""

    kind: type[Image] | type[Labels] | type[Shapes]
    data: Any
    place: dict[str, Any]
    look: dict[str, Any] = field(default_factory=dict)

    def layer(self, name: str, metadata: dict[str, Any]) -> Layer:
        """Make a layer."""
        how: dict[str, Any] = {**self.place, **self.look, "name": name, "metadata": metadata}
        if self.kind is Shapes:
            layer = Shapes(ndim=len(self.place["scale"]), **self.place, name=name)
            layer.metadata = metadata
            layer.add(self.data, **self.look)
            return layer
        kind: Any = self.kind
        return kind(self.data, multiscale=False, **how)

    def into(self, layer: Layer) -> bool:
        """Put the data into a layer that is there, as the user has it look; False if it cannot."""
        if isinstance(layer, Shapes) and self.kind is Shapes:
            layer.selected_data = set()
            layer.remove(list(range(layer.nshapes)))
            layer.add(self.data, **self.look)
            return True
        if not isinstance(layer, self.kind) or _shape(layer) != self.data.shape:
            return False
        layer.data = cast(Any, self.data)
        for name, value in self.place.items():
            setattr(layer, name, value)
        return True


def _shape(layer: Any) -> tuple[int, ...]:
    return layer.data.shape


@dataclass(frozen=True)
class Maker:
    """How a layer is made.

    Attributes
    ----------
    source
        Gives the values that the layer depends on: it stays as it is while they do.
    make
        Makes it, or None where there is nothing to show.
    """

    source: Callable[[Proven], tuple[Any, ...]]
    make: Callable[[Proven], Made | None]


def _patches(known: Proven) -> tuple[Any, ...]:
    return tuple(known.patches.values())


def _records(known: Proven) -> tuple[Any, ...]:
    return tuple(record.curve for record in known.records)


def _chosen(known: Proven) -> tuple[Any, ...]:
    chosen = known.chosen
    return (chosen.curve, known.patches.get(chosen.frame)) if chosen else ()


def _film(known: Proven, pictures: dict[int, Any], look: dict[str, Any]) -> Made:
    film = Film(pictures, frame_shape(known.image))
    return Made(Image, film, placement_on(known.image, film.grid.origin, film.grid.step), look)


def _residual(known: Proven) -> Made | None:
    if not known.patches:
        return None
    rests = {
        frame: Computed(patch.grid, patch.shape, partial(_rest, known.image, frame, patch))
        for frame, patch in known.patches.items()
    }
    last = np.abs(list(rests.values())[-1].pixels)
    last = last[np.isfinite(last)]
    most = float(np.quantile(last, TYPICAL)) if last.size else 0.0
    limits = (-most, most) if most else (-1.0, 1.0)
    return _film(known, rests, {"colormap": DIVERGING, "contrast_limits": limits})


def _rest(image: Image, frame: int, patch: Patch) -> Float[np.ndarray, "H W"]:
    """Image minus reconstruction; NaN where the image has other pixels by now."""
    block = block_on(image, frame, patch.grid, patch.shape)
    return np.full(patch.shape, np.nan) if block is None else block.read() - patch.pixels


def _background(known: Proven) -> Made | None:
    pictures = {
        frame: Patch(patch.grid, patch.background)
        for frame, patch in known.patches.items()
        if patch.background is not None
    }
    return _film(known, pictures, look_of(known.image)) if pictures else None


def _body(known: Proven) -> Made | None:
    chosen = known.chosen
    patch = known.patches.get(chosen.frame) if chosen else None
    if chosen is None or patch is None:
        return None
    others = [r.curve for r in known.records if r.frame == chosen.frame and r is not chosen]
    drawn = Computed(patch.grid, patch.shape, partial(alone, patch, chosen.curve, others))
    return _film(known, {chosen.frame: drawn}, look_of(known.image))


def _ribbon(known: Proven) -> Made | None:
    drawn = [(record.frame, ribbon(record.curve)) for record in known.records]
    lines = [in_stack(known.image, frame, line) for frame, line in drawn if line is not None]
    if not lines:
        return None
    width = 0.4 * breadth([record.curve for record in known.records])
    look = {"edge_color": palette.UNCERTAIN, "edge_width": width, "face_color": "transparent"}
    return Made(Shapes, lines, placement(known.image), {"shape_type": "path", **look})


def _masks(known: Proven) -> Made | None:
    """Label image of each frame: a pixel's value is the number of its curve."""
    size = _size(known.image)
    frames: dict[int, list[Label]] = {}
    for record in known.records:
        frames.setdefault(record.frame, []).append(_label(record))

    def plane(frame: int) -> Integer[np.ndarray, "H W"]:
        image = label_image(frames.get(frame, []), size)
        # Files count from 0, and so leave 1 for the first.
        return np.where(image > 0, image - 1, 0)

    shape = (*frame_shape(known.image), *size)
    return Made(Labels, Planes(shape, np.int32, plane), placement(known.image))


def _stack(known: Proven) -> Made | None:
    """One mask for each curve, along an axis of their own: overlaps are kept."""
    size, leading = _size(known.image), frame_shape(known.image)
    count = int(np.prod(leading))
    numbers = sorted({record.id for record in known.records})
    if not numbers:
        return None
    records = {(record.id, record.frame): record for record in known.records}

    def plane(index: int) -> Integer[np.ndarray, "H W"]:
        number, frame = numbers[index // count], index % count
        mask = np.zeros(size, np.int32)
        record = records.get((number, frame))
        patch = rasterise(_label(record), size) if record else None
        if patch is not None:
            mask[patch.place][patch.inside] = number
        return mask

    shape = (len(numbers), *leading, *size)
    return Made(Labels, Planes(shape, np.int32, plane), _placement_of_stack(known.image))


def _placement_of_stack(image: Image) -> dict[str, Any]:
    """Lie on the image, with one more axis in front."""
    own = Affine(
        scale=image.scale, translate=image.translate, rotate=image.rotate, shear=image.shear
    ).expand_dims([0])
    return {
        "scale": own.scale,
        "translate": own.translate,
        "rotate": own.rotate,
        "shear": own.shear,
        "affine": image.affine.expand_dims([0]),
        "units": ("pixel", *image.units),
        "axis_labels": (BODY, *image.axis_labels),
    }


def _label(record: Record) -> Label:
    return Label.from_curve(record.curve, frame=record.frame, identity=record.id)


def _size(image: Image) -> tuple[int, int]:
    height, width = image.level_shapes[0][image.ndim - 2 : image.ndim]
    return int(height), int(width)


MAKERS: dict[Proof, Maker] = {
    "residual": Maker(_patches, _residual),
    "background": Maker(_patches, _background),
    "body": Maker(_chosen, _body),
    "ribbon": Maker(_records, _ribbon),
    "masks": Maker(_records, _masks),
    "stack": Maker(_records, _stack),
}

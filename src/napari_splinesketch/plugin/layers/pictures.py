"""Layers of what the model says: reconstruction, residual, background, uncertainty, masks.

All but the reconstruction are made when the user asks for them, and follow what is known while
they are in view.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal, NamedTuple

import numpy as np
from jaxtyping import Float, Integer
from napari.components import ViewerModel
from napari.layers import Image, Labels, Layer, Vectors
from napari.utils.colormaps import Colormap
from napari.utils.transforms import Affine
from psygnal import Signal

from napari_splinesketch import palette
from napari_splinesketch.engine.types import Curve
from napari_splinesketch.plugin.layers.looks import breadth, ribbon, vectors
from napari_splinesketch.plugin.layers.pixels import Film, Patch, Planes, block_on
from napari_splinesketch.plugin.layers.slot import Known, Slot
from napari_splinesketch.plugin.layers.space import (
    frame_shape,
    in_stack,
    placement,
    placement_on,
    size_of,
)
from napari_splinesketch.raster import Body, label_image, rasterise
from napari_splinesketch.raster import Patch as Touched

Proof = Literal["reconstruction", "residual", "background", "body", "ribbon", "masks", "stack"]
DIVERGING = Colormap(["#0072b2", "#f7f7f7", "#d55e00"], name="residual")
"""Blue, white, vermilion: told apart by everybody; white where the model is right."""
TYPICAL = 0.995
"""Share of the residuals that the colours span."""
BODY = "body"
"""Name of the axis along which a stack has its bodies."""
SOFT = 3.0
"""How far beyond its edge a body may be seen, px of the picture."""
BIN = 0.5
"""Width of the rings in which a body is taken to be equally bright, px."""


class Made(NamedTuple):
    """A kind of layer, its data, and where they lie, if not as the image does."""

    kind: type[Layer]
    data: Any
    place: dict[str, Any]
    look: dict[str, Any]


@dataclass(frozen=True)
class Maker:
    """What a layer is called, the values that it depends on, and what makes it of them.

    It stays as it is while they do; where nothing is made, there is nothing to show.

    Attributes
    ----------
    title, tip
        Its entry in the menu, and what that says.
    nothing
        Why there is nothing to show.
    """

    name: str
    source: Callable[[Known], Sequence[Any]]
    make: Callable[[Known], Made | None]
    title: str = ""
    tip: str = ""
    nothing: str = "There is nothing to show yet: refine first."


class ProofLayers:
    """The layers on one image that belong to an `owner`, whose name theirs begin with."""

    toggled = Signal()
    """A layer was made, shown or hidden."""

    def __init__(self, viewer: ViewerModel, owner: Known):
        self._viewer, self._owner = viewer, owner
        self._sources: dict[Proof, Sequence[Any]] = {}
        self._slots = {
            proof: Slot(viewer, owner.image, proof, f"{owner.name} {maker.name}", owner)
            for proof, maker in MAKERS.items()
        }

    def layer(self, proof: Proof) -> Any:
        """Give a layer, or None where it was not asked for or the user removed it."""
        return self._slots[proof].layer

    def shown(self, proof: Proof) -> bool:
        """Whether a layer is in view."""
        layer = self.layer(proof)
        return layer is not None and layer.visible

    def ask(self, proof: Proof, on: bool) -> bool:
        """Show or hide a layer; False if there is nothing to show."""
        layer = self.layer(proof)
        if layer is not None:
            layer.visible = on
        elif on:
            self._update(proof)
        self.toggled.emit()
        return self.layer(proof) is not None or not on

    def show(self) -> Iterator[None]:
        """Bring the reconstruction, and the layers that are in view, in step with what is known."""
        for proof in MAKERS:
            if self._owner.image in self._viewer.layers:
                if proof == "reconstruction" or self.shown(proof):
                    self._update(proof)
                    yield

    def _update(self, proof: Proof) -> None:
        maker, slot, layer = MAKERS[proof], self._slots[proof], self.layer(proof)
        source, before = maker.source(self._owner), self._sources.get(proof, ())
        same = len(source) == len(before) and all(
            a is b for a, b in zip(source, before, strict=False)
        )
        if same and (layer is not None or proof == "reconstruction"):
            return
        self._sources[proof] = source
        made = maker.make(self._owner)
        if made is None:
            slot.remove()
        elif layer is None or (made.kind is not Vectors and layer.data.shape != made.data.shape):
            self._add(proof, made, layer)
        else:
            layer.data = made.data
            for name, value in (placement(self._owner.image) | made.place).items():
                setattr(layer, name, value)

    def _add(self, proof: Proof, made: Made, old: Layer | None) -> None:
        layers, slot = self._viewer.layers, self._slots[proof]
        at = layers.index(old or self._owner.image) + (old is None)
        visible = old.visible if old else proof != "reconstruction"
        slot.remove()
        how = made.place | made.look | {"visible": visible}
        if made.kind is Vectors:
            at = None if old is None else at
        else:
            how["multiscale"] = False
        layer = slot.make(made.kind, made.data, at=at, **how)
        if made.kind is Labels:
            layer.editable = False
        layer.events.visible.connect(self._on_visible)

    def _on_visible(self, event: Any) -> None:
        for _ in self.show():
            pass
        self.toggled.emit()


def _patches(known: Known) -> Sequence[Any]:
    return tuple(known.patches.values())


def _curves(known: Known) -> Sequence[Any]:
    return tuple(record.curve for record in known.records)


def _chosen(known: Known) -> Sequence[Any]:
    chosen = known.chosen
    return (chosen.curve, known.patches.get(chosen.frame)) if chosen else ()


def _like(image: Image) -> dict[str, Any]:
    """Give the keywords that make pictures in an image's own units look like it."""
    low, high = image.contrast_limits
    look = {} if image.rgb else {"colormap": image.colormap.name, "gamma": image.gamma}
    return look | {"contrast_limits": (float(low or 0), float(high or 0))}


def _film(known: Known, patches: Any, look: dict[str, Any], *make: Any) -> Made | None:
    if not patches:
        return None
    film = Film(patches, frame_shape(known.image), *make)
    return Made(Image, film, placement_on(known.image, film.grid.origin, film.grid.step), look)


def _reconstruction(known: Known) -> Made | None:
    return _film(known, known.patches, _like(known.image))


def _residual(known: Known) -> Made | None:
    def rest(frame: int, patch: Patch) -> Float[np.ndarray, "H W"]:
        """Image minus reconstruction; NaN where the image has other pixels by now."""
        shape = patch.pixels.shape
        block = block_on(known.image, frame, patch.grid, shape)
        return np.full(shape, np.nan) if block is None else block.read() - patch.pixels

    most = 0.0
    for frame, patch in list(known.patches.items())[-1:]:
        last = np.abs(rest(frame, patch))
        last = last[np.isfinite(last)]
        most = float(np.quantile(last, TYPICAL)) if last.size else 0.0
    look = {"colormap": DIVERGING, "contrast_limits": (-(most or 1.0), most or 1.0)}
    return _film(known, known.patches, look, rest)


def _background(known: Known) -> Made | None:
    known_here = {f: p for f, p in known.patches.items() if p.background is not None}
    return _film(known, known_here, _like(known.image), lambda frame, patch: patch.background)


def _body(known: Known) -> Made | None:
    chosen = known.chosen
    patch = known.patches.get(chosen.frame) if chosen else None
    if chosen is None or patch is None:
        return None
    others = [r.curve for r in known.records if r.frame == chosen.frame and r is not chosen]
    return _film(
        known,
        {chosen.frame: patch},
        _like(known.image),
        lambda frame, patch: alone(patch, chosen.curve, others),
    )


def _ribbon(known: Known) -> Made | None:
    drawn = [(record.frame, ribbon(record.curve)) for record in known.records]
    lines = [vectors(in_stack(known.image, f, line)) for f, line in drawn if line is not None]
    if not lines:
        return None
    width = 0.4 * breadth([record.curve for record in known.records])
    look = {"vector_style": "line", "edge_color": palette.UNCERTAIN, "edge_width": width}
    return Made(Vectors, np.concatenate(lines), {}, look)


def _masks(known: Known) -> Made | None:
    """Label image of each frame: a pixel's value is the number of its curve."""
    size = size_of(known.image)
    frames: dict[int, list[Body]] = {}
    for record in known.records:
        body = record.id, record.curve.points, record.curve.half_width
        frames.setdefault(record.frame, []).append(body)

    def plane(frame: int) -> Integer[np.ndarray, "H W"]:
        return label_image(frames.get(frame, []), size, np.int32)

    return Made(Labels, Planes((*frame_shape(known.image), *size), np.int32, plane), {}, {})


def _stack(known: Known) -> Made | None:
    """One mask for each curve, along an axis of their own: overlaps are kept."""
    size, leading = size_of(known.image), frame_shape(known.image)
    count = int(np.prod(leading))
    numbers = sorted({record.id for record in known.records})
    if not numbers:
        return None
    records = {(record.id, record.frame): record for record in known.records}

    def plane(index: int) -> Integer[np.ndarray, "H W"]:
        number, frame = numbers[index // count], index % count
        mask = np.zeros(size, np.int32)
        record = records.get((number, frame))
        if record:
            patch = rasterise(record.curve.points, record.curve.half_width, size)
            if patch is not None:
                mask[patch.place][patch.inside] = number
        return mask

    planes = Planes((len(numbers), *leading, *size), np.int32, plane)
    return Made(Labels, planes, _placement_of_stack(known.image), {})


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


MAKERS: dict[Proof, Maker] = {
    "reconstruction": Maker("reconstruction", _patches, _reconstruction),
    "residual": Maker("residual", _patches, _residual, "Residual",
                      "Image minus model: blue below, white right, orange above"),
    "background": Maker("background", _patches, _background, "Background",
                        "What the model has behind the bodies"),
    "body": Maker("selected body", _chosen, _body, "Selected body alone",
                  "The selected curve's body on the background",
                  "Select one curve first: its body is shown alone."),
    "ribbon": Maker("uncertainty", _curves, _ribbon, "Uncertainty",
                    "Lines at twice the standard error to both sides of each curve",
                    "No standard errors are known: the preset Paper gives none."),
    "masks": Maker("masks", _curves, _masks, "Masks",
                   "A Labels layer: pixels have their curve's number"),
    "stack": Maker("masks, one a body", _curves, _stack, "One mask for each body",
                   "A stack with a mask for each curve: overlaps are kept"),
}  # fmt: skip


def alone(patch: Patch, curve: Curve, others: Sequence[Curve]) -> Float[np.ndarray, "H W"]:
    """Draw one body of a reconstruction on its background; curves are in px of the image.

    Where it touches none of the others, it is what the reconstruction has. Where it does, it is as
    bright as elsewhere at the same depth below its edge.
    """
    background = np.zeros(patch.pixels.shape) if patch.background is None else patch.background
    picture = np.array(background, dtype=float)
    touched = _touched(patch, curve)
    if touched is None:
        return picture
    elsewhere = np.zeros(picture.shape, dtype=bool)
    for beside in map(partial(_touched, patch), others):
        if beside is not None:
            elsewhere[beside.place] |= beside.inside
    shared = elsewhere[touched.place]
    own = (patch.pixels - background)[touched.place]
    drawn = np.where(touched.inside, own, 0.0)
    both, only = touched.inside & shared, touched.inside & ~shared
    if both.any() and only.any():
        ring = np.floor(touched.depth[only] / BIN).astype(int)
        count = np.bincount(ring)
        mean = np.bincount(ring, own[only]) / np.maximum(count, 1)
        middle = (np.flatnonzero(count) + 0.5) * BIN
        drawn[both] = np.interp(touched.depth[both], middle, mean[count > 0])
    picture[touched.place] += drawn
    return picture


def _touched(patch: Patch, curve: Curve) -> Touched | None:
    """The pixels that a body may be seen in."""
    if curve.status == "failed" or not np.isfinite(curve.half_width).all():
        return None
    reach = curve.half_width / patch.grid.size + SOFT
    height, width = patch.pixels.shape
    return rasterise(patch.grid.to_block(curve.points), reach, (height, width))

"""Layers of ours that lie on an image: what each is made of, and how it follows what is known."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from time import perf_counter
from typing import TYPE_CHECKING, Any, NamedTuple
from weakref import WeakValueDictionary

import numpy as np
from napari.layers import Image, Labels, Layer, Points, Shapes, Vectors
from napari.utils.colormaps import Colormap
from napari.utils.colormaps.standardize_color import transform_color
from qtpy.QtCore import QTimer

from napari_splinesketch import grids, palette
from napari_splinesketch.engine.spline import fine
from napari_splinesketch.engine.types import Curve
from napari_splinesketch.plugin.columns import colours_of
from napari_splinesketch.plugin.layers import looks, space
from napari_splinesketch.plugin.layers.drawn import line_style
from napari_splinesketch.plugin.model import Line, Record, by_frame
from napari_splinesketch.raster import Body, label_image, labelling

if TYPE_CHECKING:
    from napari_splinesketch.plugin.layers.results import Work

ROLE, OWNER = "napari-splinesketch", "napari-splinesketch work"  # keys of a layer's metadata
SAMPLE = "napari-splinesketch sample"  # the prints of lines that come with a sample
OWNERS: WeakValueDictionary[str, Work] = WeakValueDictionary()  # by what metadata say
STEP_MS = 30  # between two steps of drawing results: time for the window to paint and to answer
AT_ONCE = 0.04  # of drawing, s: about what one step takes of it
FIRST_MS = 100  # before the first one: the change is seen in the dock, table and plots meanwhile
STYLES: dict[type[Layer], dict[str, Any]] = {
    # napari takes a picture three or four columns broad for colours.
    Image: {"rgb": False, "multiscale": False},
    Labels: {"multiscale": False},
    Vectors: {"vector_style": "line"},
    Points: {"size": 1, "face_color": "transparent", "border_color": "transparent"},
}
"""How layers of a kind look unless something else is said: points are there for their text."""
Film = Sequence[tuple[int, grids.Patch]]  # by frame
Pixels = Callable[[int, grids.Patch], grids.Picture]
DIVERGING = Colormap(["#0072b2", "#f7f7f7", "#d55e00"], name="residual")  # told apart by all
TYPICAL = 0.995  # share of the residuals that the colours span
THIN = 0.5  # breadth of outlines and halos, relative to a curve's line
HALO, MOVING = 2.0, transform_color(palette.MOVING)  # their breadth at least, px of the screen


def is_result(layer: Layer) -> bool:
    """Whether a layer shows results, and so is neither image nor sketches."""
    return ROLE in layer.metadata


class Made(NamedTuple):
    """What a layer shows, what goes with that and is set each time, and how it looks at first."""

    data: Any
    always: Mapping[str, Any] = {}
    look: Mapping[str, Any] = {}
    grid: grids.Grid | None = None  # of its pixels, where they are not the image's
    steps: Iterator[None] = iter(())  # to be taken before the data are read


@dataclass(frozen=True)
class Maker:
    """What a layer is made of; it stays as it is while its source does."""

    kind: type[Layer]
    name: str
    source: Callable[[Work], Sequence[Any]]
    make: Callable[[Work, Any], Made | None]
    title: str = ""  # in the menu, and then it is there only when asked for
    tip: str = ""
    nothing: str = "There is nothing to show yet: refine first."  # where None is made


class Slot:
    """The place of a layer that shows what its maker makes of a work; empty until it is made."""

    def __init__(self, role: str, maker: Maker, work: Work):
        self.maker, self.work = maker, work
        OWNERS[str(id(work))] = work
        named = {"name": f"{work.name} {maker.name}"} | STYLES.get(maker.kind, {})
        self._named = named | {"metadata": {ROLE: role, OWNER: str(id(work))}}
        self.veiled = False  # made, and not shown yet
        self.made: Layer | None = None  # the layer that we have made, and not taken away
        self._source: Sequence[Any] | None = None
        self._grid: grids.Grid | None = None  # of its pixels, where they are not the image's

    @property
    def layer(self) -> Any:
        """The layer, or None where there is none or the user has removed it."""
        return self.made if self.made in self.work.viewer.layers else None

    @property
    def unfit(self) -> bool:
        """Whether there is a layer, and it has other axes than the image has by now."""
        return self.layer is not None and self.layer.ndim != self.work.image.ndim

    def make(self, *data: Any, **how: Any) -> Any:
        """Make the layer: from data, or an empty one of some axes, to be filled by `update`."""
        image, layers, kind = self.work.image, self.work.viewer.layers, self.maker.kind
        layer = kind(*data, **space.placement(image, grid=self._grid) | self._named | how)
        # Pictures over the image, all else over everything.
        at = layers.index(image) + 1 if kind in (Image, Labels) else len(layers)
        # napari selects what is added: undone silently, as to tell of it twice takes as long again.
        chosen = set(layers.selection)
        with layers.selection.events.blocker_all():
            layers.insert(at, layer)
            layers.selection = chosen
        if kind in (Labels, Points, Shapes) and layer.metadata[ROLE] != "knots":
            # Results are not drawn into; napari allows it again after a view in 3-D.
            layer.events.editable.connect(lambda: _refuse(layer))
            _refuse(layer)
        layer.events.visible.connect(self.work.on_visible)
        self.made, self._source = layer, None
        return layer

    def update(self) -> Iterator[None]:
        """Bring it in step with what is known; takes steps where that is not what it shows."""
        layer, source = self.layer, self.maker.source(self.work)
        if source == self._source and (layer is not None or not self.maker.title):
            return
        made = self.maker.make(self.work, source)
        yield from made.steps if made else ()
        if self.layer is not layer:  # the user has removed it meanwhile
            return
        if made is None:
            self.remove()
        elif layer is None:
            self._grid = made.grid
            self.make(made.data, **{**made.always, "visible": False, **made.look})
        else:
            if self.maker.kind is Points:  # napari keeps the numbers of points that are gone
                layer.selected_data = set()
            layer.data, self._grid = made.data, made.grid
            if self.maker.kind is Vectors and not layer.visible:
                layer.set_view_slice()  # napari keeps the numbers of those that are gone here, too
            if made.grid is not None:
                self.place()
            for name, value in made.always.items():
                # napari draws everything again for a breadth, even for the same.
                if not (isinstance(value, float) and np.all(getattr(layer, name) == value)):
                    setattr(layer, name, value)
        self._source = source
        yield

    def place(self) -> bool:
        """Lay the layer where the image lies by now; say whether it has lain elsewhere."""
        layer = self.layer
        if layer is None or self.unfit:
            return False
        return space.place(layer, self.work.image, self._grid)

    def remove(self) -> None:
        """Take the layer away, if it is there."""
        if self.layer is not None:
            self.work.viewer.layers.remove(self.layer)
        self.made = self._source = None


class Drawing:
    """Changes layers in many short steps, its `runs`; the window lives in between."""

    def __init__(self, failed: Callable[[Exception], None]):
        self._failed = failed
        self.runs: dict[Hashable, tuple[Iterator[object], list[Any]]] = {}

    def start(
        self, key: Hashable, steps: Iterator[object], *last: Callable[[], None] | None
    ) -> None:
        """Take steps, in the place of others of the same key; then call `last`, also of those."""
        before = self.runs.get(key)
        self.runs[key] = steps, [*(before[1] if before else ()), *filter(None, last)]
        if not before:
            QTimer.singleShot(FIRST_MS, partial(self._go_on, key))

    def _go_on(self, key: Hashable) -> None:
        if key not in self.runs:
            return
        try:
            next(self.runs[key][0])
        except StopIteration:
            for last in self.runs.pop(key)[1]:
                last()
        except Exception as error:
            self.runs.pop(key, None)
            self._failed(error)
        else:
            QTimer.singleShot(STEP_MS, partial(self._go_on, key))


def _some_at_once(steps: Iterator[object]) -> Iterator[None]:
    """Take steps, as many at once as one turn of the window has time for."""
    end = 0.0
    for _ in steps:
        if perf_counter() > end:
            yield
            end = perf_counter() + AT_ONCE
    yield


def _refuse(layer: Layer) -> None:
    """Let nothing be drawn into a layer, silently: layers that are linked with it would follow."""
    with layer.events.editable.blocker():
        layer.editable = False


def _patches(work: Work) -> Film:
    frames = space.frame_count(work.image)  # a film may have been cut short
    return [(frame, patch) for frame, patch in work.state.patches.items() if frame < frames]


def _curves(work: Work) -> list[Any]:
    return [record.curve for record in work.records]


def _film(work: Work, patches: Film, *make: Pixels, **look: Any) -> Made | None:
    image = work.image
    if not patches:
        return None
    film, grid = grids.film_of(dict(patches), space.frame_shape(image), *make)
    if not look:
        low, high = image.contrast_limits
        look = {} if image.rgb else {"colormap": image.colormap.name, "gamma": image.gamma}
        look["contrast_limits"] = (float(low or 0), float(high or 0))
    return Made(film, {}, look, grid)


def _rest(image: Image, frame: int, patch: grids.Patch) -> grids.Picture:
    """Image minus reconstruction; NaN where the image has other pixels by now."""
    block = space.block_on(image, frame, patch.grid, patch.pixels.shape)
    return np.full(patch.pixels.shape, np.nan) if block is None else block.read() - patch.pixels


def _residual(work: Work, patches: Film) -> Made | None:
    rest = partial(_rest, work.image)
    last = np.array([np.abs(rest(*known)) for known in patches[-1:]])
    last = last[np.isfinite(last)]
    most = (float(np.quantile(last, TYPICAL)) if last.size else 0.0) or 1.0
    return _film(work, patches, rest, colormap=DIVERGING, contrast_limits=(-most, most))


def _background(work: Work, patches: Film) -> Made | None:
    known = [(t, grids.Patch(p.grid, p.background)) for t, p in patches if p.background is not None]
    return _film(work, known)


def _lines(
    work: Work, lines: Sequence[tuple[int, Line]], colour: str | np.ndarray, width: float
) -> Made:
    """Show lines, each with its frame, px, as vectors: napari is slow at thousands of shapes."""
    if not lines:  # one that is not seen: in 3-D, napari cannot draw a layer of none
        axes = work.image.ndim
        return Made(np.eye(2, axes, axes - 1)[None, ::-1], {"edge_width": 0.0})
    numbers, drawn = zip(*lines, strict=True)
    counts = np.array(list(map(len, drawn)))
    frames = np.repeat(numbers, counts).tolist()
    points = space.in_stack(work.image, frames, np.concatenate(drawn))
    along = np.stack([points[:-1], np.diff(points, axis=0)], axis=1)
    pieces = np.delete(along, np.cumsum(counts)[:-1] - 1, axis=0)  # from one line to the next
    if isinstance(colour, str):
        return Made(pieces, {}, {"edge_color": colour, "edge_width": width})
    colours = np.repeat(colour, counts - 1, axis=0)
    return Made(pieces, {"edge_width": width, "edge_color": colours})


def _ribbon(work: Work, curves: list[Curve]) -> Made | None:
    drawn = [(record.frame, looks.ribbon(record.curve)) for record in work.records]
    lines = [(frame, line) for frame, line in drawn if line is not None]
    return _lines(work, lines, palette.UNCERTAIN, 0.4 * looks.breadth(curves)) if lines else None


def _outlines(work: Work, _: object) -> Made:
    known = [record for record in work.records if looks.has_outline(record.curve)]
    lines = [(record.frame, looks.outline(record.curve)) for record in known]
    width = THIN * looks.breadth([record.curve for record in known])
    return _lines(work, lines, colours_of(known, work.look), width)


def _halos(work: Work, _: object) -> Made:
    """Lines outside the selected bodies: napari marks them in some of its tools only."""
    curves = [record.curve for record in work.selected]
    gap, breadth = looks.gap(curves, work.screen), looks.breadth(curves)
    drawn = looks.coarse([looks.halo(curve, gap) for curve in curves])
    lines = [(record.frame, line) for record, line in zip(work.selected, drawn, strict=True)]
    width = max(THIN * breadth, HALO * work.screen)
    return _lines(work, lines, np.tile(MOVING, (len(lines), 1)), width)


def _in_view(work: Work) -> list[Any]:
    found = looks.readable(work.records, space.view_of(work.viewer, work.image))
    return [(record, tuple(place.tolist())) for record, place in found]


def _marks(work: Work, marked: list[tuple[Record, tuple[float, ...]]]) -> Made:
    places = np.array([place for _, place in marked]).reshape(-1, 2)
    text = {
        "string": [looks.mark_of(record) for record, _ in marked],
        "color": [palette.STATUS[record.curve.status] for record, _ in marked],
        "size": 10,
        "anchor": "center",
    }
    frame = marked[0][0].frame if marked else 0
    return Made(space.in_stack(work.image, frame, places), {"text": text})


def _moving(work: Work, _: object) -> Made | None:
    """Lines that are not there yet; hidden at first, as to add a layer takes long enough."""
    style = line_style(space.size_of(work.image))
    made = _lines(work, work.moving, palette.MOVING, style["edge_width"])
    return Made(made.data, look={**made.look, "visible": True}) if work.moving else None


def _masked(work: Work) -> list[Record]:
    return [record for record in work.records if record.review != "rejected"]  # as Export does


def _masks(work: Work, _: object) -> Made:
    size, records = space.size_of(work.image), by_frame(_masked(work))
    here, plane = space.current_frame(work.viewer, work.image), np.zeros(size, np.int32)

    def bodies(frame: int) -> list[Body]:
        known = ((r.id, fine(r.curve)) for r in records.get(frame, ()))
        return [(number, curve.points, curve.half_width) for number, curve in known]

    def mask(frame: int) -> grids.Picture:
        return plane if frame == here else label_image(bodies(frame), size, np.int32)

    planes = grids.Planes((*space.frame_shape(work.image), *size), np.int32, mask)
    return Made(planes, steps=_some_at_once(labelling(bodies(here), plane)))


MAKERS: dict[str, Maker] = {
    "reconstruction": Maker(Image, "reconstruction", _patches, _film),
    # Lines of their own, some at a time.
    "curves": Maker(Shapes, "curves", _curves, lambda work, curves: None),
    "outlines": Maker(Vectors, "outlines",
                      lambda work: [work.look, *_curves(work)], _outlines),
    "selected": Maker(Vectors, "selected",
                      lambda work: [(r.curve, work.screen) for r in work.selected], _halos),
    "marks": Maker(Points, "marks", _in_view, _marks),
    "preview": Maker(Vectors, "on the way", lambda work: [id(work.moving)], _moving),
    "residual": Maker(Image, "residual", _patches, _residual, "Residual",
                      "Image minus model: blue below, white right, orange above"),
    "background": Maker(Image, "background", _patches, _background, "Background",
                        "What the model has behind the bodies"),
    "ribbon": Maker(Vectors, "uncertainty", _curves, _ribbon, "Uncertainty",
                    "Lines at twice the standard error to both sides of each curve",
                    "No standard errors are known: failed curves and Paper's have none."),
    "masks": Maker(Labels, "masks", lambda work: [r.curve for r in _masked(work)], _masks, "Masks",
                   "A Labels layer: pixels have their curve's number; without rejected curves"),
}  # fmt: skip
ASKED = [role for role, maker in MAKERS.items() if maker.title]  # only when the user asks


def residual_along(image: Image, patch: grids.Patch, record: Record) -> grids.Along | None:
    """Average image minus reconstruction across a body; None where the image is not there."""
    points = patch.grid.to_block(record.curve.points)
    half_width = record.curve.half_width / patch.grid.size
    places = grids.across(points, half_width)
    low = np.clip(np.floor(places.min((0, 1))).astype(int), 0, patch.pixels.shape)
    high = np.clip(np.ceil(places.max((0, 1))).astype(int) + 1, 0, patch.pixels.shape)
    grid = grids.Grid(patch.grid.to_image(low), patch.grid.step)
    rest = _rest(image, record.frame, grids.Patch(grid, patch.pixels[grids.slices(low, high)]))
    return None if np.isnan(rest).all() else grids.mean_across(rest, points - low, half_width)

"""The curves of an image, and the layers that show them."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from functools import partial
from itertools import chain
from typing import Any

import numpy as np
from napari.components import ViewerModel
from napari.layers import Image, Shapes
from superqt.utils import qthrottled

from napari_splinesketch.engine.spline import fine
from napari_splinesketch.engine.types import Curve
from napari_splinesketch.geometry import thinned
from napari_splinesketch.plugin import choices, columns, model, sessions
from napari_splinesketch.plugin.layers import drawn, looks, space
from napari_splinesketch.plugin.layers.pictures import ASKED, MAKERS, SAMPLE, Slot

WORKS = "_splinesketch_works"
"""Attribute of sketches: what is known through them, whichever dock looks after it. It is not in
their metadata, which other plugins may write to files."""
ORIGIN = "_splinesketch_origin"  # attribute of sketches: of the image that they were drawn on
OVER = ("outlines", "curves", "selected", "marks")
"""The layers over all others, from below to above. The halos of those selected have one of their
own: to change one shape, napari draws the whole layer of shapes again."""
ERASE = ("Delete", "Backspace", "3")  # with which napari deletes shapes
AFTER_MS = 120  # marks, halos and breadths follow the camera when it has stood still for so long


class CurveLines(Slot):
    """A line for each curve: those of curves that are gone go, and new ones come."""

    _shown: Sequence[model.Record] = ()  # in the order of the layer, unless that was made since
    _untold = False  # its features are not those of what is shown: others took the place of steps

    def update(self) -> Iterator[None]:
        """Bring it in step with what is known; some lines come at each step."""
        layer, records, look = self.layer, self.work.records, self.work.look
        wanted = {record.curve: record for record in records}
        before = self._shown if layer.nshapes == len(self._shown) else ()
        there = {record.curve for record in before}
        kept = [i for i, record in enumerate(before) if record.curve in wanted]
        if gone := set(range(layer.nshapes)).difference(kept):
            layer.selected_data = set()
            layer.remove(sorted(gone))
        self._shown = [before[i] for i in kept]
        fresh = [record for record in records if record.curve not in there]
        self._untold |= bool(gone or fresh)
        curves = [record.curve for record in fresh]
        image = self.work.image
        beside = columns.beside_of(records, space.times_of(image))
        # Worked out when they are added.
        chunks = (curves[i : i + drawn.CHUNK] for i in range(0, len(curves), drawn.CHUNK))
        lines = (
            line for some in chunks for line in thinned([fine(curve).points for curve in some])
        )
        pairs = zip(fresh, lines, strict=True)
        shapes = (space.in_stack(image, record.frame, line) for record, line in pairs)
        how = {"edge_color": columns.colours_of(fresh, look), "face_color": "transparent"}
        how["edge_width"] = self._breadths(curves)
        for done in drawn.add_shapes(layer, shapes, ["path"] * len(fresh), **how):
            self._shown = [*self._shown, *fresh[done]]
            # A few are worked out at a time: below, and for outlines, all are asked for.
            columns.rows_of(fresh[done], beside=beside)
            for curve in filter(looks.has_outline, curves[done]):
                looks.outline(curve)
            yield
        known = [wanted[record.curve] for record in self._shown]
        if self._untold or known != self._shown or layer.features.empty:
            layer.features = columns.as_table(columns.rows_of(known, beside=beside))
            self._shown, self._untold = known, False
        colours = columns.colours_of(known, look)
        if not np.allclose(layer.edge_color, colours):
            layer.edge_color = colours
        self.broaden()
        yield

    def broaden(self) -> None:
        """Keep the lines as broad as the eye needs: their breadth is in pixels of the image."""
        layer, curves = self.layer, [record.curve for record in self._shown]
        if layer is None or layer.nshapes != len(curves):
            return
        wanted = self._breadths(curves)
        if not np.allclose(layer.edge_width, wanted):
            layer.edge_width = wanted
            layer.events.edge_width()  # napari does not tell of it by itself

    def _breadths(self, curves: Sequence[Curve]) -> list[float]:
        every = [record.curve for record in self.work.records]
        unit = looks.breadth(every, self.work.screen)
        return [unit * looks.BREADTHS[curve.status] for curve in curves]


def origin_of(image: Image) -> Any:
    """Give the file or the sample that an image comes from; None where that is not known."""
    return image.source.path or image.source.sample


@model.once
def _within(state: model.State, frames: int) -> tuple[model.Record, ...]:
    return tuple([record for record in state.records if record.frame < frames])


class Work:
    """The curves of an image, how they came about, and the layers that show them.

    Layers of results come with the first of them; suggested lines are among the sketches. One dock
    listens to `changes`, and so hears what the user does in the layers.
    """

    def __init__(self, image: Image, sketches: Shapes, viewer: ViewerModel):
        self.image, self.sketches, self.viewer = image, sketches, viewer
        self.changes, self.folder = model.Changes(), sessions.Folder()  # where it is saved
        self.look: columns.Look = ("status", space.Ruler())  # what the colours of curves say
        self.slots = {role: Slot(role, maker, self) for role, maker in MAKERS.items()}
        self.slots["curves"] = self._lines = CurveLines("curves", MAKERS["curves"], self)
        self.behind = False  # not all is shown: napari cannot add flat shapes to a view in 3-D
        self._moved = False  # the image, since the layers were laid on it
        self._soon = qthrottled(self._look, AFTER_MS, leading=False)
        placed = [getattr(image.events, name) for name in choices.PLACED]
        for moved in (viewer.scene.camera.events, viewer.dims.events.current_step, *placed):
            moved.connect(self._on_move)
        self.begin(sketches)

    def begin(self, sketches: Shapes) -> None:
        """Know nothing yet; layers that show results of sketches that are gone are taken over."""
        self.sketches = sketches
        self.selection: tuple[model.Key, ...] = ()  # some of them may be gone
        self.history: model.History[model.State] = model.History(model.State(), model.bytes_beside)
        self.moving: list[tuple[int, model.Line]] = []
        self.suggested: dict[model.Marked, np.ndarray] = {}  # as they were drawn
        for slot in self.slots.values():
            slot.made = slot.layer
        vars(sketches).setdefault(WORKS, []).append(self)
        vars(sketches).setdefault(ORIGIN, origin_of(self.image))

    @property
    def begun(self) -> bool:
        """Whether there is something to save, or to say that it is gone."""
        if self.folder.path or self.state.records:
            return True
        # Lines alone are work on the image that they were drawn on; a sample's are nobody's.
        mine = vars(self.sketches)[ORIGIN] in (None, origin_of(self.image))
        lines = model.prints_of(self.sketches.data)
        new = [line.hex() for line in lines] not in ([], self.sketches.metadata.get(SAMPLE))
        return new and (mine or vars(self.sketches)[WORKS] == [self])

    @property
    def name(self) -> str:
        """What names of layers begin with."""
        return self.sketches.name.removesuffix(drawn.SUFFIX)

    @property
    def screen(self) -> float:
        """What a pixel of the screen covers, px of the image, in steps."""
        return looks.stepped(float(space.screen_pixel(self.viewer, self.image).mean()))

    @property
    def state(self) -> model.State:
        """What is known now."""
        return self.history.value

    @property
    def records(self) -> tuple[model.Record, ...]:
        """The curves of all frames that the image has: a film may have been cut short."""
        return _within(self.state, space.frame_count(self.image))

    @property
    def selected(self) -> tuple[model.Record, ...]:
        """The curves that are selected."""
        known, frames = self.state.by_key, space.frame_count(self.image)
        return tuple(known[key] for key in self.selection if key in known and key[0] < frames)

    def layer(self, role: str) -> Any:
        """Give the layer of a role, or None where there is none or the user removed it."""
        return self.sketches if role == "sketches" else self.slots[role].layer

    def remove(self) -> None:
        """Remove the layers of results; they are made again when there is something to show."""
        for slot in self.slots.values():
            slot.remove()

    def ask(self, role: str) -> Iterator[None]:
        """Show a layer that the user asks for, if there is something to show, a step at a time."""
        steps = iter(()) if (slot := self.slots[role]).unfit else slot.update()
        while self.image in self.viewer.layers and next(steps, steps) is not steps:
            yield
        if slot.layer is not None:
            slot.layer.visible = True

    def show(self) -> Iterator[object]:
        """Bring the layers in step with what is known by then, a little at each step.

        napari takes 0.1 s to add a layer and to draw it first, and longer beside full ones: the
        window may live in between, and layers are added before any is filled.
        """
        steps = chain[object](self._suggest(), self._add(), self._follow(), self._fade())
        while self.image in self.viewer.layers:
            self.behind = self.viewer.dims.ndisplay > self.image.ndim
            if self.behind or next(steps, steps) is steps:
                return
            yield

    def _follow(self, *roles: str) -> Iterator[None]:
        """Let layers follow what is known; where roles are named, those of them in view."""
        for role in roles or self.slots:
            slot = self.slots[role]
            if slot.unfit:
                continue
            shown = slot.layer is not None and slot.layer.visible
            # Marks that are hidden wait: napari fails over the text of points that it hides.
            waits = roles or slot.maker.title or role == "marks"
            always = not waits and (slot.layer or role not in OVER)
            if (shown or always) and self.image in self.viewer.layers:
                yield from slot.update()

    def _update(self, *roles: str) -> None:
        for _ in self._follow(*roles):
            pass

    def move(self, frame: int = 0, lines: Sequence[model.Line] = ()) -> None:
        """Show lines of a frame that are on their way, px; none once they have arrived."""
        slot = self.slots["preview"]
        if not lines or slot.layer is not None or slot.made is None:  # the user has not removed it
            there = frame < space.frame_count(self.image)
            self.moving = [(frame, line) for line in looks.coarse(lines) if there]
            next(slot.update(), None)

    def deleted(self) -> bool:
        """Whether the user has removed the layer of curves, and so the results."""
        return self.slots["curves"].made is not None and self.layer("curves") is None

    def select(self, keys: tuple[model.Key, ...]) -> None:
        """Select curves."""
        if keys != self.selection:
            self.selection = keys
            self._update("selected")
            self.changes.selection.emit()

    def _add(self) -> Iterator[None]:
        """Add the layers that are not there, hidden; each is drawn once while it is empty."""
        for slot in [slot for slot in self.slots.values() if slot.unfit]:
            slot.remove()
        for role in OVER if self.records else ():
            slot = self.slots[role]
            if slot.layer is None:
                layer = slot.make(visible=False, ndim=self.image.ndim)
                if role == "curves":
                    layer.mouse_drag_callbacks.append(self._on_press)
                    for key in ERASE:
                        layer.bind_key(key, lambda _: self.changes.erased.emit(), overwrite=True)
                    for key in ("A", "Control-A"):  # napari's own select shapes, not curves
                        layer.bind_key(key, lambda _: self._select_all(), overwrite=True)
                slot.veiled = True  # until it is shown, in these steps or in later ones
                yield
                if role == "marks":  # to write text and to draw it first takes 0.1 s each
                    yield from slot.update()
            if slot.veiled and slot.layer is not None:
                slot.veiled, slot.layer.visible = False, True
                yield

    def positions(self, marked: Collection[model.Marked]) -> list[int]:
        """Say where among the sketches lines are that were suggested, and not touched."""
        prints = {self.suggested[one].tobytes() for one in marked if one in self.suggested}
        data = self.sketches.data if prints else ()
        return [i for i, shape in enumerate(data) if np.float32(shape).tobytes() in prints]

    def as_read(self, frame: int, lines: Sequence[model.Line]) -> list[model.Line]:
        """Give lines of a frame, px, as they are read from the sketches once they are there."""
        read = partial(space.to_pixels, self.viewer, self.sketches, self.image)
        there = self._as_drawn([(frame, line) for line in lines])
        return [line[:, -2:] for line in model.changed(there, read)]

    def _as_drawn(self, lines: Sequence[tuple[int, model.Line]]) -> list[np.ndarray]:
        """Take lines, each with its frame, px, to the sketches' data, of single precision."""
        places = [space.in_stack(self.image, frame, line) for frame, line in lines]
        place = partial(space.to_pixels, self.viewer, self.image, self.sketches)
        return model.changed(places, lambda points: place(points).astype(np.float32))

    def touched(self) -> set[model.Marked]:
        """Say which of the suggested lines were drawn, and are there no longer as they were."""
        data = {np.float32(shape).tobytes() for shape in self.sketches.data}
        return {one for one, line in self.suggested.items() if line.tobytes() not in data}

    def _suggest(self) -> Iterator[object]:
        layer, wanted = self.sketches, self.state.suggestions
        gone = self.suggested.keys() - wanted
        # Those that the user has moved or deleted are remembered: they do not come back.
        if gone and (gone := gone - self.touched()):
            layer.remove([])  # ends what is being drawn, by its number that is soon another's
        old = self.positions(gone)
        for one in gone:
            del self.suggested[one]
        if old:
            layer.selected_data = set()
            layer.remove(old)
            yield
        if fresh := [one for one in wanted if one not in self.suggested]:
            shapes = self._as_drawn([(one[0], wanted[one]) for one in fresh])
            style = drawn.line_style(space.size_of(self.image))
            for done in drawn.add_shapes(layer, shapes, ["path"] * len(shapes), **style):
                # Only these: other steps may take the place of those that are left.
                self.suggested |= dict(zip(fresh[done], shapes[done], strict=True))
                yield

    def _fade(self) -> Iterator[None]:
        """Let the lines that have become curves step back behind them, and no others."""
        yield
        layer = self.sketches
        if not layer.nshapes:
            return
        refined = {(r.frame, model.print_of_sketch(r)) for r in self.records if r.drawn}
        frames, lines = zip(*drawn.shapes_in(self.viewer, layer, self.image), strict=True)
        back = [pair in refined for pair in zip(frames, model.prints_of(lines), strict=True)]
        # napari keeps the colour of a path that is given up.
        colours = np.array(layer.edge_color[: layer.nshapes])
        before, wanted = np.round(colours[:, 3], 3), np.where(back, drawn.FADED, 1.0)
        # A transparency that the user has chosen stays.
        changed = np.isin(before, (1.0, drawn.FADED)) & (wanted != before)
        if changed.any():
            colours[changed, 3] = wanted[changed]
            layer.edge_color = colours

    def _on_move(self, event: Any) -> None:
        self._moved |= event.type in choices.PLACED
        self._soon()

    def _look(self) -> None:
        """Let the layers follow the image, and what depends on the camera follow that."""
        moved, self._moved = self._moved, False
        if moved and [slot for slot in self.slots.values() if slot.place()]:
            self.changes.curves.emit()  # for their lengths, in its unit
        self._update("marks", "selected")
        self._lines.broaden()

    def on_visible(self, event: Any) -> None:
        """Follow the eye of a layer: halos and marks go with their curves."""
        for mark in (self.layer("selected"), self.layer("marks")):
            if event.source is self.layer("curves") and mark is not None:
                mark.visible = event.source.visible
        self._update("marks", *[role for role in ASKED if event.source is self.layer(role)])
        self.changes.shown.emit()

    def _select_all(self) -> None:
        frame = space.current_frame(self.viewer, self.image)
        self.select(tuple([key for key in self.state.by_key if key[0] == frame]))

    def _on_press(self, layer: Shapes, event: Any) -> Iterator[None]:
        """Tell a click from a drag, where napari itself only moves the camera."""
        begin, shift, far = np.array(event.pos), "Shift" in event.modifiers, 0.0
        yield
        while event.type == "mouse_move":
            far = max(far, float(np.linalg.norm(np.array(event.pos) - begin)))
            yield
        if layer.mode == "pan_zoom" and far < drawn.CLICK:
            self.changes.clicked.emit(shift)

"""What the user chose: settings, and the image and sketches worked on as layers come and go.

napari's own choice of layers would list results as well, and keep the first one where work goes on
in the latest.
"""

import gc
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import chain
from typing import Any, TypeVar

import pint
from napari.components import ViewerModel
from napari.layers import Image, Layer, Shapes
from napari.layers.base import ActionType
from napari.settings import get_plugin_settings

from napari_splinesketch.engine.settings import OFFERED, Asked
from napari_splinesketch.plugin.columns import COLOURED
from napari_splinesketch.plugin.layers.pictures import is_result
from napari_splinesketch.plugin.layers.space import Ruler
from napari_splinesketch.plugin.model import Changes

L = TypeVar("L", bound=Layer)
PLACED = ("data", "scale", "translate", "rotate", "shear", "affine", "units")
"""Events after which lines may lie elsewhere."""
LOOKED = ("point", "order", "ndisplay")  # of the sliders: something else is in view
PLUGIN = "napari-splinesketch"
KEYS = "keys"  # the group of settings with a key for each command
GROUPS = ("refining", "looking", "saving", KEYS)  # of settings, in the manifest


def listen(*pairs: tuple[Any, Callable[..., Any]]) -> Callable[[], None]:
    """Connect signals to slots; gives what ends that."""
    for signal, slot in pairs:
        signal.connect(slot)

    def end() -> None:
        for signal, slot in pairs:
            signal.disconnect(slot)

    return end


def _choice(kind: type[Layer]) -> Any:
    return property(lambda self: self.chosen(kind), lambda self, new: self.choose(kind, new))


class Choices:
    """The chosen layers: those added last, or the topmost of those left; never results."""

    image: Image | None = _choice(Image)
    sketches: Shapes | None = _choice(Shapes)

    def __init__(self, viewer: ViewerModel, changes: Changes):
        self._viewer, self._changes = viewer, changes
        self._chosen: dict[type[Layer], Layer | None] = {Image: None, Shapes: None}
        self._ends: dict[type[Layer], Callable[[], None]] = {}
        active = viewer.layers.selection.active
        for layer in (*viewer.layers, *([active] if active else [])):
            self._choose(layer)
        layers = viewer.layers.events
        self._end = listen(
            (layers.inserted, lambda event: self._choose(event.value)),
            (layers.removed, self._on_removed),
            (layers.reordered, lambda event: changes.layers.emit()),
            (layers.renamed, lambda event: changes.layers.emit()),
            *[(getattr(viewer.dims.events, name), self._on_edited) for name in LOOKED],
        )

    def close(self) -> None:
        """Follow the viewer no longer, and choose nothing."""
        self._end()
        for kind in self._chosen:
            self.choose(kind, None)

    def chosen(self, kind: type[L]) -> L | None:
        """Give the chosen layer of a kind."""
        layer: Any = self._chosen[kind]  # napari tells late that one is gone
        return layer if layer in self._viewer.layers else None

    def layers(self, kind: type[L]) -> list[L]:
        """Give the layers of a kind to choose from, topmost first."""
        layers = reversed(self._viewer.layers)
        return [layer for layer in layers if isinstance(layer, kind) and not is_result(layer)]

    def choose(self, kind: type[Layer], new: Layer | None) -> None:
        """Choose a layer of a kind, or none."""
        self._ends.pop(kind, lambda: None)()
        self._chosen[kind] = new
        if new is not None:
            events = [getattr(new.events, name) for name in PLACED]
            if isinstance(new, Shapes):
                events += [new.events.mode, new.selected_data.events.items_changed]
            self._ends[kind] = listen(*[(event, self._on_edited) for event in events])
        self._changes.layers.emit()

    def _choose(self, layer: Layer) -> None:
        for kind in self._chosen:
            if isinstance(layer, kind) and not is_result(layer):
                self.choose(kind, layer)

    def _on_removed(self, event: Any) -> None:
        if not is_result(event.value):
            gc.unfreeze()  # its pixels may be garbage among what the dock leaves out of the search
        for kind in self._chosen:
            if event.value is self._chosen[kind]:
                self.choose(kind, next(iter(self.layers(kind)), None))
        self._changes.layers.emit()

    def _on_edited(self, event: Any) -> None:
        self._changes.edited.emit()
        added = getattr(event, "action", None) == ActionType.ADDED
        if added and event.source is self._chosen[Shapes]:
            self._changes.drawn.emit()


@dataclass(frozen=True, kw_only=True)
class Settings(Asked):
    """What the user chose: how to refine, what to show of it, where to save; napari keeps it."""

    half_width: float | None = 0.0  # 0 measures it
    half_width_unit: str = "px"  # or the name of a unit
    colour_by: str = "status"
    save_work: bool = True
    work_folder: str = ""
    keys: Mapping[str, str] = field(default_factory=dict)  # of commands; "" is none

    def half_width_in(self, ruler: Ruler) -> float | None:
        """Give the half-width in px of an image; None to measure it."""
        if not self.half_width or self.half_width_unit == "px":
            return self.half_width or None
        given = pint.get_application_registry().Quantity(self.half_width, self.half_width_unit)
        if ruler.unit == "px" or not given.is_compatible_with(ruler.unit):
            return None  # it says nothing about pixels of this image
        return float(given.to(ruler.unit).magnitude) / ruler.pixel


POLARITIES = {"auto": "auto", "brighter than the rest": "bright", "darker than the rest": "dark"}
FORM: dict[str, dict[str, Any]] = {
    "preset": {"label": "Preset", "choices": [(name.capitalize(), name) for name in OFFERED],
               "tooltip": "Balanced: this engine, fast and accurate\n"
                          "Paper: the recipe of the published method; slow"},
    "polarity": {"label": "Bodies are", "choices": list(POLARITIES.items()),
                 "tooltip": "Whether bodies are brighter or darker than what is around them"},
    "colour_by": {"label": "Colour by", "choices": [(f"Colour by {column.colour}", name)
                                                   for name, column in COLOURED.items()],
                  "tooltip": "What colours show; the marks beside curves always show the status"},
    "half_width": {"label": "Half-width", "min": 0.0, "max": 1e4, "step": 0.5,
                   "tooltip": "Rough distance from a body's centreline to its edge"},
    "save_work": {"label": "Save work as I go",
                  "tooltip": "Save lines and curves as they are made"},
}  # fmt: skip
"""The settings that the dock shows, and how magicgui makes their widgets."""


def load() -> Settings:
    """Read what was chosen; what napari does not know has its default."""
    groups = _groups()
    keys = dict(groups.pop(KEYS, ()))
    return Settings(keys=keys, **dict(chain.from_iterable(groups.values())))


def save(settings: Settings) -> None:
    """Let napari keep what was chosen, but for the keys, which are chosen there."""
    for name, group in _groups().items():
        for each in type(group).model_fields if name != KEYS else ():
            setattr(group, each, getattr(settings, each))


def on_change(call: Callable[[], None]) -> Callable[[], None]:
    """Have something called when the user changes napari's preferences; gives what ends that."""
    return listen(*((group.events, lambda event: call()) for group in _groups().values()))


def _groups() -> dict[str, Any]:
    """Napari's settings of the plugin; none where it runs from a script without its manifest."""
    try:
        known = get_plugin_settings(PLUGIN)
    except KeyError:
        return {}
    return {name: getattr(known, name) for name in GROUPS}

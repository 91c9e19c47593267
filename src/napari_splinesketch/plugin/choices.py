"""What the user chose: how to refine, what to show, where to save; and who listens to what."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import chain
from typing import Any

import pint
from napari.settings import get_plugin_settings

from napari_splinesketch.engine.settings import OFFERED, Asked
from napari_splinesketch.plugin.columns import COLOURED
from napari_splinesketch.plugin.layers.space import Ruler

PLACED = ("data", "scale", "translate", "rotate", "shear", "affine", "units")
"""Events after which lines may lie elsewhere."""
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
        convert = pint.get_application_registry().convert
        if ruler.unit != "px":  # of the image: pint takes that for a length, 1/96 of an inch
            with suppress(Exception):  # whatever was typed in napari's preferences for a unit
                return convert(self.half_width, self.half_width_unit, ruler.unit) / ruler.pixel
        return None


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
    "half_width": {"label": "Half-width", "min": 0.0, "max": 1e9, "step": 0.5,
                   "tooltip": "Rough distance from a body's centreline to its edge"},
    "save_work": {"label": "Save work as I go",
                  "tooltip": "Save lines and curves as they are made"},
}  # fmt: skip
"""The settings that the dock shows, and how magicgui makes their widgets."""


def load() -> Settings:
    """Read what was chosen; what napari does not know has its default."""
    known = groups()
    keys = dict(known.pop(KEYS, ()))
    return Settings(keys=keys, **dict(chain.from_iterable(known.values())))


def save(settings: Settings) -> None:
    """Let napari keep what was chosen, but for the keys, which are chosen there."""
    for name, group in groups().items():
        for each in type(group).model_fields if name != KEYS else ():
            setattr(group, each, getattr(settings, each))


def groups() -> dict[str, Any]:
    """Give napari's settings of the plugin; none where a script runs it without its manifest."""
    try:
        known = get_plugin_settings(PLUGIN)
    except KeyError:
        return {}
    return {name: getattr(known, name) for name in GROUPS}

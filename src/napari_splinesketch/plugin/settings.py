"""What the user chose: one frozen class, which the form in the dock, napari and the engine read."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, get_args

import pint
from napari.settings import get_plugin_settings

from napari_splinesketch.engine.settings import PRESETS, Asked
from napari_splinesketch.engine.types import Polarity
from napari_splinesketch.plugin.choices import listen
from napari_splinesketch.plugin.columns import COLOUR_BY
from napari_splinesketch.plugin.layers.space import Ruler

PLUGIN = "napari-splinesketch"
GROUPS = "refining", "looking", "saving"
"""The groups of the manifest with settings that are one value each."""
KEYS = "keys"
"""The group with one key for each action."""


@dataclass(frozen=True, kw_only=True)
class Settings(Asked):
    """What the user chose: what may be asked of a refinement, and what is told of it.

    The unit of the half-width is its name, or "px". Keys are those of commands, by their ids, as
    napari writes them; an empty one takes the key away.
    """

    half_width_unit: str = "px"
    colour_by: str = "status"
    lengths_in_pixels: bool = field(
        default=False, metadata={"help": "give lengths in px although the image has a unit"}
    )
    save_work: bool = field(
        default=True, metadata={"help": "save lines and curves as they are made"}
    )
    work_folder: str = field(default="", metadata={"help": "empty: a folder beside the image"})
    keys: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Refuse what nobody can have chosen."""
        for name, allowed in (
            ("preset", PRESETS),
            ("polarity", get_args(Polarity)),
            ("colour_by", COLOUR_BY),
        ):
            if getattr(self, name) not in allowed:
                raise ValueError(f"{name} is {getattr(self, name)!r}; choose one of {allowed}.")
        if self.half_width is not None and not 0 < self.half_width < float("inf"):
            raise ValueError(f"half_width is {self.half_width}; give a number above 0, or none.")

    @property
    def saving(self) -> tuple[bool, str]:
        """Whether, and where."""
        return self.save_work, self.work_folder

    def half_width_in(self, ruler: Ruler) -> float | None:
        """Give the half-width in px of an image; None to measure it.

        One in a unit that says nothing about pixels of this image is left out.
        """
        if self.half_width is None:
            return None
        if self.half_width_unit == ruler.unit:
            return self.half_width / ruler.pixel
        if "px" in (ruler.unit, self.half_width_unit):
            return self.half_width if self.half_width_unit == "px" else None
        given = pint.get_application_registry().Quantity(self.half_width, self.half_width_unit)
        if not given.is_compatible_with(ruler.unit):
            return None
        return float(given.to(ruler.unit).magnitude) / ruler.pixel

    def without_doubles(self, before: "Settings") -> "Settings":
        """Take a key that was given to a command from the one that had it."""
        now, old = self.keys, before.keys
        given = {key for name, key in now.items() if key != old.get(name)} - {""}
        lost = {name: "" for name, key in now.items() if key in given and old.get(name) == key}
        return replace(self, keys={**now, **lost}) if lost else self


FORM: dict[str, dict[str, Any]] = {
    "preset": {"label": "Preset", "choices": [(name.capitalize(), name) for name in PRESETS]},
    "polarity": {
        "label": "Bodies are",
        "choices": [
            ("auto", "auto"),
            ("brighter than the rest", "bright"),
            ("darker than the rest", "dark"),
        ],
    },
    "half_width": {"label": "Half-width", "min": 0.0, "max": 1e4, "step": 0.5},
    "lengths_in_pixels": {"label": "Lengths in pixels"},
    "save_work": {"label": "Save work as I go"},
}
"""The settings that the dock shows, and how magicgui makes their widgets."""


def load() -> Settings:
    """Read what was chosen; what napari does not know has its default."""
    known = _napari()
    if known is None:
        return Settings()
    values = dict(pair for group in GROUPS for pair in getattr(known, group))
    values = {each.name: values[each.name] for each in fields(Settings) if each.name in values}
    values["half_width"] = values.get("half_width") or None
    keys = getattr(known, KEYS).model_dump()
    try:
        return Settings(**values, keys=keys)
    except ValueError:
        return Settings(keys=keys)


def save(settings: Settings) -> None:
    """Let napari keep what was chosen."""
    known = _napari()
    if known is None:
        return
    # napari's preferences know no number that is not there.
    chosen = vars(settings) | {"half_width": settings.half_width or 0.0}
    groups = dict.fromkeys(GROUPS, chosen) | {KEYS: settings.keys}
    for name, values in groups.items():
        group = getattr(known, name)
        for each in set(type(group).model_fields).intersection(values):
            if getattr(group, each) != values[each]:
                setattr(group, each, values[each])


def on_change(call: Callable[[], None]) -> Callable[[], None]:
    """Have something called when the user changes napari's preferences; gives what ends that."""
    known = _napari()
    groups = [getattr(known, group) for group in (*GROUPS, KEYS)] if known else []

    return listen(*((group.events, lambda event: call()) for group in groups))


def _napari() -> Any:
    """Napari's settings of the plugin; None where it runs from a script without its manifest."""
    try:
        return get_plugin_settings(PLUGIN)
    except KeyError:
        return None

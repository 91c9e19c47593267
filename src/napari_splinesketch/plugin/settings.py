"""What the user chose, kept across sessions by napari, and shown in its preferences too."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any, get_args

import pint
from napari.settings import get_plugin_settings

from napari_splinesketch.engine.settings import HELP, PRESETS, PresetName
from napari_splinesketch.engine.types import Polarity
from napari_splinesketch.plugin.columns import COLOUR_BY

PLUGIN = "napari-splinesketch"
PREFERENCES = "Opens napari's preferences: the keys are on the page of Splinesketch"
GROUPS = "refining", "looking", "saving"
"""The groups of the manifest with settings that are one value each."""
KEYS = "keys"
"""The group with one key for each action."""


def shown(label: str, tip: str, **options: Any) -> dict[str, Any]:
    """Let the form in the dock show a setting, with options for magicgui."""
    return {"label": label, "tip": tip, **options}


def _tip(name: str) -> str:
    """Say of an option what the command line says."""
    return HELP[name][0].upper() + HELP[name][1:]


@dataclass(frozen=True)
class Settings:
    """What the user chose.

    Attributes
    ----------
    preset
        How much work to do.
    polarity
        Whether bodies are brighter or darker than what is around them.
    half_width
        Rough distance from centreline to edge, in `half_width_unit`; 0 measures it.
    half_width_unit
        Name of a unit, or "px".
    colour_by
        What the colour of a curve says.
    lengths_in_pixels
        Whether lengths are told in px although the image has a unit.
    save_work
        Whether lines and curves are saved as they are made.
    work_folder
        Where; empty for a folder beside the image.
    keys
        Keys of actions, by their ids, as napari writes them; an empty one takes the key away.
    """

    preset: PresetName = "balanced"
    polarity: Polarity = field(
        default="auto",
        metadata=shown(
            "Bodies are",
            _tip("polarity"),
            choices=[
                ("auto", "auto"),
                ("brighter than the rest", "bright"),
                ("darker than the rest", "dark"),
            ],
            widget_type="ComboBox",
        ),
    )
    half_width: float = field(
        default=0.0,
        metadata=shown(
            "Half-width",
            _tip("half_width"),
            min=0.0,
            max=1e4,
            step=0.5,
        ),
    )
    half_width_unit: str = "px"
    colour_by: str = "status"
    lengths_in_pixels: bool = field(
        default=False,
        metadata=shown("Lengths in pixels", "Give lengths in px although the image has a unit"),
    )
    save_work: bool = field(
        default=True,
        metadata=shown("Save work as I go", "Save lines and curves as they are made"),
    )
    work_folder: str = ""
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
        if not 0 <= self.half_width < float("inf"):
            raise ValueError(f"half_width is {self.half_width}; give a number above 0, or 0.")

    @property
    def saving(self) -> tuple[bool, str]:
        """Whether, and where."""
        return self.save_work, self.work_folder

    def half_width_in(self, unit: str, pixel: float) -> float | None:
        """Give the half-width in px; None to measure it.

        Parameters
        ----------
        unit
            The image's unit, or "px".
        pixel
            Size of a pixel in it. A half-width in a unit that says nothing about pixels of this
            image is left out.
        """
        if not self.half_width:
            return None
        if self.half_width_unit == unit:
            return self.half_width / pixel
        if "px" in (unit, self.half_width_unit):
            return self.half_width if self.half_width_unit == "px" else None
        registry = pint.get_application_registry()
        given = registry.Quantity(self.half_width, self.half_width_unit)
        return float(given.to(unit).magnitude) / pixel if given.is_compatible_with(unit) else None


def load() -> Settings:
    """Read what was chosen; what napari does not know has its default."""
    known = _napari()
    if known is None:
        return Settings()
    values = dict(pair for group in GROUPS for pair in getattr(known, group))
    values = {each.name: values[each.name] for each in fields(Settings) if each.name in values}
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
    groups = {group: vars(settings) for group in GROUPS} | {KEYS: settings.keys}
    for name, values in groups.items():
        group = getattr(known, name)
        for each in set(type(group).model_fields).intersection(values):
            if getattr(group, each) != values[each]:
                setattr(group, each, values[each])


def on_change(call: Callable[[], None]) -> Callable[[], None]:
    """Have something called when the user changes napari's preferences; gives what ends that."""
    known = _napari()
    groups = [getattr(known, group) for group in (*GROUPS, KEYS)] if known else []

    def changed(event: Any) -> None:
        call()

    for group in groups:
        group.events.connect(changed)

    def end() -> None:
        for group in groups:
            group.events.disconnect(changed)

    return end


def _napari() -> Any:
    """Napari's settings of the plugin; None where it runs from a script without its manifest."""
    try:
        return get_plugin_settings(PLUGIN)
    except KeyError:
        return None

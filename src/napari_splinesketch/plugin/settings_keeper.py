"""What the user chose, and what follows from it."""

from dataclasses import replace

from napari.components import ViewerModel
from napari.layers import Image

from napari_splinesketch.engine.settings import PresetName
from napari_splinesketch.plugin import settings
from napari_splinesketch.plugin.adapter.space import ruler_of
from napari_splinesketch.plugin.commands import Commands
from napari_splinesketch.plugin.keeper import Keeper
from napari_splinesketch.plugin.measures import Ruler
from napari_splinesketch.plugin.settings import Settings
from napari_splinesketch.plugin.work import Work


class SettingsKeeper(Keeper):
    """Keeps the settings, and lets them act on keys and colours.

    Parameters
    ----------
    viewer
        The viewer whose layers are worked on.

    Attributes
    ----------
    settings
        What the user chose.
    """

    actions: Commands

    def __init__(self, viewer: ViewerModel):
        super().__init__(viewer)
        self.settings = settings.load()
        for work in self._works:
            self._colour(work)
        self.stop_listening = settings.on_change(lambda: self._take(settings.load()))

    @property
    def preset(self) -> PresetName:
        """How much work to do."""
        return self.settings.preset

    @preset.setter
    def preset(self, name: PresetName) -> None:
        self.change(replace(self.settings, preset=name))

    @property
    def ruler(self) -> Ruler:
        """What lengths are told in."""
        return ruler_of(None if self.settings.lengths_in_pixels else self.choices.image)

    def half_width_in(self, image: Image) -> float | None:
        """Give what the user says of the bodies' half-width, px; None to measure it."""
        ruler = ruler_of(image)
        return self.settings.half_width_in(ruler.unit, ruler.pixel)

    def change(self, chosen: Settings) -> None:
        """Take what the user chose, and keep it for other sessions."""
        self._take(chosen)
        settings.save(chosen)

    def use_keys(self) -> None:
        """Give commands the keys that the user chose for them."""
        self.actions.rebind(self.settings.keys)

    def _take(self, chosen: Settings) -> None:
        before, self.settings = self.settings, chosen
        if chosen.keys != before.keys:
            self._free(before, chosen)
            self.use_keys()
        for work in self._works:
            self._colour(work)
        self.changed.emit()

    def _free(self, before: Settings, chosen: Settings) -> None:
        """Take a key that was given to a command from the one that had it."""
        given = {key for name, key in chosen.keys.items() if key != before.keys.get(name)} - {""}
        lost = {
            n: "" for n, key in chosen.keys.items() if key in given and before.keys.get(n) == key
        }
        if lost:
            self.settings = replace(chosen, keys={**chosen.keys, **lost})
            settings.save(self.settings)

    def _attend(self, work: Work) -> None:
        super()._attend(work)
        # The works that were there before are coloured once the settings are known.
        if hasattr(self, "settings"):
            self._colour(work)

    def _colour(self, work: Work) -> None:
        """Let the colours of curves say what the user wants them to."""
        ruler = Ruler() if self.settings.lengths_in_pixels else ruler_of(work.image)
        if work.layers.colour(self.settings.colour_by, ruler):
            self._show(work)

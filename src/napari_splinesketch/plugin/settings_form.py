"""The form in which the user chooses settings, made from their fields."""

from dataclasses import fields, replace
from typing import Any

from magicgui.widgets import create_widget
from qtpy.QtCore import Signal  # pyright: ignore[reportPrivateImportUsage]
from qtpy.QtWidgets import QFormLayout, QWidget

from napari_splinesketch.plugin.measures import Ruler
from napari_splinesketch.plugin.settings import PREFERENCES, Settings
from napari_splinesketch.plugin.widgets import NARROW, button

DECIMALS = 3
"""Of half-widths."""


class SettingsForm(QWidget):
    """A form: `value`, `setValue` and `valueChanged`."""

    valueChanged = Signal(object)

    def __init__(self) -> None:
        super().__init__()
        self._settings, self._ruler = Settings(), Ruler()
        self.widgets: dict[str, Any] = {}
        form = QFormLayout(self)
        form.setContentsMargins(0, 0, 0, 0)
        form.setRowWrapPolicy(QFormLayout.RowWrapPolicy.WrapLongRows)
        form.setFieldGrowthPolicy(QFormLayout.FieldGrowthPolicy.AllNonFixedFieldsGrow)
        for each in fields(Settings):
            if "label" in each.metadata:
                made = _widget(each.name, **each.metadata)
                self.widgets[each.name] = made
                boxed = isinstance(getattr(self._settings, each.name), bool)
                form.addRow("" if boxed else each.metadata["label"], made.native)
                made.changed.connect(lambda value, name=each.name: self._take(name, value))
        form.addRow(button("Change keys…", PREFERENCES, _open_preferences))
        self.half_width = self.widgets["half_width"].native
        self.half_width.setDecimals(DECIMALS)
        self.half_width.setKeyboardTracking(False)
        self.half_width.setSpecialValueText("auto")

    def value(self) -> Settings:
        """Give what is chosen."""
        return self._settings

    def setValue(self, settings: Settings) -> None:
        """Show what is chosen, silently."""
        self._settings = settings
        width = settings.half_width_in(self._ruler.unit, self._ruler.pixel)
        for name, made in self.widgets.items():
            value = getattr(settings, name)
            if name == "half_width":
                value = round(width * self._ruler.pixel, DECIMALS) if width else 0.0
            if made.value != value:
                with made.changed.blocked():
                    made.value = value

    def show_ruler(self, ruler: Ruler) -> None:
        """Tell lengths in the unit of another image."""
        if ruler != self._ruler:
            self._ruler = ruler
            self.half_width.setSuffix(f" {ruler.unit}")
            self.setValue(self._settings)

    def _take(self, name: str, value: Any) -> None:
        changes = {name: value}
        if name == "half_width":
            changes["half_width_unit"] = self._ruler.unit
        if replace(self._settings, **changes) != self._settings:
            self.valueChanged.emit(changes)


def _widget(name: str, label: str, tip: str, **options: Any) -> Any:
    """Make the widget of a setting."""
    default = getattr(Settings(), name)
    if isinstance(default, bool):
        options["text"] = label
    made = create_widget(default, annotation=type(default), options={"tooltip": tip, **options})
    made.native.setMinimumWidth(NARROW)
    return made


def _open_preferences() -> None:
    """Open napari's preferences."""
    from napari._app_model import get_app_model

    get_app_model().commands.execute_command("napari.window.file.show_preferences_dialog")

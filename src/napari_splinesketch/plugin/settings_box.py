"""The settings that matter, out of the way until one asks for them."""

from collections.abc import Iterable
from dataclasses import replace
from typing import get_args

from qtpy.QtCore import (
    QSignalBlocker,
    Signal,  # pyright: ignore[reportPrivateImportUsage]
)
from qtpy.QtGui import QKeySequence
from qtpy.QtWidgets import (
    QCheckBox,
    QComboBox,
    QDoubleSpinBox,
    QFormLayout,
    QKeySequenceEdit,
    QToolButton,
    QWidget,
)

from napari_splinesketch.engine.types import Polarity
from napari_splinesketch.plugin.actions import Action
from napari_splinesketch.plugin.measures import Ruler
from napari_splinesketch.plugin.settings import Settings

POLARITIES: dict[Polarity, str] = {
    "auto": "find out",
    "bright": "brighter than the rest",
    "dark": "darker than the rest",
}
KINDS: tuple[Polarity, ...] = get_args(Polarity)
MOST, DECIMALS = 1e4, 3
"""Of half-widths."""


class SettingsBox(QWidget):
    """A form: `value`, `setValue` and `valueChanged`."""

    valueChanged = Signal(object)

    def __init__(self, parent: QWidget | None = None):
        super().__init__(parent)
        self._settings = Settings()
        self._ruler = Ruler()
        self.keys: dict[str, QKeySequenceEdit] = {}
        self._build()
        self._lay_out()
        self._connect()

    def _build(self) -> None:
        self.polarity = QComboBox()
        self.polarity.addItems([POLARITIES[kind] for kind in KINDS])
        self.polarity.setMinimumWidth(60)
        self.polarity.setToolTip("Whether bodies are brighter or darker than what is around them")
        self.half_width = QDoubleSpinBox()
        self.half_width.setRange(0, MOST)
        self.half_width.setDecimals(DECIMALS)
        self.half_width.setKeyboardTracking(False)
        self.half_width.setSingleStep(0.5)
        self.half_width.setSpecialValueText("measure it")
        self.half_width.setMinimumWidth(60)
        self.half_width.setToolTip(
            "Rough distance from the centreline to the edge of a body;\n"
            "0 measures it in the image, which is right for most"
        )
        self.pixels = QCheckBox("Lengths in pixels")
        self.pixels.setToolTip("Tell lengths in px although the image has a unit")

    def _lay_out(self) -> None:
        self.form = QFormLayout(self)
        self.form.setContentsMargins(0, 0, 0, 0)
        self.form.setRowWrapPolicy(QFormLayout.RowWrapPolicy.WrapLongRows)
        policy = QFormLayout.FieldGrowthPolicy.AllNonFixedFieldsGrow
        self.form.setFieldGrowthPolicy(policy)
        self.form.addRow("Bodies are", self.polarity)
        self.form.addRow("Half-width", self.half_width)
        self.form.addRow("", self.pixels)

    def _connect(self) -> None:
        self.polarity.activated.connect(lambda i: self._change(polarity=KINDS[i]))
        self.half_width.valueChanged.connect(self._on_half_width)
        self.pixels.toggled.connect(lambda on: self._change(lengths_in_pixels=on))

    def value(self) -> Settings:
        """Give what is chosen."""
        return self._settings

    def setValue(self, settings: Settings) -> None:
        """Show what is chosen, silently."""
        self._settings = settings
        width = settings.half_width_in(self._ruler.unit, self._ruler.pixel)
        self.polarity.setCurrentIndex(KINDS.index(settings.polarity))
        for widget in (self.half_width, self.pixels):
            widget.blockSignals(True)
        shown = round(width * self._ruler.pixel, DECIMALS) if width else 0.0
        if shown != self.half_width.value():
            self.half_width.setValue(shown)
        self.pixels.setChecked(settings.lengths_in_pixels)
        for widget in (self.half_width, self.pixels):
            widget.blockSignals(False)
        for name, edit in self.keys.items():
            key = settings.keys.get(name, "")
            if key != _text(edit) and not edit.hasFocus():
                with QSignalBlocker(edit):
                    edit.setKeySequence(QKeySequence(key))

    def show_ruler(self, ruler: Ruler) -> None:
        """Tell lengths in the unit of another image."""
        if ruler != self._ruler:
            self._ruler = ruler
            self.half_width.setSuffix(f" {ruler.unit}")
            self.setValue(self._settings)

    def show_actions(self, actions: Iterable[Action]) -> None:
        """Offer the keys of these actions."""
        for action in actions:
            if action.id in self.keys:
                continue
            edit = QKeySequenceEdit(QKeySequence(action.key))
            edit.setMaximumSequenceLength(1)
            edit.setClearButtonEnabled(True)
            edit.setMinimumWidth(60)
            for button in edit.findChildren(QToolButton):
                button.setToolTip("Take the key away")
            edit.setToolTip(f"{action.tip}\nClick here and press another key to change it.")
            edit.editingFinished.connect(lambda name=action.id, edit=edit: self._on_key(name, edit))
            self.keys[action.id] = edit
            self.form.addRow(action.name, edit)

    def _on_key(self, name: str, edit: QKeySequenceEdit) -> None:
        """Take a key for an action, from any other that has it."""
        key = _text(edit)
        others = {other: _text(box) for other, box in self.keys.items() if other != name}
        freed = {other: "" for other, used in others.items() if used == key}
        self._change(keys={**self._settings.keys, **others, **freed, name: key})

    def _on_half_width(self, value: float) -> None:
        self._change(half_width=value, half_width_unit=self._ruler.unit)

    def _change(self, **changes: object) -> None:
        changed = replace(self._settings, **changes)  # pyright: ignore[reportArgumentType]
        if changed != self._settings:
            self._settings = changed
            self.valueChanged.emit(changed)


def _text(edit: QKeySequenceEdit) -> str:
    return edit.keySequence().toString(QKeySequence.SequenceFormat.PortableText)

"""Buttons that show and hide the layers of results."""

from functools import partial

from qtpy.QtWidgets import QHBoxLayout, QPushButton, QWidget

from napari_splinesketch.plugin.adapter.roles import Role
from napari_splinesketch.plugin.work import Work

BUTTONS: dict[Role, tuple[str, str]] = {
    "curves": ("Curves", "Show or hide the refined centrelines"),
    "outlines": ("Outlines", "Show or hide the edges of the bodies, at the fitted width"),
    "reconstruction": ("Model", "Show or hide the image as the fitted model explains it"),
}


class VisibilityRow(QWidget):
    """One button for each layer of results; follows the layers' own eyes."""

    def __init__(self, parent: QWidget | None = None):
        super().__init__(parent)
        self._work: Work | None = None
        self._buttons: dict[Role, QPushButton] = {}
        layout = QHBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(4)
        for role, (name, tip) in BUTTONS.items():
            button = QPushButton(name)
            button.setCheckable(True)
            button.setToolTip(tip)
            button.setMinimumWidth(30)
            button.clicked.connect(partial(self._set, role))
            layout.addWidget(button)
            self._buttons[role] = button

    def show_work(self, work: Work | None) -> None:
        """Show which layers are visible."""
        self._work = work
        for role, button in self._buttons.items():
            layer = work.layers.layer(role) if work else None
            button.setEnabled(layer is not None)
            button.setChecked(layer is not None and layer.visible)

    def _set(self, role: Role, on: bool) -> None:
        layer = self._work.layers.layer(role) if self._work else None
        if layer is not None:
            layer.visible = on

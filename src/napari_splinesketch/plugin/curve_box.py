"""What can be done to the selected curve."""

from qtpy.QtWidgets import QGridLayout, QPushButton, QWidget

from napari_splinesketch.plugin.controller import Controller
from napari_splinesketch.plugin.standard_actions import CORRECTIONS
from napari_splinesketch.plugin.text_label import TextLabel

COLUMNS = 4
SEVERAL = ("flip", "lock", "delete")
"""What can be done to several curves; two can be joined, the rest is for one alone."""


class CurveBox(QWidget):
    """A button for each correction; there while a curve is selected.

    Parameters
    ----------
    controller
        Owns the state.
    """

    def __init__(self, controller: Controller, parent: QWidget | None = None):
        super().__init__(parent)
        self._controller = controller
        self.title = TextLabel()
        self.buttons = {name: QPushButton(controller.actions[name].name) for name in CORRECTIONS}
        layout = QGridLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(3)
        layout.addWidget(self.title, 0, 0, 1, COLUMNS)
        for i, (name, button) in enumerate(self.buttons.items()):
            button.setToolTip(controller.actions[name].tip)
            button.setMinimumWidth(30)
            button.setStyleSheet("padding: 3px;")
            button.clicked.connect(lambda _, name=name: controller.actions[name].run())
            layout.addWidget(button, 1 + i // COLUMNS, i % COLUMNS)

    def show_selection(self) -> None:
        """Show what is selected, and what can be done to it."""
        controller = self._controller
        selection = controller.selection
        self.setVisible(bool(selection))
        if not selection or controller.work is None:
            return
        records = [controller.work.state.record(key) for key in selection]
        locked = all(record is not None and record.locked for record in records)
        number = len(selection)
        self.title.say(
            f"<b>Curve {selection[0][1]}</b>{' 🔒' if locked else ''}"
            if number == 1
            else f"<b>{number} curves</b> selected"
        )
        for name, button in self.buttons.items():
            action = controller.actions[name]
            possible = number == 1 or name in SEVERAL
            possible = number == 2 if name == "join" else possible
            button.setText("Unlock" if name == "lock" and locked else action.name)
            button.setEnabled(possible and not controller.progress)
            button.setToolTip(f"{action.tip} ({action.key})" if action.key else action.tip)
        self.buttons["knots"].setText("Done" if controller.knots.active else "Knots")

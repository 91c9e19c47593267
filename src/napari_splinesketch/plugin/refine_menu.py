"""What else Refine can do."""

from functools import partial

from qtpy.QtWidgets import QMenu, QToolButton, QWidget

from napari_splinesketch.plugin import words
from napari_splinesketch.plugin.controller import Controller
from napari_splinesketch.plugin.plan import Scope

NAMES: dict[Scope, str] = {
    "selected": "Refine the selected",
    "all": "Refine all that is open",
}


class RefineMenu(QToolButton):
    """An arrow beside the Refine button; its menu says what each choice would do now.

    Parameters
    ----------
    controller
        Who refines.
    """

    def __init__(self, controller: Controller, parent: QWidget | None = None):
        super().__init__(parent)
        self._controller = controller
        self.setText("▾")
        self.setToolTip("Refine the selected curves, or all again")
        self.setPopupMode(QToolButton.ToolButtonPopupMode.InstantPopup)
        # napari's theme would draw an arrow of its own over the text.
        self.setStyleSheet("QToolButton::menu-indicator { image: none; }")
        self._menu = QMenu(self)
        self._menu.setToolTipsVisible(True)
        self._menu.aboutToShow.connect(self._fill)
        self.setMenu(self._menu)

    def _fill(self) -> None:
        self._menu.clear()
        for scope, name in NAMES.items():
            request = self._controller.request(scope)
            possible = not request.problem and not self._controller.progress
            action = self._menu.addAction(words.button(request.plan) if possible else name)
            if action is not None:
                action.setEnabled(possible)
                action.setToolTip(request.problem)
                action.triggered.connect(partial(self._refine, scope))

    def _refine(self, scope: Scope) -> None:
        self._controller.refine(scope)

"""The menu of layers that are made when one asks for them."""

from functools import partial
from typing import Any

from qtpy.QtCore import Signal  # pyright: ignore[reportPrivateImportUsage]
from qtpy.QtGui import QAction
from qtpy.QtWidgets import QMenu, QPushButton, QWidget

from napari_splinesketch.plugin.adapter.pictures import Proof
from napari_splinesketch.plugin.work import Work

ENTRIES: dict[Proof, tuple[str, str]] = {
    "residual": ("Residual", "Image minus model: blue below, white right, orange above"),
    "background": ("Background", "What the model has behind the bodies"),
    "body": ("Selected body alone", "The selected curve's body on the background"),
    "ribbon": ("Uncertainty", "Lines at twice the standard error to both sides of each curve"),
    "masks": ("Masks", "A Labels layer: pixels have their curve's number"),
    "stack": ("Masks, one a body", "A stack with a mask for each curve: overlaps are kept"),
}
NOTHING: dict[Proof, str] = {
    "body": "Select one curve first: its body is shown alone.",
    "ribbon": "No standard errors are known: the preset Paper gives none.",
}


class ProofMenu(QPushButton):
    """A button that unfolds a list of layers to show."""

    refused = Signal(str)
    """There is nothing to show, and why."""

    def __init__(self, parent: QWidget | None = None):
        super().__init__(parent)
        self._work: Work | None = None
        self._entries: dict[Proof, Any] = {}
        self.setText("Show more")
        self.setToolTip("Show more: residual, background, uncertainty, masks")
        self.setMinimumWidth(30)
        self._menu = QMenu(self)
        self._menu.setToolTipsVisible(True)
        for proof, (name, tip) in ENTRIES.items():
            entry = QAction(name, self._menu)
            entry.setToolTip(tip)
            entry.setCheckable(True)
            entry.triggered.connect(partial(self._ask, proof))
            self._menu.addAction(entry)
            self._entries[proof] = entry
        self.setMenu(self._menu)

    def entry(self, proof: Proof) -> Any:
        """Give an entry of the menu."""
        return self._entries[proof]

    def show_work(self, work: Work | None) -> None:
        """Show which layers are in view."""
        self._work = work
        for proof, entry in self._entries.items():
            entry.setChecked(work is not None and work.proofs.shown(proof))

    def _ask(self, proof: Proof, on: bool) -> None:
        if self._work is not None and not self._work.proofs.ask(proof, on):
            self._entries[proof].setChecked(False)
            self.refused.emit(NOTHING.get(proof, "There is nothing to show yet: refine first."))

"""The review panel comes when the user asks for it."""

from contextlib import suppress
from typing import Any
from weakref import ref

from psygnal import Signal
from qtpy.QtWidgets import QWidget
from superqt.utils import qdebounced

from napari_splinesketch.plugin.controller import Controller
from napari_splinesketch.plugin.review.panel import ReviewPanel

NAME = "Curves"
LAYOUT_MS = 20
"""In which Qt finds a place for everything in a window."""


class PanelKeeper:
    """Shows and hides the panel below the canvas.

    Parameters
    ----------
    controller
        Owns the curves.

    Attributes
    ----------
    panel
        The panel while it is shown, or None.
    """

    toggled = Signal(bool)
    """The panel was shown or hidden."""

    def __init__(self, controller: Controller):
        self.panel: ReviewPanel | None = None
        self._controller = controller
        self._waiting: ref[QWidget] | None = None
        self._soon = qdebounced(self._paint, LAYOUT_MS)

    def show_or_hide(self) -> None:
        """Show the panel if it is not there, hide it if it is."""
        if self.panel is None:
            self.show()
        else:
            self.hide()

    def show(self) -> None:
        """Show the panel."""
        if self.panel is None:
            self.panel = ReviewPanel(self._controller)
            self.panel.closed.connect(self._on_closed)
            added = self._window().add_dock_widget(self.panel, name=NAME, area="bottom")
            self._paint_later(added.window())
        self.toggled.emit(True)

    def hide(self) -> None:
        """Take the panel away."""
        if self.panel is not None:
            self._window().remove_dock_widget(self.panel)

    def _on_closed(self) -> None:
        if self.panel is not None:
            self.panel.deleteLater()
            self.panel = None
        self.toggled.emit(False)

    def _window(self) -> Any:
        # Only a viewer with a window has a dock to press the button in.
        return getattr(self._controller.viewer, "window")  # noqa: B009

    def _paint_later(self, window: QWidget) -> None:
        """Let a window paint once its layout stands: the canvas would be painted at each change."""
        window.setUpdatesEnabled(False)
        self._waiting = ref(window)
        self._soon()

    def _paint(self) -> None:
        window = self._waiting() if self._waiting else None
        if window is not None:
            with suppress(RuntimeError):  # Qt has deleted it
                window.setUpdatesEnabled(True)

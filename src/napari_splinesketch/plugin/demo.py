"""The window that shows what the plugin does."""

import napari
from qtpy.QtCore import QTimer

from napari_splinesketch.plugin.dock import SplinesketchDock

PLUGIN = "napari-splinesketch"
SIZE = (1300, 860)
"""Of the window, px."""
FIT_AFTER_MS = 300
"""The window takes its size first."""


def open_demo(*, block: bool = True) -> napari.Viewer:
    """Open a window with worms, rough lines over some of them, and the dock.

    Parameters
    ----------
    block
        Run until the window is closed; otherwise leave that to the caller.
    """
    viewer = napari.Viewer(title="Splinesketch demo")
    viewer.window.resize(*SIZE)
    # From the menu it has the plugin's name too: cut off at the width of a dock.
    viewer.window.add_dock_widget(SplinesketchDock(viewer), name="Splinesketch")
    viewer.open_sample(PLUGIN, "worms_dense")
    QTimer.singleShot(FIT_AFTER_MS, viewer.reset_view)
    if block:
        napari.run()
    return viewer

"""A real window with the dock."""

import gc
from collections.abc import Iterator
from typing import Any

import pytest
from napari.components import ViewerModel
from napari.settings import get_settings
from npe2 import PluginManifest
from qtpy.QtCore import QEvent
from qtpy.QtWidgets import QApplication

from napari_splinesketch.plugin import engine, saver
from napari_splinesketch.plugin.dock import SplinesketchDock
from napari_splinesketch.plugin.layers import pictures, results

from .fakes import FakeEngine
from .hand import add_dock

WINDOW = 900, 640
"""Of a window that draws, px: software paints every one of them, again and again."""


RESTS_MS = {
    (engine, "POLL_MS"): 2,
    (pictures, "FIRST_MS"): 1,
    (pictures, "STEP_MS"): 1,
    (results, "AFTER_MS"): 10,
    (saver, "DELAY_MS"): 100,
    (saver, "AGAIN_MS"): 200,
}
"""How long the plugin rests between steps; a test has no eye to follow them."""


@pytest.fixture(autouse=True)
def short_rests(monkeypatch: pytest.MonkeyPatch) -> None:
    """Wait for what comes next, not for the clock."""
    for (module, name), rest in RESTS_MS.items():
        monkeypatch.setattr(module, name, rest)


@pytest.fixture(autouse=True)
def imports_left_out(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave what was imported out of every search for garbage, except with mark "garbage"."""
    if not request.node.get_closest_marker("garbage"):
        monkeypatch.setattr(gc, "unfreeze", lambda: None)


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> FakeEngine:
    """Put an engine that answers at once in the place of the real one."""
    made = FakeEngine()
    made.go.set()
    monkeypatch.setattr(engine, "refine", made.refine)
    monkeypatch.setattr(engine, "warm_up", lambda report: None)
    return made


@pytest.fixture(autouse=True)
def own_data_folder(tmp_path_factory: pytest.TempPathFactory, monkeypatch: Any) -> None:
    """Let no test find what another one saved, nor where."""
    get_settings().application.save_history = []
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path_factory.mktemp("data")))


@pytest.fixture
def viewer(
    request: pytest.FixtureRequest, qapp: QApplication, plugin_settings: None
) -> Iterator[Any]:
    """What a window keeps, and settings of its own; with mark "window", a whole window.

    A window costs five times as much, and ten times where it is shown: those are for tests of mouse
    and keys, these for tests of layout and of what is painted.
    """
    mark = request.node.get_closest_marker("window")
    if mark:
        made = request.getfixturevalue("make_napari_viewer")(show=mark.kwargs.get("shown", False))
        made.window.resize(*WINDOW)
        yield made
        return
    yield ViewerModel()
    for widget in qapp.topLevelWidgets():
        if isinstance(widget, SplinesketchDock):
            widget.close()
            widget.deleteLater()
    qapp.sendPostedEvents(None, QEvent.Type.DeferredDelete)


@pytest.fixture
def dock(viewer: Any, fake: FakeEngine) -> SplinesketchDock:
    """The dock in the window."""
    return add_dock(viewer)


@pytest.fixture
def npe2pm_installed(npe2pm: Any) -> None:
    """Let napari's own menus know the plugin, which its fixtures hide."""
    npe2pm.register(PluginManifest.from_distribution("napari-splinesketch"))

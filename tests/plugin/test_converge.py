"""The curves are seen on their way, and nothing is left of that."""

from typing import Any

import numpy as np
import pytest

from napari_splinesketch.plugin.dock import SplinesketchDock

from .fakes import FakeEngine
from .hand import QTest, click, draw, fit_view, layer_named, until

LINES = [np.array([[1.0, 20, 20], [1, 20, 60]]), np.array([[1.0, 50, 30], [1, 80, 80]])]
NAME = "film on the way"


@pytest.fixture
def walking(viewer: Any, dock: SplinesketchDock, fake: FakeEngine) -> Any:
    """A film whose curves are on their way."""
    viewer.add_image(np.random.default_rng(0).random((3, 96, 128)), name="film", scale=(1, 2, 2))
    layer = viewer.add_shapes(LINES, shape_type="line", name="film sketches", scale=(1, 2, 2))
    viewer.dims.set_point(0, 1)
    fit_view(viewer)
    viewer.layers.selection.active = layer
    layer.mode = "add_line"
    fake.go.clear()
    fake.walks = True
    click(dock.refine)
    until(lambda: NAME in viewer.layers and viewer.layers[NAME].visible, 20)
    return layer


@pytest.mark.slow
@pytest.mark.window
def test_they_move_until_the_results_are_there(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine, walking: Any
) -> None:
    shown = layer_named(viewer, NAME)
    changes: list[float] = []
    shown.events.data.connect(lambda event: changes.append(float(shown.data[0, 0, 1])))
    until(lambda: len(changes) > 3, 20)
    assert changes == sorted(set(changes)), "each time somewhere else"
    assert len(np.unique(shown.data[:, 0, 0])) == 1, "in its own frame"
    np.testing.assert_array_equal(shown.scale, (1, 2, 2))
    assert viewer.layers.selection.active is walking
    draw(viewer, walking, [[120, 20], [160, 40]])
    assert walking.nshapes == 3, "she can draw on meanwhile"
    fake.go.set()
    until(lambda: not dock.controller.progress, 20)
    assert NAME not in viewer.layers
    for line, curve in zip(LINES, viewer.layers["film curves"].data, strict=True):
        np.testing.assert_allclose(curve[[0, -1]], line, atol=1e-4)


@pytest.mark.parametrize("how", ["cancel", "error"])
def test_nothing_is_left_when_it_comes_to_nothing(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine, walking: Any, how: str
) -> None:
    if how == "cancel":
        click(dock.cancel)
    else:
        fake.error = RuntimeError("full")
        fake.go.set()
        until(lambda: not dock.controller.progress, 20)
    QTest.qWait(100)
    assert [layer.name for layer in viewer.layers] == ["film", "film sketches"]
    assert viewer.layers.selection.active is walking
    assert walking.mode == "add_line"


def test_a_layer_that_she_removes_stays_away(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine, walking: Any
) -> None:
    viewer.layers.remove(NAME)
    QTest.qWait(150)
    assert NAME not in viewer.layers
    fake.go.set()
    until(lambda: not dock.controller.progress, 20)
    assert viewer.layers["film curves"].nshapes == 2

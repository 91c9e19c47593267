"""Reviewing in a real window: table, keys, camera, plots."""

from typing import Any

import numpy as np
import pytest
from napari.layers import Shapes
from qtpy.QtCore import QPoint, Qt, QTimer
from qtpy.QtWidgets import QApplication, QFileDialog

from napari_splinesketch.plugin.commands import go_to
from napari_splinesketch.plugin.dock import SplinesketchDock
from napari_splinesketch.plugin.model import State
from napari_splinesketch.plugin.plots import Plot
from napari_splinesketch.plugin.review import ReviewPanel

from .bench import bench
from .fakes import FakeEngine
from .hand import LEFT, NO_KEY, QTest, canvas, canvas_point, click, refine, until

LINES = [np.array([[20.0 * i, 20], [20 * i, 100]]) for i in range(1, 6)]
PLACE = {"scale": (0.5, 0.5), "translate": (3, 7), "units": ("um", "um")}
DOUBTS = {
    1: {"status": "check", "reasons": ("it moved",), "residual": 0.4},
    3: {"status": "check", "reasons": ("it is short",), "residual": 0.2},
    4: {"status": "failed", "half_width": np.full(100, np.nan), "sd": np.full(100, np.inf)},
}


def opened(viewer: Any, dock: SplinesketchDock, fake: FakeEngine) -> ReviewPanel:
    """Refine five lines and open the panel with its button."""
    rng = np.random.default_rng(0)
    image = rng.normal(100, 5, (128, 160)).astype(np.float32)
    viewer.add_image(image, name="cells", **PLACE)
    viewer.add_shapes(LINES, shape_type="line", name="cells sketches", **PLACE)
    fake.changes = DOUBTS
    refine(dock)
    click(dock.review)
    until(lambda: dock.panel is not None)
    assert dock.panel is not None
    return dock.panel


def ids(panel: ReviewPanel) -> list[int]:
    return [record.id for record in panel.model.records]


def press(viewer: Any, key: str) -> None:
    QTest.keyClick(canvas(viewer), getattr(Qt.Key, f"Key_{key}"))
    QTest.qWait(150)


def centre(viewer: Any) -> np.ndarray:
    return np.array(viewer.scene.camera.center)[-2:]


@pytest.mark.slow
@pytest.mark.window
def test_a_row_and_its_curve_find_each_other(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine
) -> None:
    panel = opened(viewer, dock, fake)
    assert ids(panel)[:3] == [5, 2, 4], "the worst first"
    header = [panel.model.headerData(i, Qt.Orientation.Horizontal) for i in range(9)]
    assert "Length (µm)" in header
    row = ids(panel).index(4)
    place = panel.table.visualRect(panel.model.index(row, 1)).center()
    QTest.mouseClick(panel.table.viewport(), LEFT, NO_KEY, place)
    assert dock.controller.selection == ((0, 4),)
    layer = viewer.layers["cells curves"]
    viewer.reset_view()
    middle = centre(viewer)
    dock.controller.actions.run("next")
    np.testing.assert_allclose(centre(viewer), middle, err_msg="nothing beyond it is shown")
    viewer.scene.camera.zoom *= 8
    panel.table.picked.emit((0, 4))
    np.testing.assert_allclose(centre(viewer), layer.data_to_world([80, 60]), atol=1e-3)
    width, residual = panel.plots.shown
    assert isinstance(width, Plot) and isinstance(residual, Plot)
    assert width.unit == "µm"
    assert width.distance[-1] == pytest.approx(40.0)
    np.testing.assert_allclose(width.values, 1.0)
    # The engine of these tests explains an image by its mean.
    image = viewer.layers["cells"].data
    middle = image[78:83, 20:101].mean(axis=0) - image.mean()
    np.testing.assert_allclose(residual.values[[0, -1]], middle[[0, -1]], atol=2.5)
    QTest.keyClick(panel.table, Qt.Key.Key_Down)
    assert dock.controller.selection == ((0, ids(panel)[row + 1]),)
    # The other way round: on the canvas.
    viewer.reset_view()
    viewer.layers.selection.active = layer
    QTest.qWait(50)
    where = canvas_point(viewer, layer.data_to_world([60, 60]))
    QTest.mouseMove(canvas(viewer), where + QPoint(1, 1))
    QTest.mouseClick(canvas(viewer), LEFT, NO_KEY, where)
    until(lambda: dock.controller.selection == ((0, 3),), 5)
    assert panel.table.currentIndex().row() == ids(panel).index(3)
    assert isinstance(panel.plots.shown[0], Plot) and panel.plots.shown[0] is not width


@pytest.mark.slow
@pytest.mark.window
def test_one_hand_reviews_the_worst_first(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine
) -> None:
    panel = opened(viewer, dock, fake)
    assert panel.count.text() == "0 of 5 reviewed"
    assert [b.text() for b in panel.judges.buttons.values()] == [
        "Accept (J)", "Reject (K)", "Next (N)"
    ]  # fmt: skip
    viewer.layers.selection.active = viewer.layers["cells"]
    press(viewer, "N")
    assert dock.controller.selection == ((0, 5),)
    press(viewer, "K")
    assert dock.controller.selection == ((0, 2),)
    press(viewer, "J")
    assert dock.controller.selection == ((0, 4),)
    press(viewer, "N")
    assert panel.count.text() == "2 of 5 reviewed"
    assert {r.id: r.review for r in dock.controller.records()} == {
        1: "open", 2: "accepted", 3: "open", 4: "open", 5: "rejected"
    }  # fmt: skip
    # The table leaves the viewer its keys, and the buttons do the same.
    dock.controller.select([(0, 4)])
    panel.table.setFocus()
    QTest.keyClick(panel.table, Qt.Key.Key_J)
    until(lambda: panel.count.text() == "3 of 5 reviewed", 5)
    click(panel.judges.buttons["accept"])
    until(lambda: panel.count.text() == "4 of 5 reviewed", 5)
    curves = viewer.layers["cells curves"]
    until(lambda: list(curves.features["review"]).count("open") == 1, 5)
    panel.shown.setCurrentIndex(2)
    panel.shown.activated.emit(2)
    assert len(ids(panel)) == 1, "only what is not reviewed"
    QTest.keyClick(canvas(viewer), Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    until(lambda: panel.count.text() == "3 of 5 reviewed", 5)
    assert len(ids(panel)) == 2
    dock.controller.review("accepted", *dock.controller.state.by_key)
    press(viewer, "N")
    assert "No curve is left to review" in dock.notice.text()


@pytest.mark.slow
@pytest.mark.window
def test_the_table_goes_elsewhere(
    viewer: Any,
    dock: SplinesketchDock,
    fake: FakeEngine,
    tmp_path: Any,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    panel = opened(viewer, dock, fake)
    panel.shown.setCurrentIndex(1)
    panel.shown.activated.emit(1)
    panel.copy()
    clipboard = QApplication.clipboard()
    assert clipboard is not None
    lines = clipboard.text().splitlines()
    assert [line.split("\t")[0] for line in lines] == ["curve", "5", "2", "4"]
    path = tmp_path / "table.csv"
    monkeypatch.setattr(QFileDialog, "getSaveFileName", lambda *_: (str(path), ""))
    menu = panel.more.menu()
    assert menu is not None
    menu.actions()[1].trigger()
    text = path.read_text(encoding="utf-8")
    assert text.splitlines()[1].startswith("5,0,,failed,open,40.0")
    picture = path = tmp_path / "image.tif"
    picture.write_bytes(b"pixels")
    menu.actions()[1].trigger()
    assert picture.read_bytes() == b"pixels", "what is no table is never replaced"
    assert (tmp_path / "image.tif.csv").read_text(encoding="utf-8") == text
    panel.shown.setCurrentIndex(0)
    panel.shown.activated.emit(0)
    menu.actions()[1].trigger()
    said = dock.notice.text().replace("\u200b", "")
    assert "or type image.tif.csv in full to replace it" in said, "nobody was asked about that name"
    assert (tmp_path / "image.tif.csv").read_text(encoding="utf-8") == text


@pytest.mark.slow
@pytest.mark.window
def test_what_is_still_to_come_lets_a_closed_window_go(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine, monkeypatch: pytest.MonkeyPatch
) -> None:
    """napari's fixture fails when something still holds the window after it was closed."""
    opened(viewer, dock, fake)
    later = QTimer.singleShot
    monkeypatch.setattr(QTimer, "singleShot", lambda ms, run: later(5000 + ms, run))
    click(dock.review)
    click(dock.review)
    until(lambda: dock.panel is not None)
    viewer.layers["cells sketches"].add([[100, 20], [100, 90]], shape_type="line")
    dock.controller.select([(0, 1)])
    dock.controller.toggle_knots()
    fake.go.clear()
    click(dock.refine)
    until(lambda: len(fake.calls) == 2)


@pytest.mark.slow
@pytest.mark.window(shown=True)
def test_the_panel_closes_and_comes_back(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine
) -> None:
    panel = opened(viewer, dock, fake)
    assert dock.review.isChecked()
    viewer.theme = "light"

    def lightness() -> int:
        return panel.plots.grab().toImage().pixelColor(2, 2).lightness()

    until(lambda: lightness() > 200, 5)
    viewer.window.remove_dock_widget(panel)
    until(lambda: dock.panel is None, 5)
    assert not dock.review.isChecked()
    dock.controller.review("accepted", (0, 1))
    dock.controller.actions.run("next")
    assert dock.controller.selection == ((0, 5),), "the keys work without the panel"
    click(dock.review)
    again = dock.panel
    assert again is not None and again is not panel
    assert again.count.text() == "1 of 5 reviewed"
    around: Any = again.parent()
    until(again.isVisible, 5)
    around.hide()
    until(lambda: not dock.review.isChecked(), 5)
    click(dock.review)
    assert dock.panel is again and again.isVisible(), "what hides the panel does not take it away"
    assert dock.review.isChecked()
    dock.controller.apply("Nothing", State())
    assert dock.review.isVisible(), "what opened the panel closes it"
    click(dock.review)
    until(lambda: dock.panel is None, 5)
    assert not dock.review.isVisible()


@pytest.mark.slow
@pytest.mark.window
def test_a_row_of_another_frame_goes_there(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine
) -> None:
    image = np.random.default_rng(0).normal(100, 5, (3, 64, 64)).astype(np.float32)
    viewer.add_image(image, name="film", scale=(2, 1, 1))
    lines = [np.array([[t, 10.0 + 10 * t, 10], [t, 10 + 10 * t, 50]]) for t in range(3)]
    viewer.add_shapes(lines, shape_type="line", name="film sketches", scale=(2, 1, 1))
    for frame in range(3):
        viewer.dims.set_point(0, 2 * frame)
        refine(dock)
    click(dock.review)
    panel = dock.panel
    assert panel is not None
    viewer.scene.camera.zoom *= 8
    go_to(dock.controller, (1, 2))
    assert viewer.dims.point[0] == 2
    np.testing.assert_allclose(centre(viewer), [20, 30], atol=1e-6)
    viewer.dims.set_point(0, 0)
    place = panel.table.visualRect(panel.table.currentIndex()).center()
    QTest.mouseClick(panel.table.viewport(), LEFT, NO_KEY, place)
    assert viewer.dims.point[0] == 2, "also where its row is the selected one"
    panel.shown.setCurrentIndex(3)
    panel.shown.activated.emit(3)
    assert ids(panel) == [2]
    viewer.dims.set_point(0, 4)
    until(lambda: ids(panel) == [3], 5)
    assert isinstance(viewer.layers["film curves"], Shapes)


def test_delete_in_the_table_means_the_curve_not_a_line(qapp: Any, fake: FakeEngine) -> None:
    with bench() as made:
        made.begin()
        panel = ReviewPanel(made.controller)
        QTest.keyClick(panel.table, Qt.Key.Key_Down)
        assert len(made.controller.selection) == 1
        QTest.keyClick(panel.table, Qt.Key.Key_Delete)
        assert len(made.controller.records()) == len(made.controller.state.deleted) == 1
        panel.close()

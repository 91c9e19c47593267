"""The dock has room for all that it says, also beside the review panel."""

from typing import Any

import numpy as np
import pytest
from qtpy.QtCore import QPoint, Qt
from qtpy.QtWidgets import QDockWidget, QScrollArea, QStyleOptionComboBox

from napari_splinesketch.plugin.dock import SplinesketchDock
from napari_splinesketch.plugin.layers.space import Ruler
from napari_splinesketch.plugin.plots import (
    AFTER_MS,
    RESIDUAL,
    CurvePlots,
    Plot,
    pictures,
)
from napari_splinesketch.plugin.widgets import Texts

from .fakes import FakeEngine, as_drawn
from .hand import QTest, click, refine, until


@pytest.mark.slow
@pytest.mark.window(shown=True)
def test_the_review_panel_takes_no_height_from_the_dock_and_the_legend_stays_whole(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine
) -> None:
    viewer.window.resize(1200, 800)
    viewer.add_image(np.zeros((4, 90, 120), np.float32), name="film")
    lines = [[[0, r, 20], [0, r, 60]] for r in (20, 40, 60)]
    viewer.add_shapes(lines, shape_type="line", name="film sketches")
    doubts = "it strays up to 14 px from its sketch", "another path is nearly as likely"
    fake.changes = {1: {"status": "check", "reasons": doubts}}
    refine(dock)
    around: Any = dock.parent()
    while not isinstance(around, QDockWidget):
        around = around.parent()
    window = viewer.window._qt_window
    window.resizeDocks([around], [250], Qt.Orientation.Horizontal)
    QTest.qWait(100)
    before, place = dock.height(), dock.curve.pos()
    viewer.layers["film sketches"].add([[0, 80, 20], [0, 80, 60]], shape_type="line")
    QTest.qWait(100)
    assert dock.refine.isEnabled() and dock.curve.pos() == place, "nothing moves for that"
    click(dock.review)
    until(lambda: dock.panel is not None and dock.panel.isVisible(), 10)
    QTest.qWait(200)
    assert dock.height() == before
    dock.controller.select([(0, 2)])
    QTest.qWait(50)
    assert dock.curve.pos() == place, "nor for the selected curve's doubts"
    assert dock.hint.height() >= dock.hint.heightForWidth(dock.hint.width())
    area = dock.findChild(QScrollArea)
    assert area is not None
    bar = area.verticalScrollBar()
    assert bar is not None and bar.maximum() == 0, "nothing scrolls at 800 px"
    legend = dock.legend
    bottom = legend.mapTo(dock, QPoint(0, legend.height())).y()
    assert legend.isVisible() and bottom <= area.geometry().bottom()
    assert legend.sizeHint().width() <= legend.width(), "and none of it is cut off"


@pytest.mark.parametrize("unit", ["px", "µm"])
def test_titles_of_plots_are_not_cut_in_the_narrowest_panel(qapp: Any, unit: str) -> None:
    plots = CurvePlots("dark")
    titles = f"Half-width ± sd ({unit})", RESIDUAL
    plots.show()
    plots.resize(plots.minimumWidth(), 200)
    plots.show_plots(*(Plot(title, unit, np.arange(9.0), np.ones(9)) for title in titles))
    until(lambda: [type(item).__name__ for item in plots.ci.items] == ["PlotItem"] * 2)
    QTest.qWait(20)
    for title, plot in zip(titles, plots.ci.items, strict=True):
        shown = plot.titleLabel
        assert shown.text == title
        assert shown.item.boundingRect().width() <= plot.boundingRect().width()


@pytest.mark.parametrize("length", [100.0, 2000.0, 0.004])
@pytest.mark.parametrize("width", [280, 420])
def test_the_last_number_below_a_plot_is_not_cut(qapp: Any, width: int, length: float) -> None:
    plots = CurvePlots("dark")
    plots.show()
    plots.resize(width, 200)
    along = np.linspace(0, length, 9)
    plots.show_plots(*(Plot("Half-width ± sd (px)", "px", along, np.ones(9)) for _ in "ab"))
    until(lambda: [type(item).__name__ for item in plots.ci.items] == ["PlotItem"] * 2)
    QTest.qWait(20)
    shown = plots.grab().toImage()
    right = {shown.pixel(shown.width() - 2, y) for y in range(2, shown.height() - 2)}
    assert len(right) == 1, "text or lines run out of the panel"


def test_plots_that_follow_a_hint_fit_into_a_narrow_panel(qapp: Any) -> None:
    plots = CurvePlots("dark")
    plots.resize(plots.minimumWidth() + 10, 200)
    plots.show()
    line = [Plot(title, "px", np.arange(9.0), np.ones(9)) for title in ("Half-width", RESIDUAL)]
    for shown, kind in ((), "LabelItem"), (line, "PlotItem"), ((), "LabelItem"):
        plots.show_plots(*shown)
        until(lambda kind=kind: [type(item).__name__ for item in plots.ci.items] == [kind] * 2)
        QTest.qWait(20)
        assert plots.ci.boundingRect().width() <= plots.width()


def test_plots_over_the_frames_stay_in_their_panel(qapp: Any) -> None:
    plots = CurvePlots("dark")
    plots.show()
    plots.resize(420, 200)
    body = {t: as_drawn(np.array([[20.0, 20 + 2 * t], [20, 60]])) for t in range(4)}
    made = pictures(tuple(body.items()), Ruler((0.5, 0.5), "µm"))
    for pair in (made[:2], made[2:]):
        plots.show_plots(*pair, frame=1)
        QTest.qWait(2 * AFTER_MS)
        until(lambda: [type(item).__name__ for item in plots.ci.items] == ["PlotItem"] * 2)
        QTest.qWait(50)
        assert plots.ci.boundingRect().width() <= 420
        assert {item.titleLabel.text for item in plots.ci.items} == {one.title for one in pair}
        plots._draw()
        heights = [item.vb.height() for item in plots.ci.items]
        assert heights[0] == pytest.approx(heights[1]), "at once, not after the next paint"
        for plot in plots.ci.items:
            assert plot.titleLabel.item.boundingRect().width() <= plot.boundingRect().width()


def test_a_message_longer_than_the_dock_is_high_scrolls(dock: SplinesketchDock) -> None:
    dock.resize(250, 420)
    dock.controller.say("Could not be read: /a/long/path.json. " * 40)
    QTest.qWait(50)
    assert dock.notice.height() >= dock.notice.heightForWidth(dock.notice.width()), "all of it"
    (bar,) = (area.verticalScrollBar() for area in dock.findChildren(Texts))
    assert bar is not None and bar.maximum() > 0
    dock.resize(250, 2500)
    QTest.qWait(50)
    assert bar.maximum() == 0, "where there is room, nothing scrolls"
    dock.controller.tell()
    dock.offer.said.say("Saved work (30 November 2026, 11:54): 2 sketches and 2 curves. " * 3)
    dock.offer.show()
    QTest.qWait(50)
    assert bar.maximum() == 0 and dock.offer.pos().y() < 5, "nor is there a gap"


def test_names_of_layers_keep_their_ends(viewer: Any, dock: SplinesketchDock) -> None:
    viewer.add_image(np.zeros((90, 120), np.float32), name="a film of swimming worms")
    viewer.add_shapes(name="a film of swimming worms sketches", ndim=2)
    dock.resize(250, 600)
    QTest.qWait(50)
    shown = []
    for choice in (dock.image, dock.sketches):
        option = QStyleOptionComboBox()
        choice.resize(110, 20)
        choice.initStyleOption(option)
        shown.append(option.currentText)
    assert shown[0] != shown[1]
    assert shown[0].startswith("a") and "…" in shown[0] and shown[0].endswith("s")
    assert dock.sketches.currentText() == "a film of swimming worms sketches"


@pytest.mark.slow
@pytest.mark.window(shown=True)
def test_buttons_of_a_narrow_panel_are_not_cut(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine
) -> None:
    viewer.window.resize(1100, 700)
    viewer.add_image(np.zeros((90, 120), np.float32), name="cells")
    viewer.add_shapes([[[20, 20], [20, 60]]], shape_type="line", name="cells sketches")
    refine(dock)
    click(dock.review)
    until(lambda: dock.panel is not None and dock.panel.isVisible(), 10)
    QTest.qWait(200)
    assert dock.panel is not None
    panel = dock.panel
    right = panel.mapTo(viewer.window._qt_window, panel.rect().topRight()).x()
    assert right <= dock.mapTo(viewer.window._qt_window, QPoint(0, 0)).x(), "beside the dock"
    for button in (*panel.judges.buttons.values(), panel.more, panel.count):
        assert button.width() >= button.fontMetrics().horizontalAdvance(button.text())

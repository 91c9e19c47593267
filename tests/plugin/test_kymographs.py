"""A body over its length and over the frames, in the review panel."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from napari_splinesketch.plugin.columns import RAMP
from napari_splinesketch.plugin.dock import SplinesketchDock
from napari_splinesketch.plugin.layers.space import Ruler
from napari_splinesketch.plugin.plots import Plot, pictures
from napari_splinesketch.plugin.review import ReviewPanel

from .fakes import FakeEngine, as_drawn
from .hand import QTest, refine, until

LINE = np.array([[20.0, 20], [20, 60]])


def drawn(panel: ReviewPanel) -> list[Plot]:
    return [plot for plot in panel.plots.shown if isinstance(plot, Plot)]


def test_pictures_are_in_the_unit_and_clear_where_there_is_no_curve() -> None:
    body = {t: as_drawn(LINE + np.array([0, 2.0 * t])) for t in (3, 4, 6)}
    curvature, speed, along, across = pictures(tuple(body.items()), Ruler((0.5, 0.5), "µm"))
    assert curvature.title == "Curvature (1/µm)"
    assert speed.frames == (3, 6)
    assert speed.distance[-1] == pytest.approx(20)
    np.testing.assert_allclose(along.values[:2], 1.0, atol=1e-6)
    np.testing.assert_allclose(across.values[:2], 0.0, atol=1e-6)
    np.testing.assert_array_equal(np.isnan(speed.values).all(1), [False, False, True, True])
    assert along.span == pytest.approx((-1.0, 1.0)), "zero is in the middle of the colours"
    assert speed.span[0] == 0
    assert pictures(((3, body[3]),), Ruler()) == ()


def test_pictures_are_worked_out_again_only_where_curves_are_others() -> None:
    body = {t: as_drawn(LINE + t) for t in range(3)}
    made = pictures(tuple(body.items()), Ruler())
    assert all(a is b for a, b in zip(made, pictures(tuple(body.items()), Ruler()), strict=True))
    body[1] = as_drawn(LINE)
    assert not np.array_equal(made[1].values, pictures(tuple(body.items()), Ruler())[1].values)
    assert pictures(tuple(body.items()), Ruler((0.5, 0.5), "µm"))[1].unit == "µm"


def test_the_panel_shows_the_selected_body_over_the_frames(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine
) -> None:
    viewer.add_image(np.zeros((4, 96, 128), np.float32), name="film", scale=(1, 0.5, 0.5))
    line = np.insert(LINE, 0, 0, axis=1)
    viewer.add_shapes([line], shape_type="line", name="film sketches", scale=(1, 0.5, 0.5))
    viewer.dims.set_point(0, 0)
    refine(dock)
    controller = dock.controller
    panel = ReviewPanel(controller)
    assert panel.plotted.isHidden(), "one frame is no film"
    (first,) = controller.records()
    moved = replace(first.curve, points=first.curve.points + np.array([0, 2]))
    work = controller.work
    assert work is not None
    state = work.state
    controller.apply("Track", replace(state, records=(first, replace(first, frame=1, curve=moved))))
    assert not panel.plotted.isHidden()
    controller.select([(1, first.id)])
    assert [plot.values.ndim for plot in drawn(panel)] == [1], "no model of that frame"
    panel.plotted.setCurrentIndex(1)
    panel.plotted.activated.emit(1)
    assert [p.title.split(" (")[0] for p in drawn(panel)] == ["Curvature", "Speed"]
    panel.show()
    until(lambda: [type(item).__name__ for item in panel.plots.ci.items] == ["PlotItem"] * 2)
    QTest.qWait(20)
    shown = panel.plots.grab().toImage()
    assert RAMP[-1] in {
        shown.pixelColor(x, y).name()
        for x in range(0, shown.width(), 3)
        for y in range(0, shown.height(), 5)
    }
    frames = next(iter(panel.plots.ci.items)).getAxis("left")
    for high in (2, 9):
        values = [v for _, some in frames.tickValues(-0.5, high, 120) for v in some]
        assert np.allclose(values, np.round(values)), "frames are whole"
    controller.apply("Delete", replace(state, records=(first, replace(first, frame=3))))
    controller.select([(0, first.id)])
    until(lambda: np.isnan(drawn(panel)[1].values).all(), 5)  # no speed is known, nor warned of
    QTest.qWait(100)
    other = replace(first, id=9, frame=1, curve=moved)
    controller.apply("Delete", replace(state, records=(first, other)))
    controller.select([(0, first.id)])
    assert not drawn(panel), "no other plot in its place"
    controller.apply("Delete", replace(state, records=(first,)))
    assert panel.plotted.isHidden()
    assert [plot.values.ndim for plot in drawn(panel)] == [1, 1], "there is nothing else to choose"


def test_the_panel_shows_a_body_over_time_where_there_are_planes_too(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine
) -> None:
    film = np.zeros((3, 4, 96, 128), np.float32)
    viewer.add_image(film, name="film", axis_labels=("t", "z", "y", "x"))
    viewer.add_shapes([np.insert(LINE, 0, [[0], [0]], axis=1)], shape_type="line",
                      name="film sketches")  # fmt: skip
    viewer.dims.set_point((0, 1), (0, 0))
    refine(dock)
    controller = dock.controller
    panel = ReviewPanel(controller)
    (first,) = controller.records()
    moved = replace(first.curve, points=first.curve.points + np.array([0, 2]))
    above = replace(first, frame=1, curve=replace(first.curve))
    later = replace(first, frame=4, curve=moved)
    assert controller.work is not None
    state = replace(controller.work.state, records=(first, above, later))
    controller.apply("Track", state)
    controller.select([(4, first.id)])
    panel.plotted.setCurrentIndex(1)
    panel.plotted.activated.emit(1)
    _, speed = drawn(panel)
    assert speed.frames == (0, 1)
    np.testing.assert_allclose(speed.values, 2, atol=1e-6)
    layer = controller.work.layer("curves")
    until(lambda: layer.features["speed"].round(3).fillna(-1).tolist() == [2, -1, 2])

"""The dock in a real window, worked with mouse and keys."""

import gc
import threading
from pathlib import Path
from typing import Any
from weakref import ref

import numpy as np
import pytest
from napari.layers._source import Source
from napari.settings import get_settings
from qtpy.QtCore import QPoint, QPointF, Qt
from qtpy.QtGui import QTextDocument, QWheelEvent
from qtpy.QtWidgets import QAbstractButton, QApplication, QComboBox, QFileDialog, QProgressBar

from napari_splinesketch.labels import read_labels
from napari_splinesketch.labels.formats import WRITERS
from napari_splinesketch.plugin.dock import SplinesketchDock
from napari_splinesketch.plugin.review import ReviewPanel
from napari_splinesketch.plugin.widgets import Column

from .fakes import FakeEngine
from .hand import (
    QTest,
    add_dock,
    assert_drawn,
    click,
    draw,
    drawn,
    fit_view,
    outlines,
    refine,
    refine_all,
    rest,
    until,
)

LINES = [np.array([[20.0, 20], [20, 60]]), np.array([[50.0, 30], [60, 70], [80, 80]])]


def image(viewer: Any, **how: Any) -> Any:
    rng = np.random.default_rng(0)
    return viewer.add_image(rng.normal(100, 5, (96, 128)).astype(np.float32), name="cells", **how)


def sketched(viewer: Any, **how: Any) -> Any:
    image(viewer)
    return viewer.add_shapes(LINES, shape_type=["line", "path"], name="cells sketches", **how)


@pytest.mark.window(shown=True)
def test_drawing_with_the_mouse_then_refine(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine
) -> None:
    image(viewer)
    fit_view(viewer)
    click(dock.draw)
    layer = viewer.layers["cells sketches"]
    assert dock.sketches.native.currentText() == "cells sketches"
    assert layer.mode == "add_line"
    assert viewer.layers.selection.active is layer
    for line in LINES:
        draw(viewer, layer, line)
    assert list(layer.shape_type) == ["line", "path"]
    assert dock.refine.text() == "Refine 2 new lines"
    before = drawn(layer)
    refine(dock)
    for line, curve in zip(LINES, viewer.layers["cells curves"].data, strict=True):
        # napari begins a dragged line with a length of its own, a fraction of a pixel.
        np.testing.assert_allclose(curve[[0, -1]], line[[0, -1]], atol=1)
    around = outlines(viewer.layers["cells outlines"])
    assert len(around) == 2
    for pieces in around:
        assert 4 <= len(pieces) < 68, "not more points than the eye sees"
    assert viewer.layers["cells reconstruction"].data.shape == (96, 128)
    for old, new in zip(before, layer.data, strict=True):
        np.testing.assert_array_equal(old, new)
    assert viewer.layers.selection.active is layer, "she can draw on at once"
    assert layer.mode == "add_polyline"
    assert threading.main_thread() is not fake.calls[0]["thread"]
    assert dock.results.text() == "2 good"
    assert "Refined 2 curves in " in dock.notice.text()


def test_a_selection_is_refined_alone_among_its_neighbours(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine
) -> None:
    layer = sketched(viewer)
    refine(dock)
    layer.mode = "select"
    layer.selected_data = {1}
    assert dock.refine.text() == "Refine 1 selected"
    refine(dock)
    assert len(fake.calls[1]["lines"]) == 1
    np.testing.assert_array_equal(fake.calls[1]["lines"][0], LINES[1])
    (neighbour,) = fake.calls[1]["fixed"]
    np.testing.assert_allclose(neighbour.points[[0, -1]], LINES[0])
    assert list(viewer.layers["cells curves"].features["id"]) == [1, 2]
    layer.mode = "add_line"
    assert not dock.refine.isEnabled(), "while drawing, the last line is selected"


def test_refining_again_updates_in_place(viewer: Any, dock: SplinesketchDock) -> None:
    layer = sketched(viewer)
    refine(dock)
    layers = list(viewer.layers)
    new = np.array([[90.0, 5], [90, 50]])
    layer.data = [(LINES[1] + 3, "path"), (LINES[0], "line"), (new, "line")]
    refine(dock)
    assert list(viewer.layers) == layers
    curves = viewer.layers["cells curves"]
    assert list(curves.features["id"]) == [1, 2, 3], "bodies keep their numbers"
    np.testing.assert_allclose(curves.data[0][[0, -1]], LINES[0][[0, -1]])
    np.testing.assert_allclose(curves.data[1][[0, -1]], LINES[1][[0, -1]] + 3)
    layer.selected_data = {1}
    layer.remove_selected()
    assert "Kept without their line until you delete them: curve 1." in dock.hint.text()
    refine_all(dock)
    assert list(curves.features["id"]) == [1, 2, 3], "nothing is dropped silently"
    assert len(outlines(viewer.layers["cells outlines"])) == 3


def test_status_is_told_by_colour_breadth_and_sign(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine
) -> None:
    sketched(viewer)
    fake.changes = {1: {"status": "check", "reasons": ("its ends <are> lost",)}}
    refine(dock)
    curves = viewer.layers["cells curves"]
    assert list(curves.features["status"]) == ["good", "check"]
    assert list(curves.features["reasons"]) == ["", "its ends <are> lost"]
    assert list(viewer.layers["cells marks"].text.values) == ["2 ?"]
    assert curves.edge_width[1] > curves.edge_width[0]
    assert not np.array_equal(curves.edge_color[0], curves.edge_color[1])
    assert dock.results.text() == "1 good · 1 to check"
    dock.controller.select([(0, 2)])
    assert dock.curve.title.text() == "Curve 2: to check"
    assert dock.hint.text() == "Curve 2: its ends &lt;are&gt; lost."
    dock.controller.review("accepted")
    assert dock.results.text() == "2 good", "nothing is left to check"
    until(lambda: not len(viewer.layers["cells marks"].data))
    dock.controller.undo()
    assert dock.results.text() == "1 good · 1 to check"
    until(lambda: list(viewer.layers["cells marks"].text.values) == ["2 ?"])


def test_shapes_that_are_no_lines_are_named(viewer: Any, dock: SplinesketchDock) -> None:
    layer = sketched(viewer)
    layer.add([[0, 0], [9, 9]], shape_type="rectangle")
    layer.add([[[0, 0], [9, 9]], [[30, 30], [40, 40]]], shape_type="ellipse")
    layer.add([[5, 5], [5, 9], [9, 9]], shape_type="polygon")
    layer.add([[5, 5], [5, 5.1]], shape_type="path")
    assert dock.refine.text() == "Refine 2 new lines"
    assert "Skipped: 1 stray click" in dock.hint.text()
    assert "Not usable: 1 rectangle, 2 ellipses, 1 polygon; draw" in dock.hint.text()
    refine(dock)
    assert viewer.layers["cells curves"].nshapes == 2
    assert viewer.layers["cells sketches"].nshapes == 7


def test_what_cannot_be_done_says_why(viewer: Any, dock: SplinesketchDock) -> None:
    assert not dock.refine.isEnabled()
    assert not dock.draw.isEnabled()
    assert "Open an image" in dock.refine.toolTip()
    assert "Open an image" in dock.hint.text()
    layer = image(viewer)
    assert "Press Draw lines" in dock.hint.text()
    click(dock.draw)
    assert "Nothing to refine yet" in dock.hint.text()
    assert not dock.export.isEnabled()
    assert "refine first" in dock.export.toolTip()
    viewer.layers["cells sketches"].add([[5, 5], [50, 50]], shape_type="line")
    assert dock.refine.isEnabled()
    assert not dock.hint.isVisible()
    viewer.dims.ndisplay = 3
    assert not dock.refine.isEnabled()
    assert not dock.draw.isEnabled()
    assert "2-D" in dock.hint.text()
    viewer.dims.ndisplay = 2
    assert dock.draw.isEnabled()
    viewer.layers.remove(layer)
    assert "Open an image" in dock.hint.text()


def test_lines_are_drawn_in_the_plane_of_the_frames(viewer: Any, dock: SplinesketchDock) -> None:
    viewer.add_image(np.zeros((4, 20, 30)), name="film")
    assert dock.draw.isEnabled()
    viewer.dims.roll()
    assert not dock.draw.isEnabled()
    assert "rolled" in dock.draw.toolTip()


def test_running_then_cancelled(viewer: Any, dock: SplinesketchDock, fake: FakeEngine) -> None:
    sketched(viewer)
    refine(dock)
    before = drawn(viewer.layers["cells curves"])
    fake.go.clear()
    fake.changes = {0: {"points": np.zeros((100, 2))}}
    dock.controller.refine("all")
    until(lambda: dock.bar.value() == 50)
    assert dock.progress.isVisible()
    assert dock.stage.text() == "Tracing bodies…"
    assert not dock.refine.isEnabled()
    assert "running" in dock.refine.toolTip()
    click(dock.cancel)
    assert dock.controller.progress is None
    assert "Cancelled" in dock.notice.text()
    assert not dock.refine.isEnabled(), "every line has its curve"
    assert not dock.progress.isVisible()
    until(lambda: fake.calls[-1].get("cancelled"), 2)
    QTest.qWait(100)
    for old, new in zip(before, viewer.layers["cells curves"].data, strict=True):
        np.testing.assert_array_equal(old, new)
    fake.go.set()
    refine_all(dock)
    assert "Refined 2 curves" in dock.notice.text()


def test_export_writes_what_is_shown(
    viewer: Any, dock: SplinesketchDock, tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    sketched(viewer)
    refine(dock)
    asked = []

    def ask(parent: Any, title: str, proposal: str, kinds: str) -> tuple[str, str]:
        asked.append(proposal)
        return str(tmp_path / "mine"), kinds

    monkeypatch.setattr(QFileDialog, "getSaveFileName", ask)
    dock.controller.review("accepted", (0, 2))
    click(dock.export)
    rest(dock)
    assert asked[0].endswith("cells_labels.csv")
    labels = read_labels(tmp_path / "mine.csv").labels
    assert [(label.frame, label.curve) for label in labels] == [(0, 1), (0, 2)]
    assert [label.review for label in labels] == ["open", "accepted"]
    for label, curve in zip(labels, viewer.layers["cells curves"].data, strict=True):
        assert len(label.points) == 100
        assert_drawn(curve, label.points)
    assert "Saved 2 curves to mine.csv" in dock.notice.text()
    dock.controller.export(tmp_path / "no such folder" / "x.csv")
    rest(dock)
    assert "Not saved: " in dock.notice.text() and "no such folder" in dock.notice.text()


def test_export_proposes_a_name_that_can_be_written(
    viewer: Any, dock: SplinesketchDock, monkeypatch: pytest.MonkeyPatch
) -> None:
    sketched(viewer)
    refine(dock)
    asked = []
    monkeypatch.setattr(
        QFileDialog, "getSaveFileName", lambda *given: asked.append(Path(given[2])) or ("", "")
    )
    image = dock.controller.image
    assert image is not None
    image.name = "plate.zarr/0: well?"
    click(dock.export)
    monkeypatch.setattr(image, "_source", Source(path="https://some.where/plate.zarr"))
    click(dock.export)
    assert asked == [Path.home() / "plate.zarr 0  well _labels.csv"] * 2


def test_export_proposes_the_image_s_own_folder_or_the_last_one(
    viewer: Any, dock: SplinesketchDock, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    sketched(viewer)
    refine(dock)
    asked = []
    monkeypatch.setattr(
        QFileDialog,
        "getSaveFileName",
        lambda *given: asked.append(Path(given[2]).parent) or (str(tmp_path / "a.csv"), ""),
    )
    image = dock.controller.image
    assert image is not None
    for path in (None, tmp_path / "plate" / "cells.tif", "https://some.where/plate.zarr"):
        if path is not None:
            (tmp_path / "plate").mkdir(exist_ok=True)
            monkeypatch.setattr(image, "_source", Source(path=str(path)))
        click(dock.export)
        rest(dock)
    assert asked[1:] == [tmp_path / "plate", tmp_path]


@pytest.mark.parametrize(
    ("typed", "kind", "written"),
    [
        ("a.geojson", "labels CSV (*.csv)", "a.geojson"),
        ("cells_labels.csv", "SWC (*.swc)", "cells_labels.swc"),
        ("a", "COCO keypoints (*.coco.json)", "a.coco.json"),
        ("A.CSV", "labels CSV (*.csv)", "A.CSV"),
        ("a.b", "ImageJ ROIs (*.zip)", "a.b.zip"),
        ("a.masks.tif", "napari Shapes CSV (*.shapes.csv)", "a.shapes.csv"),
        ("labels.json", "COCO keypoints (*.coco.json)", "labels.coco.json"),
        ("Labels.coco.json", "GeoJSON (*.geojson)", "Labels.geojson"),
        ("a.masks.tif", "labels CSV (*.csv)", "a.masks.tif"),
    ],
)
def test_export_in_another_format(
    viewer: Any,
    dock: SplinesketchDock,
    tmp_path: Any,
    monkeypatch: pytest.MonkeyPatch,
    typed: str,
    kind: str,
    written: str,
) -> None:
    sketched(viewer)
    refine(dock)
    offered = []

    def ask(parent: Any, title: str, proposal: str, kinds: str) -> tuple[str, str]:
        offered.extend(kinds.split(";;"))
        return str(tmp_path / typed), kind

    monkeypatch.setattr(QFileDialog, "getSaveFileName", ask)
    click(dock.export)
    rest(dock)
    assert kind in offered
    assert len(offered) == len(WRITERS)
    assert [path.name for path in tmp_path.iterdir()] == [written]
    said = dock.notice.text().replace("\u200b", "")
    assert f"Saved 2 curves to {written}." in said
    assert ("no place for" in said) == (written.endswith(".swc"))
    (tmp_path / written).write_text("mine")
    click(dock.export)
    rest(dock)
    asked_for = typed == written
    assert ((tmp_path / written).read_bytes() == b"mine") != asked_for
    said = dock.notice.text().replace("\u200b", "")
    assert (f"or type {written} in full to replace it" in said) != asked_for


def test_the_size_of_the_image_is_exported(
    viewer: Any, dock: SplinesketchDock, tmp_path: Any
) -> None:
    sketched(viewer)
    refine(dock)
    dock.controller.export(tmp_path / "a.geojson")
    rest(dock)
    assert read_labels(tmp_path / "a.geojson").shape == (96, 128)


def test_what_the_image_needed_unfolds(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine
) -> None:
    sketched(viewer)
    fake.notes = ("The background varies <much>.", "One half-width for each body is enough. " * 4)
    assert not dock.notes.isVisible()
    refine(dock)
    assert dock.notes.isVisible()
    text = dock.said
    assert not text.isVisible()
    click(dock.notes.title)
    assert "varies &lt;much&gt;.<br>" in text.text()
    dock.resize(250, 700)
    QTest.qWait(50)
    assert text.mapTo(dock, text.rect().topRight()).x() <= 250
    assert text.height() >= text.heightForWidth(text.width()), "all of it is seen"
    document = QTextDocument()
    document.setDocumentMargin(0)
    document.setDefaultFont(text.font())
    document.setHtml(text.text())
    document.setTextWidth(text.width())
    gap = text.height() - document.size().height()
    assert gap < text.fontMetrics().lineSpacing(), "and nothing around it"
    fake.notes = ()
    refine_all(dock)
    assert not dock.notes.isVisible()


def test_deleted_curves_stay_deleted_and_removed_ones_come_back(
    viewer: Any, dock: SplinesketchDock
) -> None:
    sketched(viewer)
    refine(dock)
    curves = viewer.layers["cells curves"]
    assert not curves.editable, "lines are drawn in the layer of sketches"
    dock.controller.delete((0, 1))
    until(lambda: dock.results.text() == "1 good")
    assert [record.id for record in dock.controller.records()] == [2]
    until(lambda: len(outlines(viewer.layers["cells outlines"])) == 1)
    viewer.layers.remove(curves)
    until(lambda: not dock.controller.records())
    assert not dock.results.isVisible()
    assert "Undo brings them back" in dock.notice.text()
    click(dock.undo)
    until(lambda: "cells curves" in viewer.layers and viewer.layers["cells curves"].nshapes == 1)
    until(lambda: len(outlines(viewer.layers["cells outlines"])) == 1)
    assert [record.id for record in dock.controller.records()] == [2]
    viewer.layers.remove(viewer.layers["cells curves"])
    until(lambda: not dock.controller.records())
    refine(dock)
    assert viewer.layers["cells curves"].nshapes == 2
    assert len(viewer.layers) == 7


def test_the_eye_buttons_and_the_layers_agree(viewer: Any, dock: SplinesketchDock) -> None:
    sketched(viewer)
    refine(dock)
    buttons = list(dock.eyes.buttons.values())[1:]
    assert [b.isChecked() for b in buttons] == [True, True, False]
    click(buttons[2])
    assert viewer.layers["cells reconstruction"].visible
    viewer.layers["cells curves"].visible = False
    assert [b.isChecked() for b in buttons] == [False, True, True]


@pytest.mark.window
@pytest.mark.parametrize("hidden", ["curves", "outlines"])
def test_curves_that_are_hidden_can_be_worked_on(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine, hidden: str
) -> None:
    fake.changes = {i: {"status": "check", "reasons": ("it is short",)} for i in (0, 1)}
    sketched(viewer)
    refine(dock)
    marks = viewer.layers["cells marks"]
    until(lambda: len(marks.data) == 2)
    viewer.layers[f"cells {hidden}"].visible = False
    dock.controller.delete((0, 1))
    rest(dock)
    until(lambda: not dock.controller.drawing.runs)
    assert dock.notice.text() == ""
    viewer.layers[f"cells {hidden}"].visible = True
    assert len(marks.data) == 1
    assert len(outlines(viewer.layers["cells outlines"])) == 1


@pytest.mark.slow
@pytest.mark.window(shown=True)
def test_every_control_has_a_tooltip_and_fits_250_pixels(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine
) -> None:
    layer = sketched(viewer)
    layer.name = "a name that is far longer than any dock of this world is wide"
    fake.changes = {0: {"status": "check", "reasons": ("something takes many words to tell",)}}
    fake.notes = ("Some sentence.",)
    refine(dock)
    for kind in (QAbstractButton, QComboBox, QProgressBar):
        for control in dock.content.findChildren(kind):
            assert control.toolTip(), control
    click(dock.settings.title)
    dock.controller.select([(0, 1)])
    dock.resize(250, 700)
    QTest.qWait(50)
    assert dock.minimumSizeHint().width() == 250  # napari gives a dock no more
    assert dock.content.width() <= 250
    assert dock.curve.isVisible()
    buttons = dock.content.findChildren(QAbstractButton)
    shown = [button for button in buttons if button.isVisible()]
    assert len(shown) > 6
    for control in shown:
        right = control.mapTo(dock, control.rect().topRight()).x()
        assert right <= 250
        assert control.width() >= min(control.sizeHint().width(), 60), control.text()


def test_a_large_font_makes_the_dock_wider(viewer: Any, dock: SplinesketchDock) -> None:
    sketched(viewer)
    refine(dock)
    dock.setStyleSheet("font-size: 16pt")  # as napari's preferences
    QTest.qWait(50)
    dock.resize(dock.minimumSizeHint().width(), 700)
    QTest.qWait(50)
    assert dock.review.mapTo(dock, dock.review.rect().topRight()).x() <= dock.width()


def test_a_low_dock_of_a_large_font_has_room_for_what_it_says(
    viewer: Any, dock: SplinesketchDock
) -> None:
    dock.setStyleSheet("font-size: 16pt")  # as napari's preferences
    dock.notice.say("<br>".join("abcd"))
    dock.hint.say("")
    QTest.qWait(50)
    dock.resize(1200, 10)
    QTest.qWait(50)
    assert dock.notice.height() >= 4 * dock.notice.fontMetrics().lineSpacing()


@pytest.mark.slow
@pytest.mark.window(shown=True)
@pytest.mark.parametrize("size", [9, 12, 20])
def test_the_legend_is_whole_in_any_size(viewer: Any, dock: SplinesketchDock, size: int) -> None:
    get_settings().appearance.font_size = size
    sketched(viewer)
    refine(dock)
    QTest.qWait(50)
    assert dock.legend.sizeHint().width() <= dock.legend.width()


def test_refine_says_what_it_would_do_whichever_layer_is_active(
    viewer: Any, dock: SplinesketchDock
) -> None:
    layer = sketched(viewer)
    layer.mode, layer.selected_data = "select", {1}
    until(lambda: dock.refine.text() == "Refine 1 selected", 5)
    viewer.layers.selection.active = viewer.layers["cells"]
    assert dock.refine.text() == "Refine 2 new lines"


def test_results_are_no_sketches_and_no_images(viewer: Any, dock: SplinesketchDock) -> None:
    sketched(viewer)
    refine(dock)
    assert [layer and layer.name for layer in dock.image.choices] == ["cells"]
    assert [layer and layer.name for layer in dock.sketches.choices] == ["cells sketches", None]


def test_draw_lines_goes_on_in_the_same_layer_and_the_combo_adds_one(
    viewer: Any, dock: SplinesketchDock
) -> None:
    layer = sketched(viewer)
    refine(dock)
    layer.mode = "select"
    click(dock.draw)
    assert viewer.layers.selection.active is layer
    assert layer.mode == "add_line"
    assert dock.controller.sketches is layer
    assert len(dock.controller.records()) == 2
    combo = dock.sketches.native
    combo.setCurrentIndex(combo.count() - 1)
    combo.activated.emit(combo.count() - 1)
    assert dock.controller.sketches is viewer.layers["cells sketches [1]"]


def test_without_an_image_the_combo_adds_no_layer_and_keeps_the_chosen_one(
    viewer: Any, dock: SplinesketchDock
) -> None:
    layer = viewer.add_shapes([np.array([[5.0, 5], [5, 40]])], shape_type="line")
    combo = dock.sketches.native
    combo.setCurrentIndex(combo.count() - 1)
    combo.activated.emit(combo.count() - 1)
    assert list(viewer.layers) == [layer]
    assert dock.controller.sketches is layer


def test_nothing_scrolls_or_moves_by_itself(viewer: Any, dock: SplinesketchDock) -> None:
    sketched(viewer)
    dock.resize(250, 500)
    QTest.qWait(50)
    column = dock.findChild(Column)
    assert column is not None and column.verticalScrollBar() is not None
    bar: Any = column.verticalScrollBar()
    places = [dock.refine.mapTo(dock, QPoint(0, 0)), dock.export.mapTo(dock, QPoint(0, 0))]
    refine(dock)
    dock.controller.select([(0, 1)])
    dock.controller.say("Something that takes a few words to say.")
    QTest.qWait(50)
    assert bar.value() == 0
    assert places == [dock.refine.mapTo(dock, QPoint(0, 0)), dock.export.mapTo(dock, QPoint(0, 0))]
    above = dock.curve.mapTo(dock, QPoint(0, 0)).y() - places[0].y() - dock.refine.height()
    assert 0 < above < 12, "the selected curve's buttons stand directly under Refine"
    dock.review.setFocus()
    dock.review.setEnabled(False)
    assert bar.value() == 0


def test_a_choice_with_the_mouse_leaves_the_keys_to_the_canvas(
    viewer: Any, dock: SplinesketchDock
) -> None:
    panel = ReviewPanel(dock.controller)
    boxes = [*dock.findChildren(QComboBox), *panel.findChildren(QComboBox)]
    assert len(boxes) == 7
    for box in boxes:
        assert box.focusPolicy() == Qt.FocusPolicy.TabFocus, "but the keyboard reaches them"


def test_the_wheel_scrolls_and_chooses_nothing(viewer: Any, dock: SplinesketchDock) -> None:
    sketched(viewer)
    before = dock.controller.settings, dock.sensitivity.value(), list(viewer.layers)
    forms = [made.native for made in dock.settings_form.widgets.values()]
    for box in (dock.image, dock.sketches, dock.sensitivity, *forms):
        middle, turned = QPointF(box.rect().center()), (QPoint(0, 0), QPoint(0, -120))
        no = Qt.MouseButton.NoButton, Qt.KeyboardModifier.NoModifier
        event = QWheelEvent(middle, middle, *turned, *no, Qt.ScrollPhase.NoScrollPhase, False)
        QApplication.sendEvent(box, event)
        assert not event.isAccepted(), "what is around it scrolls"
    assert (dock.controller.settings, dock.sensitivity.value(), list(viewer.layers)) == before


@pytest.mark.slow
def test_selectors_follow_the_layers(viewer: Any, dock: SplinesketchDock) -> None:
    first = sketched(viewer)
    second = viewer.add_shapes([[[0, 0], [30, 30]]], shape_type="line", name="more")
    assert dock.sketches.native.currentText() == "more"
    second.name = "other"
    assert dock.sketches.native.currentText() == "other"
    dock.sketches.native.setCurrentIndex(dock.sketches.native.findText("cells sketches"))
    dock.sketches.native.activated.emit(dock.sketches.native.currentIndex())
    assert dock.refine.text() == "Refine 2 new lines"
    viewer.layers.remove(first)
    assert dock.sketches.native.currentText() == "other"
    assert dock.refine.text() == "Refine 1 new line"
    viewer.layers.clear()
    assert not dock.image.native.isEnabled()
    assert not dock.sketches.native.isEnabled()


@pytest.mark.slow
@pytest.mark.window
def test_a_dock_that_is_opened_again_knows_the_results(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine
) -> None:
    sketched(viewer)
    refine(dock)
    viewer.window.remove_dock_widget(dock)
    again = SplinesketchDock(viewer)
    viewer.window.add_dock_widget(again, name="again")
    assert again.results.text() == "2 good"
    refine_all(again)
    assert len(viewer.layers) == 7


@pytest.mark.parametrize("theme", ["dark", "light"])
def test_text_can_be_read_in_both_themes(viewer: Any, dock: SplinesketchDock, theme: str) -> None:
    viewer.theme = theme
    sketched(viewer)
    refine(dock)
    QTest.qWait(50)
    picture = dock.results.grab().toImage()
    grey = [picture.pixelColor(x, 8).lightness() for x in range(picture.width())]
    assert max(grey) - min(grey) > 100


@pytest.mark.slow
@pytest.mark.garbage
def test_garbage_is_looked_for_among_what_is_new_until_a_layer_goes(
    viewer: Any, fake: FakeEngine
) -> None:
    image = ref(viewer.add_image(np.zeros((64, 64))))
    viewer.add_image(np.zeros((64, 64)))
    gc.unfreeze()
    dock = add_dock(viewer)
    until(gc.get_freeze_count, 5)
    del viewer.layers[0]
    assert not gc.get_freeze_count()
    until(lambda: gc.collect() >= 0 and image() is None, 5)
    gc.freeze()
    dock.hide()
    assert not gc.get_freeze_count()


@pytest.mark.parametrize("chosen", ["one", "two"])
def test_lines_of_another_image_do_not_take_the_place_of_those_that_are_removed(
    viewer: Any, dock: SplinesketchDock, chosen: str
) -> None:
    c = dock.controller
    for name in ("one", "two"):
        viewer.add_image(np.random.default_rng(0).random((60, 80)), name=name)
        viewer.add_shapes([[[5, 5], [50, 60]]], shape_type="line", name=f"{name} sketches")
    c.image, c.sketches = viewer.layers[chosen], viewer.layers[f"{chosen} sketches"]
    viewer.layers.remove(f"{chosen} sketches")
    assert c.image is viewer.layers[chosen]
    assert c.sketches is None
    c.draw()
    assert c.sketches is viewer.layers[f"{chosen} sketches"]

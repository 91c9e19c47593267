"""Layers on request: they lie on the image, say what they should, and cost nothing before."""

from collections import Counter
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from napari.layers import Image, Labels, Vectors
from qtpy.QtCore import QTimer

from napari_splinesketch import raster
from napari_splinesketch.engine import spline
from napari_splinesketch.plugin.dock import SplinesketchDock
from napari_splinesketch.plugin.files import labels_of_layer
from napari_splinesketch.plugin.layers import pictures
from napari_splinesketch.plugin.layers.looks import ribbon

from .fakes import FakeEngine, as_drawn, winding
from .hand import QTest, click, layer_named, refine, until

LINES = [np.array([[1.0, 20, 10], [1, 20, 50]]), np.array([[1.0, 5, 30], [1, 35, 30]])]
TURNED = {
    "scale": (2.0, 0.5, 0.8),
    "translate": (0, 5, -7),
    "rotate": np.array([[1, 0, 0], [0, 0.8, -0.6], [0, 0.6, 0.8]]),
    "units": ("s", "um", "um"),
}


def film(viewer: Any) -> Any:
    """Three frames with two crossing lines in the middle one."""
    pixels = np.random.default_rng(0).normal(100, 5, (3, 40, 60)).astype(np.float32)
    image = viewer.add_image(pixels, name="film", **TURNED)
    viewer.dims.set_point(0, 2)
    viewer.add_shapes(LINES, shape_type="line", name="film sketches", **TURNED)
    return image


def ask(dock: SplinesketchDock, proof: Any) -> None:
    dock.eyes.entries[proof].trigger()
    until(lambda: not dock.controller.drawing.runs, 5)


def assert_lies_on(layer: Any, image: Any) -> None:
    """Whatever the layer's own pixels: the same place in the world, in the same units."""
    point = (*[0] * (layer.ndim - image.ndim), 1, 12, 34)
    np.testing.assert_allclose(
        np.array(layer.data_to_world(point))[-3:], image.data_to_world(point[-3:])
    )
    assert layer.units[-3:] == image.units


def test_every_proof_lies_on_the_image(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine
) -> None:
    image = film(viewer)
    refine(dock)
    assert not any("residual" in layer.name for layer in viewer.layers)
    ask(dock, "residual")
    residual = layer_named(viewer, "film residual")
    assert_lies_on(residual, image)
    # The engine of these tests explains an image by its mean.
    pixels = image.data[1]
    np.testing.assert_allclose(residual.data[1], pixels - pixels.mean(), atol=1e-3)
    assert np.isnan(residual.data[0]).all()
    assert residual.contrast_limits[0] == -residual.contrast_limits[1], "centred on nothing"
    ask(dock, "background")
    np.testing.assert_allclose(
        layer_named(viewer, "film background").data[1], pixels.mean(), rtol=1e-6
    )
    ask(dock, "ribbon")
    lines = layer_named(viewer, "film uncertainty")
    assert_lies_on(lines, image)
    apart = np.linalg.norm(lines.data[10, 0] - lines.data[201 - 2 - 10, 0])
    np.testing.assert_allclose(apart, 4 * 0.1, rtol=1e-3)
    ask(dock, "masks")
    masks = layer_named(viewer, "film masks")
    assert_lies_on(masks, image)
    assert (masks.data[1][19:22, 12] == 1).all()
    assert (masks.data[1][7, 29:32] == 2).all()
    assert not masks.data[0].any()
    kinds = [type(layer) for layer in (residual, lines, masks)]
    assert kinds == [Image, Vectors, Labels]
    assert viewer.layers.selection.active.name == "film sketches", "she can draw on"


def test_masks_and_saved_layers_of_a_long_winding_curve_are_the_curve_s(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine
) -> None:
    viewer.add_image(np.zeros((200, 1600), np.float32), name="roots")
    viewer.add_shapes([LINES[0][:, 1:]], shape_type="line", name="roots sketches")
    fake.changes = {0: winding()}
    refine(dock)
    ask(dock, "masks")
    on_it = spline.sample(fake.changes[0]["knots"][:, :2], 2000).round().astype(int)
    assert np.asarray(layer_named(viewer, "roots masks").data)[tuple(on_it.T)].all()
    data, meta, _ = layer_named(viewer, "roots curves").as_layer_data_tuple()
    (label,) = labels_of_layer(data, meta).labels
    assert label.status == "good"
    np.testing.assert_array_equal(label.points, fake.changes[0]["points"])


def test_masks_are_drawn_a_few_bodies_at_a_time_and_shown_when_they_are_done(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine, monkeypatch: pytest.MonkeyPatch
) -> None:
    turns, drawn, one, timer, added = [0], Counter[int](), raster.rasterise, QTimer(), []
    timer.timeout.connect(lambda: turns.append(0))
    lines = [np.array([[row, 10.0], [row + 9, 60]]) for row in np.arange(0, 90, 3)]
    viewer.add_image(np.zeros((99, 80), np.float32), name="cells")
    viewer.add_shapes(lines, shape_type="line", name="cells sketches")
    refine(dock)
    monkeypatch.setattr(pictures, "AT_ONCE", 0.0)
    monkeypatch.setattr(raster, "rasterise", lambda *body: drawn.update([len(turns)]) or one(*body))
    timer.start(0)
    dock.eyes.entries["masks"].trigger()
    assert "cells masks" not in viewer.layers
    assert dock.eyes.entries["masks"].isChecked()
    viewer.layers.events.inserted.connect(lambda event: added.append(event.value.visible))
    until(lambda: not dock.controller.drawing.runs)
    masks = layer_named(viewer, "cells masks")
    assert masks.visible
    assert added == [False], "it is added hidden, and shown in another turn"

    def expected() -> np.ndarray:
        bodies = [(r.id, r.curve.points, r.curve.half_width) for r in dock.controller.records()]
        return raster.label_image(bodies, (99, 80), np.int32)

    most = max(drawn.values())
    np.testing.assert_array_equal(masks.data, expected())
    drawn.clear()
    dock.controller.delete((0, 5))
    until(lambda: not dock.controller.drawing.runs)
    assert max(most, *drawn.values()) <= 2, "also after an edit"
    np.testing.assert_array_equal(masks.data, expected())
    assert 5 not in np.asarray(masks.data)
    dock.eyes.entries["masks"].trigger()
    assert not masks.visible
    viewer.layers.remove(masks)
    for _ in range(2):  # asked for, and no longer
        dock.eyes.entries["masks"].trigger()
    QTest.qWait(50)
    assert "cells masks" not in viewer.layers


def test_proofs_follow_while_they_are_in_view(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine, monkeypatch: pytest.MonkeyPatch
) -> None:
    film(viewer)
    refine(dock)
    ask(dock, "masks")
    masks = layer_named(viewer, "film masks")
    assert masks.data[1][20, 12] == 1
    dock.controller.review("rejected", (1, 1))  # which Export leaves out, too
    until(lambda: masks.data[1][20, 12] == 0, 5)
    dock.controller.undo()
    until(lambda: masks.data[1][20, 12] == 1, 5)
    dock.controller.delete((1, 1))
    until(lambda: masks.data[1][20, 12] == 0, 5)
    masks.visible = False
    assert not dock.eyes.entries["masks"].isChecked()
    made = []
    maker = pictures.MAKERS["masks"]
    slow = replace(maker, make=lambda *known: made.append(1) or maker.make(*known))
    assert dock.controller.work is not None
    dock.controller.work.slots["masks"].maker = slow
    click(dock.undo)
    until(lambda: layer_named(viewer, "film curves").nshapes == 2, 5)
    QTest.qWait(100)
    assert not made, "nobody sees it"
    masks.visible = True
    assert made
    assert masks.data[1][20, 12] == 1
    viewer.layers.remove(masks)
    dock.controller.delete((1, 1))
    until(lambda: layer_named(viewer, "film curves").nshapes == 1, 5)
    assert "film masks" not in viewer.layers
    ask(dock, "masks")
    assert "film masks" in viewer.layers


def test_colours_tell_a_number_and_the_legend_its_range(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine
) -> None:
    film(viewer)
    fake.changes = {1: {"residual": 0.3, "status": "check", "reasons": ("it moved",)}}
    refine(dock)
    curves = layer_named(viewer, "film curves")
    assert "to check ?" in dock.legend.text()
    dock.colour_by.native.setCurrentIndex(1)
    until(lambda: curves.edge_color[0][0] > 0.9, 5)
    # Pixels are oblong: 40 px across are 32 µm, 30 px down are 15 µm.
    assert dock.legend.text().startswith("15.0 ")
    assert dock.legend.text().endswith(" 32.0 µm")
    np.testing.assert_allclose(curves.edge_color[:, :3] * 255, [[253, 231, 37], [65, 68, 135]])
    assert list(viewer.layers["film marks"].text.values) == ["2 ?"], "marks still tell the status"
    assert curves.edge_width[1] > curves.edge_width[0]
    unknown = as_drawn(LINES[0][:, 1:], sd=np.full(100, np.inf))
    assert ribbon(unknown) is None

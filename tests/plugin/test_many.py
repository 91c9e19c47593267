"""Many curves: they come and go a few at a time, and only those that changed."""

from typing import Any

import numpy as np

from napari_splinesketch.plugin.adapter.curve_lines import MARKED
from napari_splinesketch.plugin.dock import SplinesketchDock
from napari_splinesketch.plugin.gently import CHUNK

from .fakes import FakeEngine
from .hand import assert_drawn, click, refine, until


def test_many_curves_come_and_go_a_few_at_a_time(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine
) -> None:
    count = MARKED + 20
    rows = np.arange(count) * 4.0
    lines = [np.array([[row, 10.0], [row + 1, 60]]) for row in rows]
    viewer.add_image(np.zeros((900, 80), np.float32), name="cells")
    sketches = viewer.add_shapes(lines, shape_type="line", name="cells sketches")
    fake.changes = {3: {"status": "check", "reasons": ("why",)}}
    steps: list[int] = []
    refine(dock)
    curves = viewer.layers["cells curves"]
    assert curves.nshapes == count
    assert list(curves.features["id"]) == list(range(1, count + 1))
    assert not any(curves.text.values.tolist() if curves.text.values.size > 1 else [])
    kept = [id(data) for data in curves.data]
    curves.events.data.connect(lambda event: steps.append(len(event.data_indices)))
    dock.controller.delete((0, 5), (0, 9))
    until(lambda: curves.nshapes == count - 2, 30)
    assert 5 not in set(curves.features["id"])
    click(dock.undo)
    until(lambda: list(curves.features["id"])[-2:] == [5, 9], 30)
    assert curves.nshapes == count
    assert max(steps) <= CHUNK
    again = {id(data) for data in curves.data}
    assert len(again & set(kept)) == count - 2
    wanted = {record.id: record.curve.points for record in dock.controller.records()}
    for number, data in zip(curves.features["id"], curves.data, strict=True):
        assert_drawn(data, wanted[number])
    assert len(sketches.data) == count


def test_few_curves_keep_their_numbers_beside_them(
    viewer: Any, dock: SplinesketchDock, fake: FakeEngine
) -> None:
    viewer.add_image(np.zeros((90, 80), np.float32), name="cells")
    viewer.add_shapes([[[r, 9], [r, 60]] for r in (10, 30, 50)], shape_type="line")
    fake.changes = {1: {"status": "check", "reasons": ("why",)}}
    refine(dock)
    curves = next(layer for layer in viewer.layers if layer.name.endswith("curves"))
    assert curves.text.values.tolist() == ["", "2 ?", ""]
    dock.controller.delete((0, 1))
    until(lambda: curves.nshapes == 2, 30)
    until(lambda: curves.text.values.tolist() == ["2 ?", ""], 30)

"""How long the table and the plots take with many curves; run with

    python tests/plugin/measure_table.py [NUMBER]

on a display, or under xvfb-run.
"""

import argparse
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from fakes import FakeEngine
from hand import QTest, refine
from napari import Viewer
from napari.layers import Shapes
from qtpy.QtCore import Qt

from napari_splinesketch.plugin import engine
from napari_splinesketch.plugin.dock import SplinesketchDock

REPEATS = 20


def milliseconds(work: Callable[[int], object]) -> str:
    """Median and longest time of some calls, in words."""
    took = []
    for i in range(REPEATS):
        began = time.perf_counter()
        work(i)
        took.append(1000 * (time.perf_counter() - began))
    return f"median {np.median(took):.1f} ms, at most {max(took):.1f} ms"


def main(number: int) -> None:
    """Refine so many lines with an engine that answers at once, and look through them."""
    fake = FakeEngine()
    fake.go.set()
    fake.changes = {i: {"residual": i / number} for i in range(number)}
    engine.refine, engine.warm_up = fake.refine, lambda report: None
    viewer: Any = Viewer()
    viewer.add_image(np.random.default_rng(0).normal(100, 5, (1024, 1024)), name="cells")
    across = int(np.ceil(np.sqrt(number)))
    corners = [divmod(i, across) for i in range(number)]
    step = 1000 / across
    lines = [np.array([[step * r + 5, step * c + 2], [step * r + 9, step * c + 20]])
             for r, c in corners]  # fmt: skip
    viewer.layers.append(Shapes(lines, shape_type="line", name="cells sketches"))
    dock = SplinesketchDock(viewer)
    viewer.window.add_dock_widget(dock, name="Splinesketch")
    refine(dock)
    began = time.perf_counter()
    dock.review.click()
    QTest.qWait(1)
    print(f"{number} curves\nopening the panel: {time.perf_counter() - began:.2f} s")
    panel, controller = dock.panel, dock.controller
    assert panel is not None

    def draw(i: int) -> None:
        panel.show_selected()
        panel.plots.repaint()

    ids = [record.id for record in panel.model.records]
    print("selecting a curve:", milliseconds(lambda i: controller.select([(0, ids[i])])))
    print("drawing the plots:", milliseconds(draw))
    print("accepting a curve:", milliseconds(lambda i: dock.controller.actions.run("accept")))
    orders = Qt.SortOrder.AscendingOrder, Qt.SortOrder.DescendingOrder
    sort = panel.table.sortByColumn
    print("sorting the table:", milliseconds(lambda i: sort(4 + i % 5, orders[i % 2])))
    viewer.close()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("number", nargs="?", type=int, default=500, help="of curves")
    main(parser.parse_args().number)

"""Measure how long the window stands still with many curves in one frame.

    python tests/plugin/measure_many.py [--counts 10 100 1000] [--write]

For each action the longest gap between two ticks of a 5 ms timer, and in brackets the time that the
window's own thread was at work in the busiest gap: on an idle machine with a graphics card the two
are nearly the same; on a busy one, or where a program draws in the place of a card, the gap is
longer. Beside each number of curves, what napari takes for the like without us: for a bare layer of
as many lines of as many points. Sketches are lines of six points, as Suggest draws them; curves
have a hundred. The engine is a stand-in that answers at once, so that only the window is measured.
--write puts the table into docs/films.md.
"""

import argparse
import os
import sys
import tempfile
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import napari
import numpy as np
from fakes import FakeEngine, as_drawn
from hand import QTest, add_dock, canvas, canvas_point, click, draw
from napari.layers import Image, Shapes, Vectors
from qtpy.QtCore import Qt
from scipy.interpolate import CubicSpline
from ticks import Gap, watch

from napari_splinesketch.engine.types import Curve
from napari_splinesketch.plugin import engine
from napari_splinesketch.plugin.dock import SplinesketchDock

ROOT = Path(__file__).parents[2]
COUNTS = (10, 100, 1000)
SIZE = 1024
WORM = 30.0
BEND = 1.5
"""How far a worm turns from end to end, rad."""
PLOTS = "napari_splinesketch.plugin.plots"
CORNERS = 6
"""Points of a sketch."""

Act = Callable[..., None]


def bodies(count: int) -> list[np.ndarray]:
    """Arcs on a grid, each turned another way."""
    side = int(np.ceil(np.sqrt(count)))
    step = SIZE / side
    rng = np.random.default_rng(0)
    lines = []
    for i in range(count):
        middle = step * (np.array(divmod(i, side)) + 0.5)
        radius = min(WORM, 0.8 * step) / BEND
        angle = rng.uniform(0, 2 * np.pi) + np.linspace(-BEND / 2, BEND / 2, CORNERS)
        arc = radius * np.column_stack([np.sin(angle), np.cos(angle)])
        lines.append(arc - arc.mean(axis=0) + middle)
    return lines


def smooth(line: np.ndarray, **changes: Any) -> Curve:
    """Give the curve that runs through the corners of a line."""
    through = CubicSpline(np.linspace(0, 1, len(line)), line)
    return as_drawn(through(np.linspace(0, 1, 400)), **changes)


def picture() -> np.ndarray:
    """An image of noise."""
    return np.random.default_rng(0).normal(100, 5, (SIZE, SIZE)).astype(np.float32)


def with_us(count: int) -> dict[str, Gap]:
    """Do what a user does with so many curves; longest gap of each action, s."""
    made: list[np.ndarray] = bodies(count)
    fake = FakeEngine(curve=smooth)
    fake.go.set()
    fake.changes = {i: {"status": "check", "reasons": ("why",)} for i in range(0, count, 5)}
    # The dock imports the plots, too, before anybody presses Review.
    engine.refine, engine.warm_up = fake.refine, lambda report: import_module(PLOTS)
    engine.suggest = lambda *task: SimpleNamespace(choose=lambda sensitivity: tuple(made))

    def steps(viewer: Any, act: Act) -> None:
        dock = add_dock(viewer)
        QTest.qWait(1000)
        act("nothing", lambda: None)
        ours(viewer, dock, count, act)

    return measured(steps)


def without_us(count: int) -> dict[str, Gap]:
    """Do the like with layers of napari's alone."""
    return measured(lambda viewer, act: napari_alone(viewer, count, act))


def measured(steps: Callable[[Any, Act], None]) -> dict[str, Gap]:
    """Go through steps in a fresh window; longest gap of each, s."""
    viewer: Any = napari.Viewer()
    viewer.window.resize(1300, 860)
    viewer.add_image(picture(), name="cells")
    QTest.qWait(1000)
    viewer.reset_view()
    QTest.qWait(500)
    gaps: dict[str, Gap] = {}

    def act(
        name: str, action: Callable[[], object], done: Callable[[], bool] = lambda: True
    ) -> None:
        """Note the longest gap until something holds, and a little longer."""
        gaps[name] = watch(done, action)

    steps(viewer, act)
    viewer.close()
    return gaps


def ours(viewer: Any, dock: SplinesketchDock, count: int, act: Act) -> None:
    """Go through a user's hour."""
    controller = dock.controller

    def idle() -> bool:
        return controller.progress is None

    def shown(number: int) -> Callable[[], bool]:
        return lambda: (
            idle()
            and "cells curves" in viewer.layers
            and (viewer.layers["cells curves"].nshapes == number)
        )

    act("suggest", lambda: click(dock.suggest), idle)
    sketches = viewer.layers["cells sketches"]
    assert sketches.nshapes == count
    act("draw a line", lambda: draw(viewer, sketches, [(4, 4), (4, 40)]))
    act("refine", lambda: click(dock.refine), shown(count + 1))
    curves = viewer.layers["cells curves"]
    viewer.layers.selection.active = curves
    select(viewer, act, "select a curve, the first time", curves.data[count // 2])
    select(viewer, act, "select a curve", curves.data[count // 3])
    assert len(controller.selection) == 1, controller.selection
    act("open the table", lambda: click(dock.review), lambda: dock.panel is not None)
    act("accept, and on to the next", lambda: controller.actions.run("accept"))
    act("on to the next", lambda: controller.actions.run("next"))
    act("delete a curve", controller.delete, shown(count))
    act("undo", lambda: click(dock.undo), shown(count + 1))
    act("masks", dock.eyes.entries["masks"].trigger, lambda: not controller.drawing.runs)
    act("delete a curve, with masks", controller.delete, lambda: not controller.drawing.runs)
    act("hide the masks", dock.eyes.entries["masks"].trigger)
    act("zoom", lambda: setattr(viewer.scene.camera, "zoom", 5))
    act("hide the curves", lambda: setattr(curves, "visible", False))


def napari_alone(viewer: Any, count: int, act: Act) -> None:
    """Do with a bare layer what is most like each action."""
    layers = viewer.layers
    lines = bodies(count)
    curves = [smooth(line).points for line in lines]
    act("suggest", lambda: layers.append(Shapes(ndim=2, name="sketches")))
    sketches = layers["sketches"]
    sketches.add(lines, shape_type="path")
    QTest.qWait(500)
    act("draw a line", lambda: draw(viewer, sketches, [(4, 4), (4, 40)]))
    act("refine", lambda: layers.append(Image(picture(), name="reconstruction")))
    layers.append(Shapes(curves, shape_type="path", name="curves"))
    shapes = layers["curves"]
    shapes.mode = "select"
    QTest.qWait(500)
    mark = np.array([[[9.0, 9.0], [9.0, 9.0]]])
    act("select a curve, the first time", lambda: layers.append(Vectors(mark)))
    layers.selection.active = shapes
    select(viewer, act, "select a curve", curves[count // 3])
    act("on to the next", lambda: setattr(viewer.scene.camera, "center", (0, *lines[0][0])))
    act("delete a curve", shapes.remove_selected)
    act("undo", lambda: shapes.add(curves[count // 3], shape_type="path"))
    act("zoom", lambda: setattr(viewer.scene.camera, "zoom", 5))
    act("hide the curves", lambda: setattr(shapes, "visible", False))


def select(viewer: Any, act: Act, name: str, line: np.ndarray) -> None:
    """Click the middle of a line."""
    place = canvas_point(viewer, line[len(line) // 2])
    act(name, lambda: QTest.mouseClick(canvas(viewer), Qt.MouseButton.LeftButton, pos=place))


def table(counts: list[int]) -> str:
    """Measure, and write it as a table."""
    columns: dict[str, dict[str, Gap]] = {}
    for count in counts:
        columns[f"{count:,} curves"] = with_us(count)
        columns[f"napari, {count:,} lines"] = without_us(count)
    lines = [f"| action | {' | '.join(columns)} |", "|---" * (len(columns) + 1) + "|"]
    for name in next(iter(columns.values())):
        cells = [
            f"{1000 * gaps[name][0]:.0f} ({1000 * gaps[name][1]:.0f})" if name in gaps else "–"
            for gaps in columns.values()
        ]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measure, print, and write if asked to."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--counts", nargs="+", type=int, default=list(COUNTS))
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as home:
        # What is saved on the way is nobody's work.
        os.environ["XDG_DATA_HOME"] = home
        text = table(options.counts)
    print(text)
    if options.write:
        sys.path.insert(0, str(ROOT / "tests" / "benchmarks"))
        from insert import insert

        insert("many", text, ROOT / "docs" / "films.md")


if __name__ == "__main__":
    main()

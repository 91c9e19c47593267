"""Label the sample film from its first to its last frame with what the window offers.

    python docs/label_film.py [--frames N]

Suggest, correct the first frame by mouse and keys, Refine, Track to the end. Draws
docs/films/film.jpg. Needs a display; without one:
xvfb-run -s "-screen 0 1400x900x24" python docs/label_film.py
"""

import argparse
import shutil
import tempfile
from collections.abc import Sequence
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

import napari
import numpy as np
import skimage.io
from napari.layers import Shapes
from PIL import Image, ImageDraw
from qtpy.QtCore import QPoint, Qt
from window import QTest, click, live, refine, wait, widen

from napari_splinesketch.plugin.dock import SplinesketchDock
from napari_splinesketch.plugin.layers.space import go_to_frame
from napari_splinesketch.plugin.model import Record

OUT = Path(__file__).parent / "films"
SAMPLE = "worms_swimming.tif"
WRONG = [(135, 215), (129, 173)]
"""Points on suggestions in the first frame, one over two worms and one over half of one: seen by
looking, as the lines below."""
LINES = [
    [(140, 199), (135, 208), (134, 218), (137, 229)],
    [(133, 227), (143, 237), (147, 246), (144, 255)],
    [(127, 171), (136, 177), (141, 186), (147, 195)],
    [(203, 51), (206, 42), (209, 34), (206, 25)],
]
ZOOM = 2
SHOWN = (0, 2, 4, 6, 8, 10)
"""Frames in the strip."""


def canvas_point(viewer: Any, point: Sequence[float]) -> QPoint:
    """Give the pixel of the canvas where (row, col) is shown."""
    scene = viewer.window._qt_viewer.canvas.view.scene
    x, y, _, w = scene.transform.map([point[1], point[0], 0, 1])
    return QPoint(round(x / w), round(y / w))


def delete(viewer: Any, layer: Shapes, point: Sequence[float]) -> None:
    """Click on a line and press Delete."""
    before = layer.nshapes
    surface = viewer.window._qt_viewer.canvas.native
    viewer.layers.selection.active = layer
    layer.mode = "select"
    around = [(0, 0), *((r, c) for r in range(-3, 4) for c in range(-3, 4))]
    for row, column in around:
        QTest.mouseClick(
            surface,
            Qt.MouseButton.LeftButton,
            pos=canvas_point(viewer, (point[0] + row, point[1] + column)),
        )
        if layer.selected_data:
            break
    QTest.keyClick(surface, Qt.Key.Key_Delete)
    live(lambda: layer.nshapes < before, 10)
    if layer.nshapes != before - 1:
        raise SystemExit(f"There is no line at {point}")


def draw(viewer: Any, layer: Shapes, points: Sequence[Sequence[float]]) -> None:
    """Draw a polyline with the mouse."""
    surface = viewer.window._qt_viewer.canvas.native
    viewer.layers.selection.active = layer
    layer.mode = "add_polyline"
    for point in points:
        place = canvas_point(viewer, point)
        QTest.mouseMove(surface, place)
        wait(0.05)
        QTest.mouseClick(surface, Qt.MouseButton.LeftButton, pos=place)
    QTest.keyClick(surface, Qt.Key.Key_Return)
    wait(0.05)


def label(path: Path, last: int | None) -> tuple[SplinesketchDock, Any]:
    """Do what a user does."""
    viewer: Any = napari.Viewer()
    viewer.window.resize(1300, 1000)
    (image,) = viewer.open(path)
    dock = SplinesketchDock(viewer)
    viewer.window.add_dock_widget(dock, name="Splinesketch")
    wait(1.0)
    widen(viewer, dock)
    viewer.reset_view()
    go_to_frame(viewer, image, 0)
    wait(0.5)
    controller = dock.controller
    click(dock.suggest)
    live(lambda: controller.progress is None)
    layer = controller.sketches
    assert layer is not None
    for point in WRONG:
        delete(viewer, layer, point)
    for line in LINES:
        draw(viewer, layer, line)
    refine(dock)
    print(dock.notice.text(), dock.results.text(), flush=True)
    if last is not None:
        for _ in range(last):
            click(dock.track.buttons["next_frame"])
            live(lambda: controller.progress is None)
    else:
        click(dock.track.buttons["track"])
        live(lambda: controller.progress is None)
    print(dock.notice.text(), flush=True)
    return dock, viewer


def strip(film: np.ndarray, records: Sequence[Record], path: Path) -> None:
    """Draw the film with its curves, each body in its colour."""
    colours = np.random.default_rng(3).permutation(
        [f"hsl({hue}, 90%, {light}%)" for hue in range(0, 360, 24) for light in (38, 52)]
    )
    low, high = np.percentile(film, (0.2, 99.8))
    shown = [frame for frame in SHOWN if frame < len(film)]
    side = film.shape[1] * ZOOM
    sheet = Image.new("RGB", (3 * side, -(-len(shown) // 3) * side))
    for place, frame in enumerate(shown):
        grey = np.clip((film[frame] - low) / (high - low) * 255, 0, 255).astype(np.uint8)
        tile = Image.fromarray(grey).resize((side, side), Image.Resampling.BICUBIC).convert("RGB")
        pen = ImageDraw.Draw(tile)
        for record in records:
            if record.frame == frame:
                points = [((c + 0.5) * ZOOM, (r + 0.5) * ZOOM) for r, c in record.curve.points]
                colour = str(colours[record.id % len(colours)])
                pen.line(points, fill=colour, width=2)
                pen.text(points[50], str(record.id), fill=colour)
        pen.text((6, 4), f"frame {frame}", fill="black")
        sheet.paste(tile, (place % 3 * side, place // 3 * side))
    sheet.save(path, quality=85)


def main() -> None:
    """Label, and draw what came of it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, help="go only so many frames on")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / SAMPLE
        with as_file(files("napari_splinesketch.data") / SAMPLE) as sample:
            shutil.copy(sample, path)
        dock, viewer = label(path, options.frames)
        records = dock.controller.records()
        film = skimage.io.imread(path)
        wait(2.0)
        viewer.close()
    OUT.mkdir(exist_ok=True)
    strip(film, records, OUT / "film.jpg")


if __name__ == "__main__":
    main()

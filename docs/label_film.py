"""Label the sample film from its first to its last frame with what the window offers.

    python docs/label_film.py [--frames N]

Suggest, correct the first frame by mouse and keys, Refine, Track to the end; then the tracks are
judged: they are followed backwards from the last frame, and a body counts as kept that comes
back to where it began. Writes docs/films/film.jpg and the counts in
docs/films.md. Needs a display; without one:
xvfb-run -s "-screen 0 1400x900x24" python docs/label_film.py
"""

import argparse
import shutil
import sys
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
from napari_splinesketch.tracking import Body, View, follow

DOCS = Path(__file__).parent
PAGE, OUT = DOCS / "films.md", DOCS / "films"
SAMPLE = "worms_swimming.tif"
WRONG = [(135, 215), (229, 232), (212, 186)]
"""Points on suggestions in the first frame that run over two worms, or on into another: seen by
looking, as the lines below."""
LINES = [
    [(140, 199), (135, 208), (134, 218), (137, 229)],
    [(133, 227), (143, 237), (147, 246), (144, 255)],
    [(242, 203), (234, 208), (229, 217), (226, 226)],
    [(230, 222), (230, 232), (229, 241), (236, 251)],
    [(192, 178), (203, 181), (212, 189), (211, 198)],
    [(127, 171), (136, 177), (141, 186), (147, 195)],
    [(20, 128), (30, 125), (40, 122), (50, 116)],
    [(220, 75), (208, 77), (201, 82), (199, 92)],
    [(203, 51), (206, 42), (209, 34), (206, 25)],
]
SAME = 4.0
"""Mean distance at which a body followed backwards has come back to where it began, px."""
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


def label(path: Path, last: int | None) -> tuple[SplinesketchDock, Any, dict[str, int]]:
    """Do what a user does; gives the counts."""
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
    counts = {"suggested": layer.nshapes}
    for point in WRONG:
        delete(viewer, layer, point)
    for line in LINES:
        draw(viewer, layer, line)
    counts |= {"kept": counts["suggested"] - len(WRONG), "deleted": len(WRONG)}
    counts["drawn"] = layer.nshapes - counts["kept"]
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
    return dock, viewer, counts


def judge(film: np.ndarray, records: Sequence[Record]) -> dict[str, int]:
    """Follow the bodies of the last frame backwards; how many come back, and to whom."""
    last = max(record.frame for record in records)
    first = {r.id: r.curve.points for r in records if r.frame == 0}
    bodies = [Body(r.id, ((last, r.curve),)) for r in records if r.frame == last]
    frames = list(range(last - 1, -1, -1))
    *_, back = follow(frames, bodies, lambda frame, lines: View(film[frame]))
    kept, swapped = 0, 0
    for number, curve in zip(back.ids, back.curves, strict=True):
        apart = {n: _apart(curve.points, points) for n, points in first.items()}
        nearest = min(apart, key=lambda n: apart[n])
        kept += apart[number] < SAME
        swapped += nearest != number and apart[nearest] < SAME
    return {
        "bodies in the first frame": len(first),
        "arrived in the last frame": len(bodies),
        "flagged on the way": sum(_drifts(record) for record in records),
        "lost": len(first) - len(bodies),
        "came back to where they began": kept,
        "came back to another body (swapped)": swapped,
    }


def _apart(a: np.ndarray, b: np.ndarray) -> float:
    return min(float(np.linalg.norm(a - way, axis=1).mean()) for way in (b, b[::-1]))


def _drifts(record: Record) -> bool:
    return any("jumped" in r or "same body" in r for r in record.curve.reasons)


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
    """Label, judge, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, help="go only so many frames on")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / SAMPLE
        with as_file(files("napari_splinesketch.data") / SAMPLE) as sample:
            shutil.copy(sample, path)
        dock, viewer, counts = label(path, options.frames)
        records = dock.controller.records()
        OUT.mkdir(exist_ok=True)
        dock.controller.export(Path(folder) / "labels.csv")
        film = skimage.io.imread(path)
        counts |= judge(film, records)
        wait(2.0)
        viewer.close()
    strip(film, records, OUT / "film.jpg")
    table = "| what | how many |\n|---|---|\n"
    table += "".join(f"| {what} | {number} |\n" for what, number in counts.items())
    print(table)
    if options.frames is None:
        sys.path.insert(0, str(DOCS.parent / "tests" / "benchmarks"))
        from insert import insert

        insert("film", table, PAGE)


if __name__ == "__main__":
    main()

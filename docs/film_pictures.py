"""Make the pictures of the page of films: a body that hides is followed, and a kymograph.

    python docs/film_pictures.py [FOLDER]

Needs a display; without one: xvfb-run -s "-screen 0 1400x900x24" python docs/film_pictures.py
The settings and the saved work of whoever runs it are left alone.
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import window as w
from napari import Viewer
from PIL import Image, ImageDraw

from napari_splinesketch import refine
from napari_splinesketch.plugin.dock import SplinesketchDock
from napari_splinesketch.tracking import Body, View, follow

sys.path.append(str(Path(__file__).parents[1] / "tests" / "benchmarks"))
from generated_films import Film, film

HIDES, SHOWN = 7_004, (-4, -1, 1, 3, 5, 8)
"""The film in which a body hides, and frames of it: from the first in which it is hidden."""
SWIMS = 3
"""The film in which a body swims."""
COLOURS = ("#56b4e9", "#e69f00", "#009e73", "#d55e00")
ZOOM, DASH, CUT = 3, 5, (20, 40, 165, 155)
"""Size of a pixel; points of a dash where a curve is inferred; part of the frame that is shown,
first row and column and last ones."""


def hiding(path: Path) -> None:
    """Draw frames of a film with the curves of its bodies, dashed where they are inferred."""
    made = film(HIDES, motion="crawl", hidden=5)
    first = refine(made.images[0], [line[::11] for line in made.centrelines[0]])
    bodies = [Body(i, ((0, curve),)) for i, curve in enumerate(first.curves)]
    frames = range(1, len(made.images))
    tracked = {r.frame: r for r in follow(frames, bodies, lambda t, _: View(made.images[t]))}
    hidden = np.flatnonzero(~made.visible[:, 0].any(1))[0]
    tiles = [_tile(made, tracked[hidden + step]) for step in SHOWN]
    wide, high = tiles[0].size
    sheet = Image.new("RGB", (3 * wide, 2 * high))
    for place, tile in enumerate(tiles):
        sheet.paste(tile, (place % 3 * wide, place // 3 * high))
    sheet.save(path, quality=85)


def _tile(made: Film, result: Any) -> Image.Image:
    low, high = np.percentile(made.images, (0.2, 99.8))
    grey = np.clip((made.images[result.frame] - low) / (high - low) * 255, 0, 255).astype(np.uint8)
    size = grey.shape[1] * ZOOM, grey.shape[0] * ZOOM
    tile = Image.fromarray(grey).resize(size, Image.Resampling.BICUBIC).convert("RGB")
    pen = ImageDraw.Draw(tile)
    for number, curve in zip(result.ids, result.curves, strict=True):
        points = [((c + 0.5) * ZOOM, (r + 0.5) * ZOOM) for r, c in curve.points]
        inferred = any("inferred" in reason for reason in curve.reasons)
        step = DASH if inferred else len(points) - 1
        for start in range(0, len(points) - 1, 2 * step if inferred else step):
            pen.line(points[start : start + step + 1], fill=COLOURS[number], width=3)
    top, left, bottom, right = (ZOOM * edge for edge in CUT)
    tile = tile.crop((left, top, right, bottom))
    pen = ImageDraw.Draw(tile)
    pen.text((6, 4), f"frame {result.frame}", fill="white", stroke_width=2, stroke_fill="black")
    return tile


def kymograph(path: Path) -> None:
    """Track a film in the window, and take a picture of the panel with a body over the frames."""
    made = film(SWIMS, motion="swim", bodies=2, frames=40)
    viewer: Any = Viewer()
    viewer.window.resize(1300, 800)
    viewer.add_image(made.images, name="film")
    lines = [np.insert(line[::11], 0, 0, axis=1) for line in made.centrelines[0]]
    viewer.add_shapes(lines, shape_type="path", name="film sketches")
    dock = SplinesketchDock(viewer)
    viewer.window.add_dock_widget(dock, name="Splinesketch")
    viewer.dims.set_point(0, 0)
    w.wait(1.0)
    w.refine(dock)
    w.click(dock.track.buttons["track"])
    w.live(lambda: dock.controller.progress is None)
    w.click(dock.review)
    w.live(lambda: dock.panel is not None)
    panel: Any = dock.panel
    dock.controller.select([(20, 1)])
    panel.plotted.setCurrentIndex(1)
    panel.plotted.activated.emit(1)
    w.wait(0.5)
    panel.grab().save(str(path))
    viewer.close()


def main() -> None:
    """Make both pictures."""
    folder = w.folder(__doc__)
    kymograph(folder / "kymograph.png")
    hiding(folder / "hiding.jpg")


if __name__ == "__main__":
    main()

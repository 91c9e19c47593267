"""No more than the scene needs: the model as chosen against everything on, on the same frames.

    python tests/benchmarks models

Simple frames have one straight-ish body on an even background, without texture; complex ones three
bent bodies that cross, with texture, shading and a gradient. "Everything" has profiles of width
and brightness, a free background beside every body, and 16 knots. Written to
docs/benchmarks/models.csv.
"""

import csv
import time
from dataclasses import replace

import numpy as np
from result_tables import markdown
from rows import FOLDER

from napari_splinesketch import refine, synthetic
from napari_splinesketch.engine.settings import SETTINGS
from napari_splinesketch.metrics import average_dtw

PATH = FOLDER / "models.csv"
CHOSEN = SETTINGS["balanced"]
MODELS = {
    "as chosen": CHOSEN,
    "everything on": replace(CHOSEN, everything=True, knots=(16,)),
}
SCENES = {
    "simple": {"bodies": 1, "bend": 0.3, "texture": 0.0, "shading": 0.0, "gradient": (0.0, 0.0)},
    "complex": {"bodies": 3, "bend": 1.0, "texture": 0.2, "shading": 0.2, "gradient": (0.8, -0.5)},
}
HEADER = ["scene", "model", "frame", "ms", "dtw", "knots", "width", "brightness", "background"]


def run(frames: int) -> None:
    """Refine every frame with both models, one after the other."""
    with PATH.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(HEADER)
        for kind, options in SCENES.items():
            for seed in range(frames):
                made = synthetic.scene(seed + 900, **options)  # pyright: ignore[reportArgumentType]
                lines = [synthetic.rotate(c, 20) for c in made.centrelines]
                for name, settings in MODELS.items():
                    found, times = refine(made.image, lines, settings), []
                    for _ in range(3):
                        began = time.process_time()
                        found = refine(made.image, lines, settings)
                        times.append(time.process_time() - began)
                    pairs = zip(found.curves, made.centrelines, strict=True)
                    apart = np.mean([average_dtw(c.points, t) for c, t in pairs])
                    model = found.model
                    cost = f"{1e3 * np.median(times):.2f}", f"{apart:.4f}"
                    parts = max(model.knots), model.width, model.brightness, model.background
                    writer.writerow([kind, name, seed, *cost, *parts])


def table() -> str:
    """Medians over the frames; nothing where it has not been run."""
    if not PATH.exists():
        return "Not yet run."
    with PATH.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    body = []
    for kind in SCENES:
        for name in MODELS:
            mine = [r for r in rows if (r["scene"], r["model"]) == (kind, name)]

            def median(what: str, mine=mine) -> float:
                return float(np.median([float(row[what]) for row in mine]))

            def share(what: str, value: str, mine=mine) -> str:
                return f"{100 * np.mean([row[what] == value for row in mine]):.0f} %"

            shares = (
                share("width", "profile"),
                share("brightness", "profile"),
                share("background", "constant"),
            )
            medians = f"{median('ms'):.0f}", f"{median('dtw'):.2f}", f"{median('knots'):.0f}"
            body.append([kind, name, *medians, *shares])
    header = ["scene", "model", "ms a frame", "median DTW, px", "knots"]
    header += ["width profile", "brightness profile", "constant background"]
    return markdown(header, body)

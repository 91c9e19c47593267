"""Pictures of every image with its curves, and of what else a user would have got.

    python tests/benchmarks/real.py --gallery

Curves are kept in .cache/real, so that only what has changed is run again.
"""

from collections.abc import Sequence

import numpy as np
import real_methods
from PIL import Image, ImageDraw
from real_cases import FOLDERS, ROOT, Case, Line, in_folders
from real_judge import shares, verdict
from real_methods import LABELS, Found

FOLDER = ROOT / "docs" / "real"
CACHE = ROOT / ".cache" / "real"
METHODS = ("balanced", "minimal_path", "active_contour", "paper")
PAPERS = ("neurites", "tripod", "wormpose_00000", "worms_worme")
"""Images that show the paper's method, too."""
WIDTH, HEIGHT = 330, 400
"""Of one panel, px, at most."""
CAPTION = 16
COLOURS = {"good": (80, 230, 90), "short/long": (255, 190, 0)}
BAD, DRAWN, REFERENCE = (255, 70, 70), (0, 200, 255), (255, 255, 255)
PERCENTILES = (0.5, 99.6)
QUALITY = 82


def draw() -> None:
    """Draw one picture for each case that lies in the usual folders."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    for case in in_folders(FOLDERS):
        picture(case).save(FOLDER / f"{case.name}.jpg", quality=QUALITY, optimize=True)
        print(case.name, flush=True)


def picture(case: Case, methods: Sequence[str] = METHODS) -> Image.Image:
    """Sketches and references, then the curves of each method, side by side."""
    drawn = next(iter(case.sketches))
    scale = min(WIDTH / case.image.shape[1], HEIGHT / case.image.shape[0], 3.0)
    first = _panel(case, scale, "sketches (blue), references")
    for line in case.references:
        _stroke(first, line, scale, REFERENCE)
    for line in case.sketches[drawn]:
        _stroke(first, line, scale, DRAWN)
    panels = [first]
    for method in [m for m in methods if case.name in PAPERS or m != "paper"]:
        curves = found(method, case, drawn)
        judged = [
            verdict(*shares(f.curve, r, f.half_width))
            for f, r in zip(curves, case.references, strict=True)
        ]
        good = sum(v == "good" for v in judged)
        panel = _panel(case, scale, f"{LABELS[method]}: {good} of {len(judged)} good")
        for one, v in zip(curves, judged, strict=True):
            _stroke(panel, one.curve, scale, COLOURS.get(v, BAD), marked=one.status != "good")
        panels.append(panel)
    size = (sum(p.width + 4 for p in panels) - 4, panels[0].height)
    sheet = Image.new("RGB", size, "white")
    left = 0
    for panel in panels:
        sheet.paste(panel, (left, 0))
        left += panel.width + 4
    return sheet


def found(method: str, case: Case, drawn: str) -> list[Found]:
    """What a method makes of a set of sketches, from the cache if it is there."""
    version = real_methods.version(method)
    path = CACHE / f"{method}-{version}-{case.name}-{drawn}.npz"
    if not path.exists():
        curves = real_methods.RUNS[method](case, case.sketches[drawn])
        CACHE.mkdir(parents=True, exist_ok=True)
        arrays = {f"curve{i}": f.curve for i, f in enumerate(curves)}
        arrays["half_width"] = np.array([f.half_width for f in curves])
        arrays["status"] = np.array([f.status for f in curves])
        np.savez_compressed(path, **arrays)  # pyright: ignore[reportArgumentType]
    with np.load(path) as data:
        return [
            Found(data[f"curve{i}"], float(width), str(status))
            for i, (width, status) in enumerate(
                zip(data["half_width"], data["status"], strict=True)
            )
        ]


def _panel(case: Case, scale: float, caption: str) -> Image.Image:
    low, high = np.percentile(case.image, PERCENTILES)
    grey = 255 * np.clip((case.image - low) / (high - low), 0, 1)
    image = Image.fromarray(grey.astype(np.uint8))
    size = (round(image.width * scale), round(image.height * scale))
    panel = Image.new("RGB", (max(size[0], WIDTH // 2), size[1] + CAPTION), "white")
    panel.paste(image.resize(size, Image.Resampling.BICUBIC), (0, CAPTION))
    ImageDraw.Draw(panel).text((2, 2), caption, fill="black")
    return panel


def _stroke(
    panel: Image.Image,
    line: Line,
    scale: float,
    colour: tuple[int, int, int],
    *,
    marked: bool = False,
) -> None:
    """Draw a line; one that is marked is dashed."""
    points = (np.asarray(line)[:, ::-1] + 0.5) * scale + [0, CAPTION]
    pen = ImageDraw.Draw(panel)
    if not marked:
        pen.line([tuple(p) for p in points], fill=colour, width=2)
        return
    for piece in np.array_split(points, 15)[::2]:
        if len(piece) > 1:
            pen.line([tuple(p) for p in piece], fill=colour, width=2)

"""Real frames have no truth: how often do curves from jittered sketches agree?"""

import csv
import time
from dataclasses import asdict, dataclass, fields

import methods
import numpy as np
import perturbations
from stability_rows import FOLDER

from napari_splinesketch import refine, synthetic
from napari_splinesketch.data import IMAGES, load_sample
from napari_splinesketch.metrics import average_dtw

PATH = FOLDER / "real.csv"
REPEATS = 8
AGREE = 1.0
"""Curves that are nearer to each other than this, px of average DTW, agree."""


@dataclass(frozen=True)
class Line:
    """One body.

    Attributes
    ----------
    version, sample, frame, body
        Which.
    agreeing
        Share of pairs of curves, from different jittered sketches, that agree.
    marked
        Share of the curves that are marked.
    marked_apart
        Share of marked curves among those that lie apart from most of the others.
    apart
        Share of curves that lie apart from most of the others.
    """

    version: str
    sample: str
    frame: int
    body: int
    agreeing: float
    marked: float
    apart: float
    marked_apart: float


def jittered(rng: np.random.Generator, sketch: np.ndarray) -> np.ndarray:
    """Turn a sketch by up to 15 degrees, stretch it by up to a fifth, move it by up to 3 px."""
    turned = synthetic.rotate(sketch, rng.uniform(-15, 15))
    stretched = perturbations.scale(turned, rng.uniform(0.8, 1.2))
    return perturbations.displace(stretched, 3 * rng.random(), rng)


def run(deadline: float) -> None:
    """Refine the shipped sketches of the shipped frames, jittered, unless that was done."""
    version = methods.make("balanced").version
    if [line for line in read() if line.version == version]:
        return
    lines = []
    for sample in IMAGES:
        image, sketches = load_sample(sample)
        frames = [(0, image)] if image.ndim == 2 else list(enumerate(image))
        for number, frame in frames:
            here = [s for s in sketches if s.shape[1] == 2 or s[0, 0] == number]
            if here and time.monotonic() < deadline:
                flat = [s[:, -2:] for s in here]
                lines += _agreement(version, sample, number, frame, flat)
    _write(lines)


def _agreement(version: str, sample: str, number: int, frame, sketches) -> list[Line]:
    rng = np.random.default_rng(number)
    runs = [refine(frame, [jittered(rng, s) for s in sketches]).curves for _ in range(REPEATS)]
    lines = []
    for body in range(len(sketches)):
        curves = [curves[body] for curves in runs]
        near = np.array([[average_dtw(a.points, b.points) < AGREE for b in curves] for a in curves])
        marked = np.array([c.status != "good" for c in curves])
        others = (near.sum(1) - 1) / (REPEATS - 1)
        apart = others < 0.5
        lines.append(
            Line(
                version, sample, number, body, float(others.mean()), float(marked.mean()),
                float(apart.mean()), float(marked[apart].mean()) if apart.any() else float("nan"),
            )
        )  # fmt: skip
    return lines


def _write(lines: list[Line]) -> None:
    PATH.parent.mkdir(parents=True, exist_ok=True)
    with PATH.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, [f.name for f in fields(Line)], lineterminator="\n")
        writer.writeheader()
        for line in lines:
            row = asdict(line)
            writer.writerow({k: f"{v:.3f}" if isinstance(v, float) else v for k, v in row.items()})


_PARSE = {str: str, int: int, float: float}


def read() -> list[Line]:
    """Lines on disk."""
    if not PATH.exists():
        return []
    with PATH.open(newline="", encoding="utf-8") as file:
        return [
            Line(**{f.name: _PARSE[f.type](record[f.name]) for f in fields(Line)})
            for record in csv.DictReader(file)
        ]


def table() -> str:
    """How often curves agree, for each sample."""
    header = ["frame", "bodies", "pairs that agree", "bodies where all agree", "curves marked",
              "curves apart from most", "of those marked"]  # fmt: skip
    rows = ["| " + " | ".join(header) + " |", "|---" * len(header) + "|"]
    for sample in IMAGES:
        mine = [line for line in read() if line.sample == sample]
        if not mine:
            continue
        apart = np.array([line.apart for line in mine])
        caught = np.nansum(apart * [line.marked_apart for line in mine])
        cells = [
            f"`{sample}`",
            str(len(mine)),
            *(
                f"{100 * share:.0f} %"
                for share in (
                    np.mean([line.agreeing for line in mine]),
                    np.mean([line.agreeing == 1 for line in mine]),
                    np.mean([line.marked for line in mine]),
                    apart.mean(),
                )
            ),
            f"{100 * caught / apart.sum():.0f} %" if apart.any() else "–",
        ]
        rows.append("| " + " | ".join(cells) + " |")
    return "\n".join(rows) + "\n"

"""How many bodies are suggested: against worms judged by eye, and against generated scenes.

    python tests/benchmarks/suggested.py

Prints the figures, and writes docs/films/suggested.csv and the table in docs/films.md. The judged
worms are in tests/data/worms_dense_judged.csv, marked by eye on enlarged crops of the sample:
`isolated` ones stay 4 px clear of any other; `touching` ones can be told from their neighbours;
`cut` ones leave the frame; `crowd` gives two corners of a rectangle where bodies lie on each
other. Suggestions whose middle is in a crowd are not judged there, unless they are on a worm.
"""

import argparse
import csv
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import groupby
from pathlib import Path

import numpy as np
from insert import insert

from napari_splinesketch import suggest, synthetic
from napari_splinesketch.data import load_sample
from napari_splinesketch.metrics import average_dtw

ROOT = Path(__file__).parents[2]
JUDGED = ROOT / "tests" / "data" / "worms_dense_judged.csv"
OUT = ROOT / "docs" / "films" / "suggested.csv"
PAGE = ROOT / "docs" / "films.md"
FOUND = 4.0
"""Average DTW at which a suggestion is on a worm that was marked with a few clicks, px."""
GENERATED = 3.0
"""The same where the truth is exact; the ends of a line are not looked for, px."""
SENSITIVITIES = (0.2, 0.35, 0.5, 0.65, 0.8)
BODIES = (1, 2, 3, 6)
SEEDS = range(48)

Line = np.ndarray


@dataclass(frozen=True)
class Row:
    """One line of the table.

    Attributes
    ----------
    image
        What was looked at.
    sensitivity
        As given to `suggest`.
    bodies
        How many there are to be found.
    found
        How many of them are.
    suggested
        How many suggestions are judged.
    false
        How many of those are on no body.
    """

    image: str
    sensitivity: float
    bodies: int
    found: int
    suggested: int
    false: int


def judged() -> dict[str, list[Line]]:
    """Read the marks by kind."""
    with JUDGED.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    marks: dict[str, list[Line]] = {}
    for (_, kind), points in groupby(rows, key=lambda row: (row["number"], row["kind"])):
        line = np.array([[float(p["row"]), float(p["col"])] for p in points])
        marks.setdefault(kind, []).append(line)
    return marks


def on(suggested: Sequence[Line], bodies: Sequence[Line], reach: float) -> set[tuple[int, int]]:
    """Pairs of a suggestion and the body that it lies on, along all of both."""
    pairs = set()
    for i, line in enumerate(suggested):
        for k, body in enumerate(bodies):
            close = np.linalg.norm(line.mean(0) - body.mean(0)) < 5 * reach
            if close and min(average_dtw(line, b) for b in (body, body[::-1])) < reach:
                pairs.add((i, k))
    return pairs


def worms(sensitivity: float) -> Row:
    """Judge the suggestions on the sample."""
    image, _ = load_sample("worms_dense")
    marks = judged()
    lines = suggest(image, sensitivity)
    isolated = on(lines, marks["isolated"], FOUND)
    others = on(lines, [*marks["touching"], *marks["cut"]], FOUND)
    boxes = np.array(marks["crowd"])
    good = {i for i, _ in isolated | others}
    rest = [i for i in range(len(lines)) if i not in good and not _inside(lines[i], boxes)]
    found = len({k for _, k in isolated})
    judged_here = len(good) + len(rest)
    return Row("worms_dense", sensitivity, len(marks["isolated"]), found, judged_here, len(rest))


def _inside(line: Line, boxes: np.ndarray) -> bool:
    middle = line[len(line) // 2]
    return bool(((boxes[:, 0] <= middle) & (middle <= boxes[:, 1])).all(1).any())


def generated(bodies: int, sensitivity: float) -> Row:
    """Judge the suggestions on generated frames."""
    total = found = lines = false = 0
    for seed in SEEDS:
        made = synthetic.scene(seed, bodies=bodies)
        suggested = suggest(made.image, sensitivity)
        pairs = on(suggested, made.centrelines, GENERATED)
        total += bodies
        found += len({k for _, k in pairs})
        lines += len(suggested)
        false += len(suggested) - len({i for i, _ in pairs})
    return Row(f"generated, {bodies} a frame", sensitivity, total, found, lines, false)


def main() -> None:
    """Measure, print and write."""
    rows = [worms(s) for s in SENSITIVITIES] + [generated(n, 0.5) for n in BODIES]
    OUT.parent.mkdir(exist_ok=True)
    with OUT.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(asdict(rows[0])), lineterminator="\n")
        writer.writeheader()
        writer.writerows(asdict(row) for row in rows)
    table = "| image | sensitivity | found | false lines |\n|---|---|---|---|\n"
    for row in rows:
        found = f"{row.found} of {row.bodies} ({row.found / row.bodies:.0%})"
        false = f"{row.false} of {row.suggested}"
        table += f"| {row.image} | {row.sensitivity} | {found} | {false} |\n"
    print(table)
    insert("suggested", table, PAGE)


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_args()
    main()

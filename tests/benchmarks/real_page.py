"""Writes the tables and the chart of docs/real.md from the rows of earlier runs.

python tests/benchmarks/real.py --page
"""

import math
from collections.abc import Callable, Sequence
from statistics import median
from typing import Any

import matplotlib.pyplot as plt
import real_modes
from insert import insert
from real_cases import FOLDERS, RIGHT, ROOT, Case, in_folders
from real_foreign import NAME
from real_judge import Row, Summary, summary
from real_methods import LABELS

PAGE = ROOT / "docs" / "real.md"
CHART = ROOT / "docs" / "benchmarks" / "real.svg"
OURS = "balanced"
NONE = "–"


def write(rows: Sequence[Row], cases: Sequence[Case]) -> None:
    """Write all of it."""
    insert("methods", methods_table(rows), PAGE)
    insert("targets", targets_table(rows), PAGE)
    insert("cases", cases_table(rows, cases), PAGE)
    insert("gallery", gallery(), PAGE)
    chart(rows)


def write_lines(kind: str, rows: Sequence[Row]) -> None:
    """Write the table of sketches of one kind: straight lines, or lines drawn in one stroke."""
    insert(kind, methods_table(rows), PAGE)


def write_fresh(rows: Sequence[Row], cases: Sequence[Case]) -> None:
    """Write the section of the images that nothing was chosen on."""
    insert("fresh", fresh_tables(rows, cases), PAGE)


def _of(rows: Sequence[Row], method: str, *, right: bool = False, **wanted: object) -> Summary:
    """Sum up the rows of a method whose fields have the wanted values."""
    return summary(
        [
            row
            for row in rows
            if row.method == method
            and (row.sketches == RIGHT) == right
            and all(value(row) == wanted[key] for key, value in FIELDS.items() if key in wanted)
        ]
    )


FIELDS: dict[str, Callable[[Row], object]] = {
    "generated": lambda row: row.case.startswith(NAME),
    "split": lambda row: row.split,
    "case": lambda row: row.case,
    "sketches": lambda row: row.sketches,
}


def _percent(value: float) -> str:
    return NONE if value != value else f"{value:.0f} %"


def _table(head: str, lines: Sequence[str]) -> str:
    ruler = "|".join(["---"] * (head.count("|") + 1))
    return "\n".join([f"| {head} |", f"|{ruler}|", *(f"| {line} |" for line in lines)]) + "\n"


def methods_table(rows: Sequence[Row]) -> str:
    """How much each method finds, loses, marks and spoils, in each part of the images."""
    lines = []
    for generated in (False, True):
        for split in ("tune", "held"):
            for method in [m for m in LABELS if any(r.method == m for r in rows)]:
                line = _method(rows, method, generated=generated, split=split)
                if line:
                    what = ("generated" if generated else "real") + ", " + split
                    lines.append(f"{what} | {line}")
    return _table(f"images | {METHOD}", lines)


METHOD = (
    "method | bodies | good | lost | bad ones marked | good ones marked | right sketches made wrong"
)


def _method(rows: Sequence[Row], method: str, **wanted: Any) -> str:
    """What a table says of a method under `METHOD`; nothing where it was not run."""
    s, right = _of(rows, method, **wanted), _of(rows, method, right=True, **wanted)
    speaks = method not in ("as_drawn", "minimal_path", "active_contour")
    marks = [s.bad_marked, s.good_marked] if speaks else [float("nan")] * 2
    shares = [s.good, s.lost, *marks, right.spoilt]
    return " | ".join([LABELS[method], str(s.bodies), *map(_percent, shares)]) if s.bodies else ""


def fresh_tables(rows: Sequence[Row], cases: Sequence[Case]) -> str:
    """How far the methods get, how often the minimal path is better, and a line for each image."""
    drawn = dict.fromkeys(row.sketches for row in rows if row.sketches != RIGHT)
    parts = {"all": {}} | {name: {"sketches": name} for name in drawn}
    found = [(what, _method(rows, m, **part)) for what, part in parts.items() for m in LABELS]
    said = _table(f"sketches | {METHOD}", [f"{what} | {line}" for what, line in found if line])
    better = f"The minimal path is better in {_better(rows)} of {len(cases)} images."
    lines = []
    for case in cases:
        s, path = (_of(rows, method, case=case.name) for method in (OURS, "minimal_path"))
        shares = map(_percent, [s.good, s.lost, path.good])
        lines.append(" | ".join([case.name, case.what, case.source, case.licence, *shares]))
    table = _table("case | what | source | licence | good | lost | minimal path good", lines)
    return f"{said}\n{better}\n\n{table}" if rows else table


def _better(rows: Sequence[Row]) -> int:
    """In how many real images the minimal path finds more."""
    return sum(
        _of(rows, "minimal_path", case=name).good > _of(rows, OURS, case=name).good
        for name in {row.case for row in rows if not row.case.startswith(NAME)}
    )


def cases_table(rows: Sequence[Row], cases: Sequence[Case]) -> str:
    """A line for each image."""
    lines = []
    for case in cases:
        s = _of(rows, OURS, case=case.name)
        others = [_of(rows, m, case=case.name).good for m in ("minimal_path", "active_contour")]
        shares = [s.good, s.lost, *others]
        what = [case.name, case.what, case.source, case.licence, case.split]
        lines.append(" | ".join([*what, *map(_percent, shares)]))
    head = "case | what | source | licence | split | good | lost"
    return _table(f"{head} | minimal path good | active contour good", lines)


def targets_table(rows: Sequence[Row]) -> str:
    """What was asked for, and what a run gave."""
    modes = {row[:2]: float(row[2]) for row in real_modes.read()}

    def mode(name: str, figure: str, unit: str = " %") -> str:
        value = modes.get((name, figure), math.nan)
        return NONE if math.isnan(value) else f"{value:.3g}{unit}"

    real, path = _of(rows, OURS, generated=False), _of(rows, "minimal_path", generated=False)
    right = [_of(rows, OURS, right=True, generated=g) for g in (False, True)]
    biases = [value for (name, _), value in modes.items() if name == "ends"]
    lines = [
        "real images: good / lost | 31 / 41 % | ≥ 85 / ≤ 3 % | "
        f"{real.good:.0f} / {real.lost:.0f} %",
        "bad ones marked / good ones marked | 95 / 57 % | ≥ 90 / ≤ 15 % | "
        f"{real.bad_marked:.0f} / {real.good_marked:.0f} %",
        "right sketches (1 px off) made wrong, real / generated; unmarked | 36 % | ≤ 1 %, none | "
        + " / ".join(f"{s.spoilt:.1f} %" for s in right)
        + "; "
        + " / ".join(f"{s.spoilt_silently:.1f} %" for s in right),
        "minimal path between the sketch's ends, real images: good | better in some | "
        f"never better | {path.good:.0f} %; better in {_better(rows)} images",
        f"`suggest`, reference bodies found; slowest image | 15 % | ≥ 60 %, 3 s | "
        f"{mode('suggest', 'found, %')}; {mode('suggest', 'slowest image, s', ' s')}",
        f"crowd, one or two of three sketched: lost | 39 % | ≤ 6 % | {mode('crowd', 'lost, %')}",
        "one of five flat bodies side by side sketched, clicked / straight: wrong place or "
        "half-width | 18 / 23 % | – | "
        + " / ".join(
            mode("packed", f"{kind}: lost or of wrong half-width, %")
            for kind in ("clicked", "straight")
        ),
        "order, orientation: curves that move over 0.1 px; largest move unmarked | 60 % | "
        f"≤ 2 %, 0.5 px | {mode('order', 'moved over 0.1 px, %')}; "
        f"{mode('order', 'largest unmarked, px', ' px')}",
        "real images multiplied by 3.7: curves that move over 0.1 / 1 px | 30 / 11 % | – | "
        f"{mode('rounding', 'moved over 0.1 px, %')} / {mode('rounding', 'moved over 1 px, %')}",
        f"22 half-widths and lengths | 18 of 22 | all | {mode('sizes', 'good', '')} of 22",
        "ends on tapers of other shapes, bias | −1.5 px | within ± 0.3 px | "
        + (f"{min(biases):+.2f} to {max(biases):+.2f} px" if biases else NONE),
        "twice the noise, two bodies: lost; of those marked | 22 % | ≤ 10 %, marked | "
        f"{mode('contrast', 'lost, %')}; {mode('contrast', 'lost ones marked, %')}",
    ]
    return _table("what | before | target | measured", lines)


def gallery() -> str:
    """A picture for each image."""
    parts = [
        f"### {case.name}\n\n{case.what}\n\n![{case.kind}](real/{case.name}.jpg)\n"
        for case in in_folders(FOLDERS)
    ]
    return "\n".join(parts)


def chart(rows: Sequence[Row]) -> None:
    """Share of good curves against seconds a body, one point a method."""
    plt.rcParams["svg.hashsalt"] = "real"
    figure, axes = plt.subplots(figsize=(6, 3.6), layout="constrained")
    for method in LABELS:
        mine = [
            r
            for r in rows
            if r.method == method and r.sketches != RIGHT and not r.case.startswith(NAME)
        ]
        runs = {(r.case, r.sketches): r.seconds for r in mine}
        if mine and method != "as_drawn":
            counts = {key: sum((r.case, r.sketches) == key for r in mine) for key in runs}
            seconds = median(runs[key] / counts[key] for key in runs)
            good = summary(mine).good
            axes.plot(seconds, good, "o")
            axes.annotate(
                LABELS[method], (seconds, good), (0, -15), textcoords="offset points", ha="center"
            )
    axes.margins(x=0.5)
    axes.set(xlabel="seconds a body", ylabel="good, %", xlim=(0, None), ylim=(0, 100))
    figure.savefig(CHART, metadata={"Date": None})
    plt.close(figure)

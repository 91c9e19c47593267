"""The tables of the report, as Markdown and CSV."""

import csv
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from collect import Results
from frames import COUNTS, TABLE_KINDS, Cell, line_cells, sweep_cells, table_cells
from methods import LABELS
from stats import Summary

PERCENTILES = (5, 10, 20, 50)
KIND_NAMES = {
    "rotation": "rotated {:g}°",
    "displacement": "displaced {:g} px",
    "scaling": "scaled × {:g}",
    "pca": "PCA k = {:g}",
    "chord": "line between the ends",
    "axis": "line along the main axis",
}

# What the paper prints: Table 1, (initial, the paper's method, active contour) by bodies and kind
# of sketch; Table 2, the same at `PERCENTILES`.
PRINTED = {
    (1, "rotation"): (7.14, 0.48, 0.85),
    (1, "displacement"): (9.38, 0.49, 2.27),
    (1, "scaling"): (5.33, 0.53, 2.39),
    (1, "pca"): (5.88, 0.52, 1.44),
    (2, "rotation"): (7.14, 0.43, 1.51),
    (2, "displacement"): (9.33, 0.40, 4.37),
    (2, "scaling"): (5.31, 0.45, 2.65),
    (2, "pca"): (5.71, 0.40, 1.79),
    (3, "rotation"): (7.18, 1.63, 2.49),
    (3, "displacement"): (9.36, 0.78, 5.62),
    (3, "scaling"): (5.30, 1.39, 3.16),
    (3, "pca"): (5.69, 1.62, 2.37),
}
PRINTED_LINES = {
    "sketch": (2.06, 2.32, 2.89, 3.98),
    "paper": (0.28, 0.30, 0.34, 0.42),
    "active_contour": (1.02, 1.12, 1.43, 1.84),
}

Cells = Sequence[Sequence[str]]


def markdown(header: Sequence[str], body: Cells) -> str:
    """Format a table; numbers to the right."""
    lines = [header, [":--", *["--:"] * (len(header) - 1)], *body]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def name_of(cell: Cell) -> str:
    """Name a cell's sketches."""
    return KIND_NAMES[cell.kind].format(cell.strength)


def table(
    results: Results,
    cells: Sequence[Cell],
    value: Callable[[Summary], str],
    initial: Callable[[Summary], str] | None = None,
) -> str:
    """One row a cell, one column a method.

    `initial` adds a column about the sketches, and what the paper's Table 1 has.
    """
    names = [name for name in results.names if name != "sketch"]
    extra = ["initial"] if initial else []
    header = ["bodies", "sketch", *extra, *[_head(results, n, cells) for n in names]]
    header += ["printed: initial / paper / active contour"] if initial else []
    body = []
    for cell in cells:
        row = [str(cell.bodies), name_of(cell)]
        if initial:
            row.append(_cell(results.summary("sketch", cell), initial))
        row += [_cell(results.summary(name, cell), value) for name in names]
        if initial:
            row.append(" / ".join(f"{v:.2f}" for v in PRINTED[cell.bodies, cell.kind]))
        body.append(row)
    return markdown(header, body)


def _head(results: Results, name: str, cells: Sequence[Cell]) -> str:
    counts = [results.summary(name, cell) for cell in cells]
    return f"{LABELS[name]} ({_range([s.frames for s in counts if s])})"


def _range(counts: Sequence[int]) -> str:
    low, high = min(counts, default=0), max(counts, default=0)
    return f"{high}" if low == high else f"{low}–{high}"


def sweep_frames(results: Results, names: Sequence[str]) -> str:
    """How many frames each point of Figure 2 stands for, method by method."""
    found = []
    for name in names:
        counts = {
            n: [
                s.frames for c in sweep_cells() if c.bodies == n and (s := results.summary(name, c))
            ]
            for n in COUNTS
        }
        each = " · ".join(_range(some) for some in counts.values())
        found.append(f"{LABELS[name]} {each}")
    return "; ".join(found)


def _cell(found: Summary | None, value: Callable[[Summary], str]) -> str:
    return value(found) if found else "–"


def percentiles(results: Results) -> str:
    """Table 2: percentiles of average DTW from straight lines."""
    names = results.names
    header = ["bodies", "sketch", *[_head(results, name, line_cells()) for name in names]]
    body = []
    for cell in line_cells():
        row = [str(cell.bodies), name_of(cell)]
        for name in names:
            values = [r.dtw for r in results.of(name, [cell])]
            cuts = np.percentile(values, PERCENTILES) if values else []
            row.append(" / ".join(f"{cut:.2f}" for cut in cuts) or "–")
        body.append(row)
    cuts = [" / ".join(f"{v:.2f}" for v in PRINTED_LINES.get(name, ())) for name in names]
    body.append(["–", "printed in the paper", *(cut or "–" for cut in cuts)])
    return markdown(header, body)


def limits(results: Results) -> str:
    """Distance to the Cramér-Rao bound, over Table 1's cells."""
    header = ["bodies", "method", "best half", "median", "normal", "normal / bound", "ends"]
    body = []
    for count in COUNTS:
        bound = results.bound(count)
        rows = [("Cramér–Rao bound", bound)]
        rows += [(LABELS[n], results.summary(n, *_of(count))) for n in results.names]
        for label, s in rows:
            if s and label != "sketch":
                ratio = f"{s.normal / bound.normal:.2f}" if bound else "–"
                numbers = [f"{v:.3f}" for v in (s.best_half, s.median, s.normal)]
                body.append([str(count), label, *numbers, ratio, f"{s.end:.2f}"])
    return markdown(header, body)


def times(results: Results) -> str:
    """Milliseconds a frame, over Table 1's cells."""
    names = [name for name in results.names if name != "sketch"]
    body = []
    for name in names:
        found = [results.summary(name, *_of(count)) for count in COUNTS]
        slow = [results.summary("splender", *_of(count)) for count in COUNTS]
        row = [LABELS[name], *[f"{1e3 * s.seconds:.3g}" if s else "–" for s in found]]
        pairs = zip(found, slow, strict=True)
        row += [f"{b.seconds / a.seconds:.0f}" if a and b else "–" for a, b in pairs]
        body.append(row)
    names_of = ["1 body", "2 bodies", "3 bodies"]
    header = ["method", *names_of, *[f"splender / this, {name}" for name in names_of]]
    return markdown(header, body)


def _of(count: int) -> list[Cell]:
    return [Cell(count, kind, strength) for kind, strength in TABLE_KINDS]


def write_csv(results: Results, path: Path) -> None:
    """Write every summary of every cell and method."""
    cells = table_cells() + line_cells()
    cells += sweep_cells()
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        names = list(Summary.__dataclass_fields__)
        writer.writerow(["bodies", "kind", "strength", "method", *names])
        for cell in dict.fromkeys(cells):
            for name in results.names:
                found = results.summary(name, cell)
                if found:
                    values = [f"{getattr(found, n):.4g}" for n in names]
                    writer.writerow([cell.bodies, cell.kind, f"{cell.strength:g}", name, *values])

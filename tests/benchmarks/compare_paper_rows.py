"""Rows of the comparison with the reference, and the tables made of them."""

import csv
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import frames
import numpy as np

ROWS = Path(__file__).parents[2] / "docs" / "benchmarks" / "compare_paper.csv"
LABELS = {
    "paper": "ours, `paper`",
    "paper-quiet": "ours, `paper`, without noise and with one seed",
    "splender-phases": "splender's model and loss, three phases",
    "splender": "splender as shipped",
    "balanced": "ours, `balanced`",
}


# Settings of ours and of the reference were chosen on frames before these, and on tuning frames.
FIRST = 8
TOO_LONG, FAR = 1.3, 2.0
CELLS: dict[str, list[frames.Cell]] = {
    "straight": frames.line_cells(),
    "long": [frames.Cell(n, "scaling", TOO_LONG) for n in frames.COUNTS],
    "spoilt": frames.table_cells(),
}

SKETCHES = {
    "as in Table 1": CELLS["spoilt"],
    "line between the ends": [c for c in CELLS["straight"] if c.kind == "chord"],
    "line along the main axis": [c for c in CELLS["straight"] if c.kind == "axis"],
    f"{TOO_LONG} times too long": CELLS["long"],
}


@dataclass(frozen=True)
class Row:
    """One frame as one method left it.

    Attributes
    ----------
    method, bodies, kind, strength, index
        Which.
    initial, dtw, worst
        Average DTW of the sketches, and after refinement, mean over bodies, and of the worst, px.
    unexplained
        Mean of (Y - Ŷ)² over the variance of Y.
    seconds, compiling
        Of one core's work, without compiling; and what compiling took, where it did (where every
        call compiles, as measured on the first frame with as many bodies).
    """

    method: str
    bodies: int
    kind: str
    strength: float
    index: int
    initial: float
    dtw: float
    worst: float
    unexplained: float
    seconds: float
    compiling: float

    @property
    def place(self) -> tuple[frames.Cell, int]:
        """Which frame it is."""
        return frames.Cell(self.bodies, self.kind, self.strength), self.index


def read() -> list[Row]:
    """Rows so far."""
    if not ROWS.exists():
        return []
    parse = {str: str, int: int, float: float}
    with ROWS.open(newline="", encoding="utf-8") as file:
        return [
            Row(**{f.name: parse[f.type](line[f.name]) for f in fields(Row)})
            for line in csv.DictReader(file)
        ]


def append(row: Row) -> None:
    """Add one row to the file."""
    ROWS.parent.mkdir(parents=True, exist_ok=True)
    new = not ROWS.exists()
    with ROWS.open("a", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        if new:
            writer.writerow([f.name for f in fields(Row)])
        writer.writerow([f"{v:.4g}" if isinstance(v, float) else v for v in asdict(row).values()])


def side_by_side(rows: list[Row], ours: str = "paper", other: str = "splender-phases") -> str:
    """Accuracy and seconds of ours and of the reference, on the frames that both have.

    Frames that settings may have been chosen on come last.
    """
    lines = [
        "| sketch | n | frames | median DTW: ours | reference | mean: ours | reference "
        "| frames with a body beyond 2 px: ours | reference | times as fast |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    kinds = [(label, cells, True) for label, cells in SKETCHES.items()]
    kinds.append((f"as in Table 1, frames before {FIRST}", CELLS["spoilt"], False))
    for label, cells, fresh in kinds:
        some = [r for r in rows if r.place[0] in cells and (r.index >= FIRST) == fresh]
        for bodies in frames.COUNTS:
            here = [r for r in some if r.bodies == bodies]
            both = [{r.place: r for r in here if r.method == name} for name in (ours, other)]
            shared = both[0].keys() & both[1].keys()
            if shared:
                pair = [[found[place] for place in shared] for found in both]
                lines.append(f"| {label} | {bodies} | {len(shared)} {_pair(*pair)}")
    return "\n".join(lines) + "\n"


def _pair(ours: list[Row], other: list[Row]) -> str:
    sides = ours, other
    median = " | ".join(f"{np.median([r.dtw for r in side]):.2f}" for side in sides)
    mean = " | ".join(f"{np.mean([r.dtw for r in side]):.2f}" for side in sides)
    lost = " | ".join(f"{sum(r.worst > FAR for r in side)}" for side in sides)
    ours_seconds, seconds = (np.median([r.seconds for r in side]) for side in sides)
    return f"| {median} | {mean} | {lost} | {seconds / ours_seconds:.0f} |"


def table(rows: list[Row]) -> str:
    """Median DTW, share beyond 2 px, loss and seconds of each method, from spoilt labels."""
    lines = [
        "| n | method | frames | DTW, median | DTW, mean | frames with a body beyond 2 px "
        "| unexplained | seconds | compiling |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for bodies in frames.COUNTS:
        for method, label in LABELS.items():
            some = [r for r in rows if r.bodies == bodies and r.method == method]
            some = [r for r in some if r.place[0] in CELLS["spoilt"]]
            if some:
                lines.append(_line(bodies, label, some))
    return "\n".join(lines) + "\n"


def _line(bodies: int, label: str, rows: list[Row]) -> str:
    def median(name: str) -> float:
        return float(np.median([getattr(row, name) for row in rows]))

    compiling = [row.compiling for row in rows if row.compiling]
    return (
        f"| {bodies} | {label} | {len(rows)} | {median('dtw'):.2f} "
        f"| {np.mean([row.dtw for row in rows]):.2f} | {sum(row.worst > FAR for row in rows)} "
        f"| {100 * median('unexplained'):.1f} % | {median('seconds'):.2f} "
        f"| {np.median(compiling) if compiling else 0:.1f} |"
    )

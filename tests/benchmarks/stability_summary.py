"""Shares and tables of the stability set."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from stability_cases import CASES, by_group
from stability_rows import Row

WANTED = ("same_body",)
"""Cases in which a curve should be marked though it lies on a body."""


@dataclass(frozen=True)
class Shares:
    """What became of a set of curves.

    Attributes
    ----------
    bodies
        How many there were.
    lost
        Share that is not on its body, of those that have one.
    marked_lost
        Share of marked curves among those that are lost, or have no body; NaN without any.
    marked_found
        Share of the others that are marked.
    median
        Of average DTW over curves that have a body to find, px.
    """

    bodies: int
    lost: float
    marked_lost: float
    marked_found: float
    median: float


def shares(rows: Sequence[Row]) -> Shares:
    """Sum up some rows."""
    lost = [row for row in rows if row.lost]
    found = [row for row in rows if not row.lost]
    bodies = [row for row in rows if np.isfinite(row.dtw)]
    return Shares(
        bodies=len(rows),
        lost=_share([row.lost for row in bodies]),
        marked_lost=_share([row.marked for row in lost]),
        marked_found=_share([row.marked for row in found]),
        median=float(np.median([row.dtw for row in bodies])) if bodies else float("nan"),
    )


def _share(values: Sequence[bool]) -> float:
    return float(np.mean(values)) if values else float("nan")


def write_csv(rows: dict[str, list[Row]], path: Path) -> None:
    """One line for each preset and case, and one for all cases."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(
            ["preset", "case", "bodies", "lost", "marked_lost", "marked_found", "median_dtw"]
        )
        for preset, all_rows in rows.items():
            for case in [*CASES, "all"]:
                found = shares(_of_case(all_rows, case))
                values = (found.lost, found.marked_lost, found.marked_found, found.median)
                cells = [f"{v:.3f}" if np.isfinite(v) else "" for v in values]
                writer.writerow([preset, case, found.bodies, *cells])


def table(rows: dict[str, list[Row]]) -> str:
    """One line for each case: share lost, and what is marked."""
    lost = [f"lost, {preset}" for preset in rows]
    header = ["case", *lost, "of those marked", "found, yet marked", "median DTW, px"]
    lines = ["| " + " | ".join(header) + " |", "|---" * len(header) + "|"]
    for group, cases in by_group().items():
        lines.append(f"| **{group}** |" + " |" * (len(header) - 1))
        lines += [_line(f"[{c.what}](#{c.name})", c.name, rows) for c in cases]
    lines.append(_line("**all together**", "all", rows))
    return "\n".join(lines) + "\n"


def _line(label: str, case: str, rows: dict[str, list[Row]]) -> str:
    found = {preset: shares(_of_case(some, case)) for preset, some in rows.items()}
    main = found.get("balanced", next(iter(found.values())))
    cells = [percent(s.lost) for s in found.values()]
    marked = percent(main.marked_found) + " (wanted)" * (case in WANTED)
    median = f"{main.median:.2f}" if np.isfinite(main.median) else "–"
    return "| " + " | ".join([label, *cells, percent(main.marked_lost), marked, median]) + " |"


def _of_case(rows: Sequence[Row], case: str) -> list[Row]:
    """Rows of one case; of "all", those of curves that have a body of their own to find."""
    if case != "all":
        return [row for row in rows if row.case == case]
    return [row for row in rows if row.case not in WANTED and np.isfinite(row.dtw)]


def percent(share: float) -> str:
    """A share in words of a table."""
    return f"{100 * share:.0f} %" if np.isfinite(share) else "–"


def reasons(rows: Sequence[Row]) -> str:
    """How often each reason was given, for curves that were lost and found."""
    count: dict[str, list[int]] = {}
    for row in rows:
        for reason in filter(None, row.reasons.split("; ")):
            kind = _without_numbers(reason)
            count.setdefault(kind, [0, 0])[int(not row.lost)] += 1
    lines = ["| reason | lost | found |", "|---|---|---|"]
    for kind, (lost, found) in sorted(count.items(), key=lambda item: -sum(item[1])):
        lines.append(f"| {kind} | {lost} | {found} |")
    return "\n".join(lines) + "\n"


def _without_numbers(reason: str) -> str:
    """A reason with its numbers as dots."""
    words = [("…" if any(c.isdigit() for c in word) else word) for word in reason.split()]
    return " ".join(words)

"""Where methods fail: sweeps the stability set, and writes tables, pictures and docs/limits.md.

    python tests/benchmarks/stability.py [parts...] [--seeds 12] [--cases ...]

Parts: sweep, weights, real, pictures, page. Trials that were run with this version of the engine
are skipped. Rows and tables go to docs/limits.
"""

import argparse
import time

import methods
import stability_charts as charts
import stability_real
import stability_summary as summary
import stability_weights
from insert import insert
from stability_cases import CASES, by_group
from stability_rows import FOLDER, Row, Store, measure, path_of, read

PAGE = FOLDER.parent / "limits.md"
PRESET = "balanced"
PARTS = ("sweep", "weights", "real", "pictures", "page")


def sweep(cases: list[str], seeds: int, deadline: float) -> int:
    """Run what has not been run; returns how many trials were new."""
    version = methods.make(PRESET).version
    store, new = Store(PRESET, version), 0
    for seed in range(seeds):
        for name in cases:
            if time.monotonic() > deadline:
                return new
            if not store.has(name, seed):
                store.add(measure(version, CASES[name], seed, PRESET))
                new += 1
    return new


def stored() -> dict[str, list[Row]]:
    """All rows that are there, by preset, whichever version of the engine they are of."""
    return {PRESET: list(read(path_of(PRESET)))}


def pictures() -> None:
    """Draw each case, with the seed that says most about it."""
    main = stored()[PRESET]
    for case in CASES.values():
        charts.picture(case, _telling(case.name, main), FOLDER / f"{case.name}.png")
    if main:
        charts.roc(main, FOLDER / "flags.png")


def _telling(case: str, rows: list[Row]) -> int:
    """The first seed where a body was lost without a mark, or lost, or any."""
    mine = [row for row in rows if row.case == case and row.lost]
    silent = [row.seed for row in mine if not row.marked]
    return min(silent or [row.seed for row in mine] or [0])


def page() -> None:
    """Write the tables into docs/limits.md."""
    rows = stored()
    summary.write_csv(rows, FOLDER / "stability.csv")
    main = rows[PRESET]
    insert("stability", summary.table(rows), PAGE)
    insert("reasons", summary.reasons(main), PAGE)
    insert("weights", stability_weights.table(), PAGE)
    insert("real", stability_real.table(), PAGE)
    insert("cases", _gallery(), PAGE)
    print(summary.table(rows))


def _gallery() -> str:
    parts = []
    for group, cases in by_group().items():
        parts.append(f"## {group}\n")
        for case in cases:
            parts.append(
                f"### {case.name}\n\n{case.what.capitalize()}. Should be: {case.should}.\n\n"
                f"![{case.what}](limits/{case.name}.png)\n"
            )
    return "\n".join(parts)


def main() -> None:
    """Run the parts asked for."""
    parser = argparse.ArgumentParser("python tests/benchmarks/stability.py", description=__doc__)
    parser.add_argument("parts", nargs="*", default=list(PARTS), help=", ".join(PARTS))
    parser.add_argument("--seeds", type=int, default=12, help="trials of each case")
    parser.add_argument("--cases", nargs="+", default=list(CASES), choices=list(CASES))
    parser.add_argument("--minutes", type=float, default=float("inf"), help="start nothing after")
    options = parser.parse_args()
    if set(options.parts) - set(PARTS):
        parser.error(f"parts are {', '.join(PARTS)}")
    deadline = time.monotonic() + 60 * options.minutes
    if "sweep" in options.parts:
        new = sweep(options.cases, options.seeds, deadline)
        print(f"{PRESET}: {new} new trials", flush=True)
    if "weights" in options.parts:
        stability_weights.run(options.seeds, deadline)
    if "real" in options.parts:
        stability_real.run(deadline)
    if "pictures" in options.parts:
        pictures()
    if "page" in options.parts:
        page()


if __name__ == "__main__":
    main()

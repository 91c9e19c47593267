"""The benchmark of images of other kinds: how many bodies are found, lost, marked and spoilt.

python tests/benchmarks/real.py [--methods ...] [--images real|generated|all|fresh]
    [--split tune|held|all] [--jitter | --straight | --freehand | --dragged] [--folder DIR ...]
    [--cases NAME ...] [--rows FILE] [--fresh] [--gallery] [--page]

Stops and goes on case by case: rows of the same version of a method are kept.
"""

import argparse
import csv
import os
import time
import warnings
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, astuple, fields
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("JAX_PLATFORMS", "cpu")

import real_foreign
import real_methods
from real_cases import (
    FOLDERS,
    FRESH,
    RIGHT,
    ROOT,
    Case,
    dragged,
    freehand,
    in_folders,
    jittered,
    split_of,
    straightened,
)
from real_judge import Row, shares, summary, verdict

ROWS = ROOT / "docs" / "benchmarks" / "real.csv"
FRESH_ROWS = ROWS.with_name("fresh.csv")
"""Rows of the images that nothing was chosen on."""
LINES = {"straight": straightened, "freehand": freehand, "dragged": dragged}
"""Sets of sketches that are drawn in one go; the rows of each are in a file of its own."""


def main() -> None:
    """Run what has not been run yet, then print the summary."""
    options = _options()
    warnings.simplefilter("ignore")  # of the other methods
    if options.gallery or options.page:
        _document(options)
        return
    cases = list(_chosen(options))
    if not cases:
        raise SystemExit(f"No such cases in {', '.join(map(str, options.folder))}.")
    kept = [] if options.fresh else list(read(options.rows))
    versions = {name: real_methods.version(name) for name in options.methods}
    kept = [row for row in kept if row.version == versions.get(row.method, row.version)]
    done = {(row.method, row.case, row.sketches) for row in kept}
    for name in options.methods:
        for case in cases:
            for drawn in case.sketches:
                if (name, case.name, drawn) not in done:
                    kept += measure(name, versions[name], case, drawn)
                    write(options.rows, kept)
    names = {case.name for case in cases}
    show(
        [
            row
            for row in kept
            if row.case in names
            and row.method in options.methods
            and (row.sketches == RIGHT) == options.jitter
        ]
    )


def _document(options: argparse.Namespace) -> None:
    import real_gallery
    import real_page

    if options.gallery:
        real_gallery.draw()
    if options.page and options.images != "fresh":
        real_page.write(list(read(options.rows)), list(in_folders(options.folder)))
        for lines in LINES:
            real_page.write_lines(lines, list(read(_rows_of(lines))))
        real_page.write_fresh(list(read(FRESH_ROWS)), list(in_folders(FRESH)))
    elif options.page:
        real_page.write_fresh(list(read(options.rows)), list(in_folders(options.folder)))


def _chosen(options: argparse.Namespace) -> Iterator[Case]:
    """Cases that the options ask for, with right or otherwise drawn sketches if asked for."""

    def wanted(name: str) -> bool:
        in_split = options.split in (split_of(name), "all")
        return in_split and (not options.cases or name in options.cases)

    cases: list[Case] = []
    if options.images != "generated":
        cases += [case for case in in_folders(options.folder) if wanted(case.name)]
    if options.images in ("generated", "all"):
        cases += real_foreign.cases(wanted)
    if options.lines:
        return map(LINES[options.lines], cases)
    return map(jittered, cases) if options.jitter else iter(cases)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser("python tests/benchmarks/real.py", description=__doc__)
    known = list(real_methods.RUNS)
    parser.add_argument("--methods", nargs="+", default=["balanced"], choices=known)
    parser.add_argument("--images", default="real", choices=("real", "generated", "all", "fresh"))
    parser.add_argument("--split", default="all", choices=("tune", "held", "all"))
    parser.add_argument("--jitter", action="store_true", help="right sketches, 1 px off")
    kinds = ("straight", "lines between both ends"), ("freehand", "strokes"), ("dragged", "paths")
    for lines, what in kinds:
        parser.add_argument(
            f"--{lines}", action="store_const", dest="lines", const=lines, help=what
        )
    parser.add_argument("--folder", nargs="+", type=Path, help="of cases")
    parser.add_argument("--cases", nargs="+", default=[], help="only these")
    parser.add_argument("--rows", type=Path, help="where results are kept")
    parser.add_argument("--fresh", action="store_true", help="forget what was run before")
    parser.add_argument("--gallery", action="store_true", help="draw the pictures of docs/real.md")
    parser.add_argument("--page", action="store_true", help="write the tables of docs/real.md")
    options = parser.parse_args()
    fresh = options.images == "fresh"
    options.folder = options.folder or (FRESH if fresh else FOLDERS)
    usual = FRESH_ROWS if fresh else ROWS
    options.rows = options.rows or (_rows_of(options.lines) if options.lines else usual)
    return options


def _rows_of(lines: str) -> Path:
    return ROWS.with_name(f"{lines}.csv")


def measure(method: str, version: str, case: Case, drawn: str) -> list[Row]:
    """Run one method on one set of sketches of a case."""
    sketches = case.sketches[drawn]
    began = time.perf_counter()
    found = real_methods.RUNS[method](case, sketches)
    seconds = time.perf_counter() - began
    rows = []
    for body, (sketch, reference, one) in enumerate(
        zip(sketches, case.references, found, strict=True)
    ):
        near = shares(one.curve, reference, one.half_width)
        rows.append(
            Row(
                method=method,
                version=version,
                case=case.name,
                kind=case.kind,
                split=case.split,
                sketches=drawn,
                body=body,
                drawn=verdict(*shares(sketch, reference, case.half_width)),
                verdict=verdict(*near),
                curve_share=near[0],
                reference_share=near[1],
                half_width=one.half_width,
                status=one.status,
                reasons=one.reasons,
                seconds=seconds,
            )
        )
    return rows


def show(rows: Sequence[Row]) -> None:
    """Print a table for each method: a line a case, and one for all."""
    for method in dict.fromkeys(row.method for row in rows):
        mine = [row for row in rows if row.method == method]
        groups = {name: [r for r in mine if r.case == name] for name in {r.case for r in mine}}
        seconds = sum({(r.case, r.sketches): r.seconds for r in mine}.values())
        print(f"\n{real_methods.LABELS[method]} ({seconds:.0f} s)")
        print(f"{'%':28}bodies  good  lost | marked: bad  good | right sketches spoilt, silently")
        for name, some in [*sorted(groups.items()), ("all", mine)]:
            s = summary(some)
            print(
                f"{name:28}{s.bodies:6}{s.good:6.0f}{s.lost:6.0f}{s.bad_marked:14.0f}"
                f"{s.good_marked:6.0f}{s.spoilt:25.0f}{s.spoilt_silently:10.0f}"
            )


def read(path: Path) -> Iterable[Row]:
    """Read rows from a file that may not exist."""
    if path.exists():
        with path.open(newline="", encoding="utf-8") as file:
            for record in csv.DictReader(file):
                yield Row(**{f.name: _PARSE[str(f.type)](record[f.name]) for f in fields(Row)})


_PARSE = {"str": str, "int": int, "float": float, str(str): str, str(int): int, str(float): float}


def write(path: Path, rows: Sequence[Row]) -> None:
    """Write all rows; three digits are enough for every number."""
    path.parent.mkdir(parents=True, exist_ok=True)
    fresh = path.with_suffix(".new")
    with fresh.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(asdict(rows[0]) if rows else [f.name for f in fields(Row)])
        for row in rows:
            writer.writerow([f"{v:.3g}" if isinstance(v, float) else v for v in astuple(row)])
    fresh.replace(path)


if __name__ == "__main__":
    main()

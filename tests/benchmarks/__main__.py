"""The benchmark: runs what has not been run yet, then writes tables, charts and the page.

python tests/benchmarks [parts...] [--methods ...] [--bodies ...] [--frames N] [--minutes M]
    [--quick] [--fresh]
"""

import argparse
import os
import sys
import time
import warnings

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ["JAX_PLATFORMS"] = "cpu"
os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"

import bound
import methods
import scaling
from frames import COUNTS, line_cells, sweep_cells, table_cells
from rows import FOLDER
from runner import pin_to_one_core, run

CELLS = {"table": table_cells, "lines": line_cells, "sweep": sweep_cells}
PARTS = (*CELLS, "bound", "scaling", "solvers", "report")
FRAMES = {"table": 48, "lines": 48, "sweep": 16, "bound": 24, "solvers": 12}
QUICK_FRAMES = 4
LARGEST, QUICK_LARGEST = 1000, 30


def main() -> None:
    """Run the parts asked for."""
    options = _options()
    names = [name for name in options.methods if _runs(name)]
    if options.fresh:
        for name in names:
            (FOLDER / "rows" / f"{name}.csv").unlink(missing_ok=True)
    deadline = time.monotonic() + 60 * options.minutes
    pin_to_one_core()
    warnings.simplefilter("ignore")  # of the other methods
    for part in [part for part in options.parts if part in CELLS]:
        for name in names:
            method = methods.make(name)
            if part in method.parts:
                frames = options.frames or FRAMES[part]
                cells = [cell for cell in CELLS[part]() if cell.bodies in options.bodies]
                new = run(method, cells, frames, deadline)
                print(f"{part}: {methods.LABELS[name]}: {new} new frames", flush=True)
    if "bound" in options.parts:
        bound.run(COUNTS, options.frames or FRAMES["bound"])
    if "scaling" in options.parts:
        measured = [n for n in names if "scaling" in methods.make(n).parts]
        scaling.run(measured, largest=QUICK_LARGEST if options.quick else LARGEST)
    if "memory" in options.parts:
        scaling.memory(names)
    if "solvers" in options.parts:
        import compare_solvers

        compare_solvers.run(QUICK_FRAMES if options.quick else FRAMES["solvers"])
    if "report" in options.parts:
        import report

        report.write()


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser("python tests/benchmarks", description=__doc__)
    known = (*PARTS, "memory")
    parser.add_argument("parts", nargs="*", default=list(PARTS), help=", ".join(known))
    parser.add_argument("--methods", nargs="+", default=list(methods.NAMES), choices=methods.NAMES)
    parser.add_argument("--bodies", type=int, nargs="+", default=COUNTS, help="in a frame")
    parser.add_argument("--frames", type=int, help="frames in each cell")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="start no frame after")
    parser.add_argument("--quick", action="store_true", help="a few frames only")
    parser.add_argument("--fresh", action="store_true", help="forget what was run before")
    options = parser.parse_args()
    unknown = set(options.parts) - set(known)
    if unknown:
        parser.error(f"unknown parts {', '.join(sorted(unknown))}; known are {', '.join(known)}")
    if options.quick and options.frames is None:
        options.frames = QUICK_FRAMES
    return options


def _runs(name: str) -> bool:
    reason = methods.missing(name)
    if reason:
        print(f"{methods.LABELS[name]} is left out: {reason}", file=sys.stderr)
    return reason is None


if __name__ == "__main__":
    main()

"""Writes docs/benchmarks.md from whatever results there are."""

import platform
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

import active_contour
import charts
import compare_solvers
import filaments
import methods
import reference
import result_tables as tables
import scaling
from collect import Results
from frames import line_cells, table_cells
from rows import FOLDER

PAGE = FOLDER.parent / "benchmarks.md"
TEMPLATE = Path(__file__).with_name("report.md")
PACKAGES = ("numpy", "scipy", "jax", "scikit-image", "napari-filaments", "splender")


def write() -> None:
    """Write tables, charts and the page."""
    results = Results()
    points = scaling.read()
    charts.speed_accuracy(results, FOLDER / "speed-accuracy.svg")
    charts.sweeps(results, FOLDER / "sweeps.svg")
    charts.worse(results, FOLDER / "worse.svg")
    charts.scaling(points, FOLDER / "scaling.svg")
    tables.write_csv(results, FOLDER / "summary.csv")
    cells, lines = table_cells(), line_cells()
    page = TEMPLATE.read_text(encoding="utf-8").format(
        machine=_machine(),
        notes=_notes(results),
        active_contour=active_contour.TUNED,
        filaments=filaments.TUNED,
        splender=reference.TUNED,
        best_half=tables.table(
            results, cells, lambda s: f"{s.best_half:.2f}", lambda s: f"{s.initial_half:.2f}"
        ),
        median=tables.table(results, cells, lambda s: f"{s.median:.2f}"),
        mean=tables.table(results, cells, lambda s: f"{s.mean:.2f}"),
        far=tables.table(results, cells, lambda s: f"{100 * s.far:.0f} %"),
        lines=tables.percentiles(results),
        lines_half=tables.table(results, lines, lambda s: f"{s.best_half:.2f}"),
        lines_far=tables.table(results, lines, lambda s: f"{100 * s.far:.0f} %"),
        sweep_frames=tables.sweep_frames(results, charts.SWEEP_METHODS),
        limits=tables.limits(results),
        times=tables.times(results),
        scaling=_scaling([p for p in points if p.what in ("count", "side")]),
        solvers=compare_solvers.table(),
        first_calls=_first_calls([p for p in points if p.what not in ("count", "side")]),
    )
    PAGE.write_text(page, encoding="utf-8")
    print(page)


def _scaling(points: Sequence[scaling.Point]) -> str:
    header = ["method", "bodies", "side, px", "s", "ms a curve", "peak MiB", "DTW", "> 2 px"]
    body = [
        [
            methods.LABELS[p.method],
            str(p.bodies),
            str(p.side),
            f"{p.seconds:.3g}",
            f"{1e3 * p.seconds / p.bodies:.3g}",
            f"{p.peak_mib:.0f}",
            f"{p.median:.2f}",
            f"{100 * p.far:.0f} %",
        ]
        for p in points
    ]
    return tables.markdown(header, body)


def _first_calls(points: Sequence[scaling.Point]) -> str:
    header = ["preset", "call", "bodies", "side, px", "first, s", "later, s"]
    body = [
        [p.method, p.what, str(p.bodies), str(p.side), f"{p.first:.2f}", f"{p.seconds:.3f}"]
        for p in points
    ]
    return tables.markdown(header, body)


def _machine() -> str:
    lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    found = [f"{p} {version(p)}" for p in PACKAGES if methods.installed(p)]
    cpu = names[0] if names else platform.processor()
    return f"{cpu}, Python {platform.python_version()}, {', '.join(found)}"


def _notes(results: Results) -> str:
    """List methods without results, and those that have changed since."""
    reasons = {n: methods.missing(n) for n in methods.NAMES if n not in results.rows}
    lines = [f"- {methods.LABELS[n]}: {why or 'not yet run'}" for n, why in reasons.items()]
    outdated = [methods.LABELS[n] for n in results.names if results.outdated(n)]
    lines += [f"- {label}: measured before its source last changed" for label in outdated]
    return "\n".join(lines) or "- none"

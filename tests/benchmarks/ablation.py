"""What each mechanism of the engine is for: the same bodies refined without it.

    python tests/benchmarks/ablation.py [--without NAME ...] [--frames 8] [--jobs N] [--page]

Every row runs in a process of its own, since compiled programs hold what they were compiled with.
Frames of two and three generated bodies, one trial of each stability case, generated images of
foreign make, and the images of tests/data/real, with sketches as drawn, with right ones and with
lines of one stroke. Rows go to docs/benchmarks/ablation.csv; a row without a loss means that the
mechanism should go.
"""

import argparse
import csv
import fcntl
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import astuple, dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import real_cases
import real_foreign
from frames import Cell, frame
from insert import insert
from real_judge import shares, verdict
from result_tables import markdown
from rows import FOLDER
from stability_cases import CASES
from stability_rows import FAR

from napari_splinesketch import refine
from napari_splinesketch.engine import constants
from napari_splinesketch.engine.find import finding, hollow, neighbours, paths, scoring, strip
from napari_splinesketch.engine.fit import bands, fit_scene, pairs, solver
from napari_splinesketch.engine.fit.tube import INDEX
from napari_splinesketch.engine.judge import doubt, position
from napari_splinesketch.engine.look import scene
from napari_splinesketch.engine.types import Curve
from napari_splinesketch.metrics import average_dtw

PATH = FOLDER / "ablation.csv"
PAGE = FOLDER.parent / "how_it_works.md"
SKETCHES = ("rotation", 20.0), ("pca", 2.0), ("chord", 0.0), ("axis", 0.0)
CELLS = [Cell(n, kind, strength) for n in (2, 3) for kind, strength in SKETCHES]
UNSEEN = 40_000
"""Frames and trials from this number on were never used for anything else."""


@dataclass(frozen=True)
class Row:
    """What became of the bodies of one set without one mechanism.

    Attributes
    ----------
    without
        The mechanism; empty for the engine as it is.
    where
        "generated", "stability", "foreign", "real", or "right" for real ones whose sketches were
        right already, "stroke" for those drawn in one stroke.
    bodies, lost, silent
        How many; lost ones; lost ones that are not marked. Foreign and real bodies are lost where
        less than 90 % of curve and reference lie on each other.
    dtw
        Mean average DTW of those not lost, px; NaN where there is no exact reference.
    """

    without: str
    where: str
    bodies: int
    lost: int
    silent: int
    dtw: float


def _set(module: Any, **values: Any) -> Callable[[], None]:
    def patch() -> None:
        for name, value in values.items():
            setattr(module, name, value)

    return patch


def _held(*names: str) -> Callable[[], None]:
    """Hold parameters of the model at the means of their priors."""

    def patch() -> None:
        begin = bands.begin

        def without(*given: Any):
            theta, priors = begin(*given)
            sd = priors.sd.copy()
            sd[[INDEX[name] for name in names]] = 1e-4
            return theta, priors._replace(sd=sd)

        bands.begin = without

    return patch


def _everybody_alike() -> None:
    rungs = scene._rungs

    def without(around: Any, told: float | None):
        own, _, contradicted = rungs(around, told)
        return (int(np.median(own)),) * len(own), ((),) * len(own), contradicted

    scene._rungs = without


def _as_looked(scenes: Sequence[tuple[list[int], scene.Scene]], _: object) -> list[int]:
    """The polarity that what is around each sketch tells, or else the other sketches."""
    signs = {i: seen.sign for members, seen in scenes for i in members}
    return [signs[i] for i in sorted(signs)]


MECHANISMS: dict[str, Callable[[], None]] = {
    "": lambda: None,
    "polarity of each sketch": _set(constants, CLEAR_VOTE=2.0),
    "polarity by the paths of a sketch": _set(finding, signs=_as_looked),
    "bodies in relief": _set(constants, RELIEF_EXPLAINED=np.inf),
    "half-width of each sketch": _everybody_alike,
    "curves are as thick as what was found": _set(
        constants, PRIORS=constants.PRIORS | {"log_width_0": (0.0, 0.4, -9.0, 1.5)}
    ),
    "no body lies inside itself": _set(constants, LIMBS_SHARE=2.0),
    "much wider or thinner bodies": _set(finding, sized=lambda seen, _: seen),
    "noise of images that are cut off": _set(constants, DRAWN=0.0),
    "background that varies": _set(constants, BACKGROUND_TOLERANCE=1e6),
    "slopes count against ridges": _set(constants, RIDGE_SLOPE=0.0),
    "paths through the graph": _set(paths, routes_of_sketch=lambda *_: []),
    "paths along the sketch": _set(
        strip,
        paths_along=lambda _, sketch, *__, between_ends=False: [sketch] * (1 + between_ends),
    ),
    "ends of straight lines": _set(constants, ENDS_COST=0.0),
    "joint choice": _set(constants, SHARED_COST=0.0, EXPLAINED_GAIN=0.0),
    "bends of a path": _set(
        constants,
        PATH_WEIGHTS=np.where(np.array(scoring.FEATURES) == "kink", 0.0, constants.PATH_WEIGHTS),
    ),
    "shapes of lines that were moved": _set(constants, SHAPE_COST=0.0),
    "sketches without a body are kept": _set(constants, UNSEEN_MOST=2.0),
    "ends are held to their paths": _set(fit_scene, _ended=lambda *_: None),
    "knots by the path": _set(fit_scene, knots_needed=lambda *_: 12),
    "curves that touch take turns": _set(solver, sweep=partial(solver.sweep, together=16)),
    "careful strokes count as clicks": _set(finding, as_clicks=lambda sketch, *_: sketch),
    "clicked vertices are believed": _set(scoring, clicked=lambda _: False),
    "clicked vertices count by their number": _set(constants, CLICKED_WEIGHT=(6.0, 6.0)),
    "clicks are measurements": _set(position, with_sketch=lambda knots, known, *_: (knots, known)),
    "clicked lines end with their bodies": _set(finding, _shown=lambda _, line, __: line),
    "bodies without a sketch are taken out": _set(
        neighbours, without_neighbours=lambda seen, *_: seen
    ),
    "few knots for short bodies": _set(constants, KNOTS_SHORT_HW=0.0),
    "a clicked sketch without a body stays": _set(constants, KEPT_SKETCH=np.inf),
    "blunt ends are followed to their tips": _set(constants, BLUNT=(2.0, 3.0)),
    "knots that crowd are spaced evenly": _set(constants, CROWDED=0.0),
    "clicked ends are followed to their tips": _set(constants, CAP_AHEAD=2.0),
    "hollow bodies": _set(hollow, _between_rims=lambda *_: False),
    "curves that leave their paths are fitted again": _set(
        constants, FOLD_RAD=9.0, STRAYED_COST=1e9
    ),
    "pairs side by side": _set(pairs, settle_pairs=lambda _, __, bodies, *___: bodies),
    "outliers count linearly": _set(constants, HUBER=1e6),
    "bodies resist bending": _set(constants, BEND=0.0),
    "knots resist uneven spacing": _set(constants, UNEVEN=1e6),
    "learned taper": _held("log_power", "log_extent"),
    "half-width of the tips": _held("tip"),
    "half-width varies along": _held("log_width_1", "log_width_2", "log_width_3"),
    "brightness varies along": _held("brightness_1", "brightness_2"),
    "learned blur": _held("log_blur"),
    "learned overlap": _held("overlap"),
    "local background": _held("offset", "slope_row", "slope_col"),
    "curves end where their sketches do, or are marked": _set(constants, ENDS_HITS=np.inf),
    "weak signs of doubt": _set(doubt, reasons=lambda _: []),
}


def measure(without: str, frames: int) -> Iterator[Row]:
    """Refine everything without one mechanism."""
    MECHANISMS[without]()
    found: dict[str, list[tuple[float, bool]]] = {}
    for cell in CELLS:
        for index in range(frames):
            made = frame(cell, UNSEEN + index)
            curves = refine(made.image, made.sketches).curves
            for curve, truth in zip(curves, made.truths, strict=True):
                found.setdefault("generated", []).append(_apart(curve, truth))
    for case in CASES.values():
        trial = case.make(UNSEEN)
        curves = refine(trial.image, trial.sketches, **trial.options).curves
        for curve, truth in zip(curves, trial.truths, strict=True):
            if truth is not None:
                found.setdefault("stability", []).append(_apart(curve, truth))
    images = [("foreign", case) for case in real_foreign.cases()]
    real = list(real_cases.in_folders(real_cases.FOLDERS[:1]))
    images += [("real", case) for case in real]
    images += [("right", real_cases.jittered(case)) for case in real]
    images += [("stroke", real_cases.freehand(case)) for case in real]
    for where, case in images:
        curves = refine(case.image, next(iter(case.sketches.values()))).curves
        for curve, reference in zip(curves, case.references, strict=True):
            near = shares(curve.points, reference, float(np.median(curve.half_width)))
            known = average_dtw(curve.points, reference) if where == "foreign" else np.nan
            apart = known if verdict(*near) == "good" else np.inf
            found.setdefault(where, []).append((apart, curve.status == "good"))
    for where, bodies in found.items():
        apart, good = (np.array(column) for column in zip(*bodies, strict=True))
        lost, near = np.isinf(apart), apart[np.isfinite(apart)]
        mean = float(near.mean()) if len(near) else np.nan
        yield Row(without, where, len(bodies), int(lost.sum()), int((lost & good).sum()), mean)


def _apart(curve: Curve, truth: np.ndarray) -> tuple[float, bool]:
    """Average DTW, infinite for a curve that is lost; and whether the curve is not marked."""
    apart = average_dtw(curve.points, truth)
    return apart if apart <= FAR else np.inf, curve.status == "good"


def read() -> list[Row]:
    """What has been measured."""
    if not PATH.exists():
        return []
    kinds = [str, str, int, int, int, float]
    with PATH.open(newline="", encoding="utf-8") as file:
        lines = list(csv.reader(file))[1:]
    return [Row(*(kind(x) for kind, x in zip(kinds, line, strict=True))) for line in lines]


def table() -> str:
    """Lost bodies in percent and mean DTW in px, with every mechanism and without each."""
    rows = {(row.without, row.where): row for row in read()}
    places = list(dict.fromkeys(where for _, where in rows))
    body = []
    for name in (name for name in MECHANISMS if (name, "real") in rows):
        mine = [rows[name, where] for where in places]
        lost = [f"{100 * row.lost / row.bodies:.0f} %" for row in mine]
        apart = [f"{row.dtw:.3f}" for row in mine if np.isfinite(row.dtw)]
        body.append([name or "(nothing)", *lost, *apart, str(sum(row.silent for row in mine))])
    header = ["without", *(f"lost, {where}" for where in places)]
    header += [f"DTW, {where}" for where in places if np.isfinite(rows["", where].dtw)]
    return markdown([*header, "lost unmarked"], body)


def main() -> None:
    """Measure the rows asked for, each in its own process, and write the page."""
    parser = argparse.ArgumentParser("python tests/benchmarks/ablation.py", description=__doc__)
    parser.add_argument("--without", nargs="+", default=list(MECHANISMS), choices=list(MECHANISMS))
    parser.add_argument("--frames", type=int, default=8, help="in each of the eight cells")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--page", action="store_true", help="only write the table into the page")
    options = parser.parse_args()
    if options.page:
        insert("ablation", table() + "\n", PAGE)
        return
    if len(options.without) > 1:
        frames = ["--frames", str(options.frames)]
        calls = [[sys.executable, __file__, "--without", name, *frames] for name in options.without]
        with ThreadPoolExecutor(options.jobs) as pool:
            list(pool.map(partial(subprocess.run, check=True), calls))
        return
    (name,) = options.without
    new = list(measure(name, options.frames))
    with Path(__file__).open() as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        write([row for row in read() if row.without != name] + new)


def write(rows: list[Row]) -> None:
    """Replace what has been measured."""
    with PATH.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([field.name for field in fields(Row)])
        writer.writerows(astuple(replace(row, dtw=round(row.dtw, 4))) for row in rows)


if __name__ == "__main__":
    main()

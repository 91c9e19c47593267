"""Every weight of the engine ten times smaller and ten times larger: how far results move."""

import csv
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from functools import partial

import methods
import numpy as np
from stability_cases import CASES
from stability_rows import FAR, FOLDER, measure

from napari_splinesketch.engine import constants
from napari_splinesketch.engine.find import scoring
from napari_splinesketch.engine.fit import bands

FACTORS = (0.1, 10.0)
CASE = "plain"
PATH = FOLDER / "weights.csv"
FIELDS = ("version", "weight", "factor", "seeds", "median", "lost")


def _constant(module, name: str, factor: float):
    return _changed(module, name, factor * getattr(module, name))


@contextmanager
def _changed(module, name: str, value) -> Iterator[None]:
    before = getattr(module, name)
    setattr(module, name, value)
    try:
        yield
    finally:
        setattr(module, name, before)


def _of_priors(factor: float):
    """Scale the weight (one over the variance) of every prior of widths, taper, look."""
    make = bands.default_priors

    def scaled(*given, **options):
        made = make(*given, **options)
        return made._replace(sd=made.sd / np.sqrt(factor))

    return _changed(bands, "default_priors", scaled)


def _of_score(index: int, factor: float):
    """Scale the weight of one feature of a path's cost."""
    weights = constants.PATH_WEIGHTS.copy()
    weights[index] *= factor
    return _changed(constants, "PATH_WEIGHTS", weights)


WEIGHTS: dict[str, Callable[[float], AbstractContextManager[None]]] = {
    "bending of the curve": lambda factor: _changed(constants, "BEND", constants.BEND * factor),
    "uneven knots": lambda factor: _changed(
        constants, "UNEVEN", constants.UNEVEN / np.sqrt(factor)
    ),
    "priors of width, taper, look": _of_priors,
    **{f"path: {name}": partial(_of_score, i) for i, name in enumerate(scoring.FEATURES)},
    "body taken twice": partial(_constant, constants, "SHARED_COST"),
    "body explained": partial(_constant, constants, "EXPLAINED_GAIN"),
}


@dataclass(frozen=True)
class Line:
    """Result of one weight at one factor; `weight` is empty for the engine as it is."""

    version: str
    weight: str
    factor: float
    seeds: int
    median: float
    lost: float


def run(seeds: int, deadline: float) -> None:
    """Measure what has not been measured."""
    version = methods.make("balanced").version
    lines = [line for line in read() if (line.version, line.seeds) == (version, seeds)]
    done = {(line.weight, line.factor) for line in lines}
    wanted = [("", 1.0), *((w, f) for w in WEIGHTS for f in FACTORS)]
    for weight, factor in wanted:
        if (weight, factor) in done or time.monotonic() > deadline:
            continue
        lines.append(_measured(version, weight, factor, seeds))
        _write(lines)
        print(f"{weight or 'as it is'} × {factor:g}: {lines[-1].median:.3f} px", flush=True)


def _measured(version: str, weight: str, factor: float, seeds: int) -> Line:
    with WEIGHTS[weight](factor) if weight else nullcontext():
        rows = [r for s in range(seeds) for r in measure(version, CASES[CASE], s, "balanced")]
    dtw = np.array([row.dtw for row in rows])
    return Line(version, weight, factor, seeds, float(np.median(dtw)), float(np.mean(dtw > FAR)))


def _write(lines: list[Line]) -> None:
    PATH.parent.mkdir(parents=True, exist_ok=True)
    with PATH.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(FIELDS)
        for line in lines:
            values = (getattr(line, f) for f in FIELDS)
            writer.writerow([f"{v:.4g}" if isinstance(v, float) else v for v in values])


def read() -> list[Line]:
    """Lines on disk."""
    if not PATH.exists():
        return []
    with PATH.open(newline="", encoding="utf-8") as file:
        return [
            Line(
                r["version"], r["weight"], float(r["factor"]), int(r["seeds"]),
                float(r["median"]), float(r["lost"]),
            )
            for r in csv.DictReader(file)
        ]  # fmt: skip


def table() -> str:
    """Median DTW and its change for each weight."""
    lines = read()
    base = next(line for line in lines if not line.weight)
    header = ["weight", *(f"× {f:g}" for f in FACTORS), "bodies lost"]
    rows = ["| " + " | ".join(header) + " |", "|---" * len(header) + "|"]
    rows.append(f"| (as it is) | {base.median:.2f} px | | {100 * base.lost:.0f} % |")
    for weight in WEIGHTS:
        mine = {line.factor: line for line in lines if line.weight == weight}
        cells = [_change(mine.get(f), base) for f in FACTORS]
        lost = " / ".join(f"{100 * mine[f].lost:.0f} %" for f in FACTORS if f in mine)
        rows.append(f"| {weight} | " + " | ".join(cells) + f" | {lost} |")
    return "\n".join(rows) + "\n"


def _change(line: Line | None, base: Line) -> str:
    if line is None:
        return "–"
    return f"{line.median:.2f} px ({100 * (line.median / base.median - 1):+.0f} %)"

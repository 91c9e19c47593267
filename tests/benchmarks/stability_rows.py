"""What became of every body of the stability set, on disk, so that a sweep can go on later."""

import csv
import time
from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from rows import append
from stability_case import Case, Trial

from napari_splinesketch import Curve, refine
from napari_splinesketch.engine.settings import PresetName
from napari_splinesketch.metrics import average_dtw

FOLDER = Path(__file__).parents[2] / "docs" / "limits"
FAR = 2.0
"""A body further from the truth than this, px of average DTW, was not found."""


@dataclass(frozen=True)
class Row:
    """One curve of one trial.

    Attributes
    ----------
    version
        Of the engine.
    case, seed, body
        Which.
    initial, dtw
        Average DTW from the truth of the sketch, and of the curve, px; NaN where there is
        nothing to find.
    status, reasons
        What the curve says about itself.
    residual, sd, length, moved
        Residual; largest standard error but for the ends, px; length over the sketch's; distance
        between the middles of sketch and curve over the longer of the two.
    seconds
        For the whole frame, by the clock.
    """

    version: str
    case: str
    seed: int
    body: int
    initial: float
    dtw: float
    status: str
    reasons: str
    residual: float
    sd: float
    length: float
    moved: float
    seconds: float

    @property
    def lost(self) -> bool:
        """Whether the curve is not on its body."""
        return not self.dtw <= FAR

    @property
    def marked(self) -> bool:
        """Whether it says that it wants a look."""
        return self.status != "good"


def measure(version: str, case: Case, seed: int, preset: PresetName) -> list[Row]:
    """Refine one trial."""
    trial = case.make(seed)
    began = time.perf_counter()
    result = refine(trial.image, trial.sketches, preset, **trial.options)
    seconds = time.perf_counter() - began
    return [
        _row(version, case.name, seed, i, trial, curve, seconds)
        for i, curve in enumerate(result.curves)
    ]


def _row(
    version: str, case: str, seed: int, body: int, trial: Trial, curve: Curve, seconds: float
) -> Row:
    sketch, truth = trial.sketches[body], trial.truths[body]
    drawn = float(np.linalg.norm(np.diff(sketch, axis=0), axis=1).sum())
    moved = float(np.linalg.norm(curve.points.mean(0) - sketch.mean(0)))
    return Row(
        version=version,
        case=case,
        seed=seed,
        body=body,
        initial=float("nan") if truth is None else average_dtw(sketch, truth),
        dtw=float("nan") if truth is None else average_dtw(curve.points, truth),
        status=curve.status,
        reasons="; ".join(curve.reasons),
        residual=curve.residual,
        sd=float(curve.sd[10:-10].max()),
        length=curve.length / drawn,
        moved=moved / max(curve.length, drawn),
        seconds=seconds,
    )


def path_of(name: str) -> Path:
    """Where the rows of a preset are."""
    return FOLDER / "rows" / f"{name}.csv"


class Store:
    """The rows of one preset in one file; those of other versions of the engine are dropped."""

    def __init__(self, name: str, version: str) -> None:
        self.path = path_of(name)
        self.version = version
        self.rows = [row for row in read(self.path) if row.version == version]
        self._done = {(row.case, row.seed) for row in self.rows}
        self.path.parent.mkdir(parents=True, exist_ok=True)
        fresh = self.path.with_suffix(".new")
        fresh.write_text(",".join(f.name for f in fields(Row)) + "\n", encoding="utf-8")
        append(fresh, self.rows)  # pyright: ignore[reportArgumentType]
        fresh.replace(self.path)

    def has(self, case: str, seed: int) -> bool:
        """Whether a trial was run."""
        return (case, seed) in self._done

    def add(self, rows: list[Row]) -> None:
        """Append the rows of one trial."""
        self.rows += rows
        self._done |= {(row.case, row.seed) for row in rows}
        append(self.path, rows)  # pyright: ignore[reportArgumentType]


_PARSE = {str: str, int: int, float: float}


def read(path: Path) -> Iterator[Row]:
    """Read rows from a file that may not exist; a half-written last line is left out."""
    if not path.exists():
        return
    with path.open(newline="", encoding="utf-8") as file:
        for record in csv.DictReader(file):
            if None not in record.values():
                yield Row(**{f.name: _PARSE[f.type](record[f.name]) for f in fields(Row)})

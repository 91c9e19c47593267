"""Can the standard errors be believed? Shares of true errors within one, two, ... of them.

    python tests/benchmarks/uncertainty.py [--frames 12] [--minutes M]

Generated frames of one, two and three bodies with a usual look, with strong texture, with strong
noise, and thin; sketches rotated by 20 degrees. Curves that are not on their body (average DTW
above 2 px) have no meaningful error along the normal and are left out; those with any status are
kept. Rows go to docs/limits/rows, the table and the chart to docs/limits and docs/limits.md.
Frames that were run with this version of the engine are skipped.
"""

import argparse
import csv
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import methods
import numpy as np
import stability_charts
from insert import insert
from stability_rows import FAR, FOLDER

from napari_splinesketch import refine, synthetic
from napari_splinesketch.metrics import average_dtw, resample

PAGE = FOLDER.parent / "limits.md"
PATH = FOLDER / "rows" / "uncertainty.csv"
PRESET = "balanced"
BODIES = (1, 2, 3)
LOOKS: dict[str, dict] = {
    "usual": {},
    "textured": {"texture": 0.15, "shading": 0.2},
    "noisy": {"snr": 4.0},
    "thin": {"length": 45, "half_width": 1.2, "shape": (80, 80)},
}
MULTIPLES = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0)
NORMAL = (0.383, 0.683, 0.866, 0.954, 0.988, 0.997)
"""Shares of a normal distribution within MULTIPLES standard deviations."""
FIRST_SEED = 7_000
END = 10
"""Points from either end that count as ends."""
BESIDE = 2.3
"""Points nearer to another curve than this many half-widths lie beside it."""
FIELDS = ("version", "preset", "look", "bodies", "seed", "place", "points", "error", "sd")


@dataclass(frozen=True)
class Row:
    """Points of one frame in one place: the middle of a body, beside another curve, or an end.

    Attributes
    ----------
    version, preset, look, bodies, seed, place
        Which.
    points
        How many there are; 0 where no curve was on its body.
    error, sd
        Typical true error along the normal (1.48 times the median of its size, which for a
        normal distribution is the standard deviation), and median standard error, px.
    within
        Shares of the points whose error is below each of MULTIPLES of its standard error.
    """

    version: str
    preset: str
    look: str
    bodies: int
    seed: int
    place: str
    points: int
    error: float
    sd: float
    within: tuple[float, ...]


def normal_errors(points: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """(P,) signed distance of the truth along the normal, px; NaN where the truth has ended."""
    tangent = np.gradient(points, axis=0)
    normal = np.column_stack([-tangent[:, 1], tangent[:, 0]])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    dense = resample(truth, 1000)
    nearest = np.linalg.norm(points[:, None] - dense[None], axis=2).argmin(1)
    ended = (nearest <= 5) | (nearest >= len(dense) - 6)
    return np.where(ended, np.nan, ((dense[nearest] - points) * normal).sum(1))


def measure(version: str, look: str, bodies: int, seed: int) -> list[Row]:
    """Refine one frame."""
    scene = synthetic.scene(seed, bodies=bodies, **LOOKS[look])
    turns = np.random.default_rng(seed).choice([-20.0, 20.0], bodies)
    sketches = [synthetic.rotate(c, t) for c, t in zip(scene.centrelines, turns, strict=True)]
    curves = refine(scene.image, sketches, PRESET).curves
    errors, sds, places = [], [], []
    for i, (curve, truth) in enumerate(zip(curves, scene.centrelines, strict=True)):
        if average_dtw(curve.points, truth) <= FAR:
            errors.append(normal_errors(curve.points, truth))
            sds.append(curve.sd)
            others = [t for j, t in enumerate(scene.centrelines) if j != i]
            places.append(_places(curve.points, others, scene.half_widths[i].max()))
    found = []
    for place in ("middle", "beside", "end"):
        here = np.array(places).ravel() == place
        error, sd = (np.array(a).ravel()[here] for a in (errors, sds))
        known = np.isfinite(error)
        error, sd = error[known], sd[known]
        within = tuple(float(np.mean(np.abs(error) < m * sd)) for m in MULTIPLES if len(error))
        sizes = (1.4826 * _median(np.abs(error)), _median(sd))
        found.append(
            Row(version, PRESET, look, bodies, seed, place, len(error), *sizes, within=within)
        )
    return found


def _median(values: np.ndarray) -> float:
    return float(np.median(values)) if len(values) else 0.0


def _places(points: np.ndarray, others: Sequence[np.ndarray], half_width: float) -> np.ndarray:
    """Where each point of a curve lies."""
    places = np.full(len(points), "middle")
    if others:
        rest = np.concatenate(others)
        apart = np.linalg.norm(points[:, None] - rest[None], axis=2).min(1)
        places[apart < BESIDE * half_width] = "beside"
    places[:END] = places[-END:] = "end"
    return places


def read() -> Iterator[Row]:
    """Rows on disk; a half-written last line is left out."""
    if not PATH.exists():
        return
    with PATH.open(newline="", encoding="utf-8") as file:
        for r in csv.DictReader(file):
            if None in r.values():
                continue
            shares = tuple(float(r[f"{m:g}"]) for m in MULTIPLES) if int(r["points"]) else ()
            yield Row(
                r["version"], r["preset"], r["look"], int(r["bodies"]), int(r["seed"]), r["place"],
                int(r["points"]), float(r["error"]), float(r["sd"]), shares,
            )  # fmt: skip


def write(rows: Sequence[Row]) -> None:
    """Replace what is on disk."""
    PATH.parent.mkdir(parents=True, exist_ok=True)
    fresh = PATH.with_suffix(".new")
    with fresh.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([*FIELDS, *(f"{m:g}" for m in MULTIPLES)])
        for row in rows:
            values = [getattr(row, name) for name in FIELDS]
            values += row.within or (0.0,) * len(MULTIPLES)
            writer.writerow([f"{v:.4g}" if isinstance(v, float) else v for v in values])
    fresh.replace(PATH)


def sweep(frames: int, deadline: float) -> list[Row]:
    """Measure what has not been measured."""
    version = methods.make(PRESET).version
    rows = [row for row in read() if row.version == version]
    done = {(row.look, row.bodies, row.seed) for row in rows}
    for seed in range(FIRST_SEED, FIRST_SEED + frames):
        for look in LOOKS:
            for bodies in BODIES:
                new = (look, bodies, seed) not in done
                if new and time.monotonic() < deadline:
                    rows += measure(version, look, bodies, seed)
        write(rows)
    return rows


def shares(rows: Sequence[Row]) -> np.ndarray:
    """Share of points within each of MULTIPLES, over all points of some rows."""
    some = [row for row in rows if row.points]
    weights = np.array([row.points for row in some], dtype=float)
    return np.average([row.within for row in some], axis=0, weights=weights)


def _sizes(rows: Sequence[Row]) -> tuple[float, float]:
    """Medians over frames of the true and of the standard errors, px."""
    return _median(np.array([r.error for r in rows])), _median(np.array([r.sd for r in rows]))


def table(rows: Sequence[Row]) -> str:
    """Shares within one and two standard errors, by preset, look and place."""
    header = ["", "points", "within 1 sd", "within 2 sd", "typical error, px", "typical sd, px"]
    lines = ["| " + " | ".join(header) + " |", "|---" * len(header) + "|"]
    kinds = [("preset", "{}"), ("look", "balanced, {}"), ("place", "balanced, {}")]
    for field, label in kinds:
        for value in dict.fromkeys(getattr(row, field) for row in rows):
            mine = [row for row in rows if getattr(row, field) == value and row.points]
            if not mine:
                continue
            found, (error, sd) = shares(mine), _sizes(mine)
            count = sum(row.points for row in mine)
            cells = [label.format(value), str(count), f"{100 * found[1]:.0f} %"]
            cells += [f"{100 * found[3]:.0f} %", f"{error:.3f}", f"{sd:.3f}"]
            lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measure, draw, and write the table."""
    parser = argparse.ArgumentParser("python tests/benchmarks/uncertainty.py", description=__doc__)
    parser.add_argument("--frames", type=int, default=12, help="frames of each kind")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="start nothing after")
    options = parser.parse_args()
    rows = sweep(options.frames, time.monotonic() + 60 * options.minutes)
    curves = {PRESET: shares(rows)}
    for look in LOOKS:
        if look != "usual":
            curves[f"{PRESET}, {look}"] = shares([r for r in rows if r.look == look])
    stability_charts.reliability(curves, MULTIPLES, NORMAL, FOLDER / "reliability.png")
    insert("reliability", table(rows), PAGE)
    print(table(rows))


if __name__ == "__main__":
    main()

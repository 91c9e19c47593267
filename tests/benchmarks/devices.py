"""Seconds for many bodies on the device that JAX uses, one curve at a time or many at once.

    python tests/benchmarks/devices.py [--bodies 1 3 16 64 250 1000] [--together N]

Prints, for each number of bodies, the median of three calls after the first: of `refine`, and of
the fits within it. `JAX_PLATFORMS=cpu` and `cuda` choose the device. Adds the figures to
docs/benchmarks/devices.csv with `--write`, with the number of cores that may be used.
"""

import argparse
import csv
import statistics
import time
from pathlib import Path

import jax
import numpy as np
from scaling import side_for

from napari_splinesketch import refine, synthetic
from napari_splinesketch.engine.fit import fit_scene, solver
from napari_splinesketch.metrics import average_dtw

FIGURES = Path(__file__).parents[2] / "docs" / "benchmarks" / "devices.csv"
FIELDS = ("device", "cores", "together", "bodies", "refine_s", "fits_s", "first_s", "median_px")
REPEATS, POINTS = 3, 6
TILE = 10
"""Bodies lie in squares of so many, which cross within their square."""


def squares(bodies: int) -> tuple[np.ndarray, list[np.ndarray]]:
    """An image of so many bodies, and their centrelines."""
    count = min(bodies, TILE)
    side, parts = side_for(count), -(-bodies // count)
    across = int(np.ceil(np.sqrt(parts)))
    image = np.zeros((across * side, across * side))
    lines: list[np.ndarray] = []
    for k in range(parts):
        corner = np.array(divmod(k, across)) * side
        made = synthetic.scene(1000 + k, bodies=count, shape=(side, side))
        image[corner[0] : corner[0] + side, corner[1] : corner[1] + side] = made.image
        lines += [line + corner for line in made.centrelines]
    return image, lines[:bodies]


def measured(bodies: int) -> dict[str, float]:
    """Seconds of one number of bodies."""
    image, truths = squares(bodies)
    random = np.random.default_rng(0)
    clicked = [t[np.linspace(0, len(t) - 1, POINTS).astype(int)] for t in truths]
    sketches = [line + random.normal(0, 1, line.shape) for line in clicked]
    within = [0.0]
    fit_batches = fit_scene._fit_batches

    def timed(*args, **options):
        began = time.perf_counter()
        found = fit_batches(*args, **options)
        within[0] += time.perf_counter() - began
        return found

    fit_scene._fit_batches = timed
    seconds, fits, curves = [], [], ()
    try:
        for _ in range(1 + REPEATS):
            began, within[0] = time.perf_counter(), 0.0
            curves = refine(image, sketches).curves
            seconds.append(time.perf_counter() - began)
            fits.append(within[0])
    finally:
        fit_scene._fit_batches = fit_batches
    return {
        "refine_s": statistics.median(seconds[1:]),
        "fits_s": statistics.median(fits[1:]),
        "first_s": seconds[0],
        "median_px": float(
            np.median([average_dtw(c.points, t) for c, t in zip(curves, truths, strict=True)])
        ),
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--bodies", type=int, nargs="+", default=[1, 3, 16, 64, 250, 1000])
    parser.add_argument("--together", type=int, help="curves fitted at a time")
    parser.add_argument("--write", action="store_true", help="add the figures to the CSV")
    options = parser.parse_args()
    if options.together:
        solver.at_a_time = lambda: options.together
    device = jax.devices()[0].device_kind
    rows = []
    for bodies in options.bodies:
        row = {"device": device, "cores": fit_scene.cores()}
        row |= {"together": options.together or "", "bodies": bodies}
        row |= {name: round(value, 4) for name, value in measured(bodies).items()}
        print(row, flush=True)
        rows.append(row)
    if options.write:
        new = not FIGURES.exists()
        with FIGURES.open("a", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, FIELDS, lineterminator="\n")
            if new:
                writer.writeheader()
            writer.writerows(rows)


if __name__ == "__main__":
    main()

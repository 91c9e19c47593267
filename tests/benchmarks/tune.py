"""Finds the settings at which the other methods are at their best, on frames of their own.

    python tests/benchmarks/tune.py active_contour|filaments|splender [frames]

prints every setting tried and, last, the best: the smallest sum of the mean over all frames and
the mean over the best half. It is written by hand into `TUNED` of the method's module. The
frames are those of Table 1's cells with other seeds.
"""

import argparse
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import combinations, product
from typing import Any

import active_contour
import filaments
import numpy as np
import reference
from frames import TABLE_KINDS, Cell, Frame, frame
from runner import pin_to_one_core

from napari_splinesketch.metrics import average_dtw

COUNTS = (1, 2)
ROUNDS = 3
AT_ONCE = {"active_contour": 2, "filaments": 1, "splender": 1}

GRIDS: dict[str, dict[str, tuple[Any, ...]]] = {
    "active_contour": {
        "blurs": ((0.5,), (1.0,), (1.5,), (2.0, 1.0), (4.0, 2.0, 1.0)),
        "alpha": (0.0, 0.001, 0.01, 0.1),
        "beta": (0.3, 1.0, 3.0),
        "line": (0.3, 1.0, 3.0),
        "gamma": (0.003, 0.01, 0.03),
        "iterations": (1000, 4000),
    },
    "filaments": {
        "width": (15, 21, 31, 41),
        "fine_width": (7, 11, 15),
        "passes": (1, 2, 3),
        "interval": (4.0, 8.0),
        "error": (0.03, 0.1, 0.3),
        "extend": (0.0, 10.0, 20.0, 30.0),
    },
    "splender": {
        "global_scale": (0.2, 0.3, 0.5),
        "low": (0.0, 0.25),
        "noise": (0.0, 1e-8),
    },
}


START = {
    "active_contour": active_contour.TUNED,
    "filaments": filaments.TUNED,
    "splender": reference.TUNED,
}


def variants(method: str, settings: Any) -> Iterator[Any]:
    """Vary a few settings at a time; the slow methods' one by one."""
    grid = GRIDS[method]
    for names in combinations(grid, AT_ONCE[method]):
        for values in product(*(grid[name] for name in names)):
            yield replace(settings, **dict(zip(names, values, strict=True)))


def _run(method: str, settings: Any, given: Frame) -> list[np.ndarray]:
    if method == "splender":
        return reference.fit(given.image, given.sketches, settings, bright=given.bright)
    if method == "active_contour":
        images = active_contour.prepare(given.image, settings, bright=given.bright)
        return [active_contour.fit(images, s, settings) for s in given.sketches]
    image = given.image if given.bright else -given.image
    curves = [filaments.fit(image, s, settings) for s in given.sketches]
    return [s if c is None else c for c, s in zip(curves, given.sketches, strict=True)]


def score(run: Callable[[Frame], list[np.ndarray]], frames: list[Frame]) -> tuple[float, float]:
    """Mean over frames of the bodies' average DTW, capped at 5 px; and of the best half."""
    errors = [
        np.mean([average_dtw(c, t) for c, t in zip(run(given), given.truths, strict=True)])
        for given in frames
    ]
    ordered = np.sort(errors)
    return float(np.minimum(ordered, 5).mean()), float(ordered[: len(ordered) // 2].mean())


def main() -> None:
    """Try all variants."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("method", choices=START)
    parser.add_argument("frames", type=int, nargs="?", default=2)
    options = parser.parse_args()
    method, count = options.method, options.frames
    pin_to_one_core()
    cells = [Cell(n, kind, strength) for n in COUNTS for kind, strength in TABLE_KINDS]
    frames = [frame(cell, i, tuning=True) for cell in cells for i in range(count)]
    best, scores = START[method], {}
    for _ in range(ROUNDS):
        for settings in variants(method, best):
            if settings not in scores:
                scores[settings] = score(lambda f, s=settings: _run(method, s, f), frames)
                print(*scores[settings], settings, flush=True)
        winner = min(scores, key=lambda s: sum(scores[s]))
        if winner == best:
            break
        best = winner
    print("\nbest:", *scores[best], best)


if __name__ == "__main__":
    main()

"""Fit the weights by which signs of a wrong curve are added up (engine/doubt.py).

    python tests/benchmarks/doubt_weights.py [--seeds 28] [--frames 24]

Trials of every stability case and frames of three bodies, none of which any other benchmark uses,
each refined by `fast` and by `balanced`. A logistic regression tells curves that are more than
2 px from the truth from those that are not, both kinds weighing the same. Printed are the lines
to put into the engine, and what they come to on trials that they were not fitted to.
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass

import frames
import numpy as np
from scipy.optimize import minimize
from stability_cases import CASES
from stability_rows import FAR

from napari_splinesketch import refine
from napari_splinesketch.engine.judge import doubt
from napari_splinesketch.engine.settings import PresetName
from napari_splinesketch.metrics import average_dtw

FIRST_SEED = 1_000
PRESETS: tuple[PresetName, ...] = ("fast", "balanced")
CELLS = (("rotation", 20.0), ("displacement", 10.0), ("pca", 2.0), ("chord", 0.0), ("axis", 0.0))
FALSE = 0.05
"""Share of curves in the right place that `balanced` may mark."""
FOLDS = 5
RIDGE = 1.0
CLIP = 3.0
"""Standardised signs count no more than this while fitting."""


@dataclass(frozen=True)
class Example:
    """One curve: signs, whether it is lost, whether anything else marks it, and its trial."""

    preset: str

    signs: np.ndarray
    lost: bool
    marked: bool
    seed: int
    case: str


def examples(seeds: int, count: int) -> Iterator[Example]:
    """Refine everything; curves whose marks are asked for anyway are left out."""
    for case in CASES.values():
        for seed in range(FIRST_SEED, FIRST_SEED + seeds):
            trial = case.make(seed)
            given = trial.image, trial.sketches, trial.truths, trial.options
            for example in _of(*given, seed, case.name):
                if example.lost or case.expects != "marked":
                    yield example
    for kind, strength in CELLS:
        for seed in range(FIRST_SEED, FIRST_SEED + count):
            made = frames.frame(frames.Cell(3, kind, strength), seed, tuning=True)
            yield from _of(made.image, made.sketches, made.truths, {}, seed, kind)


def _of(image, sketches, truths, options, seed: int, case: str) -> Iterator[Example]:
    for preset in PRESETS:
        found: list[np.ndarray] = []
        judge = doubt.reasons

        def record(evidence, found=found):
            found.append(evidence.signs)
            return []

        doubt.reasons = record
        try:
            curves = refine(image, sketches, preset, **options).curves
        finally:
            doubt.reasons = judge
        signs = iter(found)
        for curve, truth in zip(curves, truths, strict=True):
            if curve.status != "failed":
                lost = truth is None or not average_dtw(curve.points, truth) <= FAR
                yield Example(preset, next(signs), lost, curve.status != "good", seed, case)


def fit(signs: np.ndarray, lost: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Weights of the signs, and their usual values; a curve is as likely lost as not at 0."""
    usual, spread = signs[~lost].mean(0), signs.std(0) + 1e-9
    x = np.column_stack([np.clip((signs - usual) / spread, -CLIP, CLIP), np.ones(len(signs))])
    y = 2.0 * lost - 1
    balance = np.where(lost, (~lost).sum() / max(lost.sum(), 1), 1.0)

    def loss(b):
        return (balance * np.logaddexp(0, -y * (x @ b))).sum() + RIDGE * (b[:-1] ** 2).sum() / 2

    return minimize(loss, np.zeros(x.shape[1])).x[:-1] / spread, usual


def shares(sums: np.ndarray, lost: np.ndarray, marked: np.ndarray, threshold: float) -> str:
    """What is marked, with what else marks a curve."""
    flagged = marked | (sums > threshold)
    return f"{flagged[lost].mean():.0%} of lost, {flagged[~lost].mean():.1%} of found"


def main() -> None:
    """Refine, fit, and say what it comes to."""
    parser = argparse.ArgumentParser(
        "python tests/benchmarks/doubt_weights.py", description=__doc__
    )
    parser.add_argument("--seeds", type=int, default=28, help="trials of each stability case")
    parser.add_argument("--frames", type=int, default=24, help="frames of each kind of sketch")
    options = parser.parse_args()
    found = list(examples(options.seeds, options.frames))
    signs = np.array([e.signs for e in found])
    lost, marked = (np.array([getattr(e, a) for e in found]) for a in ("lost", "marked"))
    fold = np.array([e.seed % FOLDS for e in found])
    stable = np.array([e.case in CASES for e in found])
    sums = np.zeros(len(found))
    for k in range(FOLDS):
        weights, usual = fit(signs[fold != k], lost[fold != k])
        sums[fold == k] = (signs[fold == k] - usual) @ weights
    right = stable & ~lost & np.array([e.preset == PRESETS[-1] for e in found])
    allowed = (FALSE * right.sum() - (right & marked).sum()) / (right & ~marked).sum()
    threshold = float(np.quantile(sums[right & ~marked], 1 - max(allowed, 0.001)))
    weights, usual = fit(signs, lost)
    print(f"{len(found)} curves, {lost.sum()} lost; other reasons mark", end=" ")
    print(shares(sums, lost, marked, np.inf))
    for preset in PRESETS:
        mine = np.array([e.preset == preset for e in found])
        for name, some in (("stability cases", stable & mine), ("three bodies", ~stable & mine)):
            print(f"{preset}, {name}:", shares(sums[some], lost[some], marked[some], threshold))
    for name, values in (("WEIGHTS", weights), ("USUAL", usual)):
        print(f"{name} = np.array([{', '.join(f'{v:.2g}' for v in values)}])")
    print(f"THRESHOLD = {threshold:.2g}")


if __name__ == "__main__":
    main()

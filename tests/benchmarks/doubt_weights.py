"""Fit the weights by which signs of a wrong curve are added up (engine/judge/doubt.py).

    python tests/benchmarks/doubt_weights.py [--frames 16] [--folder DIR ...]

Generated frames that no other benchmark uses, scenes of foreign make and real images that are not
held out are refined by `balanced`, the latter two also with sketches that are right already. A
logistic regression tells curves that are wrong from those that are right, both counting the same,
as do real and generated images. Printed are the lines to put into the engine, and what share of
wrong and of right curves each threshold marks, out of fold.
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import frames
import numpy as np
from jaxtyping import Bool, Float
from path_weights import CELLS, grey, tunable
from real_cases import FOLDERS, jittered
from real_judge import MOST, shares
from scipy.optimize import minimize

from napari_splinesketch import refine
from napari_splinesketch.engine.judge import doubt
from napari_splinesketch.metrics import average_dtw

FIRST = 400
"""Number of the first frame, out of reach of the other benchmarks."""
COUNTS = (1, 2, 3)
FAR = 2.0
"""A generated body is lost where its curve is farther from it, px of average DTW."""
SHARE = {"real": 1.0, "foreign": 0.5, "generated": 1.0}
"""How much each source weighs."""
FOLDS = 6
RIDGE = 0.02
CLIP = 3.0
"""Standardised signs count no more than this while fitting."""


@dataclass(frozen=True)
class Example:
    """One curve: where it is from, its signs, whether it is wrong, and whether it is marked."""

    source: str
    scene: str
    signs: Float[np.ndarray, " S"]
    wrong: bool
    marked: bool


def examples(count: int, folders) -> Iterator[Example]:
    """Refine everything that may be tuned on."""
    for bodies in COUNTS:
        for kind, strength in CELLS:
            for index in range(FIRST, FIRST + count):
                made = frames.frame(frames.Cell(bodies, kind, strength), index, tuning=True)

                def wrong(i, curve, made=made):
                    return not average_dtw(curve.points, made.truths[i]) <= FAR

                scene = f"{bodies}_{kind}_{index}"
                yield from _of(made.image, made.sketches, wrong, "generated", scene)
    for source, case in tunable(folders):
        for mine in (case, jittered(case)):

            def missed(i, curve, case=case):
                return min(shares(curve.points, case.references[i], case.half_width)) < MOST

            for sketches in mine.sketches.values():
                yield from _of(grey(mine), sketches, missed, source, case.name)


def _of(image, sketches, wrong, source: str, scene: str) -> Iterator[Example]:
    """What is collected of each curve, in the order of the sketches."""
    known: dict[tuple[float, ...], doubt.Evidence] = {}
    collect = doubt.collect

    def record(points, sd, *others):
        evidence = collect(points, sd, *others)
        known[tuple(sorted(sd))] = evidence  # curves may begin at their other end
        return evidence

    doubt.collect = record
    try:
        curves = refine(image, sketches).curves
    finally:
        doubt.collect = collect
    for i, curve in enumerate(curves):
        if curve.status != "failed":
            signs = known[tuple(sorted(curve.sd))].signs
            yield Example(source, scene, signs, bool(wrong(i, curve)), curve.status != "good")


def fit(
    signs: Float[np.ndarray, "N S"], wrong: Bool[np.ndarray, " N"], source: np.ndarray
) -> tuple[Float[np.ndarray, " S"], Float[np.ndarray, " S"]]:
    """Weights of the signs, none below 0, and their usual values."""
    usual, spread = np.median(signs[~wrong], axis=0), signs.std(0) + 1e-9
    x = np.clip((signs - usual) / spread, -CLIP, CLIP)
    y = np.where(wrong, 1.0, -1.0)
    weight = np.zeros(len(signs))
    for name, share in SHARE.items():
        for side in (wrong, ~wrong):
            mine = side & (source == name)
            weight[mine] = share / max(mine.sum(), 5)

    def loss(b):
        sums = x @ b[1:] + b[0]
        slope = -y * weight / (1 + np.exp(np.clip(y * sums, -50, 50)))
        value = (weight * np.logaddexp(0, -y * sums)).sum() + RIDGE * (b[1:] ** 2).sum()
        return value, np.concatenate([[slope.sum()], x.T @ slope + 2 * RIDGE * b[1:]])

    bounds = [(None, None), *[(0, None)] * x.shape[1]]
    found = minimize(loss, np.zeros(1 + x.shape[1]), jac=True, bounds=bounds).x
    return found[1:] / spread, usual


def main() -> None:
    """Refine, fit, and say what it comes to."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--frames", type=int, default=16, help="frames a cell")
    parser.add_argument("--folder", type=Path, action="append", help="of real cases")
    options = parser.parse_args()
    known = list(examples(options.frames, options.folder or FOLDERS))
    signs = np.array([e.signs for e in known])
    wrong, marked = (np.array([getattr(e, a) for e in known]) for a in ("wrong", "marked"))
    source = np.array([e.source for e in known])
    scenes = sorted({e.scene for e in known})
    fold = np.array([scenes.index(e.scene) % FOLDS for e in known])
    sums = np.zeros(len(known))
    for k in range(FOLDS):
        weights, usual = fit(signs[fold != k], wrong[fold != k], source[fold != k])
        sums[fold == k] = (signs[fold == k] - usual) @ weights

    def line(label: str, flagged: Bool[np.ndarray, " N"]) -> None:
        each = [
            f"{name} {flagged[wrong & (source == name)].mean():.0%} of wrong, "
            f"{flagged[~wrong & (source == name)].mean():.0%} of right"
            for name in SHARE
        ]
        print(f"{label}: {'; '.join(each)}")

    print(f"{len(known)} curves, {wrong.sum()} wrong")
    line("marked now", marked)
    for threshold in np.arange(1.4, 4.0, 0.2):
        line(f"threshold {threshold:.1f}", sums > threshold)
    weights, usual = fit(signs, wrong, source)
    print("SIGNS =", doubt.SIGNS)
    for name, values in (("WEIGHTS", weights), ("USUAL", usual)):
        print(f"{name} = np.array([{', '.join(f'{v:.2g}' for v in values)}])")


if __name__ == "__main__":
    main()

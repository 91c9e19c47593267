"""Fit the weights by which signs of a wrong curve are added up (engine/judge/doubt.py).

    python tests/benchmarks/doubt_weights.py [--frames 16] [--jobs N] [--folder DIR ...]

Generated frames that no other benchmark uses, scenes of foreign make and real images that are not
held out are refined by `balanced`: the first also with a few clicked points that are off as a
whole or each by itself, the latter two also with sketches that are right already. A
logistic regression tells curves that are wrong from those that are right, both counting the same,
as do real and generated images. Printed are the lines to put into the engine, and what share of
wrong and of right curves each threshold marks, out of fold.
"""

import argparse
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("JAX_PLATFORMS", "cpu")

import frames
import numpy as np
import perturbations
from jaxtyping import Bool, Float
from path_weights import CELLS, grey, tunable
from real_cases import FOLDERS, Case, by_arc, jittered
from real_judge import MOST, shares
from scipy.optimize import minimize

from napari_splinesketch import refine, synthetic
from napari_splinesketch.engine.judge import doubt
from napari_splinesketch.metrics import average_dtw

FIRST = 400
"""Number of the first frame, out of reach of the other benchmarks."""
COUNTS = (1, 2, 3)
HANDS = {"turned": 12.0, "moved": 5.0, "careless": 1.8}
"""How clicked sketches are off: turned by so many degrees, moved by so many px, or each point by
so many px (standard deviation, row and column)."""
CLICKS = 4, 9
"""Their points: at least, and fewer than."""
FAR = 2.0
"""A generated body is lost where its curve is farther from it, px of average DTW."""
SHARE = {"real": 2.0, "foreign": 0.5, "generated": 0.7, "clicked": 0.5}
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


Task = Callable[[], "list[Example]"]


def tasks(count: int, folders) -> Iterator[Task]:
    """What to refine of everything that may be tuned on."""
    for bodies in COUNTS:
        for kind, strength in CELLS:
            cell = frames.Cell(bodies, kind, strength)
            yield from (partial(_generated, cell, FIRST + k, "generated") for k in range(count))
        for hand in HANDS:
            cell = frames.Cell(bodies, "rotation", 0.0)
            yield from (partial(_generated, cell, FIRST + k, "clicked", hand) for k in range(count))
    for source, case in tunable(folders):
        yield partial(_of_case, case, source)
        yield partial(_of_case, jittered(case), source)


def _generated(cell: frames.Cell, index: int, source: str, hand: str = "") -> list[Example]:
    made = frames.frame(cell, index, tuning=True)
    random = np.random.default_rng([cell.bodies, index, *hand.encode()])
    sketches = [_clicked(x, hand, random) for x in made.truths] if hand else made.sketches

    def wrong(i, curve):
        return not average_dtw(curve.points, made.truths[i]) <= FAR

    scene = f"{cell.bodies}_{cell.kind}{hand}_{index}"
    return list(_of(made.image, sketches, wrong, source, scene))


def _clicked(line, hand: str, random: np.random.Generator) -> Float[np.ndarray, "N 2"]:
    """A few points on a body, as a hand that is off sets them."""
    points, off = by_arc(line, int(random.integers(*CLICKS))), HANDS[hand]
    if hand == "turned":
        return synthetic.rotate(points, off * random.choice([-1, 1]))
    if hand == "moved":
        return perturbations.displace(points, off, random)
    return points + random.normal(0, off, points.shape)


def _of_case(case: Case, source: str) -> list[Example]:
    def wrong(i, curve):
        width = float(np.median(curve.half_width))
        return min(shares(curve.points, case.references[i], width)) < MOST

    found: list[Example] = []
    for sketches in case.sketches.values():
        found += _of(grey(case), sketches, wrong, source, case.name)
    return found


def _done(task: Task) -> list[Example]:
    return task()


def _of(image, sketches, wrong, source: str, scene: str) -> Iterator[Example]:
    """What is collected of each curve, in the order of the sketches."""
    known: dict[tuple[float, ...], doubt.Evidence] = {}
    collect = doubt.collect

    def record(points, u, sd, *others):
        evidence = collect(points, u, sd, *others)
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
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--folder", type=Path, action="append", help="of real cases")
    options = parser.parse_args()
    what = list(tasks(options.frames, options.folder or FOLDERS))
    with ProcessPoolExecutor(options.jobs, mp_context=get_context("spawn")) as pool:
        known = [one for some in pool.map(_done, what) for one in some]
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
    for threshold in np.arange(2.0, 4.6, 0.2):
        line(f"threshold {threshold:.1f}", sums > threshold)
    weights, usual = fit(signs, wrong, source)
    print("SIGNS =", doubt.SIGNS)
    for name, values in (("WEIGHTS", weights), ("USUAL", usual)):
        print(f"{name} = np.array([{', '.join(f'{v:.2g}' for v in values)}])")


if __name__ == "__main__":
    main()

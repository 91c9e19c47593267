"""Fit the weights by which paths are chosen (engine/find/scoring.py and choice.py).

    python tests/benchmarks/path_weights.py [--frames 24] [--folder DIR ...]

Of each group of sketches that may mean the same pieces of body the sets of paths are gathered that
the engine looks at, from generated frames that no other benchmark uses, scenes of foreign make and
real images that are not held out; real ones also with sketches that are right already. The
weights are those by which the sets with the most right paths are the likeliest, out of fold, the
sources weighing the same but for generated frames. Printed are the weights there are and those
that were fitted, and how many bodies the best set loses by either.
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import frames
import numpy as np
import real_foreign
from jaxtyping import Float
from real_cases import FOLDERS, RIGHT, Case, in_folders, jittered
from real_judge import MOST, shares
from scipy.optimize import minimize

from napari_splinesketch.engine import constants, islands
from napari_splinesketch.engine.find import choice, finding, scoring
from napari_splinesketch.engine.look import scene
from napari_splinesketch.engine.settings import Settings
from napari_splinesketch.metrics import average_dtw

FIRST = 200
"""Number of the first frame, out of reach of the other benchmarks."""
CELLS = (
    ("rotation", 20.0),
    ("rotation", 30.0),
    ("displacement", 10.0),
    ("chord", 0.0),
    ("axis", 0.0),
    ("scaling", 0.7),
    ("part", 0.75),
)
COUNTS = (1, 2, 3, 4)
SETS = 24
"""Sets looked at in each group."""
FAR = 1.5
"""A path so many px from the truth is worth half of one that lies on it."""
FOLDS = 4
SHARE = {"generated": 2.0}
"""How much a source weighs against the others."""
RIDGE = 0.03
NAMES = (*scoring.FEATURES, "shared", "explains")
NOW = np.array([*constants.PATH_WEIGHTS, constants.SHARED_COST, constants.EXPLAINED_GAIN])


@dataclass(frozen=True, eq=False)
class Group:
    """The sets of paths of some sketches: what is known of each, and how right they are."""

    source: str
    scene: str
    terms: Float[np.ndarray, "S F"]
    right: Float[np.ndarray, " S"]
    bodies: int


def groups(image, sketches, right, source: str, name: str) -> Iterator[Group]:
    """The groups of one image; `right` tells how right a line is for a sketch, 0 to 1."""
    lines = [np.asarray(s, float) for s in sketches]
    for island in islands.split(image, lines, range(len(lines)), ()):
        pixels = island.pose.cut(image)
        for members, seen in scene.read_scenes(pixels, island.sketches, "auto", None):
            mine = [island.sketches[i] for i in members]
            graph, candidates = finding.candidates_of(seen, mine, Settings(), lambda _: None)
            usual = finding.usual_length(mine)
            length, price = choice.prices(graph, seen.half_width, usual)
            none = np.zeros(len(graph.pieces), dtype=bool)
            for cluster in choice.interacting(candidates):
                of = [candidates[i] for i in cluster]
                paths = choice.sets(graph, of, seen.half_width, usual, none)[0][:SETS]
                known = [c.known for c in of]
                good = [
                    [right(island.members[members[i]], island.pose.outside(x)) for x in c.lines]
                    for i, c in zip(cluster, of, strict=True)
                ]
                every = np.arange(len(graph.pieces))
                covers = _sums([c.along(every) for c in of], paths)
                earns = _sums([c.along(every) * bool(c.explains) for c in of], paths)
                terms = np.column_stack(
                    [
                        _sums(known, paths),
                        np.maximum(covers - 1, 0) @ price,
                        -choice.eagerness(len(cluster)) * ((earns > 0) @ length),
                    ]
                )
                count = _sums([np.array(g) for g in good], paths)
                yield Group(source, name, terms, count, len(cluster))


def _sums(values: list[np.ndarray], paths: np.ndarray) -> np.ndarray:
    """Over the paths of each set."""
    return np.sum([of[p] for of, p in zip(values, paths.T, strict=True)], axis=0, dtype=float)


def everything(count: int, folders) -> Iterator[Group]:
    """All groups that may be tuned on."""
    for bodies in COUNTS:
        for kind, strength in CELLS:
            for index in range(FIRST, FIRST + count):
                made = frames.frame(frames.Cell(bodies, kind, strength), index, tuning=True)

                def right(i, line, made=made):
                    return 1 / (1 + (average_dtw(line, made.truths[i]) / FAR) ** 2)

                name = f"{bodies}_{kind}_{index}"
                yield from groups(made.image, made.sketches, right, "generated", name)
    for source, case in tunable(folders):
        yield from _of_case(case, source)
        yield from _of_case(jittered(case), RIGHT)


def tunable(folders) -> Iterator[tuple[str, Case]]:
    """Scenes of foreign make and real images that are not held out, with where they are from."""
    for case in [*real_foreign.cases(), *in_folders(folders)]:
        if case.split == "tune":
            source = "foreign" if case.name.startswith(real_foreign.NAME) else "real"
            yield source, case


def grey(case: Case) -> Float[np.ndarray, "H W"]:
    """The mean of a case's colours."""
    image = np.asarray(case.image, float)
    return image[..., :3].mean(-1) if image.ndim == 3 else image


def _of_case(case: Case, source: str) -> Iterator[Group]:
    image = grey(case)

    def right(i, line):
        least = min(shares(line, case.references[i], case.half_width))
        return 1.0 if least >= MOST else least**2

    for sketches in case.sketches.values():
        yield from groups(image, sketches, right, source, case.name)


def fitted(known: list[Group]) -> Float[np.ndarray, " F"]:
    """Weights by which sets with many right paths are likely, near those that there are."""
    telling = [g for g in known if np.ptp(g.right) > 0]
    usual = np.mean([g.terms.var(0) for g in telling], axis=0)
    unit = 1 / np.sqrt(np.maximum(usual, 1e-6))
    source = [g.source for g in telling]
    share = np.array([SHARE.get(s, 1.0) / source.count(s) for s in source])

    def loss(relative):
        value, slope = 0.0, np.zeros(len(NOW))
        for g, weight in zip(telling, share, strict=True):
            x = (g.terms - g.terms.mean(0)) * unit
            score = -x @ relative
            p = np.exp(score - score.max())
            p /= p.sum()
            gain = g.right / g.right.max()
            expected = p @ gain
            value -= weight * np.log(expected + 1e-9)
            slope += weight * ((p * gain / (expected + 1e-9)) - p) @ x
        apart = relative - NOW / unit
        return value + RIDGE * apart @ apart, slope + 2 * RIDGE * apart

    begin = NOW / unit
    found = minimize(loss, begin, jac=True, bounds=[(0, None)] * len(NOW))
    return found.x * unit


def lost(
    known: list[Group], weights: Float[np.ndarray, " F"]
) -> dict[str, tuple[float, float, int]]:
    """For each source the bodies that the best set loses, those that any set does, and all."""
    found: dict[str, tuple[float, float, int]] = {}
    for g in known:
        a, b, n = found.get(g.source, (0.0, 0.0, 0))
        best = g.right[np.argmin(g.terms @ weights)]
        found[g.source] = a + g.bodies - best, b + g.bodies - g.right.max(), n + g.bodies
    return found


def main() -> None:
    """Gather, fit, print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--frames", type=int, default=24, help="frames a cell")
    parser.add_argument("--folder", type=Path, action="append", help="of real cases")
    options = parser.parse_args()
    known = list(everything(options.frames, options.folder or FOLDERS))
    names = sorted({g.scene for g in known})
    held: dict[str, np.ndarray] = {}
    for fold in range(FOLDS):
        out = set(names[fold::FOLDS])
        found = fitted([g for g in known if g.scene not in out])
        for source, row in lost([g for g in known if g.scene in out], found).items():
            held[source] = held.get(source, np.zeros(3)) + np.array(row)
    now = lost(known, NOW)
    for source, (by_now, least, bodies) in now.items():
        print(
            f"{source:10s} {bodies:4d} bodies: {by_now:.1f} wrong now, "
            f"{held[source][0]:.1f} out of fold, {least:.1f} whatever is chosen"
        )
    for name, value, new in zip(NAMES, NOW, fitted(known), strict=True):
        print(f"{name:10s} {value:6.2f} -> {new:6.2f}")


if __name__ == "__main__":
    main()

"""Measurements of one thing each: crowds, order, ends, sizes, widths and others.

python tests/benchmarks/real_modes.py [modes...] [--preset balanced] [--frames N]

Prints a line for each, and writes all figures to docs/benchmarks/real_modes.csv.
"""

import argparse
import csv
import os
import resource
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("JAX_PLATFORMS", "cpu")

import numpy as np
from frames import spoil
from real_cases import FOLDERS, ROOT, Case, Line, freehand, in_folders, jittered, straightened
from real_foreign import LOOKS, NAME, PROFILES, SET, TAPERS, pair, scene, single
from real_judge import MOST, shares, verdict
from scipy.ndimage import gaussian_filter
from scipy.spatial import KDTree

from napari_splinesketch import Curve, refine, suggest, synthetic
from napari_splinesketch.engine import spline
from napari_splinesketch.metrics import average_dtw

FIGURES = ROOT / "docs" / "benchmarks" / "real_modes.csv"
LOST = 2.0
"""A curve farther than this from its body is lost, px of average DTW, as in the other tables."""
TURNED = 20.0
"""Sketches are turned by so many degrees, either way."""
MOVED, FAR = 0.1, 0.5
"""A curve has moved; a curve has moved far and must be marked: largest distance, px."""
UNIT = 3.7
"""An image is multiplied by this, as if it were in another unit."""
SEED = 910_000
SIZES = (
    *((1.2, n) for n in (30, 100, 400, 1000, 2000)),
    *((2.0, n) for n in (40, 200, 1000, 2000)),
    *((3.0, n) for n in (60, 200, 600, 2000)),
    *((6.0, n) for n in (100, 400, 1500)),
    *((12.0, n) for n in (200, 800, 2000)),
    *((24.0, n) for n in (400, 1500)),
    (36.0, 500),
)
"""Half-widths and lengths, px."""
WIDE, THIN = (8.0, 13.0), (1.5, 2.8)
"""Ranges of the half-widths of bodies in one image, px."""
LEAST_RIGHT = 1.4
"""A half-width that is wrong by more than this factor is wrong."""
TOO_WIDE = 1.3
"""The same for one of bodies side by side: beyond this it reaches into its neighbours."""
ENDS_FRAMES = 8
"""Ends vary by as much as a pixel: there are so many bodies of each taper for each frame."""
THICK, LONG = (3.0, 6.0, 12.0), 150.0
"""Half-widths and length of bodies of different profiles, px."""
MESH, APART = 6000, 60
"""Side of an image full of filaments, and how far these are from each other, px."""
STRETCHES = ((500, 6), (2000, 2), (2000, 21), (4000, 41))
"""Lengths and numbers of points of lines on them, px."""
UNEQUAL = ("club",)
"""Tapers whose two ends are not alike."""
RIMS = (3.5, 4.5, 6.0)
"""Half-widths of hollow bodies, px."""
SCENES = 20
"""There is one scene of six hollow bodies of each half-width for so many frames."""
FIRST = 1000
"""Number of the first of these scenes."""

Figures = dict[str, float]
Refine = Callable[[np.ndarray, Sequence[Line]], tuple[Curve, ...]]


def crowd(run: Refine, frames: int) -> Figures:
    """Three bodies that cross, of which one or two have a sketch."""
    lost, marked = [], []
    for seed in range(frames):
        scene = synthetic.scene(SEED + seed, bodies=3)
        for count in (1, 2):
            pairs = _judged(run, scene.image, _turned(scene, seed)[:count], scene.centrelines)
            lost += [far for far, _ in pairs]
            marked += [mark for far, mark in pairs if far]
    return {"bodies": len(lost), "lost, %": _percent(lost), "lost ones marked, %": _percent(marked)}


def contrast(run: Refine, frames: int) -> Figures:
    """Two bodies that cross, at twice the usual noise."""
    lost, marked = [], []
    for seed in range(frames):
        snr = float(np.random.default_rng(seed).uniform(5, 7.5))
        scene = synthetic.scene(SEED + 1000 + seed, bodies=2, snr=snr)
        pairs = _judged(run, scene.image, _turned(scene, seed), scene.centrelines)
        lost += [far for far, _ in pairs]
        marked += [mark for far, mark in pairs if far]
    return {"bodies": len(lost), "lost, %": _percent(lost), "lost ones marked, %": _percent(marked)}


def _turned(scene: synthetic.Scene, seed: int) -> list[Line]:
    rng = np.random.default_rng([SEED, seed])
    return [spoil(line, "rotation", TURNED, rng) for line in scene.centrelines]


def _judged(run: Refine, image, sketches, truths) -> list[tuple[bool, bool]]:
    """Whether each curve is lost, and whether it is marked."""
    curves = run(image, sketches)
    pairs = zip(curves, truths, strict=False)
    return [(average_dtw(c.points, t) > LOST, c.status != "good") for c, t in pairs]


def _transposed(points: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    del shape
    return points[:, ::-1]


def _flipped(points: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    return np.stack([shape[0] - 1 - points[:, 0], points[:, 1]], axis=1)


def _quarter(points: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    return np.stack([shape[1] - 1 - points[:, 1], points[:, 0]], axis=1)


def _back(points: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Turn a quarter back; `shape` is that of the frame before it was turned."""
    return np.stack([points[:, 1], shape[1] - 1 - points[:, 0]], axis=1)


TURNS = (
    (np.transpose, _transposed, _transposed),
    (np.flipud, _flipped, _flipped),
    (np.rot90, _quarter, _back),
)
"""How an image and points are turned, and points back."""


def order(run: Refine, frames: int) -> Figures:
    """The same scene with its sketches in another order, transposed, flipped, turned."""
    mean, most, unmarked = [], [], []
    for seed in range(frames):
        scene = synthetic.scene(SEED + 2000 + seed, bodies=2 + seed % 2, shape=(128, 140))
        image, sketches = scene.image, _turned(scene, seed)
        first = run(image, sketches)
        others = [run(image, sketches[::-1])[::-1]]
        moved = [[c.points for c in others[0]]]
        for turn, forth, back in TURNS:
            curves = run(
                np.ascontiguousarray(turn(image)), [forth(s, image.shape) for s in sketches]
            )
            others.append(curves)
            moved.append([back(c.points, image.shape) for c in curves])
        for curves, lines in zip(others, moved, strict=True):
            for one, other, line in zip(first, curves, lines, strict=True):
                mean.append(average_dtw(one.points, line))
                most.append(float(np.linalg.norm(one.points - line, axis=1).max()))
                if one.status == other.status == "good":
                    unmarked.append(most[-1])
    return {
        "curves": len(most),
        "moved over 0.1 px, %": _percent([m > MOVED for m in most]),
        "moved over 0.1 px on average, %": _percent([m > MOVED for m in mean]),
        "median of the average, px": float(np.median(mean)),
        "over 0.5 px unmarked, %": 100 * sum(m > FAR for m in unmarked) / len(most),
        "largest unmarked, px": max(unmarked, default=0.0),
    }


def rounding(run: Refine, frames: int) -> Figures:
    """Real images in another unit: but for rounding, nothing is different."""
    moved, unmarked = [], []
    for case in in_folders(FOLDERS[:1]):
        for drawn in (case, jittered(case)):
            sketches = next(iter(drawn.sketches.values()))
            image = case.image.astype(np.float64)
            for one, other in zip(run(image, sketches), run(UNIT * image, sketches), strict=True):
                away = max(
                    float(spline.apart(a.points, b.points).max())
                    for a, b in ((one, other), (other, one))
                )
                moved.append(away)
                unmarked.append(away > 1 and one.status == other.status == "good")
    return {
        "curves": len(moved),
        "moved over 0.1 px, %": _percent([m > MOVED for m in moved]),
        "moved over 1 px, %": _percent([m > 1 for m in moved]),
        "over 1 px unmarked, %": _percent(unmarked),
    }


def ends(run: Refine, frames: int) -> Figures:
    """How far single bodies of three tapers end beyond (+) or short of (-) their tips.

    Medians; where both ends of the bodies are alike, of both together.
    """
    figures: Figures = {}
    for name, taper in TAPERS.items():
        biases = []
        for seed in range(ENDS_FRAMES * frames):
            case = single(SEED + seed, 3.0, 100.0, taper=taper)
            curve = run(case.image, case.sketches[SET])[0].points
            biases.append(_beyond(curve, case.references[0]))
        both = np.array(biases)
        parts = {"first": both[:, 0], "last": both[:, 1]} if name in UNEQUAL else {"either": both}
        figures |= {f"{name}: {end} end, px": float(np.median(x)) for end, x in parts.items()}
    return figures


def _beyond(curve: Line, truth: Line) -> tuple[float, float]:
    """How far a curve's ends lie beyond the truth's, along the truth; sketches keep direction."""
    first = (truth[0] - truth[3]) / np.linalg.norm(truth[0] - truth[3])
    last = (truth[-1] - truth[-4]) / np.linalg.norm(truth[-1] - truth[-4])
    return float((curve[0] - truth[0]) @ first), float((curve[-1] - truth[-1]) @ last)


def sizes(run: Refine, frames: int) -> Figures:
    """Bodies of 22 half-widths and lengths from five points, a few more where long."""
    del frames
    figures: Figures = {}
    for half_width, length in SIZES:
        case = single(SEED, half_width, length)
        began = time.perf_counter()
        curve = run(case.image, case.sketches[SET])[0]
        seconds = time.perf_counter() - began
        width = float(np.median(curve.half_width))
        good = verdict(*shares(curve.points, case.references[0], width)) == "good"
        figures[case.name] = float(good)
        print(f"  {case.name}: {'good' if good else 'not good'}, {curve.status}, {seconds:.1f} s")
    return {"good": sum(figures.values()), "of": len(figures), **figures}


def widths(run: Refine, frames: int) -> Figures:
    """One or two wide bodies among thin ones, from ends alone, four points, or a stroke."""
    figures: Figures = {}
    for kind, vertices in (("straight", 2), ("clicked", 4), ("freehand", 100)):
        found: list[tuple[bool, bool, bool]] = []
        for number in range(max(1, frames // 6)):
            rng = np.random.default_rng(SEED + number)
            wide = rng.integers(1, 3)
            own = [rng.uniform(*(WIDE if i < wide else THIN)) for i in range(6)]
            rows = np.concatenate([35 + 42 * np.arange(wide), np.linspace(125, 265, 6 - wide)])
            truths = [_bow(rng, row) for row in rows]
            places = np.moveaxis(np.indices((300, 300)), 0, -1)
            edges = [w - KDTree(t).query(places)[0] + 0.5 for w, t in zip(own, truths, strict=True)]
            image = np.clip(edges, 0, 1).max(0) + rng.normal(0, 0.15, (300, 300))
            at = np.linspace(0, 399, vertices).astype(int)
            sketches = [t[at] + rng.normal(0, 1, (vertices, 2)) for t in truths]
            for curve, truth, width in zip(run(image, sketches), truths, own, strict=True):
                if width > WIDE[0]:
                    off = KDTree(truth).query(curve.points)[0].mean() > LOST
                    ratio = abs(np.log(np.median(curve.half_width) / width))
                    wrong = ratio > np.log(LEAST_RIGHT)
                    found.append((bool(off), bool(wrong), curve.status != "good"))
        lost, wrong, marked = (_percent(flags) for flags in zip(*found, strict=True))
        figures |= {f"{kind}: wide bodies": len(found), f"{kind}: lost, %": lost}
        figures |= {f"{kind}: wrong half-width, %": wrong, f"{kind}: marked, %": marked}
    return figures


def packed(run: Refine, frames: int) -> Figures:
    """One of five flat bodies side by side has a sketch, and is lost or has a wrong half-width."""
    figures: Figures = {}
    for kind, vertices in (("clicked", 4), ("straight", 2)):
        found: list[tuple[bool, bool]] = []
        for number in range(frames):
            rng = np.random.default_rng(SEED + number)
            image, truth, own = _pack(rng)
            at = np.linspace(0, len(truth) - 1, vertices).astype(int)
            sketch = truth[at] + rng.normal(0, 1, (vertices, 2)) * (vertices > 2)
            (curve,) = run(image, [sketch])
            off = KDTree(truth).query(curve.points)[0]
            ratio = abs(np.log(curve.typical_half_width / own))
            found.append(
                (bool(np.median(off) > own / 2 or ratio > np.log(TOO_WIDE)), curve.status != "good")
            )
        figures |= {
            f"{kind}: bodies": len(found),
            f"{kind}: lost or of wrong half-width, %": _percent([bad for bad, _ in found]),
            f"{kind}: those marked, %": _percent([mark for bad, mark in found if bad]),
        }
    return figures


def _pack(rng: np.random.Generator) -> tuple[np.ndarray, Line, float]:
    """Five bodies side by side, some with halos; the centreline of one, and their half-width."""
    own, gap, bend = rng.uniform(2.5, 7), rng.uniform(0.8, 3), rng.uniform(-0.3, 0.3)
    length, turn, places = rng.uniform(8, 14) * own, rng.uniform(0, np.pi), np.indices((180, 180))
    onto = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    image, lines = np.zeros((180, 180)), []
    for number in range(-2, 3):
        along = np.linspace(-length / 2, length / 2, 100)
        bowed = number * (2 * own + gap) + bend * along**2 / length
        lines.append(np.column_stack([bowed, along + rng.uniform(-own, own)]) @ onto + 90)
        off = KDTree(lines[-1]).query(places.reshape(2, -1).T)[0].reshape(image.shape)
        image = np.maximum(image, rng.uniform(0.8, 1.2) * np.clip(own - off + 0.5, 0, 1))
    image = gaussian_filter(image, 0.25 * own)
    image -= rng.uniform(0, 0.6) * gaussian_filter(image, own)
    return image + rng.normal(0, 0.05, image.shape), lines[rng.integers(5)], own


def stretches(run: Refine, frames: int) -> Figures:
    """Time and memory of one long line in a large image; once each."""
    del frames
    figures: Figures = {}
    along = np.arange(MESH)
    wave = 40 * np.sin(along / 90)
    off = (along[:, None] - wave) % APART - APART / 2
    one = np.exp(-(off**2) / 18, dtype=np.float32)
    image = np.maximum(one, one.T)
    image += np.random.default_rng(SEED).normal(0, 0.1, image.shape).astype(np.float32)
    for length, points in STRETCHES:
        at = np.linspace(0, length, points) + (MESH - length) // 2
        truth = np.stack([wave + MESH // 2 + APART / 2, along], axis=1)
        sketch = np.stack([np.interp(at, along, truth[:, 0]), at], axis=1)
        began = time.perf_counter()
        (curve,) = run(image, [sketch])
        name = f"{length} px, {points} points"
        figures[f"{name}: s"] = time.perf_counter() - began
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        figures[f"{name}: peak so far, MB"] = peak
        away = KDTree(truth).query(curve.points)[0]
        figures[f"{name}: farthest from its filament, px"] = float(away.max())
    return figures


def profiles(run: Refine, frames: int) -> Figures:
    """By how much the half-widths of single bodies come out too large, by profile; medians."""
    figures: Figures = {}
    for name, profile in PROFILES.items():
        for half_width in THICK:
            off = []
            for seed in range(max(1, frames // 6)):
                case = single(SEED + seed, half_width, LONG, profile=profile)
                off.append(run(case.image, case.sketches[SET])[0].typical_half_width - half_width)
            figures[f"{name}, half-width {half_width:g} px: off, px"] = float(np.median(off))
    return figures


def _bow(rng: np.random.Generator, row: float) -> Line:
    """A body that bows, from left to right."""
    along, high = np.linspace(0, 1, 400), rng.uniform(4, 9)
    down = high * (np.sin(np.pi * along) + 0.4 * np.sin(2 * np.pi * along))
    return np.column_stack([row + down + along * rng.uniform(-8, 8), 25 + 250 * along])


def hollow(run: Refine, frames: int) -> Figures:
    """Lines over hollow bodies, and over one of two bodies that run side by side.

    They are straight from end to end, or drawn in one stroke.
    """
    figures: Figures = {}
    pairs = [pair(SEED + seed) for seed in range(frames)]
    scenes = [
        scene(
            f"{NAME}{half_width}_{number}",
            "hollow",
            replace(LOOKS["hollow"], half_width=half_width),
        )
        for number in range(FIRST, FIRST + max(1, frames // SCENES))
        for half_width in RIMS
    ]
    for kind, sketched in (("straight", straightened), ("freehand", freehand)):
        found = [one for case in scenes for one in _good(run, sketched(case))]
        beside = [one for case in pairs for one in _good(run, sketched(case))]
        figures |= {
            f"{kind}: bodies": len(found),
            f"{kind}: good, %": _percent([good for good, _ in found]),
            f"{kind}: others marked, %": _percent([mark for good, mark in found if not good]),
            f"{kind}: pairs": len(beside),
            f"{kind}: good beside another, %": _percent([good for good, _ in beside]),
        }
    return figures


def _good(run: Refine, case: Case) -> list[tuple[bool, bool]]:
    """Whether the curves of a case with one set of sketches are good, and whether marked."""
    (sketches,) = case.sketches.values()
    pairs = zip(run(case.image, sketches), case.references, strict=True)
    near = [(curve, shares(curve.points, of, curve.typical_half_width)) for curve, of in pairs]
    return [(verdict(*both) == "good", curve.status != "good") for curve, both in near]


def suggested(run: Refine, frames: int) -> Figures:
    """Share of the reference bodies of the real images that are among the suggested sketches."""
    del run, frames
    found: dict[str, list[bool]] = {"tune": [], "held": []}
    covered, seconds, offered = [], [], 0
    for case in in_folders(FOLDERS):
        began = time.perf_counter()
        lines = [line for line in suggest(case.image) if len(line) > 1]
        seconds.append(time.perf_counter() - began)
        offered += len(lines)
        for reference in case.references:
            known = [shares(np.asarray(line), reference, case.half_width) for line in lines]
            found[case.split].append(any(verdict(*both) == "good" for both in known))
            covered.append(any(of_reference >= MOST for _, of_reference in known))
    return {
        "bodies": len(covered),
        "lines": offered,
        "found, %": _percent(found["tune"] + found["held"]),
        **{f"found, {split}, %": _percent(each) for split, each in found.items()},
        "covered by one line, %": _percent(covered),
        "slowest image, s": max(seconds),
    }


def _percent(flags: Sequence[bool]) -> float:
    return 100 * float(np.mean(flags)) if flags else float("nan")


MODES = {
    "crowd": crowd,
    "order": order,
    "rounding": rounding,
    "ends": ends,
    "sizes": sizes,
    "widths": widths,
    "packed": packed,
    "profiles": profiles,
    "stretches": stretches,
    "contrast": contrast,
    "hollow": hollow,
    "suggest": suggested,
}


def main() -> None:
    """Run the modes asked for."""
    parser = argparse.ArgumentParser("python tests/benchmarks/real_modes.py", description=__doc__)
    parser.add_argument("modes", nargs="*", default=list(MODES), help=", ".join(MODES))
    parser.add_argument("--preset", default="balanced")
    parser.add_argument("--frames", type=int, default=120, help="frames of each kind")
    options = parser.parse_args()
    unknown = set(options.modes) - set(MODES)
    if unknown:
        parser.error(f"unknown modes {', '.join(sorted(unknown))}; known are {', '.join(MODES)}")
    warnings.simplefilter("ignore")
    kept = {row[:2]: row[2] for row in read()}
    for mode in options.modes:
        figures = MODES[mode](partial(_refine, preset=options.preset), options.frames)
        kept = {key: value for key, value in kept.items() if key[0] != mode}
        kept |= {(mode, what): f"{value:.4g}" for what, value in figures.items()}
        print(f"{mode}: " + "; ".join(f"{k} {v:.3g}" for k, v in figures.items()), flush=True)
        write(kept)


def _refine(image: np.ndarray, sketches: Sequence[Line], preset: str) -> tuple[Curve, ...]:
    return tuple(refine(image, sketches, preset=preset).curves)  # pyright: ignore[reportArgumentType]


def read() -> list[tuple[str, str, str]]:
    """Mode, figure and value of the last runs."""
    if not FIGURES.exists():
        return []
    with FIGURES.open(newline="", encoding="utf-8") as file:
        return [(row["mode"], row["figure"], row["value"]) for row in csv.DictReader(file)]


def write(figures: dict[tuple[str, str], str]) -> None:
    """Write all figures."""
    with FIGURES.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["mode", "figure", "value"])
        writer.writerows([*key, value] for key, value in figures.items())


if __name__ == "__main__":
    main()

"""Films with truth: who is followed, how exactly, through crossings and out of sight.

    python tests/benchmarks/films.py [--films N] [--cases ...] [--held-out] [--real] [--write]
    python tests/benchmarks/films.py --many BODIES FRAMES [--write]

Every film is tracked frame by frame and with the frames around it. Prints a table; with --write,
docs/films.md gets all that were measured. With --real, the sample film is tracked to its end and
back, and nothing else is done; with --many, one film of many bodies is tracked as the command line
does it, to see what time and memory it takes. Without --held-out, films are those that settings may
be chosen on. What was measured is kept in docs/films/tracked.json and not measured again; delete it
to do so.
"""

import argparse
import json
import os
import resource
import time
from dataclasses import asdict, dataclass, fields, replace
from itertools import product
from pathlib import Path
from typing import Any

os.environ["JAX_PLATFORMS"] = "cpu"

import numpy as np
import skimage.io
from insert import insert

from napari_splinesketch import refine, suggest
from napari_splinesketch.metrics import average_dtw, normal_distances
from napari_splinesketch.synthetic.bodies import crosses
from napari_splinesketch.synthetic.films import Film, film
from napari_splinesketch.tracking import Body, View, follow

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "films.md"
KEPT = ROOT / "docs" / "films" / "tracked.json"
SAMPLE = ROOT / "src" / "napari_splinesketch" / "data" / "worms_swimming.tif"
HELD_OUT = 7_000
MOTIONS = ("crawl", "swim", "glide")
CASES: dict[str, dict[str, Any]] = {
    "crossing": {},
    "hiding": {"hidden": True},
    "covered": {"cover": 12.0},
    "drifting": {"drift": True},
    "apart": {"crossing": False},
    "faint": {"crossing": False, "snr": 3.0},
    "crowd": {"crossing": False, "frames": 20, "bodies": 60, "length": 50.0, "shape": (900, 900)},
    "fast": {"crossing": False, "speed": 4.0, "frames": 30, "bodies": 2, "length": 50.0},
}
BEYOND, SAME = 2.0, 4.0
"""Average DTW, px: beyond which a curve is wrong, and within which it lies on a body."""
SIDE = 108.0
"""Side of a film of one body, px; of many, times the root of their number."""
SEEN = 0.95
"""Share of a body that is seen where its curve is compared with all of it."""


@dataclass
class Counts:
    """What is counted over films."""

    bodies: int = 0
    frames: int = 0
    beyond: int = 0
    crossings: int = 0
    lost: int = 0
    swapped: int = 0
    hidden: int = 0
    found: int = 0
    marked: int = 0
    normal: tuple[float, ...] = ()
    ratio: tuple[float, ...] = ()
    seconds: float = 0.0

    def __add__(self, other: "Counts") -> "Counts":
        names = [f.name for f in fields(self)]
        return Counts(**{name: getattr(self, name) + getattr(other, name) for name in names})

    def brief(self) -> "Counts":
        """The same, with one number for each list: of a film."""
        normal, ratio = (
            round(float(f(x)), 4) for f, x in ((np.mean, self.normal), (np.median, self.ratio))
        )
        return replace(self, normal=(normal,), ratio=(ratio,), seconds=round(self.seconds, 2))


def made(case: str, index: int, held_out: bool) -> Film:
    """Give a film of a case."""
    options = dict(CASES[case])
    if options.get("hidden"):
        options["hidden"] = 1 + index % 10
    motion = MOTIONS[index % len(MOTIONS)]
    return film(index + HELD_OUT * held_out, motion=motion, **options)


def tracked(shown: Film, **options: Any) -> tuple[list[dict[int, Any]], float]:
    """Curves by body for each frame, and the seconds that it took."""
    sketches = [line[::11] for line in shown.centrelines[0]]  # from end to end
    first = refine(shown.images[0], sketches, polarity=shown.look.polarity)
    curves = [dict(enumerate(first.curves))]
    bodies = [Body(i, ((0, c),)) for i, c in enumerate(first.curves) if c.status != "failed"]
    began = time.process_time()
    frames = range(1, len(shown.images))
    for result in follow(frames, bodies, lambda t, _: View(shown.images[t]), **options):
        curves.append(dict(zip(result.ids, result.curves, strict=True)))
    return curves, time.process_time() - began


def counted(shown: Film, curves: list[dict[int, Any]], seconds: float) -> Counts:
    """Compare curves with the truth."""
    frames, bodies = shown.visible.shape[:2]
    counts = Counts(bodies=bodies, seconds=seconds)
    for frame in range(1, frames):
        for body in range(bodies):
            counts += _one(shown, frame, body, curves[frame].get(body))
    for a in range(bodies):
        for b in range(a):
            lines = shown.centrelines
            met = [crosses(lines[t, a], lines[t, b]) for t in range(frames)]
            counts.crossings += int(np.diff(np.array(met, int)).clip(0).sum())
    for body in range(bodies):
        there = [t for t in range(frames) if shown.visible[t, body].mean() > SEEN]
        last = there[-1]
        curve = curves[last].get(body)
        apart = [
            average_dtw(curve.points, line) if curve else np.inf for line in shown.centrelines[last]
        ]
        counts.swapped += min(apart) < SAME and int(np.argmin(apart)) != body
        counts.lost += min(apart) >= SAME
    return counts


def _one(shown: Film, frame: int, body: int, curve: Any) -> Counts:
    truth, visible = shown.centrelines[frame, body], shown.visible[frame, body]
    half_width = shown.half_widths[body].max()
    if visible.mean() <= SEEN:
        hidden = truth[~visible]
        if curve is None:
            return Counts(hidden=len(hidden))
        apart = np.linalg.norm(hidden[:, None] - curve.points[None], axis=2).min(1)
        marked = _inferred(curve)
        found = int((apart < 2 * half_width).sum())
        return Counts(hidden=len(hidden), found=found, marked=marked * len(hidden))
    if curve is None:
        return Counts(frames=1, beyond=1)
    wrong = average_dtw(curve.points, truth) > BEYOND
    if wrong:
        return Counts(frames=1, beyond=1)
    normal = normal_distances(curve.points, truth)
    here = np.isfinite(normal) & np.isfinite(curve.sd)
    ratio = float(np.sqrt(np.mean((normal[here] / curve.sd[here]) ** 2)))
    return Counts(frames=1, normal=(float(normal[here].mean()),), ratio=(ratio,))


def row(name: str, c: Counts) -> str:
    """One row of the table."""
    share = 100 / max(c.hidden, 1)
    hidden = f"{share * c.found:.0f} % ({share * c.marked:.0f} %)"
    cells = (
        name,
        f"{100 * c.beyond / c.frames:.1f} % of {c.frames}",
        f"{c.lost} of {c.bodies}",
        f"{c.swapped} ({c.crossings})",
        f"{np.mean(c.normal):.3f}",
        f"{np.median(c.ratio):.2f}",
        hidden if c.hidden else "–",
        f"{1e3 * c.seconds / c.frames:.0f}",
    )
    return "| " + " | ".join(cells) + " |"


HEAD = (
    "| films | body-frames beyond 2 px | lost | swapped (crossings) | normal error, px "
    "| error / sd | hidden points within 2 half-widths (marked) | ms a body and frame |\n"
    "|---|---|---|---|---|---|---|---|\n"
)
MODES = {"frame by frame": False, "frames around": True}


def there_and_back(movie: np.ndarray) -> str:
    """What comes of a film without truth that is tracked forwards, and backwards from its end."""
    first = refine(movie[0], suggest(movie[0]))
    start = {i: c for i, c in enumerate(first.curves) if c.status == "good"}
    table = "| there and back | bodies | arrive | come back | to another | inferred |\n"
    table += "|---|---|---|---|---|---|\n"
    for mode, smooth in MODES.items():

        def along(bodies: dict[int, Any], way: range, smooth: bool = smooth) -> list[Any]:
            known = [Body(i, ((way[0], c),)) for i, c in bodies.items()]
            return list(follow(way[1:], known, lambda t, _: View(movie[t]), smooth=smooth))

        ahead = along(start, range(len(movie)))
        back = along(ahead[-1].by_id, range(len(movie))[::-1])[-1].by_id
        nearest = {
            i: min(start, key=lambda j, c=c: average_dtw(c.points, start[j].points))
            for i, c in back.items()
        }
        near = {i: average_dtw(back[i].points, start[j].points) < SAME for i, j in nearest.items()}
        same = sum(near[i] for i, j in nearest.items() if i == j)
        inferred = sum(_inferred(c) for result in ahead for c in result.curves)
        cells = (mode, len(start), len(ahead[-1].ids), same, sum(near.values()) - same, inferred)
        table += "| " + " | ".join(map(str, cells)) + " |\n"
    return table


def many(bodies: int, frames: int) -> str:
    """Time and memory from frame to frame of a film with many bodies that touch where they go."""
    side = int(SIDE * bodies**0.5)
    size: dict[str, Any] = {"shape": (side, side), "bodies": bodies, "frames": frames}
    shown = film(1, crossing=False, touching=True, length=50.0, snr=8.0, **size)
    first = refine(shown.images[0], [line[::11] for line in shown.centrelines[0]])
    start = [Body(i, ((0, c),)) for i, c in enumerate(first.curves) if c.status != "failed"]
    table = "| frame | held back | ms of CPU a body and frame | largest memory so far, MB "
    table += "| beyond 2 px or lost |\n|---|---|---|---|---|\n"
    read, wrong, began = 0, 0, time.process_time()

    def view(frame: int, _: Any) -> View:
        nonlocal read
        read = frame
        return View(shown.images[frame])

    for result in follow(range(1, frames), start, view, pictures=False):
        lines = shown.centrelines[result.frame]
        here = result.by_id
        wrong += bodies - sum(average_dtw(c.points, lines[i]) < BEYOND for i, c in here.items())
        spent = 1e3 * (time.process_time() - began) / read / bodies
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
        cells = result.frame, read - result.frame, f"{spent:.0f}", memory, wrong
        table += "| " + " | ".join(map(str, cells)) + " |\n"
    return table


def _inferred(curve: Any) -> bool:
    return any("inferred" in reason for reason in curve.reasons)


def main() -> None:
    """Track the films asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--films", type=int, default=6)
    usual = [case for case in CASES if case != "crowd"]
    parser.add_argument("--cases", nargs="+", default=usual, choices=list(CASES))
    parser.add_argument("--held-out", action="store_true")
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--real", action="store_true")
    parser.add_argument("--many", type=int, nargs=2, metavar=("BODIES", "FRAMES"))
    options = parser.parse_args()
    if options.real or options.many:
        name = "there and back" if options.real else "many bodies"
        table = there_and_back(skimage.io.imread(SAMPLE)) if options.real else many(*options.many)
        print(table)
        if options.write:
            insert(name, table, PAGE)
        return
    kept = json.loads(KEPT.read_text()) if KEPT.exists() else {}
    for case, index, (mode, smooth) in product(options.cases, range(options.films), MODES.items()):
        name = f"{case} {index} {mode} {options.held_out}"
        if name not in kept:
            shown = made(case, index, options.held_out)
            kept[name] = asdict(counted(shown, *tracked(shown, smooth=smooth)).brief())
            KEPT.write_text(json.dumps(kept, indent=0))
        print(row(name, _read(kept[name])), flush=True)
    table = table_of(kept, options.held_out)
    print(table)
    if options.write:
        insert("tracked", table, PAGE)


def table_of(kept: dict[str, Any], held_out: bool) -> str:
    """All films that were measured both ways, in the table of the page."""
    table = HEAD
    for case in CASES:
        films = [i for i in range(100) if all(f"{case} {i} {m} {held_out}" in kept for m in MODES)]
        for mode in MODES if films else ():
            counts = [_read(kept[f"{case} {i} {mode} {held_out}"]) for i in films]
            films_said = f"{len(films)} film{'s' * (len(films) > 1)}"
            table += row(f"{case} ({films_said}), {mode}", sum(counts, Counts())) + "\n"
    return table


def _read(values: dict[str, Any]) -> Counts:
    lists: dict[str, Any] = {name: tuple(values[name]) for name in ("normal", "ratio")}
    return Counts(**{**values, **lists})


if __name__ == "__main__":
    main()

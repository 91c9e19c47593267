"""Films with truth: who is followed, how exactly, through crossings and out of sight.

    python tests/benchmarks/films.py [--films N] [--first I] [--cases ...] [--held-out] [--jobs N]
    python tests/benchmarks/films.py --real [--jobs 2]
    python tests/benchmarks/films.py --many BODIES FRAMES [--many BODIES FRAMES] [--cores ...]

Every film is tracked frame by frame and with the frames around it, each in a process of its own
with one thread, as many at a time as there are jobs. Prints a table; with --write, docs/films.md
gets all that were measured. With --real, the sample film is tracked to its end and back; with
--many, films of many bodies are tracked by the command line, to see what time and memory it takes
on a few cores. Without --held-out, films are those that settings may be chosen on. What was
measured is kept in docs/films/tracked.json and not measured again; delete it to do so.
"""

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import as_completed
from dataclasses import asdict, dataclass, fields, replace
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

os.environ["JAX_PLATFORMS"] = "cpu"

import numpy as np
import tifffile
from generated_films import Film, film
from insert import insert

from napari_splinesketch import refine, suggest
from napari_splinesketch.batch.workers import Local
from napari_splinesketch.labels import Label, Labels, read_labels, write_labels
from napari_splinesketch.metrics import average_dtw, normal_distances
from napari_splinesketch.synthetic.bodies import crosses
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
    "covered at first": {"cover": 12.0, "covered_first": True},
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
COMMAND = "import sys; from napari_splinesketch.cli import main; sys.exit(main())"
LONGEST = 10
"""Frames for which bodies hide at most, and films of them at least: in each for one more frame."""
PAUSE = 1.0
"""From one look at the memory of the command line to the next, s."""


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
        options["hidden"] = 1 + index % LONGEST
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
    return _cells(*cells)


HEAD = (
    "| films | body-frames beyond 2 px | lost | swapped (crossings) | normal error, px "
    "| error / sd | hidden points within 2 half-widths (marked) | ms a body and frame |\n"
    "|---|---|---|---|---|---|---|---|\n"
)
REAL_HEAD = (
    "| there and back | bodies | arrive | come back | to another | inferred |\n"
    "|---|---|---|---|---|---|\n"
)
MANY_HEAD = (
    "| bodies | frames | minutes by the clock | ms a body and frame | ms of CPU "
    "| largest memory until a third of the time, MB | until two thirds | until the end "
    "| beyond 2 px or lost |\n"
    "|---|---|---|---|---|---|---|---|---|\n"
)
MODES = {"frame by frame": False, "frames around": True}


def there_and_back(mode: str) -> str:
    """What comes of a film without truth, as it is, reversed and turned."""
    movie = tifffile.imread(SAMPLE)
    ways = movie, movie[::-1], np.rot90(movie, axes=(1, 2))
    return _cells(mode, *np.sum([_returned(way, mode) for way in ways], axis=0))


def _returned(movie: np.ndarray, mode: str) -> tuple[int, ...]:
    """How many bodies there are, arrive in the last frame, come back, come back to another one.

    And how many curves are inferred on the way there.
    """
    first = refine(movie[0], suggest(movie[0]))
    start = {i: c for i, c in enumerate(first.curves) if c.status == "good"}

    def along(bodies: dict[int, Any], way: range) -> list[Any]:
        known = [Body(i, ((way[0], c),)) for i, c in bodies.items()]
        return list(follow(way[1:], known, lambda t, _: View(movie[t]), smooth=MODES[mode]))

    ahead = along(start, range(len(movie)))
    back = along(ahead[-1].by_id, range(len(movie))[::-1])[-1].by_id
    nearest = {
        i: min(start, key=lambda j, c=c: average_dtw(c.points, start[j].points))
        for i, c in back.items()
    }
    near = {i: average_dtw(back[i].points, start[j].points) < SAME for i, j in nearest.items()}
    same = sum(near[i] for i, j in nearest.items() if i == j)
    inferred = sum(_inferred(c) for result in ahead for c in result.curves)
    return len(start), len(ahead[-1].ids), same, sum(near.values()) - same, inferred


def many(bodies: int, frames: int, cores: str) -> str:
    """Time and memory of the command line on a film with many bodies that touch as they go."""
    side = int(SIDE * bodies**0.5)
    size: dict[str, Any] = {"shape": (side, side), "bodies": bodies, "frames": frames}
    shown = film(1, crossing=False, touching=True, length=50.0, snr=8.0, **size)
    with TemporaryDirectory() as folder:
        image, drawn, labels = (Path(folder) / name for name in ("film.tif", "first.csv", "l.csv"))
        tifffile.imwrite(image, shown.images, photometric="minisblack")
        lines = [Label.from_sketch(c[::11], identity=i) for i, c in enumerate(shown.centrelines[0])]
        write_labels(drawn, Labels(tuple(lines)))
        command = ["taskset", "-c", cores, sys.executable, "-c", COMMAND, "track"]
        before, began = os.times(), time.perf_counter()
        run = subprocess.Popen([*command, *map(str, (image, drawn, "-o", labels))])
        peaks = [0]
        while run.poll() is None:
            peaks.append(max(peaks[-1], _peak(run.pid)))
            time.sleep(PAUSE)
        seconds, after = time.perf_counter() - began, os.times()
        if run.returncode not in (0, 1):
            raise RuntimeError(f"the command line gave {run.returncode}")
        found = {(one.frame, one.curve): one.points for one in read_labels(labels).labels}
    cpu = after.children_user + after.children_system
    cpu -= before.children_user + before.children_system
    wrong = sum(
        (t, i) not in found or average_dtw(found[t, i], shown.centrelines[t, i]) > BEYOND
        for t, i in product(range(1, frames), range(bodies))
    )
    count = (frames - 1) * bodies
    spent = f"{seconds / 60:.1f}", f"{1e3 * seconds / count:.0f}", f"{1e3 * cpu / count:.0f}"
    wrongly = f"{100 * wrong / count:.2f} %"
    thirds = [peaks[k * len(peaks) // 3] for k in (1, 2)]
    return _cells(bodies, frames, *spent, *thirds, peaks[-1], wrongly)


def _peak(process: int) -> int:
    """Largest resident memory so far, MB; 0 of a process that has ended."""
    lines = Path(f"/proc/{process}/status").read_text().splitlines()
    return next((int(line.split()[1]) // 1024 for line in lines if line.startswith("VmHWM")), 0)


def _cells(*cells: Any) -> str:
    return "| " + " | ".join(map(str, cells)) + " |\n"


def _inferred(curve: Any) -> bool:
    return any("inferred" in reason for reason in curve.reasons)


def measured(case: str, index: int, mode: str, held_out: bool) -> dict[str, Any]:
    """What is counted over one film."""
    shown = made(case, index, held_out)
    return asdict(counted(shown, *tracked(shown, smooth=MODES[mode])).brief())


def warmed(number: int) -> None:
    """Compile, in a process that is to measure films."""
    tracked(film(number, frames=8, bodies=2, hidden=2, crossing=False))


def each(jobs: int, work: Any, tasks: list[tuple[Any, ...]]) -> Iterator[tuple[Any, Any]]:
    """Each task with what came of it, when it is done."""
    with Local(jobs) as processes:
        for done in [processes.submit(warmed, i) for i in range(jobs)]:
            done.result()
        under_way = {processes.submit(_called, (work, task)): task for task in tasks}
        for done in as_completed(under_way):
            yield under_way[done], done.result()


def _called(task: Any) -> Any:
    work, values = task
    return work(*values)


def main() -> None:
    """Track the films asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--films", type=int, default=6)
    parser.add_argument("--first", type=int, default=0)
    usual = [case for case in CASES if case != "crowd"]
    parser.add_argument("--cases", nargs="+", default=usual, choices=list(CASES))
    parser.add_argument("--held-out", action="store_true")
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--real", action="store_true")
    parser.add_argument("--many", type=int, nargs=2, action="append", metavar=("BODIES", "FRAMES"))
    parser.add_argument("--cores", default="0,1")
    options = parser.parse_args()
    if options.many:
        name, table = "many bodies", MANY_HEAD
        for bodies, frames in options.many:
            table += many(bodies, frames, options.cores)
    elif options.real:
        done = dict(each(options.jobs, there_and_back, [(mode,) for mode in MODES]))
        name, table = "there and back", REAL_HEAD + "".join(done[mode,] for mode in MODES)
    else:
        name, table = "tracked", _tracked(options)
    print(table)
    if options.write:
        insert(name, table, PAGE)


def _tracked(options: argparse.Namespace) -> str:
    """Track films, and give the table of all that were."""
    kept = json.loads(KEPT.read_text()) if KEPT.exists() else {}
    tasks = []
    for case in options.cases:
        count = max(options.films, LONGEST) if CASES[case].get("hidden") else options.films
        wanted = range(options.first, options.first + count)
        tasks += product([case], wanted, MODES, [options.held_out])
    tasks = [task for task in tasks if _name(task) not in kept]
    for task, counts in each(options.jobs, measured, tasks):
        kept[_name(task)] = counts
        KEPT.write_text(json.dumps(dict(sorted(kept.items()))))
        print(row(_name(task), _read(counts)), end="", flush=True)
    return table_of(kept, options.held_out)


def _name(task: tuple[Any, ...]) -> str:
    return " ".join(map(str, task))


def table_of(kept: dict[str, Any], held_out: bool) -> str:
    """All films that were measured both ways, in the table of the page."""
    table = HEAD
    for case in CASES:
        films = [i for i in range(100) if all(f"{case} {i} {m} {held_out}" in kept for m in MODES)]
        for mode in MODES if films else ():
            counts = [_read(kept[f"{case} {i} {mode} {held_out}"]) for i in films]
            films_said = f"{len(films)} film{'s' * (len(films) > 1)}"
            table += row(f"{case} ({films_said}), {mode}", sum(counts, Counts()))
    return table


def _read(values: dict[str, Any]) -> Counts:
    lists: dict[str, Any] = {name: tuple(values[name]) for name in ("normal", "ratio")}
    return Counts(**{**values, **lists})


if __name__ == "__main__":
    main()

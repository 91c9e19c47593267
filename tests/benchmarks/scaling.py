"""Time and memory against the number of curves and the image's size; first calls."""

import csv
import json
import os
import subprocess
import sys
import tempfile
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path

import methods
import numpy as np
from rows import FOLDER

from napari_splinesketch import synthetic
from napari_splinesketch.metrics import average_dtw

AREA_PER_BODY = 4194
"""px²: 250 bodies in 1024 × 1024."""
SMALLEST = 128
BODIES = (1, 3, 10, 30, 100, 250, 1000)
SIDES = (256, 512, 1024, 2048)
BODIES_IN_SIDES = 10
# The others' time grows as they are called curve by curve; more of it would show nothing new.
MOST = {"active_contour": 30, "filaments": 30}
SCENES = Path(__file__).parents[2] / ".cache" / "benchmarks"
ROTATION = 20.0
SEED = 7


@dataclass(frozen=True)
class Point:
    """One measurement.

    Attributes
    ----------
    method, version
        Name and version of the method.
    what
        "count" or "side", whichever is varied; "cold", "cached", "other count" or "other size"
        for first calls.
    bodies, side
        Bodies in the frame, and the frame's height and width, px.
    first, seconds
        Of the first call in a new interpreter, and of a later one (median), s.
    peak_mib
        Largest resident memory of the process, MiB.
    median, far
        Median average DTW of the bodies, px, and the share of them above 2 px.
    """

    method: str
    version: str
    what: str
    bodies: int
    side: int
    first: float
    seconds: float
    peak_mib: float
    median: float
    far: float


PATH = FOLDER / "scaling.csv"


def run(names: list[str], *, largest: int) -> None:
    """Measure what is not yet there, with at most `largest` bodies."""
    points = [p for p in read() if p.method not in names or p.version == _version(p.method)]
    done = {(p.method, p.what, p.bodies, p.side) for p in points}
    for name in names:
        most = min(largest, MOST.get(name, largest))
        tasks = [("count", n, side_for(n)) for n in BODIES if n <= most]
        sides = SIDES if name == "balanced" else SIDES[:2]
        tasks += [("side", BODIES_IN_SIDES, side) for side in sides]
        for what, bodies, side in tasks:
            if (name, what, bodies, side) not in done:
                points += _probe(name, what, [(bodies, side)], repeats=3 if bodies < 300 else 1)
                _write(points)
        if name == "balanced" and (name, "cold", 1, SMALLEST) not in done:
            points += first_calls(name)
            _write(points)


def memory(names: list[str]) -> None:
    """Measure the peaks of memory again, and leave the times as they are."""
    points = read()
    for i, old in enumerate(points):
        if old.method in names and old.what in ("count", "side"):
            scene = [(old.bodies, old.side)]
            _probe(old.method, old.what, scene, repeats=0)  # compiles, in memory of its own
            [new] = _probe(old.method, old.what, scene, repeats=1)
            points[i] = replace(old, peak_mib=new.peak_mib)
            _write(points)


def first_calls(name: str) -> list[Point]:
    """First calls with an empty compilation cache, with a full one, and for another shape.

    Modules are compiled to bytecode before, as they are where packages are installed by pip.
    """
    with tempfile.TemporaryDirectory() as cache:
        _probe(name, "cold", [(1, SMALLEST)], repeats=0, cache=cache)
    with tempfile.TemporaryDirectory() as cache:
        scenes = [(1, SMALLEST), (2, SMALLEST), (1, 150)]
        cold = _probe(name, "cold", scenes[:1], repeats=3, cache=cache)
        _probe(name, "other count", scenes, repeats=1, cache=cache)
        cached = _probe(name, "cached", scenes[:1], repeats=3, cache=cache)
    with tempfile.TemporaryDirectory() as cache:
        count = _probe(name, "other count", scenes[:2], repeats=3, cache=cache)[1:]
        size = _probe(name, "other size", [scenes[0], scenes[2]], repeats=3, cache=cache)[1:]
    return cold + cached + count + size


def side_for(bodies: int) -> int:
    """Side of a frame in which so many bodies lie as densely as in the largest ones, px."""
    return max(SMALLEST, round(np.sqrt(bodies * AREA_PER_BODY)))


def _probe(
    name: str, what: str, scenes: list[tuple[int, int]], *, repeats: int, cache: str | None = None
) -> list[Point]:
    paths = [_scene(bodies, side) for bodies, side in scenes]
    command = [sys.executable, str(Path(__file__).with_name("probe.py")), name, str(repeats)]
    environment = os.environ | ({"XDG_CACHE_HOME": cache} if cache else {})
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    done = subprocess.run(
        [*command, *map(str, paths)],
        env=environment,
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    records = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
    points = []
    for (bodies, side), path, record in zip(scenes, paths, records, strict=True):
        truths = np.load(path)["truths"]
        curves = np.load(path.with_suffix(f".{name}.npz"))["curves"]
        dtw = [average_dtw(c, t) for c, t in zip(curves, truths, strict=True)]
        points.append(
            Point(
                method=name,
                version=_version(name),
                what=what,
                bodies=bodies,
                side=side,
                first=record["first"],
                seconds=record["seconds"],
                peak_mib=record["peak_mib"],
                median=float(np.median(dtw)),
                far=float(np.mean(np.array(dtw) > 2)),
            )
        )
    return points


def _scene(bodies: int, side: int) -> Path:
    """Generate a scene once; returns its file."""
    scene = synthetic.scene(SEED, bodies=bodies, shape=(side, side), crossing=False)
    rng = np.random.default_rng(SEED)
    path = SCENES / f"{bodies}-{side}.npz"
    path.parent.mkdir(parents=True, exist_ok=True)
    turns = ROTATION * rng.choice([-1, 1], bodies)
    sketches = [synthetic.rotate(c, t) for c, t in zip(scene.centrelines, turns, strict=True)]
    np.savez(
        path,
        image=scene.image,
        bright=scene.look.polarity == "bright",
        truths=np.stack(scene.centrelines),
        sketches=np.stack(sketches),
    )
    return path


def _version(name: str) -> str:
    return methods.make(name).version if methods.missing(name) is None else ""


def read() -> list[Point]:
    """Read the measurements there are."""
    if not PATH.exists():
        return []
    parse = {str: str, int: int, float: float}
    with PATH.open(newline="", encoding="utf-8") as file:
        return [
            Point(**{f.name: parse[f.type](record[f.name]) for f in fields(Point)})
            for record in csv.DictReader(file)
        ]


def _write(points: list[Point]) -> None:
    fresh = PATH.with_suffix(".new")
    with fresh.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([f.name for f in fields(Point)])
        for point in points:
            values = asdict(point).values()
            writer.writerow([f"{v:.4g}" if isinstance(v, float) else v for v in values])
    fresh.replace(PATH)

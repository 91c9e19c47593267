"""Frames a second against number of workers, on this machine and on a cluster of its loopback.

Starts a scheduler and its workers, refines films of two lengths by one process, by processes and
by the cluster, kills a worker in the middle, and compares the labels of all byte by byte.
`python tests/benchmarks/throughput.py --write` puts the table into docs/batch.md.
"""

import argparse
import csv
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np
import tifffile
from insert import insert

from napari_splinesketch.labels import Label, Labels, write_labels
from napari_splinesketch.synthetic import scene

DOCS = Path(__file__).parents[2] / "docs"
PAGE, TABLE = DOCS / "batch.md", DOCS / "benchmarks" / "throughput.csv"
LENGTHS = (50, 200)
SCENES, BODIES = 20, 3
TICKS = os.sysconf("SC_CLK_TCK")
REFINE = """
import json, resource, sys
from napari_splinesketch.cli import main
if __name__ == "__main__":
    code = main()
    own, others = (resource.getrusage(who) for who in (0, resource.RUSAGE_CHILDREN))
    told = [own.ru_maxrss, others.ru_maxrss, own.ru_utime + own.ru_stime]
    print(json.dumps(told), file=sys.stderr)
    sys.exit(code)
"""


@dataclass(frozen=True)
class Point:
    """One measurement.

    Attributes
    ----------
    who
        "one process", "jobs", "cluster", or "cluster, one killed".
    workers, frames
        How many.
    seconds, cpu, own
        On the clock, of all cores that worked on it, and of the command's own process, s.
    others
        Cores that other programs used meanwhile, on average.
    client, worker
        Largest resident memory of the command and of a worker, MiB.
    same
        Whether the labels are those of one process, byte by byte.
    """

    who: str
    workers: int
    frames: int
    seconds: float
    cpu: float
    own: float
    others: float
    client: float
    worker: float
    same: bool


def make_film(folder: Path, frames: int) -> None:
    """Write a film of three bodies a frame, and a rough line over each."""
    scenes = [scene(seed, bodies=BODIES) for seed in range(SCENES)]
    with tifffile.TiffWriter(folder / f"{frames}.tif") as film:
        pages = (scenes[i % SCENES].image for i in range(frames))
        film.write(pages, shape=(frames, 128, 128), dtype=np.float32, photometric="minisblack")
    lines = ((i, j, c) for i in range(frames) for j, c in enumerate(scenes[i % SCENES].centrelines))
    labels = [Label.from_sketch(c[::33] + 2, frame=i, identity=j) for i, j, c in lines]
    write_labels(folder / f"{frames}.csv", Labels(tuple(labels)))


@contextmanager
def cluster(folder: Path, workers: int) -> Iterator[tuple[str, list[int]]]:
    """Start a scheduler and workers on the loopback; gives its address and their processes."""
    note = folder / f"scheduler-{workers}.json"
    python = [sys.executable, "-m"]
    with ExitStack() as inside:

        def start(name: str, *command: str) -> None:
            log = inside.enter_context((folder / "cluster.log").open("a"))
            options = ["--host", "127.0.0.1", "--no-dashboard", "--scheduler-file", str(note)]
            process = subprocess.Popen([*python, *command, *options], stdout=log, stderr=log)
            inside.callback(process.wait)
            inside.callback(process.terminate)

        start("scheduler", "distributed.cli.dask_scheduler", "--port", "0", "--no-show")
        for _ in range(workers):
            start("worker", "distributed.cli.dask_worker", "--nthreads", "1")
        while not note.exists() or not note.read_text().endswith("}"):
            time.sleep(0.1)
        from distributed import Client

        address = json.loads(note.read_text())["address"]
        with Client(address, set_as_default=False) as client:
            client.wait_for_workers(workers)
            found = client.run(os.getpid)
        yield address, list(found.values())  # pyright: ignore[reportAttributeAccessIssue]


def measure(
    folder: Path,
    who: str,
    workers: int,
    frames: int,
    options: Sequence[str],
    processes: Sequence[int] = (),
) -> Point:
    """Refine a film; `processes` work for it too."""
    output = folder / "labels.csv"
    command = [sys.executable, "-c", REFINE, "refine", f"{frames}.tif", f"{frames}.csv"]
    command += ["-o", str(output), "--overwrite", *options]
    busy, worked, began = _busy(), _cpu(processes), time.perf_counter()
    before = os.times()
    run = subprocess.Popen(
        command, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )
    if "killed" in who:
        while len(list(folder.glob("labels.csv.partial/*/frame-*.json"))) < frames // 3:
            time.sleep(0.01)
        os.kill(processes[0], signal.SIGKILL)
        processes = processes[1:]
    _, told = run.communicate()
    seconds, after = time.perf_counter() - began, os.times()
    if run.returncode not in (0, 1):
        raise RuntimeError(told)
    cpu = after.children_user + after.children_system
    cpu += _cpu(processes) - worked - before.children_user - before.children_system
    if "killed" in who:
        cpu = float("nan")  # that of the dead is not known
    others = (_busy() - busy - float(np.nan_to_num(cpu))) / seconds
    rss, children, own = json.loads(told.splitlines()[-1])
    one = folder / f"one-{frames}.csv"
    if who == "one process":
        output.rename(one)
        output = one
    peak = max([_peak(process) for process in processes], default=children)
    same = output.read_bytes() == one.read_bytes()
    known = (seconds, cpu, own, max(others, 0.0), rss / 1024, peak / 1024)
    point = Point(who, workers, frames, *(round(number, 2) for number in known), same)  # pyright: ignore[reportCallIssue]
    print(point, flush=True)
    return point


def _busy() -> float:
    """Seconds that all cores have worked so far."""
    user, nice, system = Path("/proc/stat").read_text().split()[1:4]
    return (int(user) + int(nice) + int(system)) / TICKS


def _cpu(processes: Sequence[int]) -> float:
    stats = [Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split() for pid in processes]
    return sum(int(stat[11]) + int(stat[12]) for stat in stats) / TICKS


def _peak(process: int) -> int:
    """Largest resident memory, KiB."""
    lines = Path(f"/proc/{process}/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM"))


def measure_all(folder: Path) -> list[Point]:
    """Make the films and refine them in every way."""
    points = []
    for frames in LENGTHS:
        make_film(folder, frames)
        points.append(measure(folder, "one process", 1, frames, ()))
    for frames in LENGTHS:
        points.append(measure(folder, "jobs", 2, frames, ("--jobs", "2")))
    for workers in (1, 2):
        with cluster(folder, workers) as (address, processes):
            options = ("--scheduler", address)
            # Workers that have just started compile first; those of a cluster have done so before.
            measure(folder, "cluster", workers, LENGTHS[0], options, processes)
            for frames in LENGTHS:
                points.append(measure(folder, "cluster", workers, frames, options, processes))
            if workers == 2:
                killed = "cluster, one killed"
                points.append(measure(folder, killed, 2, LENGTHS[-1], options, processes))
    return points


def as_table(points: Sequence[Point]) -> str:
    """Give a table for the page; rates are those of the further frames of the longer film."""
    short, long = LENGTHS
    head = ["who works", "workers", "frames a second, a core each", "measured", "CPU ms a frame"]
    head += ["of which the command's", f"MiB, the command: {short} / {long} frames"]
    head += [f"MiB, a worker: {short} / {long}", "same labels", "cores that others used"]
    rows = [head, ["---"] * len(head)]
    first = {(p.who, p.workers): p for p in points if p.frames == short}
    for one in (point for point in points if point.frames == long):
        told = _rates(first[key], one) if (key := (one.who, one.workers)) in first else ["–"] * 6
        same = "yes" if one.same else "no"
        rows.append([one.who, str(one.workers), *told, same, f"{one.others:.1f}"])
    return "".join(f"| {' | '.join(row)} |\n" for row in rows)


def _rates(short: Point, long: Point) -> list[str]:
    more = long.frames - short.frames
    cpu = (long.cpu - short.cpu) / more
    own = (long.own - short.own) / more
    here = long.who == "one process"
    return [
        f"{long.workers / cpu:.1f}",
        f"{more / (long.seconds - short.seconds):.1f}",
        f"{1000 * cpu:.0f}",
        "–" if here else f"{1000 * own:.0f}",
        f"{short.client:.0f} / {long.client:.0f}",
        "–" if here else f"{short.worker:.0f} / {long.worker:.0f}",
    ]


def _known() -> list[Point]:
    """Read the points of an earlier run."""
    with TABLE.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    read: dict[object, Callable[[str], object]] = {bool: "True".__eq__, int: int, float: float}
    kinds = {field.name: read.get(field.type, str) for field in fields(Point)}
    values = [{name: kind(row[name]) for name, kind in kinds.items()} for row in rows]
    return [Point(**value) for value in values]  # pyright: ignore[reportArgumentType]


def main() -> None:
    """Measure, and write where asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="also write the page and the CSV")
    parser.add_argument("--table", action="store_true", help="only write the page, from the CSV")
    options = parser.parse_args()
    if options.table:
        insert("throughput", as_table(_known()), PAGE)
        return
    with tempfile.TemporaryDirectory() as folder:
        points = measure_all(Path(folder))
    print(as_table(points))
    if not all(point.same for point in points):
        raise SystemExit("the labels differ")
    if options.write:
        with TABLE.open("w", encoding="utf-8", newline="") as file:
            table = csv.DictWriter(file, [field.name for field in fields(Point)])
            table.writeheader()
            table.writerows(asdict(point) for point in points)
        insert("throughput", as_table(points), PAGE)


if __name__ == "__main__":
    main()

"""Runs methods over cells on one core, frame by frame, and stores what comes out."""

import os
import time
from collections.abc import Iterable, Iterator

from frames import Cell, Frame, frame
from methods import Answer, Method
from rows import Row, Store

from napari_splinesketch.metrics import average_dtw, end_error, normal_distance


def run(method: Method, cells: Iterable[Cell], frames: int, deadline: float) -> int:
    """Run a method over the first frames of each cell; returns how many frames were new.

    Frames that are in the store already are skipped; no frame starts after `deadline`, in
    seconds of `time.monotonic`.
    """
    store = Store(method.name, method.version)
    cells = list(cells)
    warm: set[int] = set()
    new = 0
    for index in range(min(frames, method.frames)):
        for cell in cells:
            if time.monotonic() > deadline:
                return new
            given = frame(cell, index)
            if store.has(cell, index, given.checksum):
                continue
            if cell.bodies not in warm:
                (method.warm_up or method.run)(frame(cell, index, tuning=True))
                warm.add(cell.bodies)
            store.add(_measure(method, cell, index, given))
            new += 1
    return new


def _measure(method: Method, cell: Cell, index: int, given: Frame) -> Iterator[Row]:
    wall, cpu = time.perf_counter(), time.process_time()
    answer = method.run(given)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    return measured(method, cell, index, given, answer, wall, cpu)


def measured(
    method: Method,
    cell: Cell,
    index: int,
    given: Frame,
    answer: Answer,
    wall: float,
    cpu: float,
) -> Iterator[Row]:
    """Rows of one frame, a row a body."""
    bodies = zip(given.sketches, given.truths, answer.curves, answer.statuses, strict=True)
    for body, (sketch, truth, curve, status) in enumerate(bodies):
        yield Row(
            method=method.name,
            version=method.version,
            frame=given.checksum,
            bodies=cell.bodies,
            kind=cell.kind,
            strength=cell.strength,
            index=index,
            body=body,
            initial=average_dtw(sketch, truth),
            dtw=average_dtw(curve, truth),
            normal=normal_distance(curve, truth),
            end=end_error(curve, truth),
            status=status,
            wall=wall,
            cpu=cpu,
        )


def pin_to_one_core() -> int:
    """Keep this process on one core; returns which."""
    core = max(os.sched_getaffinity(0))
    os.sched_setaffinity(0, {core})
    return core

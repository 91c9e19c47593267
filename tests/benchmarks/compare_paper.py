"""The paper's method, as here and as in splender: losses, accuracy and seconds, frame by frame.

    python tests/benchmarks/compare_paper.py [--frames 1] [--bodies 1 2 3] [--minutes 30]
        [--first 8] [--sketches spoilt straight long] [--methods METHOD...] [--only METHOD]

Frames that none of the settings was chosen on, the same for all methods: the cells of Tables 1
and 2, and sketches that are too long. Each method runs in a process of its own, on one core, with
no compilation cache, so that its first frame says what compiling costs. Rows go to
docs/benchmarks/compare_paper.csv; frames that are there already are skipped, so delete the rows of
a method that has changed. Those of the reference in the paper's phases, which is slow, also go to
the benchmark (docs/benchmarks/rows/splender.csv). Ends by writing the tables into docs/method.md.
"""

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from importlib import import_module

import frames
import jax.numpy as jnp
import methods
import numpy as np
import reference
from compare_paper_rows import CELLS, FIRST, Row, append, read, side_by_side, table
from insert import insert
from paper_score import refined
from rows import Store
from runner import measured, pin_to_one_core

from napari_splinesketch import refine
from napari_splinesketch.engine import spline
from napari_splinesketch.metrics import average_dtw
from napari_splinesketch.paper import phases

Outcome = tuple[Sequence[np.ndarray], float]
Run = Callable[[frames.Frame], Outcome]


def unexplained(image: np.ndarray, reconstruction: np.ndarray) -> float:
    """Share of an image's variance that a reconstruction leaves."""
    return float(np.mean((image - reconstruction) ** 2) / np.var(image))


def paper(frame: frames.Frame, settings: phases.PaperSettings) -> Outcome:
    """Our implementation, from the image as `refine` normalises it."""
    seen, found = refined(frame, settings)
    curves = [spline.sample(knots, 100)[:, :2] for knots in found.knots]
    return curves, unexplained(seen.normal, found.reconstruction)


def balanced(frame: frames.Frame) -> Outcome:
    """Our default."""
    found = refine(frame.image, frame.sketches)
    return [c.points for c in found.curves], unexplained(frame.image, found.reconstruction)


def splender_phases(frame: frames.Frame, settings: reference.Settings) -> Outcome:
    """The reference's model and loss, trained in the paper's phases by a loop compiled once."""
    image = reference._stretched(frame.image, settings, frame.bright)
    target, size = jnp.asarray(image, jnp.float32)[None], len(image)
    params = reference._start(size, frame.sketches, settings)
    for phase in range(3):
        params, _ = reference._phase(params, target, phase, settings, seed=0)
    model = reference._model(size, init_knots=jnp.ones(1), **params)
    curves = [reference._centreline(params, i, size) for i in range(len(frame.sketches))]
    return curves, unexplained(image, np.asarray(model()[0][0]))


def splender_shipped(frame: frames.Frame, steps: int) -> Outcome:
    """The reference's own `optim.fit`, with its own number of steps and learning rate."""
    settings = reference.TUNED
    image = reference._stretched(frame.image, settings, frame.bright)
    target, size = jnp.asarray(image, jnp.float32)[None], len(image)
    knots = [reference.resample(s, settings.knots)[:, ::-1] / size for s in frame.sketches]
    model = reference._model(
        size, init_knots=jnp.asarray(np.clip(knots, 0.01, 0.99), jnp.float32)[None]
    )
    model.global_scale = settings.global_scale
    model, _ = import_module("splender").optim.fit(model, target, n_iter=steps, video=False)
    params = {"loc_params": model.loc_params, "knot_params": model.knot_params}
    curves = [reference._centreline(params, i, size) for i in range(len(frame.sketches))]
    return curves, unexplained(image, np.asarray(model()[0][0]))


FULL = phases.PaperSettings()
QUIET = replace(FULL, noise=0.0, seeds=1)
# What is timed, and what compiles the same without doing the work.
METHODS: dict[str, tuple[Run, Run]] = {
    "paper": (partial(paper, settings=FULL), partial(paper, settings=FULL)),
    "paper-quiet": (partial(paper, settings=QUIET), partial(paper, settings=QUIET)),
    "balanced": (balanced, balanced),
    "splender-phases": (
        partial(splender_phases, settings=reference.TUNED),
        partial(splender_phases, settings=reference.COMPILE_ONLY),
    ),
    "splender": (partial(splender_shipped, steps=1000), partial(splender_shipped, steps=1)),
}
COMPILES_IN_EVERY_CALL = {"splender"}
# Its rows count in the benchmark too.
BENCHMARKED = {"splender-phases": "splender"}


def run(method: str, start: int, count: int, cells: Sequence[frames.Cell], deadline: float) -> None:
    """Run one method over the frames that have no row yet."""
    timed, compiles = METHODS[method]
    done = {row.place for row in read() if row.method == method}
    cost: dict[int, float] = {}
    same = methods.make(BENCHMARKED[method]) if method in BENCHMARKED else None
    store = Store(same.name, same.version) if same else None
    for index in range(start, start + count):
        for cell in cells:
            if (cell, index) in done or time.monotonic() > deadline:
                continue
            frame = frames.frame(cell, index)
            every_call = method in COMPILES_IN_EVERY_CALL
            compiling = cost[cell.bodies] if every_call and cell.bodies in cost else 0.0
            if cell.bodies not in cost:
                _, first = _timed(compiles, frame)
                _, again = _timed(compiles, frame)
                cost[cell.bodies] = compiling = again if every_call else max(0.0, first - again)
            (curves, rest), seconds = _timed(timed, frame)
            seconds -= compiling if every_call else 0.0
            if same and store:
                answer = methods.Answer(curves, ["good"] * len(curves))
                store.add(measured(same, cell, index, frame, answer, seconds, seconds))
            distances = [average_dtw(c, t) for c, t in zip(curves, frame.truths, strict=True)]
            initial = [average_dtw(s, t) for s, t in zip(frame.sketches, frame.truths, strict=True)]
            append(
                Row(
                    method=method,
                    bodies=cell.bodies,
                    kind=cell.kind,
                    strength=cell.strength,
                    index=index,
                    initial=float(np.mean(initial)),
                    dtw=float(np.mean(distances)),
                    worst=max(distances),
                    unexplained=rest,
                    seconds=seconds,
                    compiling=compiling,
                )
            )


def _timed(call: Run, frame: frames.Frame) -> tuple[Outcome, float]:
    began = time.process_time()
    return call(frame), time.process_time() - began


def main() -> None:
    """Run what is asked for, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=1, help="of each cell")
    parser.add_argument("--bodies", type=int, nargs="+", default=frames.COUNTS)
    parser.add_argument("--minutes", type=float, default=30.0, help="for each method")
    parser.add_argument("--first", type=int, default=FIRST, help="frame of each cell")
    parser.add_argument("--sketches", nargs="+", default=list(CELLS), choices=CELLS)
    parser.add_argument("--methods", nargs="+", default=list(METHODS), choices=METHODS)
    parser.add_argument("--only", choices=METHODS, help="one method, in this process")
    given = parser.parse_args()
    if given.only:
        pin_to_one_core()
        deadline = time.monotonic() + 60 * given.minutes
        cells = [c for name in given.sketches for c in CELLS[name] if c.bodies in given.bodies]
        run(given.only, given.first, given.frames, cells, deadline)
        return
    for method in given.methods:
        command = [sys.executable, __file__, "--only", method, "--frames", str(given.frames)]
        fresh = {**os.environ, "JAX_ENABLE_COMPILATION_CACHE": "false"}
        command += ["--minutes", str(given.minutes), "--bodies", *map(str, given.bodies)]
        command += ["--sketches", *given.sketches, "--first", str(given.first)]
        subprocess.run(command, check=True, env=fresh)
    for name, text in (("side_by_side", side_by_side(read())), ("compare_paper", table(read()))):
        insert(name, text)
        print(text)


if __name__ == "__main__":
    main()

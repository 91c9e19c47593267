"""Our Levenberg-Marquardt against kept libraries on the same problem: one body, one band.

    python tests/benchmarks solvers

Every solver minimises the same cost (data with Huber's loss, and all priors) from the same start,
float32 where it can. Written to docs/benchmarks/solvers.csv. Compiling does not count.
"""

import csv
import importlib
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import perturbations
import scipy.optimize
from result_tables import markdown
from rows import FOLDER

from napari_splinesketch import synthetic
from napari_splinesketch.engine.fit import bands, fitting, solver, tube
from napari_splinesketch.engine.look import scene

KNOTS = 8
STEPS = 30
PATH = FOLDER / "solvers.csv"


@dataclass(frozen=True, eq=False)
class Problem:
    """A body begun 2 px beside where it is."""

    bands: solver.Bands
    level: solver.Level
    begin: np.ndarray

    @staticmethod
    def make(seed: int) -> "Problem":
        """Set up a fit."""
        made = synthetic.scene(seed, bodies=1)
        ((_, seen),) = scene.read_scenes(made.image, made.centrelines, "auto", None)
        line = perturbations.displace(made.centrelines[0], 2, np.random.default_rng(seed))
        theta, priors = bands.begin([(line, seen.half_width, 1.0)], KNOTS, seen)
        pixels = [bands.band_pixels(fitting.lines_of(theta)[0], 8.0, seen.valid)]
        free = np.zeros((1, 2 * KNOTS, 2 * KNOTS))
        one, _, begin = bands.make_bands(seen.normal, pixels, theta, seen.half_width, priors, free)
        level = bands.level(seen)
        return Problem(jax.device_put(one), jax.device_put(level), begin)


@jax.jit
def residuals(theta, problem):
    """All rows whose squares add up to the cost that `solver` minimises."""
    one, level, root = problem
    basis = jax.tree.map(jnp.asarray, bands.spline_basis(KNOTS))
    nobody = jnp.zeros_like(one.values)
    model, *_ = tube.render(theta, one.pixels, nobody, nobody, basis)
    size = jnp.abs(one.values - model) / level.noise
    robust = jnp.sqrt(one.weight * solver._huber(size) + 1e-12)
    return jnp.concatenate([robust, root @ (theta - one.prior_mean) + _lean(problem)])


def _lean(problem):
    """What is added to the priors' rows, so that the slope of their squares is as given."""
    one, _, root = problem
    return jnp.linalg.solve(root.T + 1e-6 * jnp.eye(len(root)), one.prior_slope)


def of_body(problem: Problem):
    """The first (only) body of the padded arrays, and a root of its prior, for `residuals`."""
    one = jax.tree.map(lambda a: a[0], problem.bands)
    values, vectors = np.linalg.eigh(np.asarray(one.prior_precision, float))
    root = (vectors * np.sqrt(np.maximum(values, 0))).T.astype(np.float32)
    return one, problem.level, jnp.asarray(root)


jacobian = jax.jit(jax.jacfwd(residuals))


@partial(jax.jit, static_argnums=2)
def _optimistix(theta, args, method):
    library = importlib.import_module("optimistix")  # of the extra "benchmarks"
    made = getattr(library, method)(rtol=1e-4, atol=1e-4)
    return library.least_squares(residuals, made, theta, args, max_steps=STEPS, throw=False).value


def ours(problem: Problem) -> np.ndarray:
    """Our solver: one visit of at most STEPS evaluations."""
    basis = bands.spline_basis(KNOTS)
    fit = solver.start(problem.begin, problem.bands.values.shape[1])
    order = np.zeros(len(problem.begin), np.int32)
    made = solver.sweep(
        problem.bands, problem.level, fit, basis, order, np.int32(1), np.int32(STEPS)
    )
    return np.asarray(made.theta[0])


def by_optimistix(problem: Problem, method: str) -> np.ndarray:
    """optimistix with forward-mode derivatives, compiled once."""
    return np.asarray(_optimistix(problem.begin[0], of_body(problem), method))


def by_scipy(problem: Problem, method: str) -> np.ndarray:
    """SciPy, with compiled residuals and Jacobian."""
    args = of_body(problem)
    return scipy.optimize.least_squares(
        lambda t: np.asarray(residuals(t.astype(np.float32), args), float),
        problem.begin[0].astype(float),
        lambda t: np.asarray(jacobian(t.astype(np.float32), args), float),  # pyright: ignore[reportArgumentType]
        method=method,
        max_nfev=STEPS,
    ).x


SOLVERS: dict[str, Callable[[Problem], np.ndarray]] = {
    "ours": ours,
    "optimistix LevenbergMarquardt": partial(by_optimistix, method="LevenbergMarquardt"),
    "optimistix Dogleg": partial(by_optimistix, method="Dogleg"),
    "scipy least_squares, lm": partial(by_scipy, method="lm"),
    "scipy least_squares, trf": partial(by_scipy, method="trf"),
}


def run(frames: int) -> None:
    """Solve every problem with every solver; the median of three calls is its time."""
    problems = [Problem.make(seed) for seed in range(frames)]
    with PATH.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["solver", "frame", "ms", "cost", "begin"])
        for name, solve in SOLVERS.items():
            solve(problems[0])
            for k, problem in enumerate(problems):
                times, theta = [], problem.begin[0]
                for _ in range(3):
                    began = time.process_time()
                    theta = solve(problem)
                    times.append(time.process_time() - began)
                args = of_body(problem)
                cost, first = (
                    float((residuals(jnp.asarray(t, jnp.float32), args) ** 2).sum())
                    for t in (theta, problem.begin[0])
                )
                writer.writerow(
                    [name, k, f"{1e3 * np.median(times):.3f}", f"{cost:.1f}", f"{first:.1f}"]
                )
            print(name, "done", flush=True)


def table() -> str:
    """Medians over the frames; nothing where it has not been run."""
    if not PATH.exists():
        return "Not yet run."
    with PATH.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    best: dict[str, float] = {}
    for row in rows:
        best[row["frame"]] = min(best.get(row["frame"], np.inf), float(row["cost"]))
    body = []
    for name in dict.fromkeys(row["solver"] for row in rows):
        mine = [row for row in rows if row["solver"] == name]
        above = [float(row["cost"]) / best[row["frame"]] - 1 for row in mine]
        milliseconds = np.median([float(row["ms"]) for row in mine])
        arrived = np.mean([a < 0.01 for a in above])
        body.append([name, f"{milliseconds:.1f}", f"{100 * arrived:.0f} %"])
    return markdown(["solver", "ms a body", "within 1 % of the lowest cost"], body)

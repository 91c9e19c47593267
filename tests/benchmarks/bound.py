"""The Cramér-Rao bound: how far an efficient, unbiased estimate would be from the truth.

The noise-free image is differentiated numerically with respect to the shape of every centreline
(K knots moved along the normal, both ends along the tangent: to slide an inner knot along its
curve changes nothing) and to what else a fit cannot know: each body's width profile and
brightness; background, blur, taper and cross-section of the scene. Estimates drawn from the
inverse of the Fisher information are then scored like those of any method.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from frames import scene_of
from rows import Row, Store
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter

from napari_splinesketch.metrics import average_dtw, end_error, normal_distance
from napari_splinesketch.synthetic import Look, Scene
from napari_splinesketch.synthetic.drawing import background_of, draw_bodies, taper

NAME, VERSION = "bound", "2"
KNOTS = 8
MOVES = KNOTS + 2
REPLICATES = 8
REPLICATE_OFFSET = 10_000
MOVE_STEP = 0.2
NUISANCES = {
    "level": 0.01,
    "blur": 0.05,
    "flatness": 0.05,
    "taper_power": 0.03,
    "taper_length": 0.02,
}
GRADIENT_STEP = 0.05
SIZE_STEP = 0.05
PRIOR_SD = 3.0
"""Of every parameter, in px or relative to its own size: keeps the inverse finite."""


def covariance(scene: Scene) -> np.ndarray:
    """Return the bound's covariance (P, P), the moves of every body first."""
    columns = [column.ravel() / scene.noise_sd.ravel() for column in derivatives(scene)]
    jacobian = np.stack(columns, axis=1)
    return np.linalg.inv(jacobian.T @ jacobian + np.eye(jacobian.shape[1]) / PRIOR_SD**2)


def moves(curve: np.ndarray) -> np.ndarray:
    """Ways (K + 2, N, 2) to change a centreline: each knot along the normal, then the ends."""
    tangent = np.gradient(curve, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
    u = np.linspace(0, 1, len(curve))
    across = knot_basis(len(curve)).T[..., None] * normal
    along = np.stack([1 - u, u])[..., None] * tangent
    return np.concatenate([across, along])


def knot_basis(points: int) -> np.ndarray:
    """Return the natural cubic basis (points, K) of uniform knots."""
    knots = np.linspace(0, 1, KNOTS)
    return CubicSpline(knots, np.eye(KNOTS), bc_type="natural")(np.linspace(0, 1, points))


def derivatives(scene: Scene) -> Iterator[np.ndarray]:
    """Differentiate the noise-free image (H, W) with respect to each parameter in turn."""
    for body, curve in enumerate(scene.centrelines):
        for move in moves(curve):
            ahead, behind = (_moved(scene, body, sign * MOVE_STEP * move) for sign in (1, -1))
            yield (render(ahead) - render(behind)) / (2 * MOVE_STEP)
    basis = knot_basis(len(scene.centrelines[0]))
    for body in range(len(scene.centrelines)):
        for knot in range(KNOTS):
            change = SIZE_STEP * basis[:, knot]
            ahead, behind = (_resized(scene, body, 1 + sign * change) for sign in (1, -1))
            yield (render(ahead) - render(behind)) / (2 * SIZE_STEP)
        ahead, behind = (_brightened(scene, body, 1 + sign * SIZE_STEP) for sign in (1, -1))
        yield (render(ahead) - render(behind)) / (2 * SIZE_STEP)
    for looks, step in _looks(scene):
        ahead, behind = (_relooked(scene, look) for look in looks)
        yield (render(ahead) - render(behind)) / (2 * step)


def _moved(scene: Scene, body: int, move: np.ndarray) -> Scene:
    curves = list(scene.centrelines)
    curves[body] = curves[body] + move
    return replace(scene, centrelines=tuple(curves))


def _resized(scene: Scene, body: int, factor: np.ndarray) -> Scene:
    widths = list(scene.half_widths)
    widths[body] = widths[body] * factor
    return replace(scene, half_widths=tuple(widths))


def _brightened(scene: Scene, body: int, factor: float) -> Scene:
    finishes = list(scene.finishes)
    finishes[body] = replace(finishes[body], brightness=finishes[body].brightness * factor)
    return replace(scene, finishes=tuple(finishes))


def _relooked(scene: Scene, look: Look) -> Scene:
    ratio = taper(look) / taper(scene.look)
    return replace(scene, look=look, half_widths=tuple(w * ratio for w in scene.half_widths))


def _looks(scene: Scene) -> Iterator[tuple[tuple, float]]:
    look = scene.look
    for name, step in NUISANCES.items():
        value = getattr(look, name)
        yield tuple(replace(look, **{name: value + s * step}) for s in (1, -1)), step
    down, across = look.gradient
    h = GRADIENT_STEP
    yield tuple(replace(look, gradient=(down + s * h, across)) for s in (1, -1)), h
    yield tuple(replace(look, gradient=(down, across + s * h)) for s in (1, -1)), h


def render(scene: Scene) -> np.ndarray:
    """Draw the noise-free image, without texture."""
    look, shape = scene.look, scene.image.shape
    drawn = draw_bodies(scene.centrelines, scene.half_widths, scene.finishes, look, shape)
    sign = 1 if look.polarity == "bright" else -1
    return background_of(look, shape) + sign * look.contrast * gaussian_filter(drawn, look.blur)


def run(counts: tuple[int, ...], frames: int) -> None:
    """Store the bound for the first frames with so many bodies."""
    store = Store(NAME, VERSION)
    done = {(row.bodies, row.index % REPLICATE_OFFSET) for row in store.rows}
    for index in range(frames):
        for bodies in counts:
            if (bodies, index) not in done:
                store.add(_rows(bodies, index))


def _rows(bodies: int, index: int) -> Iterator[Row]:
    scene = scene_of(100_000 * bodies + index, bodies)
    size = MOVES * bodies
    root = np.linalg.cholesky(covariance(scene)[:size, :size])
    rng = np.random.default_rng([bodies, index])
    for replicate in range(REPLICATES):
        amounts = (root @ rng.standard_normal(size)).reshape(bodies, MOVES)
        for body, (truth, amount) in enumerate(zip(scene.centrelines, amounts, strict=True)):
            curve = truth + np.tensordot(amount, moves(truth), axes=1)
            yield Row(
                method=NAME,
                version=VERSION,
                frame="",
                bodies=bodies,
                kind="scene",
                strength=0.0,
                index=REPLICATE_OFFSET * replicate + index,
                body=body,
                initial=0.0,
                dtw=average_dtw(curve, truth),
                normal=normal_distance(curve, truth),
                end=end_error(curve, truth),
                status="good",
                wall=0.0,
                cpu=0.0,
            )

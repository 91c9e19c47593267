"""The paper's three phases: background, then all but the texture, then everything."""

from collections.abc import Callable, Sequence
from functools import partial
from time import perf_counter
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, Int

from napari_splinesketch.paper.blobs import (
    Blobs,
    Canvas,
    Place,
    compose,
    convolve,
    half_width_ratio,
    keep_in_frame,
    spline_knots,
)
from napari_splinesketch.paper.fit import (
    PaperFit,
    Problem,
    bucket,
    centrelines,
    draw,
    pictures,
    prepare,
    render_bodies,
)
from napari_splinesketch.paper.loss import Weights, reconstruction_loss, regularization
from napari_splinesketch.paper.settings import PaperSettings, PhaseName, Plan

__all__ = ["PaperFit", "PaperSettings", "refine_paper", "render_bodies"]

Report = Callable[[str, float, list[np.ndarray] | None], bool]

_TEXTURE = ("profile", "kernel")
_TRAINED: dict[PhaseName, tuple[str, ...]] = {
    "background": ("brightness", "gradient", "log_contrast"),
    "splines": tuple(name for name in Blobs._fields if name not in _TEXTURE),
    "everything": Blobs._fields,
}
_STAGE: dict[PhaseName, str] = {
    "background": "fitting the background",
    "splines": "moving the splines",
    "everything": "fitting everything",
}
_PIECE_SECONDS = 0.1
_FEWEST_STEPS = 512
_DEFAULT = PaperSettings()


class State(NamedTuple):
    """A phase under way; `best` is the parameters of the lowest reconstruction loss so far."""

    trained: dict[str, jax.Array]
    optimizer: Any
    best: dict[str, jax.Array]
    best_loss: Float[Array, ""]
    losses: Float[Array, " T"]
    step: Int[Array, ""]


class Attempt(NamedTuple):
    """A phase that has ended: where, at which reconstruction loss, and the way there."""

    scene: Blobs
    loss: float
    losses: Float[np.ndarray, " T"]


def refine_paper(
    image: Float[np.ndarray, "H W"],
    sketches: list[Float[np.ndarray, "N 2"]],
    *,
    half_width: float,
    seed: int,
    report: Report,
    fixed: Sequence[Float[np.ndarray, "K 3"]] = (),
    settings: PaperSettings = _DEFAULT,
) -> PaperFit:
    """Fit splines to an image by the paper's method.

    Parameters
    ----------
    image
        (H, W) normalised: background about 0, bodies positive, of contrast about 1; pixels that
        are not finite are left out.
    sketches
        (N, 2) polylines, row and col, px.
    half_width
        Prior of the bodies' half-width, px.
    seed
        Seed of the noise on the gradients.
    report
        Called with what is being done, the share done and the centrelines so far; returns False
        to cancel.
    fixed
        (K, 3) knots (row, col, half-width, px) of curves that are drawn but do not move; only W,
        which all share, changes their widths.
    settings
        How long and how hard to try.
    """
    scene, problem, canvas = prepare(
        image,
        sketches,
        list(fixed),
        half_width=half_width,
        knots=settings.knots,
        spacing=settings.spacing,
    )
    total = settings.background_steps + settings.everything_steps
    watch = _Watch(report, len(sketches), total + settings.seeds * settings.splines_steps)
    run = partial(_run, problem=problem, canvas=canvas, settings=settings, watch=watch)
    first = run("background", scene, 0)
    tries = [run("splines", first.scene, n) for n in range(seed, seed + settings.seeds)]
    kept = min(tries, key=lambda attempt: attempt.loss)
    last = run("everything", kept.scene, 0)
    scene, place = last.scene, problem.place
    rows, columns = map(slice, image.shape)
    both = pictures(scene, draw(scene, place, canvas)[0], place, canvas.frame)
    drawn, empty = (np.asarray(picture)[rows, columns] for picture in both)
    ratio = half_width_ratio(np.asarray(scene.profile, float))
    return PaperFit(
        knots=np.asarray(spline_knots(scene, place))[: len(sketches)] * [1.0, 1.0, ratio],
        reconstruction=drawn,
        background=empty,
        losses={"background": first.losses, "splines": kept.losses, "everything": last.losses},
        score=float(np.nanmean((image - drawn) ** 2)),
        alpha=float(jax.nn.sigmoid(scene.blend)),
        cancelled=watch.cancelled,
        scene=scene,
        place=place,
        canvas=canvas,
    )


def _run(
    phase: PhaseName,
    scene: Blobs,
    seed: int,
    *,
    problem: Problem,
    canvas: Canvas,
    settings: PaperSettings,
    watch: "_Watch",
) -> Attempt:
    """One phase, in pieces short enough to be cancelled between them."""
    plan = settings.plan(phase)
    left, piece = int(plan.steps), 1
    drawn = draw(scene, problem.place, canvas) if phase == "background" else None
    state = _start(scene, seed, plan, phase=phase, room=bucket(left, _FEWEST_STEPS, 2))
    while left and not watch.cancelled:
        piece = min(piece, left)
        began = perf_counter()
        state = _advance(scene, drawn, problem, state, plan, piece, phase=phase, canvas=canvas)
        jax.block_until_ready(state)
        per_step = (perf_counter() - began) / piece
        left -= piece
        watch.tell(phase, piece, scene._replace(**state.trained), problem.place)
        piece = int(np.clip(_PIECE_SECONDS / per_step, 1, 4 * piece))
    losses = np.asarray(state.losses)[: int(state.step)]
    return Attempt(scene._replace(**state.best), float(state.best_loss), losses)


def _optimizer(
    phase: PhaseName, plan: Plan, key: jax.Array | int = 0
) -> optax.GradientTransformation:
    if phase != "splines":
        return optax.flatten(optax.adam(plan.rate))

    def cosine(step: Any) -> jax.Array:
        return plan.rate * (1 + jnp.cos(jnp.pi * step / plan.steps)) / 2

    noise = relative_noise(plan.noise, plan.noise_decay, key)
    return optax.chain(noise, optax.flatten(optax.adam(cosine)))


class NoiseState(NamedTuple):
    """Where a sequence of noise stands."""

    key: jax.Array
    step: Int[Array, ""]


def relative_noise(
    variance: Float[Array, ""] | float, decay: Float[Array, ""] | float, key: jax.Array | int
) -> optax.GradientTransformation:
    """Gaussian noise of variance η / (1 + t)^γ in units of the gradient's own mean square.

    The mean is over a parameter of one spline. Noise of one size for all parameters, as of
    `optax.add_noise`, drowns those of small gradient: widths, and with them the ends, stay put.
    """

    def init(params: Any) -> NoiseState:
        del params
        return NoiseState(jnp.asarray(key), jnp.asarray(0, jnp.int32))

    def update(updates: Any, state: Any, params: Any = None) -> tuple[Any, NoiseState]:
        del params
        typical, restore = ravel_pytree(jax.tree.map(_root_mean_square, updates))
        noise = jax.random.normal(jax.random.fold_in(state.key, state.step), typical.shape)
        sd = jnp.sqrt(variance / (1.0 + state.step) ** decay)
        noisy = jax.tree.map(jnp.add, updates, restore(sd * typical * noise))
        return noisy, NoiseState(state.key, state.step + 1)

    return optax.GradientTransformation(init, update)


def _root_mean_square(gradient: Float[Array, "*S"]) -> Float[Array, "*S"]:
    """Of each entry along the first axis, in the shape of the gradient."""
    axes = tuple(range(1, gradient.ndim))
    mean = (gradient**2).mean(axes, keepdims=True) if axes else gradient**2
    return jnp.broadcast_to(jnp.sqrt(mean), gradient.shape)


@partial(jax.jit, static_argnames=("phase", "room"))
def _start(scene: Blobs, seed: Int[Array, ""], plan: Plan, *, phase: PhaseName, room: int) -> State:
    trained = {name: getattr(scene, name) for name in _TRAINED[phase]}
    optimizer = _optimizer(phase, plan, jax.random.key(seed)).init(trained)
    # Of the types that `_advance` gives back: weak ones would have it compiled twice.
    trained = jax.tree.map(lambda value: jnp.asarray(value, value.dtype), trained)
    worst, step = jnp.asarray(jnp.inf, jnp.float32), jnp.asarray(0, jnp.int32)
    return State(trained, optimizer, trained, worst, jnp.zeros(room), step)


@partial(jax.jit, static_argnames=("phase", "canvas"))
def _advance(
    scene: Blobs,
    drawn: tuple[jax.Array, jax.Array] | None,
    problem: Problem,
    state: State,
    plan: Plan,
    count: Int[Array, ""],
    *,
    phase: PhaseName,
    canvas: Canvas,
) -> State:
    """`count` steps of a phase; `drawn` is what `draw` gives, where nothing of it is trained."""
    descend = _optimizer(phase, plan)
    objective = partial(
        _objective, scene=scene, problem=problem, drawn=drawn, weights=plan.weights, canvas=canvas
    )

    def step(_: int, state: State) -> State:
        (_, loss), gradient = jax.value_and_grad(objective, has_aux=True)(state.trained)
        updates, optimizer = descend.update(gradient, state.optimizer, state.trained)
        better = loss < state.best_loss
        best = jax.tree.map(partial(jnp.where, better), state.trained, state.best)
        trained = cast(dict[str, jax.Array], optax.apply_updates(state.trained, updates))
        if "offsets" in trained:
            inside = keep_in_frame(trained["centre"], trained["offsets"], problem.place)
            trained["offsets"] = inside
        return State(
            trained,
            optimizer,
            best,
            jnp.minimum(loss, state.best_loss),
            state.losses.at[state.step].set(loss),
            state.step + 1,
        )

    return jax.lax.fori_loop(0, count, step, state)


def _objective(
    trained: dict[str, jax.Array],
    *,
    scene: Blobs,
    problem: Problem,
    drawn: tuple[jax.Array, jax.Array] | None,
    weights: Weights,
    canvas: Canvas,
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Give the loss with its regularizers, and the reconstruction's share of it."""
    place, target = problem
    scene = scene._replace(**trained)
    bodies, length = drawn or draw(scene, place, canvas)
    image = compose(scene, bodies, place, canvas.frame)
    if "kernel" in trained:  # until it is trained, it changes nothing
        image = convolve(image, scene.kernel)
    loss = reconstruction_loss(target, image)
    return loss + regularization(scene, length, target, place, weights), loss


class _Watch:
    """Tells how far the work is, and remembers that it was cancelled."""

    def __init__(self, report: Report, count: int, total: int) -> None:
        self.cancelled = False
        self._report, self._count, self._total, self._done = report, count, total, 0

    def tell(self, phase: PhaseName, steps: int, scene: Blobs, place: Place) -> None:
        """Pass on the state after `steps` more steps."""
        self._done += steps
        lines = centrelines(scene, place, self._count)
        self.cancelled = not self._report(_STAGE[phase], self._done / self._total, lines)

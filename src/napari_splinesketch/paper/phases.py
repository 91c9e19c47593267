"""The paper's three phases: background, then all but the texture, then everything."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from time import perf_counter
from typing import Any, Literal, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, Int

from napari_splinesketch.engine.fit.fit_scene import Centrelines
from napari_splinesketch.engine.types import InputError
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
    bucket,
    centrelines,
    draw,
    prepare,
    render,
    render_bodies,
)
from napari_splinesketch.paper.loss import Target, Weights, reconstruction_loss, regularization

__all__ = ["PaperFit", "PaperSettings", "refine_paper", "render_bodies"]

PhaseName = Literal["background", "splines", "everything"]
Tell = Callable[[PhaseName, int, Blobs], None]
"""Takes how many more steps of a phase are done, and where they led."""

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


@dataclass(frozen=True)
class PaperSettings:
    """How long and how hard to try."""

    knots: int = 12
    """Knots of each spline, K."""
    spacing: float = 0.8
    """Largest distance between the blobs of a sketch, in half-widths."""
    background_steps: int = 100
    splines_steps: int = 600
    everything_steps: int = 100
    """`background_steps`, `splines_steps` and `everything_steps`: Adam's steps in each phase."""
    seeds: int = 2
    """How often the second phase is tried, with different noise."""
    rate: float = 1e-2
    last_rate: float = 1e-4
    """`rate` and `last_rate`: learning rate of the first two phases, and of the last."""
    noise: float = 1.0
    noise_decay: float = 1.0
    """`noise` and `noise_decay`: η and γ: at step t the noise on the gradients has the variance η /
    (1 + t)^γ, in units of the gradient's own mean square."""
    weights: Weights = field(default_factory=Weights)
    """Weights and priors of the regularizers."""

    def __post_init__(self) -> None:
        """Refuse what could not run."""
        if self.knots < 3 or self.seeds < 1 or self.spacing <= 0:
            raise InputError(
                f"{self} cannot run: it needs at least 3 knots and 1 seed, and a spacing above 0."
            )

    def plan(self, phase: PhaseName) -> "Plan":
        """Numbers of one phase."""
        steps = getattr(self, f"{phase}_steps")
        rate = self.last_rate if phase == "everything" else self.rate
        return Plan(steps, rate, self.noise, self.noise_decay, self.weights)


class Plan(NamedTuple):
    """Numbers of one phase; data, so that other ones do not cause a compilation."""

    steps: Int[Array, ""] | int
    rate: Float[Array, ""] | float
    noise: Float[Array, ""] | float
    noise_decay: Float[Array, ""] | float
    weights: Weights


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
    report: Callable[[str, float, Centrelines], object],
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
        Called with what is being done, the share done and what gives the centrelines so far; what
        it raises ends the work.
    fixed
        (K, 3) knots (row, col, half-width, px) of curves that are drawn but do not move; only W,
        which all share, changes their widths.
    settings
        How long and how hard to try.
    """
    scene, place, target, canvas = prepare(
        image,
        sketches,
        list(fixed),
        half_width=half_width,
        knots=settings.knots,
        spacing=settings.spacing,
    )
    done, total = 0, settings.background_steps + settings.everything_steps
    total += settings.seeds * settings.splines_steps

    def tell(phase: PhaseName, steps: int, now: Blobs) -> None:
        nonlocal done
        done += steps
        report(_STAGE[phase], done / total, partial(centrelines, now, place, len(sketches)))

    run = partial(_run, place=place, target=target, canvas=canvas, settings=settings, tell=tell)
    first = run("background", scene, 0)
    tries = [run("splines", first.scene, n) for n in range(seed, seed + settings.seeds)]
    kept = min(tries, key=lambda attempt: attempt.loss)
    last = run("everything", kept.scene, 0)
    scene = last.scene
    drawn, empty = render(scene, place, canvas, image.shape)
    ratio = half_width_ratio(np.asarray(scene.profile, float))
    return PaperFit(
        knots=np.asarray(spline_knots(scene, place))[: len(sketches)] * [1.0, 1.0, ratio],
        reconstruction=drawn,
        background=empty,
        losses={"background": first.losses, "splines": kept.losses, "everything": last.losses},
        score=float(np.nanmean((image - drawn) ** 2)),
        alpha=float(jax.nn.sigmoid(scene.blend)),
        scene=scene,
        place=place,
        canvas=canvas,
    )


def _run(
    phase: PhaseName,
    scene: Blobs,
    seed: int,
    *,
    place: Place,
    target: Target,
    canvas: Canvas,
    settings: PaperSettings,
    tell: Tell,
) -> Attempt:
    """One phase, in pieces between which it can be cancelled."""
    plan = settings.plan(phase)
    left, piece = int(plan.steps), 1
    drawn = draw(scene, place, canvas) if phase == "background" else None
    state = _start(scene, phase=phase, room=bucket(left, _FEWEST_STEPS, 2))
    while left:
        piece = min(piece, left)
        began = perf_counter()
        state = _advance(
            scene, drawn, place, target, state, plan, seed, piece, phase=phase, canvas=canvas
        )
        jax.block_until_ready(state)
        per_step = (perf_counter() - began) / piece
        left -= piece
        tell(phase, piece, scene._replace(**state.trained))
        piece = int(np.clip(_PIECE_SECONDS / per_step, 1, 4 * piece))
    losses = np.asarray(state.losses)[: int(state.step)]
    return Attempt(scene._replace(**state.best), float(state.best_loss), losses)


def relative_noise(
    gradient: dict[str, jax.Array], key: jax.Array, step: Int[Array, ""], plan: Plan
) -> dict[str, jax.Array]:
    """A gradient with Gaussian noise of variance η / (1 + t)^γ, in units of its own mean square.

    The mean is over a parameter of one spline. Noise of one size for all parameters, as of
    `optax.add_noise`, drowns those of small gradient: widths, and with them the ends, stay put.
    """
    typical, restore = ravel_pytree(jax.tree.map(_root_mean_square, gradient))
    noise = jax.random.normal(jax.random.fold_in(key, step), typical.shape)
    sd = jnp.sqrt(plan.noise / (1.0 + step) ** plan.noise_decay)
    return jax.tree.map(jnp.add, gradient, restore(sd * typical * noise))


def _root_mean_square(gradient: Float[Array, "*S"]) -> Float[Array, "*S"]:
    """Of each entry along the first axis, in the shape of the gradient."""
    axes = tuple(range(1, gradient.ndim))
    mean = (gradient**2).mean(axes, keepdims=True) if axes else gradient**2
    return jnp.broadcast_to(jnp.sqrt(mean), gradient.shape)


def _adam(rate: Any = 0.0) -> optax.GradientTransformation:
    return optax.flatten(optax.adam(rate))


@partial(jax.jit, static_argnames=("phase", "room"))
def _start(scene: Blobs, *, phase: PhaseName, room: int) -> State:
    trained = {name: getattr(scene, name) for name in _TRAINED[phase]}
    # Of the types that `_advance` gives back: weak ones would have it compiled twice.
    worst, step = jnp.asarray(jnp.inf, jnp.float32), jnp.asarray(0, jnp.int32)
    return State(trained, _adam().init(trained), trained, worst, jnp.zeros(room), step)


@partial(jax.jit, static_argnames=("phase", "canvas"))
def _advance(
    scene: Blobs,
    drawn: tuple[jax.Array, jax.Array] | None,
    place: Place,
    target: Target,
    state: State,
    plan: Plan,
    seed: Int[Array, ""] | int,
    count: Int[Array, ""] | int,
    *,
    phase: PhaseName,
    canvas: Canvas,
) -> State:
    """`count` steps of a phase; `drawn` is what `draw` gives, where nothing of it is trained."""

    def objective(trained: dict[str, jax.Array]) -> tuple[jax.Array, jax.Array]:
        """Give the loss with its regularizers, and the reconstruction's share of it."""
        now = scene._replace(**trained)
        bodies, length = drawn or draw(now, place, canvas)
        image = compose(now, bodies, place, canvas.frame)
        if "kernel" in trained:  # until it is trained, it changes nothing
            image = convolve(image, now.kernel)
        loss = reconstruction_loss(target, image)
        return loss + regularization(now, length, target, place, plan.weights), loss

    def step(_: int, state: State) -> State:
        (_, loss), gradient = jax.value_and_grad(objective, has_aux=True)(state.trained)
        rate = plan.rate
        if phase == "splines":
            gradient = relative_noise(gradient, jax.random.key(seed), state.step, plan)
            rate = rate * (1 + jnp.cos(jnp.pi * state.step / plan.steps)) / 2  # annealing
        updates, optimizer = _adam(rate).update(gradient, state.optimizer)
        better = loss < state.best_loss
        best = jax.tree.map(partial(jnp.where, better), state.trained, state.best)
        trained = cast(dict[str, jax.Array], optax.apply_updates(state.trained, updates))
        if "offsets" in trained:
            inside = keep_in_frame(trained["centre"], trained["offsets"], place)
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

"""From a fitted scene to the result that the user gets."""

import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Real

from napari_splinesketch.engine import spline
from napari_splinesketch.engine.fit import fitting
from napari_splinesketch.engine.fit.fit_scene import SceneFit
from napari_splinesketch.engine.fit.fitting import Body
from napari_splinesketch.engine.fit.solver import SLOPE_UNIT
from napari_splinesketch.engine.judge import assess, doubt
from napari_splinesketch.engine.judge.standard_error import (
    BESIDE,
    beside_others,
    standard_error,
    unexplained,
)
from napari_splinesketch.engine.look import scene
from napari_splinesketch.engine.look.background import estimate_background
from napari_splinesketch.engine.look.scene import Scene
from napari_splinesketch.engine.types import Array, Curve, Refinement, SceneModel


def assemble(
    image: Real[Array, "H W"],
    sketches: list[Float[Array, "N 2"]],
    faults: list[str],
    window: tuple[slice, slice],
    seen: Scene,
    fit: SceneFit,
    began: float,
) -> Refinement:
    """Curves with status, reconstruction in the image's units, and what the scene needed.

    Parameters
    ----------
    image, sketches
        As given to `refine`.
    faults
        Why each sketch could not be refined, or nothing.
    window, seen, fit
        The part of the image that was fitted, what it is made of, and the bodies in it.
    began
        When the call began, by `time.perf_counter`.
    """
    corner = np.array([s.start for s in window])
    drawn = _draw(seen.valid, [*fit.bodies, *fit.fixed, *fit.beside])
    numbers = [i for i, fault in enumerate(faults) if not fault]
    residual = seen.normal - drawn
    rests = [_rest(body, residual) for body in fit.bodies]
    drawings = [sketches[i] - corner for i in numbers]
    made = [
        replace(c, knots=c.knots + np.append(corner, 0), points=c.points + corner)
        for c in _curves(seen, fit, drawings, numbers, residual, rests)
    ]
    curves = full_list(made, sketches, faults)
    background, reconstruction = frames(image, window, seen, drawn * seen.contrast)
    return Refinement(
        curves,
        reconstruction,
        background,
        _model(seen, fit, rests, faults),
        time.perf_counter() - began,
    )


def _curves(
    seen: Scene,
    fit: SceneFit,
    sketches: list[Float[Array, "N 2"]],
    numbers: list[int],
    residual: Float[Array, "H W"],
    rests: list[Float[Array, " m"]],
) -> Iterator[Curve]:
    """The curves with what they say of themselves, in the window's pixels."""
    centres = [spline.sample(b.knots, 100) for b in fit.bodies]
    everything = [*centres, *(b.points() for b in (*fit.fixed, *fit.beside))]
    twins = assess.doubles(centres, assess.ON_TOP * seen.half_width, assess.SAME_BODY)
    usual_length = float(np.median([spline.arc_length(c)[-1] for c in centres]))
    misfit = unexplained(seen, residual)
    widths = [float(np.exp(b["log_width_0"])) for b in fit.bodies]
    beside = assess.neighbours(everything, BESIDE * max(widths))
    for i, (body, sketch, others) in enumerate(zip(fit.bodies, sketches, beside, strict=False)):
        core = rests[i][body.own > assess.CORE * body["contrast"]]
        reasons = assess.doubts(centres[i], sketch, core, seen.noise, seen.normal.shape)
        if not body.settled:
            reasons.append("it had not settled when the steps ran out")
        if i in twins:
            reasons.append(f"it lies on the same body as curve {numbers[twins[i]]}")
        u = assess.uniform(body.knots)
        points = spline.basis(len(body.knots), u) @ body.knots
        near = beside_others(points, [everything[k] for k in others], widths[i])
        sd = standard_error(body, u, misfit, near)
        evidence = doubt.collect(
            points,
            sd,
            near,
            sketch,
            body["contrast"],
            fit.starts[i].margin,
            usual_length,
            widths[i],
        )
        reasons += doubt.reasons(evidence)
        yield assess.make_curve(body, u, sd, rests[i], tuple(reasons))


def full_list(
    made: list[Curve], sketches: list[Float[Array, "N 2"]], faults: list[str]
) -> tuple[Curve, ...]:
    """The curves made, with the sketches that have a fault in between, as drawn."""
    curves = iter(made)
    return tuple(
        assess.as_drawn(line, fault) if fault else next(curves)
        for line, fault in zip(sketches, faults, strict=True)
    )


def _draw(valid: Bool[Array, "H W"], bodies: list[Body]) -> Float[Array, "H W"]:
    """All bodies, as a share of the contrast; guessed where the image has no value."""
    flat = np.zeros(valid.size)
    pixels = np.unique(np.concatenate([b.pixels for b in bodies]))
    flat[pixels] = fitting.render_at(pixels, bodies)
    drawn = flat.reshape(valid.shape)
    return drawn if valid.all() else scene.filled(drawn, valid)


def _rest(body: Body, residual: Float[Array, "H W"]) -> Float[Array, " m"]:
    """Image minus bodies minus the body's own local background, in its band."""
    at = np.column_stack(np.divmod(body.pixels, residual.shape[1]))
    away = (at - body.knots.mean(0)) / SLOPE_UNIT
    local = body["offset"] + away @ [body["slope_row"], body["slope_col"]]
    return residual.ravel()[body.pixels] - local


def frames(
    image: Real[Array, "H W"],
    window: tuple[slice, slice],
    seen: Scene,
    bodies: Float[Array, "h w"],
) -> tuple[Float[Array, "H W"], Float[Array, "H W"]]:
    """Background and reconstruction of the whole image, in its own units."""
    drawn = np.zeros(image.shape)
    drawn[window] = bodies
    bare = _filled(image) - drawn
    background, _ = estimate_background(bare, scene.pixel_noise(bare), seen.background_kind)
    return background, background + drawn


def _filled(image: Real[Array, "H W"]) -> Float[Array, "H W"]:
    finite = np.isfinite(image)
    return np.where(finite, image, np.median(image[finite])).astype(np.float64)


def _model(seen: Scene, fit: SceneFit, rests, faults) -> SceneModel:
    def typical(name: str) -> float:
        return float(np.median([b[name] for b in fit.bodies]))

    def along(part: str) -> Literal["constant", "profile"]:
        return "constant" if part in fit.parts and not fit.parts[part].on else "profile"

    knots = iter([len(b.knots) for b in fit.bodies])
    contrast = abs(seen.contrast)
    overlap = typical("overlap") if _overlapping(fit.bodies) else None
    return SceneModel(
        polarity=seen.polarity,
        knots=tuple(0 if fault else next(knots) for fault in faults),
        half_width=float(np.exp(typical("log_width_0"))),
        width=along("width"),
        brightness=along("brightness"),
        background=seen.background_kind,
        overlap=overlap,
        contrast=contrast * typical("contrast"),
        noise=contrast * float(np.sqrt(np.mean(np.concatenate(rests) ** 2))),
        blur=float(np.exp(typical("log_blur"))),
        notes=_notes(seen, fit, overlap),
    )


def _overlapping(bodies: list[Body]) -> bool:
    """Whether any pixel is well inside two bodies."""
    inside = [b.pixels[b.own > 0.5 * b["contrast"]] for b in bodies]
    _, count = np.unique(np.concatenate(inside), return_counts=True)
    return bool((count > 1).any())


def _notes(seen: Scene, fit: SceneFit, overlap: float | None) -> tuple[str, ...]:
    """What was chosen and why, in words for the user."""
    background = {
        "constant": "The background is the same everywhere.",
        "linear": "The background rises evenly from one side to the other.",
        "textured": "The background varies, so it was followed block by block.",
    }
    notes = [background[seen.background_kind]]
    if seen.contradicted is not None:
        notes.append(
            f"No body here has a half-width of {seen.contradicted:.1f} px, so it was measured:"
            f" {seen.half_width:.1f} px."
        )
    words = {"width": "half-width", "brightness": "brightness"}
    for part, weighed in fit.parts.items():
        if weighed.on:
            notes.append(f"The bodies' {words[part]} changes along them, so it has a profile.")
        else:
            notes.append(f"One {words[part]} for each body is enough (apart from its ends).")
    most = max(len(b.knots) for b in fit.bodies)
    if most > 8:
        notes.append(f"Some bodies bend so much that their curves have {most} knots.")
    if fit.beside:
        some = "A body" if len(fit.beside) == 1 else f"{len(fit.beside)} bodies"
        notes.append(f"{some} without a sketch lay across others, and took part in the model.")
    if overlap is not None:
        how = "hide each other" if overlap > 0.5 else "add up"
        notes.append(f"Where bodies overlap, they mostly {how}.")
    return tuple(notes)


def nothing(
    image: Real[Array, "H W"],
    sketches: list[Float[Array, "N 2"]],
    faults: list[str],
    began: float,
) -> Refinement:
    """Every curve as drawn, for the reasons given."""
    filled = _filled(image)
    noise = scene.pixel_noise(filled)
    background, kind = estimate_background(filled, noise)
    curves = tuple(assess.as_drawn(s, f) for s, f in zip(sketches, faults, strict=True))
    model = SceneModel(
        polarity="bright",
        knots=(0,) * len(sketches),
        half_width=float("nan"),
        width="constant",
        brightness="constant",
        background=kind,
        overlap=None,
        contrast=0.0,
        noise=noise,
        blur=float("nan"),
    )
    return Refinement(curves, background, background, model, time.perf_counter() - began)

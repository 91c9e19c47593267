"""From fitted islands to the result that the user gets."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Real

from napari_splinesketch.engine import constants as const
from napari_splinesketch.engine import spline
from napari_splinesketch.engine.find import scoring
from napari_splinesketch.engine.fit import fitting
from napari_splinesketch.engine.fit.fit_scene import SceneFit
from napari_splinesketch.engine.fit.fitting import Body
from napari_splinesketch.engine.islands import Island
from napari_splinesketch.engine.judge import assess, doubt, position
from napari_splinesketch.engine.look import scene
from napari_splinesketch.engine.look.background import Kind, estimate_background
from napari_splinesketch.engine.report import needed
from napari_splinesketch.engine.types import POINTS, Array, Curve, Refinement, SceneModel

SAME_BODY = "it lies on the same body as"


@dataclass(frozen=True, eq=False)
class Part:
    """What was found on one island."""

    members: tuple[int, ...]
    """Numbers of its sketches."""
    curves: list[Curve]
    """One for each of them, in the image's pixels."""
    window: tuple[slice, slice]
    drawn: Float[Array, "h w"]
    """`window` and `drawn`: its part of the image, and the bodies there in the image's units."""
    model: SceneModel
    """What it needed."""


@dataclass(frozen=True, eq=False)
class Pictures:
    """The two pictures of a result, made when they are first read: as large as the image."""

    image: Real[Array, "H W"]
    """As given to `refine`."""
    drawn: Sequence[tuple[tuple[slice, slice], Float[Array, "h w"]]]
    """Bodies in windows of the image, in its units."""
    kind: Kind | None
    """How simple a background explains the image; None to find out."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Of the image."""
        return self.image.shape

    @cached_property
    def background(self) -> Float[Array, "H W"]:
        """(H, W) the image without bodies, in its units."""
        bare = self.image.astype(np.float64)
        finite = np.isfinite(bare)
        if not finite.all():
            bare[~finite] = np.median(bare[finite])
        for window, bodies in self.drawn:
            bare[window] -= bodies
        noise = scene.pixel_noise(bare) if self.kind is None else 0.0
        return estimate_background(bare, noise, self.kind)[0]

    @cached_property
    def reconstruction(self) -> Float[Array, "H W"]:
        """(H, W) background and bodies."""
        whole = self.background.copy()
        for window, bodies in self.drawn:
            whole[window] += bodies
        return whole


def describe(island: Island, fit: SceneFit) -> Part:
    """The curves of an island with their status, and what they are drawn as."""
    seen = fit.seen
    drawn = _draw(seen.valid, [*fit.bodies, *fit.fixed])
    bodies, known = _placed(fit, seen.normal - drawn)
    if any(new.own is not old.own for new, old in zip(bodies, fit.bodies, strict=True)):
        drawn = _draw(seen.valid, [*bodies, *fit.fixed])
    residual = seen.normal - drawn
    rests = [_rest(body, residual) for body in bodies]
    curves = list(_curves(fit, bodies, known, island, rests))
    return part_of(island, curves, seen.in_image(drawn), needed.model(seen, bodies, rests))


def part_of(
    island: Island, curves: list[Curve], drawn: Float[Array, "h w"], model: SceneModel
) -> Part:
    """What was found in the turned window of an island, in the image."""
    drawn = island.pose.back(drawn.astype(np.float32))
    return Part(island.members, island.in_image(curves), island.pose.window, drawn, model)


def assemble(
    image: Real[Array, "H W"],
    sketches: list[Float[Array, "N 2"]],
    faults: list[str],
    copies: dict[int, int],
    parts: list[Part],
    began: float,
) -> Refinement:
    """Everything that was found, in the order of the sketches.

    `faults` say why a sketch could not be refined, or nothing; `copies` are the numbers of sketches
    that are as an earlier one, with its number; the call began at `began`, by `time.perf_counter`.
    """
    made = {i: (c, p.model) for p in parts for i, c in zip(p.members, p.curves, strict=True)}
    alone = dict(made)
    for copy, original in copies.items():
        if original not in alone:
            continue
        curve, model = alone[original]
        for one, other in ((copy, original), (original, copy)):
            said = *curve.reasons, f"{SAME_BODY} curve {other}"
            made[one] = replace(curve, status="check", reasons=said), model
    curves = tuple(
        made[i][0] if i in made else assess.as_drawn(line, faults[copies.get(i, i)])
        for i, line in enumerate(sketches)
    )
    knots = [len(curve.knots) * (i in made) for i, curve in enumerate(curves)]
    model = needed.joined([model for _, model in made.values()], knots)
    drawn = [(part.window, part.drawn) for part in parts]
    pictures = Pictures(image, drawn, model.background if parts else None)
    return Refinement.lazy(curves, pictures, model, time.perf_counter() - began)


def _placed(
    fit: SceneFit, residual: Float[Array, "H W"]
) -> tuple[list[Body], list[Float[Array, "2K 2K"]]]:
    """Bodies where image and clicked sketches put them together, and the knots' covariances."""
    everything = [body.points(POINTS) for body in (*fit.bodies, *fit.fixed)]
    misfit = position.unexplained(fit.seen, residual)
    widest = max(body.half_width for body in fit.bodies)
    beside = spline.neighbours(everything, const.BESIDE_HW * widest)
    bodies, known = [], []
    for body, start, near in zip(fit.bodies, fit.starts, beside, strict=False):
        others = np.concatenate([everything[k] for k in near]) if near else None
        sure = position.covariance(body, misfit, others)
        if start.found and scoring.clicked(start.sketch) and len(body.pixels):
            knots, sure = position.with_sketch(body.knots, sure, start.sketch, start.half_width)
            body = fitting.moved(fit.seen, body, knots)
        bodies.append(body)
        known.append(sure)
    return bodies, known


def _curves(
    fit: SceneFit,
    bodies: list[Body],
    known: list[Float[Array, "2K 2K"]],
    island: Island,
    rests: list[Float[Array, " m"]],
) -> Iterator[Curve]:
    """The curves with what they say of themselves, in the window's pixels."""
    lines = [spline.sample(b.knots, 100) for b in (*bodies, *fit.fixed)]
    twins = spline.doubles(lines, const.TWIN_HW * fit.seen.half_width, const.TWIN_SHARE)
    for i, (body, start) in enumerate(zip(bodies, fit.starts, strict=True)):
        reasons = []
        if not start.found:
            reasons.append("no body was seen along its sketch")
        if all(start.goes_on):
            reasons.append("the body seems to go on beyond its ends")
        if i in twins:
            twin = twins[i] < len(bodies) and f"curve {island.members[twins[i]]}"
            reasons.append(f"{SAME_BODY} {twin or 'another curve'}")
        cuts = spline.knot_miss(start.line, len(body.knots)) > const.CORNERS_HW * body.half_width
        if start.found and cuts:
            reasons.append("it has too few knots to follow all bends of its body")
        tips = start.found & ~(start.whole | np.array(start.goes_on))
        knots, points, half_width, u = assess.outline(body, start.sketch, tips, fit.seen)
        # Normals of the fit: clicks may turn the curve, but not what is unknown along it.
        sd = position.normal_sd(known[i], fit.bodies[i].knots, u)
        if not len(body.pixels):
            sd[:] = np.inf
        if i in fit.held:
            sd = np.maximum(sd, body.half_width)
        if spline.sharpest_turn(points, body.half_width) > const.FOLD_RAD:
            reasons.append("it folds over itself")
        reasons += doubt.reasons(doubt.collect(points, u, sd, body.half_width, start))
        yield Curve(
            knots,
            points,
            half_width,
            sd,
            "check" if reasons else "good",
            tuple(reasons),
            float(np.sqrt(np.mean(rests[i] ** 2))) if len(rests[i]) else np.inf,
        )


def _draw(valid: Bool[Array, "H W"], bodies: list[Body]) -> Float[Array, "H W"]:
    """All bodies, as a share of the contrast; guessed where the image has no value."""
    there = np.zeros(valid.shape, dtype=bool)
    there.flat[np.concatenate([body.pixels for body in bodies])] = True
    drawn = np.zeros(valid.shape, np.float32)
    drawn[there] = fitting.drawn(bodies, np.flatnonzero(there))
    return drawn if valid.all() else scene.filled(drawn, valid)


def _rest(body: Body, residual: Float[Array, "H W"]) -> Float[Array, " m"]:
    """Image minus bodies minus the body's own local background, in its band."""
    at = np.column_stack(np.divmod(body.pixels, residual.shape[1]))
    away = (at - body.knots.mean(0)) / const.SLOPE_UNIT_PX
    local = body["offset"] + away @ [body["slope_row"], body["slope_col"]]
    return residual.ravel()[body.pixels] - local

"""The `paper` preset: what the paper's own method found, as `refine` gives it."""

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int, Real

from napari_splinesketch.engine import spline
from napari_splinesketch.engine.fit.fit_scene import Reporter
from napari_splinesketch.engine.fit.fitting import Stopped
from napari_splinesketch.engine.judge import assess
from napari_splinesketch.engine.look.scene import Scene
from napari_splinesketch.engine.report.assemble import frames, full_list
from napari_splinesketch.engine.types import POINTS, Array, Curve, Refinement, SceneModel
from napari_splinesketch.paper.fit import PaperFit
from napari_splinesketch.paper.phases import refine_paper

Lines = list[Float[Array, "N 2"]]


def fit_paper(
    seen: Scene,
    sketches: Lines,
    fixed: Sequence[Curve],
    corner: Int[Array, "2"],
    seed: int,
    report: Reporter,
) -> PaperFit:
    """Run the three phases of the paper on the normalised image."""

    def passed_on(stage: str, share: float, lines: list | None) -> bool:
        report(stage, share)
        return True

    image = np.where(seen.valid, seen.normal, np.nan)
    found = refine_paper(
        image,
        sketches,
        half_width=seen.half_width,
        seed=seed,
        report=passed_on,
        fixed=[np.column_stack([c.points - corner, c.half_width]) for c in fixed],
    )
    if found.cancelled:
        raise Stopped
    return found


def assemble_paper(
    image: Real[Array, "H W"],
    sketches: Lines,
    faults: list[str],
    window: tuple[slice, slice],
    seen: Scene,
    fit: PaperFit,
    began: float,
) -> Refinement:
    """The result of the paper's method; it knows no standard errors, so `sd` is infinite."""
    corner = np.array([s.start for s in window])
    bodies = fit.reconstruction - fit.background
    rest = seen.normal - fit.reconstruction
    usable = [line - corner for line, fault in zip(sketches, faults, strict=True) if not fault]
    made = [
        _curve(knots, line, rest, bodies, seen)
        for knots, line in zip(fit.knots, usable, strict=True)
    ]
    moved = [
        replace(c, knots=c.knots + np.append(corner, 0), points=c.points + corner) for c in made
    ]
    background, reconstruction = frames(image, window, seen, bodies * seen.contrast)
    counts = iter([len(k) for k in fit.knots])
    model = SceneModel(
        polarity=seen.polarity,
        knots=tuple(0 if fault else next(counts) for fault in faults),
        half_width=float(np.median(fit.knots[:, :, 2])),
        width="profile",
        background="linear",
        overlap=fit.alpha if int(fit.place.real) > 1 else None,
        contrast=abs(seen.contrast),
        noise=abs(seen.contrast) * float(np.sqrt(fit.score)),
        blur=float("nan"),
        notes=("The paper's own method: every part of its model is always used.",),
    )
    curves = full_list(moved, sketches, faults)
    return Refinement(curves, reconstruction, background, model, time.perf_counter() - began)


def _curve(knots, sketch, rest, bodies, seen: Scene) -> Curve:
    u = assess.uniform(knots[:, :2])
    points, width = np.split(spline.basis(len(knots), u) @ knots, [2], axis=1)
    at = np.rint(points).astype(int).clip(0, np.array(rest.shape) - 1)
    along = rest[at[:, 0], at[:, 1]]
    reasons = assess.doubts(points, sketch, along, seen.noise, rest.shape)
    rms = float(np.sqrt(np.mean(along**2)))
    nothing_known = np.full(POINTS, np.inf)
    status = "check" if reasons else "good"
    return Curve(knots, points, width[:, 0], nothing_known, status, tuple(reasons), rms)

"""The `paper` preset: what the paper's own method found, as `refine` gives it."""

import numpy as np
from jaxtyping import Float

from napari_splinesketch.engine import spline
from napari_splinesketch.engine.fit.fit_scene import Reporter
from napari_splinesketch.engine.islands import Island
from napari_splinesketch.engine.look.scene import Scene
from napari_splinesketch.engine.report.assemble import Part, part_of
from napari_splinesketch.engine.types import POINTS, Array, Curve, SceneModel
from napari_splinesketch.paper.fit import PaperFit
from napari_splinesketch.paper.phases import refine_paper

MOVED = 0.5
"""A curve whose middle moved by more than this share of its length needs review."""
SHORTER, LONGER = 2.5, 2.8
"""So does one that came out shorter or longer than its sketch by more than these factors."""


def fit_paper(island: Island, seen: Scene, seed: int, report: Reporter) -> Part:
    """Run the three phases of the paper on the normalised image of an island.

    The paper's method knows no standard errors, so `sd` is infinite.
    """
    image = np.where(seen.valid, seen.normal, np.nan)
    found = refine_paper(
        image,
        island.sketches,
        half_width=seen.half_width,
        seed=seed,
        report=report,
        fixed=island.fixed,
    )
    bodies = found.reconstruction - found.background
    rest = seen.normal - found.reconstruction
    curves = [
        _curve(knots, line, rest) for knots, line in zip(found.knots, island.sketches, strict=True)
    ]
    return part_of(island, curves, seen.in_image(bodies), _model(found, seen))


def _model(fit: PaperFit, seen: Scene) -> SceneModel:
    return SceneModel(
        polarity=seen.polarity,
        knots=tuple(len(k) for k in fit.knots),
        half_width=float(np.median(fit.knots[:, :, 2])),
        width="profile",
        background="linear",
        overlap=fit.alpha if int(fit.place.real) > 1 else None,
        contrast=abs(seen.contrast),
        noise=abs(seen.contrast) * float(np.sqrt(fit.score)),
        blur=float("nan"),
        notes=("The paper's own method: every part of its model is always used.",),
    )


def _curve(
    knots: Float[Array, "K 3"], sketch: Float[Array, "N 2"], rest: Float[Array, "H W"]
) -> Curve:
    u = spline.places(knots)
    points, width = np.split(spline.basis(len(knots), u) @ knots, [2], axis=1)
    at = np.rint(points).astype(int).clip(0, np.array(rest.shape) - 1)
    along = rest[at[:, 0], at[:, 1]]
    reasons = _doubts(points, sketch)
    rms = float(np.sqrt(np.mean(along**2)))
    nothing_known = np.full(POINTS, np.inf)
    status = "check" if reasons else "good"
    return Curve(knots, points, width[:, 0], nothing_known, status, tuple(reasons), rms)


def _doubts(curve: Float[Array, "P 2"], sketch: Float[Array, "N 2"]) -> list[str]:
    """What looks wrong with a curve, in words for the user."""
    drawn = spline.resample(sketch, len(curve))
    length, before = spline.arc_length(curve)[-1], spline.arc_length(drawn)[-1]
    moved = np.linalg.norm(curve.mean(0) - drawn.mean(0))
    found = []
    if moved > MOVED * max(length, before):
        found.append(f"it moved {moved:.0f} px from its sketch")
    if not 1 / SHORTER < length / before < LONGER:
        found.append(f"its length changed from {before:.0f} to {length:.0f} px")
    return found

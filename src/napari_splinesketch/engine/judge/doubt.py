"""How likely it is that a curve lies on the wrong body: several weak signs, weighed together."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import distance

from napari_splinesketch.engine import spline
from napari_splinesketch.engine.types import Array

NO_RIVAL = 100.0
"""Margin of a curve that no other set of paths contests."""
END_SHARE = 0.1
"""Of the points, at either end, may be uncertain."""
LEAST_SD = 0.03
"""Added to standard errors, px: below, they tell nothing."""
ACROSS, ALONG = 2.3, 8.0
"""A curve lies over itself where parts of it are nearer than so many half-widths, and so many apart
along it."""
SIGNS = ("sd", "sd_beside", "astray", "kink", "contrast", "margin", "length", "over_itself")
WEIGHTS = np.array([2.1, -0.5, 1.7, 2.2, -4.7, 0.76, 3.6, 6])
USUAL = np.array([-1.5, -1.8, -2.4, 0.83, 0.22, -4.2, 0.056, -3.9])
"""Weights of the signs, and their values in curves that are right."""
THRESHOLD = 4.9
"""Of the weighted sum, above which a curve asks for a look. All three are fitted to generated
frames by tests/benchmarks/doubt_weights.py."""
TELLING = 0.8
"""Signs that add more than this are named."""


@dataclass(frozen=True)
class Evidence:
    """What a fitted curve looks like beside its sketch, its rivals and the other curves.

    Attributes
    ----------
    sd, sd_beside
        Largest standard error between the ends, px; and the largest where another curve is near.
    astray
        Farthest that curve and sketch are from each other, px.
    drawn
        Length of the sketch, px.
    kink
        Largest curvature over its root mean square.
    contrast
        Brightness of the body above the background, in units of the scene's.
    margin
        By how much the best set of paths with another curve there is worse, in unexplained
        pixels; NO_RIVAL without any.
    length
        Over the median length of all curves.
    over_itself
        Share of the curve that lies over another part of it.
    """

    sd: float
    sd_beside: float
    astray: float
    drawn: float
    kink: float
    contrast: float
    margin: float
    length: float
    over_itself: float

    @property
    def signs(self) -> Float[Array, " S"]:
        """(S,) what is weighed, in the order of SIGNS."""
        return np.array(
            [
                np.log(LEAST_SD + min(self.sd, 1e3)),
                np.log(LEAST_SD + min(self.sd_beside, 1e3)),
                np.log(0.01 + self.astray / self.drawn),
                np.log(self.kink),
                np.log(max(self.contrast, 1e-2)),
                -np.log1p(np.clip(self.margin, 0, NO_RIVAL)),
                abs(np.log(self.length)),
                np.log(0.02 + self.over_itself),
            ]
        )


def collect(
    points: Float[Array, "P 2"],
    sd: Float[Array, " P"],
    beside: Bool[Array, " P"],
    sketch: Float[Array, "N 2"],
    contrast: float,
    margin: float,
    usual_length: float,
    half_width: float,
) -> Evidence:
    """The evidence about one curve.

    Parameters
    ----------
    points, sd, beside
        (P, 2) the curve, uniform in arc length; (P,) its standard errors, px, and which of its
        points have another curve near.
    sketch
        (N, 2) what was drawn.
    contrast, margin
        See `Evidence`.
    usual_length
        Median length of all curves, px.
    half_width
        Of the body, px.
    """
    end = int(END_SHARE * len(points))
    middle = slice(end, -end)
    apart = np.linalg.norm(points[:, None] - spline.resample(sketch, len(points))[None], axis=2)
    length = float(spline.arc_length(points)[-1])
    return Evidence(
        sd=float(sd[middle].max()),
        sd_beside=float(np.where(beside, sd, 0.0)[middle].max()),
        astray=float(max(apart.min(0).max(), apart.min(1).max())),
        drawn=float(spline.arc_length(sketch)[-1]),
        kink=_kink(points),
        contrast=contrast,
        margin=margin,
        length=max(length, 1e-3) / max(usual_length, 1e-3),
        over_itself=_over_itself(points, half_width),
    )


def reasons(evidence: Evidence) -> list[str]:
    """Why a curve asks for a look, in words for the user; empty where it does not."""
    share = WEIGHTS * (evidence.signs - USUAL)
    if share.sum() < THRESHOLD:
        return []
    told = {SIGNS[i] for i in np.flatnonzero(share > min(TELLING, share.max() - 1e-9))}
    words = {
        "sd": f"its position is uncertain by up to {evidence.sd:.1f} px",
        "astray": f"it strays up to {evidence.astray:.0f} px from its sketch",
        "kink": "it bends sharply in one place",
        "contrast": "little of it can be seen",
        "margin": "another path explains the image about as well",
        "length": f"it is {evidence.length:.1f} times as long as most curves here",
        "over_itself": "it lies over itself",
    }
    return [text for sign, text in words.items() if sign in told] or [words["sd"]]


def _over_itself(points: Float[Array, "P 2"], half_width: float) -> float:
    """Share of the points that have a part of the curve near which is not near along it."""
    apart = distance.cdist(points, points)
    along = spline.arc_length(points)
    apart[np.abs(along[:, None] - along) < ALONG * half_width] = np.inf
    return float((apart.min(1) < ACROSS * half_width).mean())


def _kink(points: Float[Array, "P 2"]) -> float:
    """Largest curvature over its root mean square, but for the ends."""
    tangent = np.gradient(points, axis=0)
    bend = np.gradient(tangent, axis=0)
    speed = np.maximum(np.linalg.norm(tangent, axis=1), 1e-6)
    turn = np.abs(tangent[:, 0] * bend[:, 1] - tangent[:, 1] * bend[:, 0]) / speed**3
    return float((turn[5:-5].max() + 1e-6) / (np.sqrt(np.mean(turn**2)) + 1e-6))

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
SIGNS = (
    "sd", "sd_beside", "astray", "kink", "contrast", "margin", "length", "over_itself",
    "residual", "unsettled",
)  # fmt: skip
WEIGHTS = np.array([0.53, -0.13, 2.36, 0.73, -1.14, 0.11, 0.45, 1.0, 1.27, 1.17])
USUAL = np.array([-1.16, -1.98, -2.51, 0.99, 0.48, -1.65, 0.06, -3.91, -1.69, 0.0])
"""Weights of the signs, and their values in curves that are right."""
THRESHOLD = 2.7
"""Of the weighted sum, above which a curve needs review: fitted to images of many kinds together
with generated frames, both weighing the same."""
TELLING = 0.5
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
    residual
        Root mean square of what the image leaves unexplained in the body's band, as a share of
        its contrast.
    unsettled
        Whether the fit was still improving when its steps were over.
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
    residual: float = 0.18
    unsettled: bool = False

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
                np.log(np.clip(self.residual, 0.02, 1e3)),
                float(self.unsettled),
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
    residual: float = 0.18,
    unsettled: bool = False,
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
    residual, unsettled
        See `Evidence`.
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
        residual=residual,
        unsettled=unsettled,
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
        "residual": f"{evidence.residual:.0%} of its contrast is left unexplained",
        "unsettled": "the fit was still improving when it ended",
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

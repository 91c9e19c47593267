"""How likely it is that a curve lies on the wrong body: a few signs, weighed together."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial import distance

from napari_splinesketch.engine import spline
from napari_splinesketch.engine.types import Array

END_SHARE = 0.1
"""Of the points, at either end, may be uncertain."""
LEAST_SD = 0.03
"""Added to standard errors, px: below, they tell nothing."""
SIGNS = ("sd", "astray", "unseen", "goes_on")
WEIGHTS = np.array([1.3, 2.1, 6.6, 4.4])
USUAL = np.array([-1.2, -2.7, 0.01, 0.0])
"""Weights of the signs, and their values in curves that are right."""
THRESHOLD = 3.0
"""Of the weighted sum, above which a curve needs review. The weights are fitted to real images and
generated ones by tests/benchmarks/doubt_weights.py, but for that of "goes_on", which marks a curve
by itself; the threshold is chosen from what the command prints."""
TELLING = 0.5
"""Signs that add more than this are named."""


@dataclass(frozen=True)
class Evidence:
    """What a fitted curve looks like beside its sketch.

    Attributes
    ----------
    sd
        Largest standard error between the ends, px.
    astray
        Farthest that curve and sketch are from each other, px.
    drawn
        Length of the sketch, px.
    unseen
        Share of its path where the image shows no body.
    goes_on
        Beyond how many of the path's ends the image shows a body: where it does beyond both, only
        a part was sketched.
    """

    sd: float
    astray: float
    drawn: float
    unseen: float
    goes_on: int

    @property
    def signs(self) -> Float[Array, " S"]:
        """(S,) what is weighed, in the order of SIGNS."""
        return np.array(
            [
                np.log(LEAST_SD + min(self.sd, 1e3)),
                np.log(0.01 + self.astray / self.drawn),
                self.unseen,
                float(self.goes_on == 2),
            ]
        )


def collect(
    points: Float[Array, "P 2"],
    sd: Float[Array, " P"],
    sketch: Float[Array, "N 2"],
    unseen: float,
    goes_on: int,
) -> Evidence:
    """The evidence about one curve.

    Parameters
    ----------
    points, sd
        (P, 2) the curve, uniform in arc length; (P,) its standard errors, px.
    sketch
        (N, 2) what was drawn.
    unseen, goes_on
        See `Evidence`.
    """
    end = int(END_SHARE * len(points))
    apart = distance.cdist(points, spline.resample(sketch, len(points)))
    return Evidence(
        sd=float(sd[end:-end].max()),
        astray=float(max(apart.min(0).max(), apart.min(1).max())),
        drawn=float(spline.arc_length(sketch)[-1]),
        unseen=unseen,
        goes_on=goes_on,
    )


def reasons(evidence: Evidence) -> list[str]:
    """Why a curve needs review, in words for the user; empty where it does not."""
    share = WEIGHTS * (evidence.signs - USUAL)
    if share.sum() < THRESHOLD:
        return []
    words = (
        f"its position is uncertain by up to {evidence.sd:.1f} px",
        f"it strays up to {evidence.astray:.0f} px from its sketch",
        f"{evidence.unseen:.0%} of it cannot be seen",
        "the body seems to go on beyond its ends",
    )
    least = min(TELLING, share.max())
    return [text for text, mine in zip(words, share, strict=True) if mine >= least]

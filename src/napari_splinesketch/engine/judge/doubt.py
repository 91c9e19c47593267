"""How likely it is that a curve lies on the wrong body: a few signs, weighed together."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from napari_splinesketch.engine import spline
from napari_splinesketch.engine.find import scoring
from napari_splinesketch.engine.types import Array

END_SHARE = 0.1
"""Of the points, at either end, may be uncertain."""
LEAST_SD = 0.03
"""Added to standard errors, px: below, they tell nothing."""
SIGNS = ("sd", "astray", "cost")
WEIGHTS = np.array([0.85, 1.1, 1.2])
USUAL = np.array([-1.6, -2.3, 1.5])
"""Weights of the signs, and their values in curves that are right: fitted to real images and
generated ones by tests/benchmarks/doubt_weights.py, which prints what each threshold marks."""
THRESHOLD = 1.6
"""Of the weighted sum, above which a curve needs review."""
UNCERTAIN = 5.0
"""A curve that may be so far off needs review, however likely its path is, px."""
TELLING = 0.5
"""Signs that add more than this are named."""
WORDS = {
    "apart": "it runs beside its sketch",
    "missed": "it misses points of its sketch",
    "kink": "it bends sharply",
    "short": "it is shorter than its sketch",
    "long": "it is longer than its sketch",
}
"""Why a path is an unlikely one for its sketch, by what costs it most."""


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
    known
        (F,) what is known of its path, in the order of `scoring.FEATURES`.
    """

    sd: float
    astray: float
    drawn: float
    known: Float[Array, " F"]

    @property
    def signs(self) -> Float[Array, " S"]:
        """(S,) what is weighed, in the order of SIGNS."""
        return np.array(
            [
                np.log(LEAST_SD + min(self.sd, 1e3)),
                np.log(0.01 + self.astray / self.drawn),
                np.log1p(self.known @ scoring.WEIGHTS),
            ]
        )

    @property
    def dearest(self) -> str:
        """What of its path costs most, in words."""
        name = scoring.FEATURES[int((self.known * scoring.WEIGHTS).argmax())]
        unseen = self.known[scoring.FEATURES.index("unseen")]
        return WORDS.get(name, f"{unseen:.0%} of it cannot be seen")


def collect(
    points: Float[Array, "P 2"],
    sd: Float[Array, " P"],
    sketch: Float[Array, "N 2"],
    known: Float[Array, " F"],
) -> Evidence:
    """The evidence about one curve.

    Parameters
    ----------
    points, sd
        (P, 2) the curve, uniform in arc length; (P,) its standard errors, px.
    sketch
        (N, 2) what was drawn.
    known
        See `Evidence`.
    """
    end = int(END_SHARE * len(points))
    drawn = spline.resample(sketch, len(points))
    astray = max(spline.apart(points, drawn).max(), spline.apart(drawn, points).max())
    return Evidence(
        sd=float(sd[end:-end].max()),
        astray=float(astray),
        drawn=float(spline.arc_length(sketch)[-1]),
        known=known,
    )


def reasons(evidence: Evidence) -> list[str]:
    """Why a curve needs review, in words for the user; empty where it does not."""
    share = WEIGHTS * (evidence.signs - USUAL)
    if share.sum() < THRESHOLD and evidence.sd < UNCERTAIN:
        return []
    words = (
        f"its position is uncertain by up to {evidence.sd:.1f} px",
        f"it strays up to {evidence.astray:.0f} px from its sketch",
        evidence.dearest,
    )
    telling = share >= min(TELLING, share.max())
    telling[0] |= evidence.sd >= UNCERTAIN
    return [text for text, tells in zip(words, telling, strict=True) if tells]

"""How likely it is that a curve lies on the wrong body: a few signs, weighed together."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from napari_splinesketch.engine import spline
from napari_splinesketch.engine.find import scoring
from napari_splinesketch.engine.find.finding import Start
from napari_splinesketch.engine.types import Array

END_SHARE = 0.1
"""Of the points, at either end, may be uncertain."""
LEAST_SD, LEAST_ASTRAY = 0.02, 0.2
"""Added to standard errors and distances, in their units: below, they tell nothing."""
CLEAR = 3.0
"""A path that all others are dearer than by so much has no rival."""
SIGNS = ("sd", "astray", "cost", "rival")
WEIGHTS = np.array([0.9, 1.7, 1.4, 1.6])
USUAL = np.array([-2.6, 0.3, 1.5, 0.0])
"""Weights of the signs, and their values in curves that are right, from a fit to real images and
generated ones. tests/benchmarks/doubt_weights.py prints what a fit would be now, which moves by
half with the few curves that are wrong, and what these weights and each threshold mark."""
THRESHOLD = 3.2
"""Of the weighted sum, above which a curve needs review."""
ADRIFT = 2.0
"""A curve that may be so far off, in the unit of its standard error, needs review anyway."""
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
    half_width
        Of the body, px.
    room
        How far a sketch like this usually is from its body, px.
    known
        (F,) what is known of its path, in the order of `scoring.FEATURES`.
    margin
        By how much the sketches cost more if this one means another path.
    missed_end
        How far before a clicked end of its sketch it ends, px, if that is more than usual.
    """

    sd: float
    astray: float
    half_width: float
    room: float
    known: Float[Array, " F"]
    margin: float
    missed_end: float = 0.0

    @property
    def uncertain(self) -> float:
        """The standard error in half-widths of the body, and what lines are drawn with."""
        return min(self.sd, 1e3) / (self.half_width + scoring.DRAWN)

    @property
    def signs(self) -> Float[Array, " S"]:
        """(S,) what is weighed, in the order of SIGNS."""
        return np.array(
            [
                np.log(LEAST_SD + self.uncertain),
                np.log(LEAST_ASTRAY + self.astray / self.room),
                np.log1p(self.known @ scoring.WEIGHTS),
                max(CLEAR - self.margin, 0.0),
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
    half_width: float,
    start: Start,
) -> Evidence:
    """The evidence about one curve.

    Parameters
    ----------
    points, sd
        (P, 2) the curve, uniform in arc length; (P,) its standard errors, px.
    sketch
        (N, 2) what was drawn.
    half_width
        Of the body, px.
    start
        Where its fit began.
    """
    end = int(END_SHARE * len(points))
    drawn = spline.resample(sketch, len(points))
    astray = max(spline.apart(points, drawn).max(), spline.apart(drawn, points).max())
    room, length = half_width + scoring.DRAWN, float(spline.arc_length(sketch)[-1])
    missed_end = 0.0
    if scoring.clicked(sketch):
        out = points[[0, -1]] - points[[end, -1 - end]]
        out /= np.linalg.norm(out, axis=1, keepdims=True) + 1e-9
        short = float(((sketch[[0, -1]] - points[[0, -1]]) * out).sum(1).max())
        usual = scoring.hit(half_width, length) + scoring.ENDS * length
        missed_end = short if short > usual else 0.0
    else:
        room += scoring.STROKE * length
    return Evidence(
        float(sd[end:-end].max()),
        float(astray),
        half_width,
        room,
        start.known,
        start.margin,
        missed_end,
    )


def reasons(evidence: Evidence) -> list[str]:
    """Why a curve needs review, in words for the user; empty where it does not."""
    share = WEIGHTS * (evidence.signs - USUAL)
    missed = [f"it ends {evidence.missed_end:.0f} px before its sketch does"]
    missed *= evidence.missed_end > 0
    if share.sum() < THRESHOLD and evidence.uncertain < ADRIFT:
        return missed
    words = (
        f"its position is uncertain by up to {evidence.sd:.1f} px",
        f"it strays up to {evidence.astray:.0f} px from its sketch",
        evidence.dearest,
        "another path is nearly as likely",
    )
    telling = share >= min(TELLING, share.max())
    telling[0] |= evidence.uncertain >= ADRIFT
    return [*missed, *(text for text, tells in zip(words, telling, strict=True) if tells)]

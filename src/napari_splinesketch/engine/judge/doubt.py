"""How likely it is that a curve lies on the wrong body: a few signs, weighed together."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from napari_splinesketch.engine import spline
from napari_splinesketch.engine.find import scoring
from napari_splinesketch.engine.find.finding import Start
from napari_splinesketch.engine.look.ridges import ASIDE, ASIDE_PX, LEFT, WIDTHS
from napari_splinesketch.engine.look.scene import Scene
from napari_splinesketch.engine.types import Array

CERTAIN, NEAR = 0.9, 0.95
"""Shares of a curve that are at least as certain, and as near to its sketch, as is weighed: what is
worse is a small part of it."""
ENDS = 10
"""Points at either end whose direction is that of the end."""
LEAST_SD, LEAST_ASTRAY = 0.02, 0.2
"""Added to standard errors and distances, in their units: below, they tell nothing."""
CLEAR = 3.0
"""A path that all others are dearer than by so much has no rival."""
SIGNS = ("sd", "astray", "cost", "rival")
WEIGHTS = np.array([1.3, 2.5, 0.6, 1.2])
USUAL = np.array([-2.1, 0.1, 1.5, 0.0])
"""Weights of the signs, and their values in curves that are right, from a fit to real images and
generated ones. tests/benchmarks/doubt_weights.py prints what a fit would be now, which moves by
half with the few curves that are wrong, and what these weights and each threshold mark."""
THRESHOLD = 2.8
"""Of the weighted sum, above which a curve needs review."""
ADRIFT = 2.0
"""A curve that may be so far off, in the unit of its standard error, needs review anyway."""
STRETCHES, SHOWN = 8, 6
"""A body shows along a path where so many of so many stretches of it are a ridge ..."""
ABOVE = 2.0
"""... whose mean is above the means of both sides by so many of their standard errors ..."""
OTHER = 3
"""... at a half-width that is at most so many of WIDTHS from the one it was looked for at."""
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
        Standard error that a tenth of its points exceed, px.
    astray
        How far a twentieth of curve or sketch, at least, is from the other, px.
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
    drawn = spline.resample(sketch, len(points))
    apart = spline.apart(points, drawn), spline.apart(drawn, points)
    astray = np.quantile(apart, NEAR, axis=1, method="higher").max()
    room, length = half_width + scoring.DRAWN, float(spline.arc_length(sketch)[-1])
    missed_end = 0.0
    if scoring.clicked(sketch):
        out = points[[0, -1]] - points[[ENDS, -1 - ENDS]]
        out /= np.linalg.norm(out, axis=1, keepdims=True) + 1e-9
        short = float(((sketch[[0, -1]] - points[[0, -1]]) * out).sum(1).max())
        usual = scoring.hit(half_width, length) + scoring.ENDS * length
        missed_end = short if short > usual else 0.0
    else:
        room += scoring.STROKE * length
    return Evidence(
        float(np.quantile(sd, CERTAIN, method="higher")),
        float(astray),
        half_width,
        room,
        start.known,
        start.margin,
        missed_end,
    )


def shows(seen: Scene, start: Start) -> bool:
    """Whether a body shows along the whole of a path on which too few pixels look like one."""
    length = float(spline.arc_length(start.line)[-1])
    points = spline.resample(start.line, STRETCHES * int(np.ceil(max(length / STRETCHES, 4))))
    for width in WIDTHS[max(start.rung - OTHER, 0) : start.rung + OTHER + 1]:
        middle, away = 0.5 * width * np.linspace(-1, 1, 5), ASIDE * width + ASIDE_PX
        across = spline.across(seen.normal, points, np.add.outer([-away, 0, away], middle).ravel())
        one, own, other = across.reshape(STRETCHES, -1, 3, 5).mean((1, 3)).T
        noise = LEFT * seen.noise / np.sqrt(max(length / STRETCHES * width, 1))
        if (own - np.maximum(one, other) > ABOVE * noise).sum() >= SHOWN:
            return True
    return False


def reasons(evidence: Evidence) -> list[str]:
    """Why a curve needs review, in words for the user; empty where it does not."""
    share = WEIGHTS * (evidence.signs - USUAL)
    missed = [f"it ends {evidence.missed_end:.0f} px before its sketch does"]
    missed *= evidence.missed_end > 0
    if share.sum() < THRESHOLD and evidence.uncertain < ADRIFT:
        return missed
    words = (
        f"part of it is uncertain by {evidence.sd:.1f} px or more",
        f"part of it is {evidence.astray:.0f} px or more from its sketch",
        evidence.dearest,
        "another path is nearly as likely",
    )
    telling = share >= min(TELLING, share.max())
    telling[0] |= evidence.uncertain >= ADRIFT
    return [*missed, *(text for text, tells in zip(words, telling, strict=True) if tells)]

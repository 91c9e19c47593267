"""How likely it is that a curve lies on the wrong body: a few signs, weighed together."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from napari_splinesketch.engine import constants as const
from napari_splinesketch.engine import spline
from napari_splinesketch.engine.find import scoring
from napari_splinesketch.engine.find.finding import Start
from napari_splinesketch.engine.types import Array

SIGNS = ("sd", "astray", "cost", "rival")
WORDS = {
    "apart": "it runs beside its sketch",
    "missed": "it misses points of its sketch",
    "kink": "it bends sharply",
    "short": "it is shorter than its sketch",
    "long": "it is longer than its sketch",
}
"""Why a path is unlikely for its sketch, by the feature that costs most."""


@dataclass(frozen=True)
class Evidence:
    """What a fitted curve looks like beside its sketch."""

    sd: float
    """Largest standard error between the ends, px."""
    astray: float
    """Farthest that curve and sketch are from each other, px."""
    half_width: float
    """Of the body, px."""
    room: float
    """How far a sketch like this usually is from its body, px."""
    known: Float[Array, " F"]
    """What is known of its path, in the order of `scoring.FEATURES`."""
    margin: float
    """What it would cost if this sketch meant another path."""
    missed_end: float = 0.0
    """How far it ends from an end of its sketch, px; 0 where that is usual."""

    @property
    def uncertain(self) -> float:
        """The standard error in half-widths of the body, and what lines are drawn with."""
        return min(self.sd, 1e3) / (self.half_width + const.STROKE_PX)

    @property
    def signs(self) -> Float[Array, " S"]:
        """(S,) what is weighed, in the order of SIGNS."""
        return np.array(
            [
                np.log(const.LEAST_SD + self.uncertain),
                np.log(const.LEAST_ASTRAY + self.astray / self.room),
                np.log1p(self.known @ const.PATH_WEIGHTS),
                max(const.CLEAR_MARGIN - self.margin, 0.0),
            ]
        )

    @property
    def main_cost(self) -> str:
        """What its path is charged for most, in words."""
        name = scoring.FEATURES[int((self.known * const.PATH_WEIGHTS).argmax())]
        unseen = self.known[scoring.FEATURES.index("unseen")]
        return WORDS.get(name, f"{unseen:.0%} of it cannot be seen")


def collect(
    points: Float[Array, "P 2"],
    u: Float[Array, " P"],
    sd: Float[Array, " P"],
    half_width: float,
    start: Start,
) -> Evidence:
    """The evidence about one curve, whose fit began at `start`.

    Its points are at `u` on the fitted spline, beyond 0 and 1 in caps, with standard errors `sd`.
    """
    sketch, inside = start.sketch, (u >= 0) & (u <= 1)
    end = int(const.END_SHARE * len(points))
    drawn = spline.resample(sketch, len(points))
    astray = max(spline.apart(points[inside], drawn).max(), spline.apart(drawn, points).max())
    clicked, length = scoring.clicked(sketch), float(spline.arc_length(sketch)[-1])
    share, ends = const.STROKE_SHARE, const.STROKE_END
    if clicked:
        share, ends = const.HIT_SHARE, const.CLICKED_END
    missed_end = float(np.linalg.norm(points[[0, -1]] - sketch[[0, -1]], axis=1).max())
    near = const.ENDS_HITS * scoring.hit(half_width) + ends * length
    if missed_end < near or (len(sketch) > 2 and scoring.moved(sketch, points, half_width)):
        missed_end = 0.0
    return Evidence(
        float(sd[end:-end].max()),
        float(astray),
        half_width,
        half_width + const.STROKE_PX + share * length,
        start.known,
        start.margin,
        missed_end,
    )


def reasons(evidence: Evidence) -> list[str]:
    """Why a curve needs review, in words for the user; empty where it does not."""
    share = const.DOUBT_WEIGHTS * (evidence.signs - const.DOUBT_USUAL)
    missed = [f"it ends {evidence.missed_end:.0f} px from an end of its sketch"]
    missed *= evidence.missed_end > 0
    if share.sum() < const.DOUBT_THRESHOLD and evidence.uncertain < const.ADRIFT:
        return missed
    words = (
        f"its position is uncertain by up to {evidence.sd:.1f} px",
        f"it strays up to {evidence.astray:.0f} px from its sketch",
        evidence.main_cost,
        "another path is nearly as likely",
    )
    telling = share >= min(const.TELLING, share.max())
    telling[0] |= evidence.uncertain >= const.ADRIFT
    return [*missed, *(text for text, tells in zip(words, telling, strict=True) if tells)]

"""How a curve is judged against its reference, and what a table says of many."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Real
from real_cases import by_arc, length_of
from scipy.spatial import KDTree

POINTS = 400
TOLERANCES = (3.0, 5.0)
"""The tolerance is the curve's median half-width, px, but never outside these."""
MOST, SOME = 0.9, 0.4
STEP = 0.5
"""Distance between the points of the line that distances are measured to, px, at most."""

Verdict = Literal["good", "short/long", "partly", "lost"]


def shares(
    curve: Real[np.ndarray, "N 2"], reference: Real[np.ndarray, "M 2"], half_width: float
) -> tuple[float, float]:
    """Share of the curve near the reference, and of the reference near the curve."""
    near = float(np.clip(half_width, *TOLERANCES))
    return _share(curve, reference, near), _share(reference, curve, near)


def _share(line: np.ndarray, other: np.ndarray, near: float) -> float:
    fine = by_arc(other, max(POINTS, int(length_of(other) / STEP)))
    return float(np.mean(KDTree(fine).query(by_arc(line, POINTS))[0] <= near))


def verdict(curve_share: float, reference_share: float) -> Verdict:
    """What the two shares amount to."""
    low, high = sorted((curve_share, reference_share))
    if low >= MOST:
        return "good"
    if high >= MOST and low > SOME:
        return "short/long"
    return "partly" if low > SOME else "lost"


@dataclass(frozen=True)
class Row:
    """One body as one method left it.

    Attributes
    ----------
    method, version
        Name of the method, and what changes when its results may.
    case, kind, split, sketches, body
        Which body, and which set of sketches it was drawn from.
    drawn, verdict
        Of the sketch itself, and of the curve.
    curve_share, reference_share
        What the verdict comes from.
    half_width, status, reasons
        What the method says of the body.
    seconds
        For the whole image.
    """

    method: str
    version: str
    case: str
    kind: str
    split: str
    sketches: str
    body: int
    drawn: str
    verdict: str
    curve_share: float
    reference_share: float
    half_width: float
    status: str
    reasons: str
    seconds: float

    @property
    def marked(self) -> bool:
        """Whether the method says that the curve needs review."""
        return self.status != "good"


@dataclass(frozen=True)
class Summary:
    """Shares of bodies in percent; NaN where there are none to speak of.

    Attributes
    ----------
    bodies
        How many.
    good, lost
        Of all.
    bad_marked, good_marked
        Of those that are not good, and of those that are.
    spoilt, spoilt_silently
        Of those whose sketch was good already: not good any more; that and not marked.
    """

    bodies: int
    good: float
    lost: float
    bad_marked: float
    good_marked: float
    spoilt: float
    spoilt_silently: float


def summary(rows: Sequence[Row]) -> Summary:
    """Sum up."""
    good = [row for row in rows if row.verdict == "good"]
    bad = [row for row in rows if row.verdict != "good"]
    right = [row for row in rows if row.drawn == "good"]
    spoilt = [row for row in right if row.verdict != "good"]
    return Summary(
        bodies=len(rows),
        good=_percent(len(good), len(rows)),
        lost=_percent(sum(row.verdict == "lost" for row in rows), len(rows)),
        bad_marked=_percent(sum(row.marked for row in bad), len(bad)),
        good_marked=_percent(sum(row.marked for row in good), len(good)),
        spoilt=_percent(len(spoilt), len(right)),
        spoilt_silently=_percent(sum(not row.marked for row in spoilt), len(right)),
    )


def _percent(part: int, whole: int) -> float:
    return 100 * part / whole if whole else float("nan")

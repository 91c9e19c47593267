"""Where values lie in a plot, and which of them are named at its edges."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from qtpy.QtCore import QPointF, QRectF
from qtpy.QtGui import QPolygonF

Values = Float[np.ndarray, " P"]
ROUND = (1.0, 2.0, 2.5, 5.0, 10.0)
"""What steps from tick to tick begin with."""


@dataclass(frozen=True)
class Axes:
    """A rectangle of the screen, and the values at its edges.

    Attributes
    ----------
    box
        The rectangle.
    x, y
        (low, high) at its left and right, and at its bottom and top.
    """

    box: QRectF
    x: tuple[float, float] = (0.0, 1.0)
    y: tuple[float, float] = (0.0, 1.0)

    def places(self, x: Values, y: Values) -> list[QPointF]:
        """Points of the screen."""
        right = self.box.left() + (x - self.x[0]) / (self.x[1] - self.x[0]) * self.box.width()
        up = self.box.bottom() - (y - self.y[0]) / (self.y[1] - self.y[0]) * self.box.height()
        return [QPointF(a, b) for a, b in zip(right.tolist(), up.tolist(), strict=True)]

    def lines(self, x: Values, y: Values) -> Iterator[QPolygonF]:
        """Lines through the points, broken where a value is not known."""
        for part in known(x, y):
            yield QPolygonF(self.places(x[part], y[part]))

    def bands(self, x: Values, low: Values, high: Values) -> Iterator[QPolygonF]:
        """Areas between two lines, broken where a value is not known."""
        for part in known(x, low, high):
            back = self.places(x[part][::-1], low[part][::-1])
            yield QPolygonF([*self.places(x[part], high[part]), *back])


def known(*values: Values) -> Iterator[slice]:
    """Give the stretches where all are finite."""
    finite = np.concatenate([[False], np.isfinite(np.stack(values)).all(axis=0), [False]])
    edges = np.flatnonzero(np.diff(finite)).tolist()
    return (slice(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True))


def spanned(values: Sequence[Values], below: float, above: float) -> tuple[float, float]:
    """Give what holds all finite values, with room as a share of what they span."""
    together = np.concatenate(values)
    together = together[np.isfinite(together)]
    low, high = (together.min(), together.max()) if together.size else (0.0, 1.0)
    span = (high - low) or 1.0
    return float(low - below * span), float(high + above * span)


def ticks(low: float, high: float, most: int) -> list[tuple[float, str]]:
    """Give round values between two others, and how they are written."""
    least = (high - low) / max(most, 1)
    power = 10.0 ** np.floor(np.log10(least))
    step = next(power * factor for factor in ROUND if power * factor >= least)
    decimals = next(d for d in range(20) if abs(round(step, d) - step) < 1e-9 * step)
    first, last = np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9)
    return [(n * step, f"{n * step + 0.0:.{decimals}f}") for n in np.arange(first, last + 1)]

"""Pictures of one body over its length and over the frames: curvature, speed and velocity."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float
from napari.utils.colormaps import Colormap
from qtpy.QtCore import QRectF
from qtpy.QtGui import QImage

from napari_splinesketch.engine.types import Curve
from napari_splinesketch.plugin.columns import RAMP
from napari_splinesketch.plugin.layers.space import Ruler
from napari_splinesketch.tracking import kymograph

SIGNED = ("#0072b2", "#56b4e9", "#f7f7f7", "#e69f00", "#a34700")
"""From negative over zero to positive, in colours that can be told apart by everybody."""
SHARE = 98.0
"""Of the values that the colours span, %: few that stand out do not flatten the others."""


@dataclass(frozen=True, eq=False)
class Picture:
    """A quantity of one body over its length and over the frames, from the first to the last.

    `values` are (T, P), NaN where the body has no curve; `length` is its mean, in the unit. Where
    they are `signed`, zero is in the middle of the colours.
    """

    title: str
    values: Float[np.ndarray, "T P"]
    frames: tuple[int, int]
    length: float
    unit: str
    signed: bool

    @cached_property
    def span(self) -> tuple[float, float]:
        """What the ends of the colours stand for."""
        known = np.abs(self.values[np.isfinite(self.values)])
        high = float(np.percentile(known, SHARE)) if known.size else 0.0
        high = high or 1.0
        return (-high if self.signed else 0.0), high

    @cached_property
    def image(self) -> QImage:
        """One pixel for each value, transparent where it is not known."""
        low, high = self.span
        return _image(np.clip((self.values - low) / (high - low), 0, 1), self._colours)

    @cached_property
    def bar(self) -> QImage:
        """The colours, the highest value on top."""
        return _image(np.linspace(1, 0, 64)[:, None], self._colours)

    @property
    def _colours(self) -> Sequence[str]:
        return SIGNED if self.signed else RAMP

    def row(self, box: QRectF, frame: int) -> QRectF:
        """Where a frame is in a box that the picture fills."""
        first, last = self.frames
        high = box.height() / (last - first + 1)
        return QRectF(box.left(), box.top() + (frame - first) * high, box.width(), high)


def pictures(body: Mapping[int, Curve], ruler: Ruler) -> tuple[Picture, ...]:
    """Curvature, speed, and velocity along and across a body; nothing of one in a single frame."""
    if len(body) < 2:
        return ()
    scale = np.array([*ruler.scale, 1.0])
    scaled = {
        frame: replace(curve, knots=curve.knots * scale, points=curve.points * ruler.scale)
        for frame, curve in body.items()
    }
    made = kymograph(scaled)
    frames = int(made.frames[0]), int(made.frames[-1])
    length = float(np.mean([ruler.along(curve.points)[-1] for curve in body.values()]))
    unit = ruler.unit
    named = (
        (f"Curvature (1/{unit})", made.curvature, True),
        (f"Speed ({unit}/frame)", np.hypot(made.along, made.across), False),
        (f"Velocity along ({unit}/frame)", made.along, True),
        (f"Velocity across ({unit}/frame)", made.across, True),
    )
    return tuple(Picture(title, v, frames, length, unit, signed) for title, v, signed in named)


def _image(share: Float[np.ndarray, "T P"], colours: Sequence[str]) -> QImage:
    """Colours of values from 0 to 1."""
    rgba = (Colormap(list(colours)).map(share) * 255).round().astype(np.uint8)
    high, wide = share.shape
    image = QImage(rgba.tobytes(), wide, high, 4 * wide, QImage.Format.Format_RGBA8888)
    return image.copy()  # which owns its pixels

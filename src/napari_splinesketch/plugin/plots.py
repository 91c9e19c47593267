"""Plots beside the table: of the selected curve along it, and of its body over the frames."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from napari.layers import Image
from napari.utils.colormaps import Colormap
from napari.utils.theme import get_theme
from qtpy.QtCore import QPointF, QRectF, Qt
from qtpy.QtGui import QColor, QImage, QPainter, QPaintEvent, QPen, QPolygonF
from qtpy.QtWidgets import QWidget

from napari_splinesketch.engine.types import Curve
from napari_splinesketch.plugin.columns import RAMP, half_widths, three_digits
from napari_splinesketch.plugin.layers.pictures import Along, residual_along
from napari_splinesketch.plugin.layers.pixels import Patch
from napari_splinesketch.plugin.layers.space import Ruler
from napari_splinesketch.plugin.model import Record
from napari_splinesketch.tracking import kymograph

ROUND = (1.0, 2.0, 2.5, 5.0, 10.0)
"""What steps from tick to tick begin with."""
SMALL = 8
"""Size of the text, pt."""
LEFT, RIGHT, TOP, BOTTOM = 42, 10, 22, 34
"""Margins around the axes, px."""
TICK, GAP = 4, 3
"""Length of a tick, and from it to its number, px."""
PER_TICK = 45, 26
"""Room for a number along x and along y, px."""
BAR = 8, 40
"""Width of the bar of colours beside a picture, and the room that it has with its numbers, px."""
SWATCH = 14
"""Length of a line in the legend, px."""
ROOM, LEGEND = 0.08, 0.35
"""Left free above and below the lines, and for the legend, as a share of what they span."""
SIGNED = ("#0072b2", "#56b4e9", "#f7f7f7", "#e69f00", "#a34700")
"""From negative over zero to positive, in colours that can be told apart by everybody."""
SHARE = 98.0
"""Of the values that the colours span, %: few that stand out do not flatten the others."""
EMPTY = "Select a curve to see its half-width along it", "… and what the model leaves unexplained"
RESIDUAL = "Image − model, across"
NO_MODEL = "There is no model of this frame to compare with"
ALIGN = Qt.AlignmentFlag
CENTRE = ALIGN.AlignCenter
BEGIN, BESIDE = (side | ALIGN.AlignVCenter for side in (ALIGN.AlignLeft, ALIGN.AlignRight))


class Theme(NamedTuple):
    """Colours that can be told apart by everybody, on the window's background."""

    background: str
    text: str
    faint: str
    line: str
    other: str


def theme_of(name: str) -> Theme:
    """Give the colours that go with one of napari's themes."""
    theme = get_theme(name)
    lines = ("#56b4e9", "#e69f00") if theme.type == "dark" else ("#0072b2", "#a34700")
    own = theme.background, theme.text, theme.secondary
    background, text, faint = (colour.as_hex(format="long") for colour in own)
    return Theme(background, text, faint, *lines)


@dataclass(frozen=True, eq=False)
class Profile:
    """What is drawn of one curve against the distance from its first point; lengths in the unit.

    `mean` is the half-width of all curves at the same share of their lengths, `residual` the image
    minus the reconstruction; None where it is not known.
    """

    name: str
    unit: str
    distance: Along
    half_width: Along
    sd: Along
    mean: Along | None = None
    residual: Along | None = None


def profile_of(
    image: Image, patch: Patch | None, record: Record, records: tuple[Record, ...], ruler: Ruler
) -> Profile:
    """Say what there is to draw of a curve, one of `records`."""
    curve = record.curve
    return Profile(
        f"curve {record.id}",
        ruler.unit,
        ruler.along(curve.points),
        half_widths(curve, ruler),
        ruler.across(curve, curve.sd),
        _mean_half_width(records, ruler),
        residual_along(image, patch, record) if patch else None,
    )


@lru_cache(1)
def _mean_half_width(records: tuple[Record, ...], ruler: Ruler) -> Along | None:
    every = np.array([half_widths(record.curve, ruler) for record in records])
    known = every[np.isfinite(every).all(axis=1)]
    return known.mean(axis=0) if len(known) else None


class Picture:
    """A quantity of one body over its length and over the frames, from the first to the last.

    Its (T, P) values are NaN where the body has no curve; `length` is its mean, in the unit. Where
    they are signed, zero is in the middle of the colours, whose ends stand for the `span`.
    """

    def __init__(
        self,
        title: str,
        values: Float[np.ndarray, "T P"],
        frames: tuple[int, int],
        length: float,
        unit: str,
        signed: bool,
    ):
        self.title, self.values, self.frames = title, values, frames
        self.length, self.unit = length, unit
        known = np.abs(values[np.isfinite(values)])
        high = float(np.percentile(known, SHARE)) if known.size else 0.0
        high = high or 1.0
        low = -high if signed else 0.0
        colours = SIGNED if signed else RAMP
        self.span = low, high
        self.image = _image(np.clip((values - low) / (high - low), 0, 1), colours)
        self.bar = _image(np.linspace(1, 0, 64)[:, None], colours)


def pictures(body: Mapping[int, Curve], ruler: Ruler) -> tuple[Picture, ...]:
    """Curvature, speed, and velocity along and across a body; nothing of one in a single frame."""
    if len(body) < 2:
        return ()
    scale = np.array([*ruler.scale, 1.0])
    made = kymograph(
        {
            frame: replace(curve, knots=curve.knots * scale, points=curve.points * ruler.scale)
            for frame, curve in body.items()
        }
    )
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
    """Colours of values from 0 to 1, a pixel each; transparent where they are not known."""
    rgba = (Colormap(list(colours)).map(share) * 255).round().astype(np.uint8)
    high, wide = share.shape
    image = QImage(rgba.tobytes(), wide, high, 4 * wide, QImage.Format.Format_RGBA8888)
    return image.copy()  # which owns its pixels


class CurvePlots(QWidget):
    """Half-width and residual against arc length, or two pictures over the frames."""

    def __init__(self, theme: Theme):
        super().__init__()
        self.theme = theme
        self.show_plots()
        font = self.font()
        font.setPointSizeF(SMALL)
        self.setFont(font)
        self.setMinimumSize(320, 130)
        self.setAccessibleName("Plots of the selected curve")

    def show_theme(self, name: str) -> None:
        """Take the colours of one of napari's themes."""
        self.theme = theme_of(name)
        self.update()

    def show_plots(
        self,
        profile: Profile | None = None,
        pictures: tuple[Picture, ...] = (),
        frame: int = 0,
        empty: tuple[str, str] = EMPTY,
    ) -> None:
        """Draw a curve, or two pictures of a body with a frame marked, or say why there is none."""
        self.profile, self.pictures, self._frame, self._empty = profile, pictures, frame, empty
        self.update()

    def paintEvent(self, a0: QPaintEvent | None) -> None:
        """Draw both plots."""
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.fillRect(self.rect(), QColor(self.theme.background))
        half, profile = self.width() / 2, self.profile
        for i in range(2):
            axes = Axes(painter, self.theme, QRectF(i * half, 0, half, self.height()))
            if self.pictures:
                axes.picture(self.pictures[i], self._frame)
            elif profile is None:
                axes.say(self._empty[i])
            elif i:
                axes.residual(profile)
            else:
                axes.half_width(profile)
        painter.end()


class Axes:
    """A plot: the room that it has, a box in it, the values at the box's edges, and a painter."""

    def __init__(self, painter: QPainter, theme: Theme, room: QRectF):
        self._painter, self._theme, self._room = painter, theme, room
        self._box = room.adjusted(LEFT, TOP, -RIGHT, -BOTTOM)
        self._x = self._y = 0.0, 1.0

    def say(self, text: str) -> None:
        """Say why there is nothing to see."""
        self._painter.setPen(QColor(self._theme.text))
        room = self._room.adjusted(GAP, GAP, -GAP, -GAP)
        self._painter.drawText(room, CENTRE | Qt.TextFlag.TextWordWrap, text)

    def half_width(self, profile: Profile) -> None:
        """Draw the half-widths along a curve, and how far they may be off."""
        y, sd = profile.half_width, np.where(np.isfinite(profile.sd), profile.sd, 0.0)
        mean = [] if profile.mean is None else [(profile.mean, "mean of all")]
        lines = [(y, f"{profile.name} ± sd"), *mean]
        x = self._along(profile, [y + sd, *(line for line, _ in lines)], LEGEND)
        self._frame(f"Half-width ({profile.unit})", profile.unit)
        colour = QColor(self._theme.line)
        colour.setAlphaF(0.35)
        self._painter.setPen(Qt.PenStyle.NoPen)
        self._painter.setBrush(colour)
        for part in known(y + sd):
            back = self._places(x[part][::-1], np.maximum(y - sd, 0)[part][::-1])
            self._painter.drawPolygon(QPolygonF([*self._places(x[part], (y + sd)[part]), *back]))
        self._lines(x, lines)

    def residual(self, profile: Profile) -> None:
        """Draw what the model leaves unexplained along a curve."""
        if profile.residual is None:
            self.say(NO_MODEL)
            return
        x = self._along(profile, [profile.residual], ROOM)
        self._frame(RESIDUAL, profile.unit)
        self._lines(x, [(profile.residual, ""), (0 * x, "")])

    def picture(self, picture: Picture, frame: int) -> None:
        """Draw a picture, time downwards, with the colours beside it."""
        painter, (first, last) = self._painter, picture.frames
        box = self._box = self._box.adjusted(0, 0, -BAR[1], 0)
        painter.drawImage(box, picture.image)
        painter.setPen(QPen(QColor(self._theme.text), 1.2))
        painter.setBrush(Qt.BrushStyle.NoBrush)
        high = box.height() / (last - first + 1)
        painter.drawRect(QRectF(box.left(), box.top() + (frame - first) * high, box.width(), high))
        self._x, self._y = (0.0, picture.length), (last + 0.5, first - 0.5)
        self._frame(picture.title, picture.unit, whole=True)
        bar = QRectF(box.right() + GAP, box.top(), BAR[0], box.height())
        painter.drawImage(bar, picture.bar)
        high = painter.fontMetrics().height()
        for value, at in zip(picture.span, (bar.bottom() - high, bar.top()), strict=True):
            place = QRectF(bar.right() + GAP, at, BAR[1] - BAR[0] + GAP, high)
            painter.drawText(place, BEGIN, three_digits(value))

    def _along(self, profile: Profile, shown: Sequence[Along], above: float) -> Along:
        """Span a curve, and zero and all finite values, with room as a share of what they span."""
        x = profile.distance
        together = np.concatenate([np.zeros(1), *shown])
        together = together[np.isfinite(together)]
        low, high = float(together.min()), float(together.max())
        span = (high - low) or 1.0
        # A curve may have no length.
        self._x = float(x[0]), float(x[-1]) if x[-1] > x[0] else float(x[0]) + 1.0
        self._y = low - ROOM * span, high + above * span
        return x

    def _frame(self, title: str, unit: str, *, whole: bool = False) -> None:
        """Draw two edges with their ticks, upwards maybe whole numbers, and say what they mean."""
        painter, box = self._painter, self._box
        edge, text = QColor(self._theme.faint), QColor(self._theme.text)
        fonts, high = painter.fontMetrics(), painter.fontMetrics().height()
        painter.setPen(edge)
        painter.drawPolyline(QPolygonF([box.topLeft(), box.bottomLeft(), box.bottomRight()]))
        marks: list[tuple[QPointF, QPointF, QRectF, Qt.AlignmentFlag, str]] = []
        for value, name in ticks(*self._x, int(box.width() / PER_TICK[0])):
            (at,) = self._places(np.array([value]), np.array([self._y[0]]))
            below = QRectF(at.x() - 30, at.y() + TICK, 60, high)
            marks.append((at, at + QPointF(0, TICK), below, CENTRE, name))
        most = int(box.height() / PER_TICK[1])
        for value, name in ticks(min(self._y), max(self._y), most, whole=whole):
            (at,) = self._places(np.array([self._x[0]]), np.array([value]))
            beside = QRectF(at.x() - LEFT, at.y() - high / 2, LEFT - TICK - GAP, high)
            marks.append((at, at - QPointF(TICK, 0), beside, BESIDE, name))
        for at, to, place, align, name in marks:
            painter.setPen(edge)
            painter.drawLine(at, to)
            painter.setPen(text)
            painter.drawText(place, align, name)
        room = self._room.adjusted(GAP, 0, -GAP, 0)
        said = fonts.elidedText(title, Qt.TextElideMode.ElideRight, int(room.width()))
        painter.drawText(QRectF(room.left(), 0, room.width(), TOP - 4), CENTRE, said)
        place = QRectF(room.left(), box.bottom() + TICK + high, room.width(), high)
        painter.drawText(place, CENTRE, f"distance along it ({unit})")

    def _lines(self, x: Along, lines: Sequence[tuple[Along, str]]) -> None:
        """Draw a line and a dashed one, broken where they are not known; name those with a name."""
        painter, box = self._painter, self._box
        at, high = box.left() + 6, painter.fontMetrics().height()
        painter.setBrush(Qt.BrushStyle.NoBrush)
        pens = (
            QPen(QColor(self._theme.line), 1.6),
            QPen(QColor(self._theme.other), 1.3, Qt.PenStyle.DashLine),
        )
        for row, ((y, name), pen) in enumerate(zip(lines, pens, strict=False)):
            painter.setPen(pen)
            for part in known(y):
                painter.drawPolyline(QPolygonF(self._places(x[part], y[part])))
            if name:
                top = box.top() + row * high
                middle = QPointF(at, top + high / 2)
                painter.drawLine(middle, middle + QPointF(SWATCH, 0))
                painter.setPen(QColor(self._theme.text))
                painter.drawText(QRectF(at + SWATCH + 4, top, box.width(), high), BEGIN, name)

    def _places(self, x: Along, y: Along) -> list[QPointF]:
        """Points of the screen."""
        right = self._box.left() + (x - self._x[0]) / np.ptp(self._x) * self._box.width()
        share = (y - self._y[0]) / (self._y[1] - self._y[0])
        up = self._box.bottom() - share * self._box.height()
        return [QPointF(a, b) for a, b in zip(right.tolist(), up.tolist(), strict=True)]


def known(values: Along) -> list[slice]:
    """Give the stretches that are finite."""
    return np.ma.clump_unmasked(np.ma.masked_invalid(values))  # pyright: ignore


def ticks(low: float, high: float, most: int, *, whole: bool = False) -> list[tuple[float, str]]:
    """Give round values between two others, maybe whole ones, and how they are written."""
    least = max((high - low) / max(most, 1), float(whole))
    power = 10.0 ** np.floor(np.log10(least))
    steps = [power * factor for factor in ROUND if not (whole and power * factor % 1)]
    step = next(step for step in steps if step >= least)
    decimals = next(d for d in range(20) if abs(round(step, d) - step) < 1e-9 * step)
    first, last = np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9)
    return [(n * step, f"{n * step + 0.0:.{decimals}f}") for n in np.arange(first, last + 1)]

"""Plots beside the table: of the selected curve along it, and of its body over the frames."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from napari.utils.theme import get_theme
from qtpy.QtCore import QPointF, QRectF, Qt
from qtpy.QtGui import QColor, QPainter, QPaintEvent, QPen, QPolygonF
from qtpy.QtWidgets import QWidget

from napari_splinesketch.plugin.measures import three_digits
from napari_splinesketch.plugin.review.kymographs import Picture

ROUND = (1.0, 2.0, 2.5, 5.0, 10.0)
"""What steps from tick to tick begin with."""
Along = Float[np.ndarray, " P"]
SMALL = 8
"""Size of the text, pt."""
LEFT, RIGHT, TOP, BOTTOM = 42, 10, 22, 34
"""Margins around the axes, px."""
TICK, GAP = 4, 3
"""Length of a tick, and from it to its number, px."""
PER_TICK = 60, 26
"""Room for a number along x and along y, px."""
BAR = 8, 40
"""Width of the bar of colours beside a picture, and the room that it has with its numbers, px."""
SWATCH = 14
"""Length of a line in the legend, px."""
ROOM, LEGEND = 0.08, 0.25
"""Left free above and below the lines, and for the legend, as a share of what they span."""
WIDTH, RESIDUAL = "Select a curve: its half-width along it", "What the model leaves unexplained"
NO_MODEL = "No model of this frame to compare with"
CENTRE = Qt.AlignmentFlag.AlignCenter
BESIDE = Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
BEGIN = Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter


@dataclass(frozen=True)
class Theme:
    """Colours that can be told apart by everybody, on the window's background."""

    background: str
    text: str
    faint: str
    line: str
    other: str


def theme_of(name: str) -> Theme:
    """Give the colours that go with one of napari's themes."""
    theme = get_theme(name)
    dark = theme.type == "dark"
    line, other = ("#56b4e9", "#e69f00") if dark else ("#0072b2", "#a34700")
    background, text, faint = (
        colour.as_hex(format="long") for colour in (theme.background, theme.text, theme.secondary)
    )
    return Theme(background, text, faint, line, other)


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


class CurvePlots(QWidget):
    """Half-width and residual against arc length, or two pictures over the frames."""

    def __init__(self, theme: Theme):
        super().__init__()
        self.profile: Profile | None = None
        self.pictures: tuple[Picture, ...] = ()
        self._frame = 0
        self._theme = theme
        font = self.font()
        font.setPointSizeF(SMALL)
        self.setFont(font)
        self.setMinimumSize(320, 130)
        self.setAccessibleName("Plots of the selected curve")

    def show_theme(self, theme: Theme) -> None:
        """Take the window's colours."""
        self._theme = theme
        self.update()

    def show_profile(self, profile: Profile | None) -> None:
        """Draw a curve, or say that none is selected."""
        self.profile, self.pictures = profile, ()
        self.update()

    def show_pictures(self, pictures: tuple[Picture, Picture], frame: int) -> None:
        """Draw pictures of a body over the frames, one of which is marked."""
        self.profile, self.pictures, self._frame = None, pictures, frame
        self.update()

    def paintEvent(self, a0: QPaintEvent | None) -> None:
        """Draw both plots."""
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.fillRect(self.rect(), QColor(self._theme.background))
        half = self.width() / 2
        left, right = (
            Axes(
                QRectF(
                    i * half + LEFT,
                    TOP,
                    max(half - LEFT - RIGHT, 1),
                    max(self.height() - TOP - BOTTOM, 1),
                )
            )
            for i in (0, 1)
        )
        if self.pictures:
            for axes, picture in zip((left, right), self.pictures, strict=True):
                self._draw_picture(painter, axes.box, picture)
        elif self.profile is None:
            self._draw_axes(painter, left, WIDTH, numbered=False)
            self._draw_axes(painter, right, RESIDUAL, numbered=False)
        else:
            self._draw_width(painter, left, self.profile)
            self._draw_residual(painter, right, self.profile)
        painter.end()

    def _draw_width(self, painter: QPainter, axes: Axes, profile: Profile) -> None:
        x, y = profile.distance, profile.half_width
        sd = np.where(np.isfinite(profile.sd), profile.sd, 0.0)
        shown = [y + sd, y - sd, np.zeros(1)]
        if profile.mean is not None:
            shown.append(profile.mean)
        axes = replace(axes, x=_over(x), y=spanned(shown, ROOM, LEGEND))
        title = f"Half-width of {profile.name} ({profile.unit})"
        self._draw_axes(painter, axes, title, f"distance along it ({profile.unit})")
        band = QColor(self._theme.line)
        band.setAlphaF(0.35)
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(band)
        for area in axes.bands(x, np.maximum(y - sd, 0), y + sd):
            painter.drawPolygon(area)
        lines = [(y, self._line(), "curve ± sd")]
        if profile.mean is not None:
            lines.append((profile.mean, self._other(), "mean of all"))
        self._draw_lines(painter, axes, x, lines)

    def _draw_residual(self, painter: QPainter, axes: Axes, profile: Profile) -> None:
        x, y = profile.distance, profile.residual
        below = f"distance along it ({profile.unit})"
        if y is None:
            self._draw_axes(painter, replace(axes, x=_over(x)), NO_MODEL, below, numbered=False)
            return
        axes = replace(axes, x=_over(x), y=spanned([y, np.zeros(1)], ROOM, ROOM))
        self._draw_axes(painter, axes, "Image − model, mean across it", below)
        zero = np.zeros(len(x))
        self._draw_lines(painter, axes, x, [(zero, self._other(), ""), (y, self._line(), "")])

    def _draw_picture(self, painter: QPainter, box: QRectF, picture: Picture) -> None:
        """Draw a picture, time downwards, with the colours beside it."""
        box = box.adjusted(0, 0, -BAR[1], 0)
        painter.drawImage(box, picture.image)
        painter.setPen(QPen(QColor(self._theme.text), 1.2))
        painter.setBrush(Qt.BrushStyle.NoBrush)
        painter.drawRect(picture.row(box, self._frame))
        first, last = picture.frames
        axes = Axes(box, (0.0, picture.length), (last + 0.5, first - 0.5))
        self._draw_axes(
            painter, axes, picture.title, f"distance along it ({picture.unit})", whole=True
        )
        bar = QRectF(box.right() + GAP, box.top(), BAR[0], box.height())
        painter.drawImage(bar, picture.bar)
        high = painter.fontMetrics().height()
        for value, at in zip(picture.span, (bar.bottom() - high, bar.top()), strict=True):
            place = QRectF(bar.right() + GAP, at, BAR[1] - BAR[0] + GAP, high)
            painter.drawText(place, BEGIN, three_digits(value))

    def _draw_lines(
        self, painter: QPainter, axes: Axes, x: Along, lines: list[tuple[Along, QPen, str]]
    ) -> None:
        """Draw lines, each with its pen, and name those that have a name."""
        at = axes.box.left() + 6
        painter.setBrush(Qt.BrushStyle.NoBrush)
        for y, pen, name in lines:
            painter.setPen(pen)
            for line in axes.lines(x, y):
                painter.drawPolyline(line)
            if name:
                middle = axes.box.top() + 6
                painter.drawLine(QPointF(at, middle), QPointF(at + SWATCH, middle))
                painter.setPen(QColor(self._theme.text))
                room = painter.fontMetrics().horizontalAdvance(name) + 4
                painter.drawText(QRectF(at + SWATCH + 4, middle - 8, room, 16), BEGIN, name)
                at += SWATCH + room + 14

    def _draw_axes(
        self,
        painter: QPainter,
        axes: Axes,
        title: str,
        below: str = "",
        *,
        numbered: bool = True,
        whole: bool = False,
    ) -> None:
        """Draw two edges with their ticks, upwards maybe whole numbers, and say what they mean."""
        box, fonts = axes.box, painter.fontMetrics()
        edge, text = QPen(QColor(self._theme.faint), 1), QPen(QColor(self._theme.text))
        painter.setPen(edge)
        painter.drawPolyline(QPolygonF([box.topLeft(), box.bottomLeft(), box.bottomRight()]))
        high = fonts.height()
        for value, name in ticks(*axes.x, int(box.width() / PER_TICK[0])) if numbered else ():
            (at,) = axes.places(np.array([value]), np.array([axes.y[0]]))
            painter.setPen(edge)
            painter.drawLine(at, at + QPointF(0, TICK))
            painter.setPen(text)
            painter.drawText(QRectF(at.x() - 30, at.y() + TICK, 60, high), CENTRE, name)
        most = int(box.height() / PER_TICK[1])
        for value, name in ticks(min(axes.y), max(axes.y), most) if numbered else ():
            if whole and value != round(value):
                continue
            (at,) = axes.places(np.array([axes.x[0]]), np.array([value]))
            painter.setPen(edge)
            painter.drawLine(at, at - QPointF(TICK, 0))
            painter.setPen(text)
            place = QRectF(at.x() - LEFT, at.y() - high / 2, LEFT - TICK - GAP, high)
            painter.drawText(place, BESIDE, name)
        painter.setPen(text)
        room = self.width() / 2 - LEFT - RIGHT
        said = fonts.elidedText(title, Qt.TextElideMode.ElideRight, int(room))
        painter.drawText(QRectF(box.left(), 0, room, TOP - 4), BEGIN, said)
        place = QRectF(box.center().x() - room / 2, box.bottom() + TICK + high, room, high)
        painter.drawText(place, CENTRE, below)

    def _line(self) -> QPen:
        return QPen(QColor(self._theme.line), 1.6)

    def _other(self) -> QPen:
        return QPen(QColor(self._theme.other), 1.3, Qt.PenStyle.DashLine)


def _over(x: Along) -> tuple[float, float]:
    """Give the ends of an axis along a curve, which may have no length."""
    return float(x[0]), float(x[-1]) if x[-1] > x[0] else float(x[0]) + 1.0


@dataclass(frozen=True)
class Axes:
    """A rectangle of the screen, and the values at its edges: (low, high) of x and y."""

    box: QRectF
    x: tuple[float, float] = (0.0, 1.0)
    y: tuple[float, float] = (0.0, 1.0)

    def places(self, x: Along, y: Along) -> list[QPointF]:
        """Points of the screen."""
        right = self.box.left() + (x - self.x[0]) / (self.x[1] - self.x[0]) * self.box.width()
        up = self.box.bottom() - (y - self.y[0]) / (self.y[1] - self.y[0]) * self.box.height()
        return [QPointF(a, b) for a, b in zip(right.tolist(), up.tolist(), strict=True)]

    def lines(self, x: Along, y: Along) -> Iterator[QPolygonF]:
        """Lines through the points, broken where a value is not known."""
        for part in known(x, y):
            yield QPolygonF(self.places(x[part], y[part]))

    def bands(self, x: Along, low: Along, high: Along) -> Iterator[QPolygonF]:
        """Areas between two lines, broken where a value is not known."""
        for part in known(x, low, high):
            back = self.places(x[part][::-1], low[part][::-1])
            yield QPolygonF([*self.places(x[part], high[part]), *back])


def known(*values: Along) -> Iterator[slice]:
    """Give the stretches where all are finite."""
    finite = np.concatenate([[False], np.isfinite(np.stack(values)).all(axis=0), [False]])
    edges = np.flatnonzero(np.diff(finite)).tolist()
    return (slice(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True))


def spanned(values: Sequence[Along], below: float, above: float) -> tuple[float, float]:
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

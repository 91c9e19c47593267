"""Plots beside the table: of the selected curve along it, and of its body over the frames."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float, Real
from napari.layers import Image
from napari.utils.theme import get_theme
from qtpy.QtCore import QPointF, QRectF, Qt
from qtpy.QtGui import QColor, QPainter, QPaintEvent, QPen, QPolygonF
from qtpy.QtWidgets import QWidget
from scipy.ndimage import map_coordinates

from napari_splinesketch.plugin.columns import half_widths, three_digits
from napari_splinesketch.plugin.layers.looks import normals
from napari_splinesketch.plugin.layers.pixels import Grid, Patch, block_on
from napari_splinesketch.plugin.layers.space import Ruler
from napari_splinesketch.plugin.model import Record
from napari_splinesketch.plugin.review.kymographs import Picture

Along = Float[np.ndarray, " P"]
Range = tuple[float, float]
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
SPACING = 0.5
"""Between the places across a body at which the picture is read, px at most."""
EMPTY = "Select a curve to see its half-width along it", "… and what the model leaves unexplained"
NO_MODEL = "There is no model of this frame to compare with"
ALIGN = Qt.AlignmentFlag
CENTRE = ALIGN.AlignCenter
BEGIN = ALIGN.AlignLeft | ALIGN.AlignVCenter
BESIDE = ALIGN.AlignRight | ALIGN.AlignVCenter


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
    line, other = ("#56b4e9", "#e69f00") if theme.type == "dark" else ("#0072b2", "#a34700")
    own = (theme.background, theme.text, theme.secondary)
    background, text, faint = (colour.as_hex(format="long") for colour in own)
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


class CurvePlots(QWidget):
    """Half-width and residual against arc length, or two pictures over the frames."""

    def __init__(self, theme: Theme):
        super().__init__()
        self.profile: Profile | None = None
        self.pictures: tuple[Picture, ...] = ()
        self._frame, self._empty = 0, EMPTY
        self._theme = theme
        font = self.font()
        font.setPointSizeF(SMALL)
        self.setFont(font)
        self.setMinimumSize(320, 130)
        self.setAccessibleName("Plots of the selected curve")

    def show_theme(self, name: str) -> None:
        """Take the colours of one of napari's themes."""
        self._theme = theme_of(name)
        self.update()

    def show_profile(self, profile: Profile | None, empty: tuple[str, str] = EMPTY) -> None:
        """Draw a curve, or say why there is none."""
        self.profile, self.pictures, self._empty = profile, (), empty
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
        for i, draw in enumerate((_draw_width, _draw_residual)):
            axes = Axes(painter, self._theme, QRectF(i * half, 0, half, self.height()))
            if self.pictures:
                _draw_picture(axes, self.pictures[i], self._frame)
            elif self.profile is None:
                axes.say(self._empty[i])
            else:
                draw(axes, self.profile)
        painter.end()


def titles_of(profile: Profile) -> tuple[str, str]:
    """Name the two plots of a curve."""
    return f"Half-width ({profile.unit})", "Image − model, across"


def _draw_width(axes: "Axes", profile: Profile) -> None:
    x, y = profile.distance, profile.half_width
    sd = np.where(np.isfinite(profile.sd), profile.sd, 0.0)
    lines = [(y, axes.pen(axes.theme.line, 1.6), f"{profile.name} ± sd")]
    if profile.mean is not None:
        dashed = axes.pen(axes.theme.other, 1.3, Qt.PenStyle.DashLine)
        lines.append((profile.mean, dashed, "mean of all"))
    shown = [y + sd, y - sd, np.zeros(1), *(line for line, _, _ in lines)]
    axes.x, axes.y = _over(x), spanned(shown, ROOM, LEGEND)
    axes.frame(titles_of(profile)[0], profile.unit)
    axes.band(x, np.maximum(y - sd, 0), y + sd)
    axes.lines(x, lines)


def _draw_residual(axes: "Axes", profile: Profile) -> None:
    x, y = profile.distance, profile.residual
    if y is None:
        axes.say(NO_MODEL)
        return
    axes.x, axes.y = _over(x), spanned([y, np.zeros(1)], ROOM, ROOM)
    axes.frame(titles_of(profile)[1], profile.unit)
    zero = axes.pen(axes.theme.other, 1.3, Qt.PenStyle.DashLine)
    axes.lines(x, [(np.zeros(len(x)), zero, ""), (y, axes.pen(axes.theme.line, 1.6), "")])


def _draw_picture(axes: "Axes", picture: Picture, frame: int) -> None:
    """Draw a picture, time downwards, with the colours beside it."""
    painter = axes.painter
    box = axes.box = axes.box.adjusted(0, 0, -BAR[1], 0)
    painter.drawImage(box, picture.image)
    painter.setPen(axes.pen(axes.theme.text, 1.2))
    painter.setBrush(Qt.BrushStyle.NoBrush)
    painter.drawRect(picture.row(box, frame))
    first, last = picture.frames
    axes.x, axes.y = (0.0, picture.length), (last + 0.5, first - 0.5)
    axes.frame(picture.title, picture.unit, whole=True)
    bar = QRectF(box.right() + GAP, box.top(), BAR[0], box.height())
    painter.drawImage(bar, picture.bar)
    high = painter.fontMetrics().height()
    for value, at in zip(picture.span, (bar.bottom() - high, bar.top()), strict=True):
        place = QRectF(bar.right() + GAP, at, BAR[1] - BAR[0] + GAP, high)
        painter.drawText(place, BEGIN, three_digits(value))


class Axes:
    """A plot: the room that it has, a box in it, the values at the box's edges, and a painter."""

    def __init__(self, painter: QPainter, theme: Theme, room: QRectF):
        self.painter, self.theme, self._room = painter, theme, room
        self.box = room.adjusted(LEFT, TOP, -RIGHT, -BOTTOM)
        self.x: Range = (0.0, 1.0)
        self.y: Range = (0.0, 1.0)

    def pen(self, colour: str, width: float = 1.0, style: Qt.PenStyle = Qt.PenStyle.SolidLine):
        """Make a pen."""
        return QPen(QColor(colour), width, style)

    def say(self, text: str) -> None:
        """Say why there is nothing to see."""
        self.painter.setPen(QColor(self.theme.text))
        room = self._room.adjusted(GAP, GAP, -GAP, -GAP)
        self.painter.drawText(room, CENTRE | Qt.TextFlag.TextWordWrap, text)

    def frame(self, title: str, unit: str, *, whole: bool = False) -> None:
        """Draw two edges with their ticks, upwards maybe whole numbers, and say what they mean."""
        painter, box = self.painter, self.box
        edge, text = self.pen(self.theme.faint), self.pen(self.theme.text)
        fonts, high = painter.fontMetrics(), painter.fontMetrics().height()
        painter.setPen(edge)
        painter.drawPolyline(QPolygonF([box.topLeft(), box.bottomLeft(), box.bottomRight()]))
        marks: list[tuple[QPointF, QPointF, QRectF, Qt.AlignmentFlag, str]] = []
        for value, name in ticks(*self.x, int(box.width() / PER_TICK[0])):
            (at,) = self._places(np.array([value]), np.array([self.y[0]]))
            below = QRectF(at.x() - 30, at.y() + TICK, 60, high)
            marks.append((at, at + QPointF(0, TICK), below, CENTRE, name))
        most = int(box.height() / PER_TICK[1])
        for value, name in ticks(min(self.y), max(self.y), most, whole=whole):
            (at,) = self._places(np.array([self.x[0]]), np.array([value]))
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

    def lines(self, x: Along, lines: Sequence[tuple[Along, QPen, str]]) -> None:
        """Draw lines, each with its pen, broken where it is not known; name those with a name."""
        painter, box = self.painter, self.box
        at, middle = box.left() + 6, box.top()
        painter.setBrush(Qt.BrushStyle.NoBrush)
        for y, pen, name in lines:
            painter.setPen(pen)
            for part in known(x, y):
                painter.drawPolyline(QPolygonF(self._places(x[part], y[part])))
            if name:
                high = painter.fontMetrics().height()
                middle += high / 2
                painter.drawLine(QPointF(at, middle), QPointF(at + SWATCH, middle))
                painter.setPen(QColor(self.theme.text))
                place = QRectF(at + SWATCH + 4, middle - high / 2, box.width(), high)
                painter.drawText(place, BEGIN, name)
                middle += high / 2

    def band(self, x: Along, low: Along, high: Along) -> None:
        """Fill what is between two lines."""
        colour = QColor(self.theme.line)
        colour.setAlphaF(0.35)
        self.painter.setPen(Qt.PenStyle.NoPen)
        self.painter.setBrush(colour)
        for part in known(x, low, high):
            back = self._places(x[part][::-1], low[part][::-1])
            self.painter.drawPolygon(QPolygonF([*self._places(x[part], high[part]), *back]))

    def _places(self, x: Along, y: Along) -> list[QPointF]:
        """Points of the screen."""
        right = self.box.left() + (x - self.x[0]) / (self.x[1] - self.x[0]) * self.box.width()
        up = self.box.bottom() - (y - self.y[0]) / (self.y[1] - self.y[0]) * self.box.height()
        return [QPointF(a, b) for a, b in zip(right.tolist(), up.tolist(), strict=True)]


def _over(x: Along) -> Range:
    """Give the ends of an axis along a curve, which may have no length."""
    return float(x[0]), float(x[-1]) if x[-1] > x[0] else float(x[0]) + 1.0


def known(*values: Along) -> Iterator[slice]:
    """Give the stretches where all are finite."""
    finite = np.concatenate([[False], np.isfinite(np.stack(values)).all(axis=0), [False]])
    edges = np.flatnonzero(np.diff(finite)).tolist()
    return (slice(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True))


def spanned(values: Sequence[Along], below: float, above: float) -> Range:
    """Give what holds all finite values, with room as a share of what they span."""
    together = np.concatenate(values)
    together = together[np.isfinite(together)]
    low, high = (together.min(), together.max()) if together.size else (0.0, 1.0)
    span = (high - low) or 1.0
    return float(low - below * span), float(high + above * span)


def ticks(low: float, high: float, most: int, *, whole: bool = False) -> list[tuple[float, str]]:
    """Give round values between two others, maybe whole ones, and how they are written."""
    least = max((high - low) / max(most, 1), float(whole))
    power = 10.0 ** np.floor(np.log10(least))
    steps = [power * factor for factor in ROUND if not (whole and power * factor % 1)]
    step = next(step for step in steps if step >= least)
    decimals = next(d for d in range(20) if abs(round(step, d) - step) < 1e-9 * step)
    first, last = np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9)
    return [(n * step, f"{n * step + 0.0:.{decimals}f}") for n in np.arange(first, last + 1)]


def residual_along(image: Image, patch: Patch, record: Record) -> Along | None:
    """Average image minus reconstruction across a body; None where the image is not there.

    Only the pixels around the body are read.
    """
    points = patch.grid.to_block(record.curve.points)
    half_width = record.curve.half_width / patch.grid.size
    places = across(points, half_width)
    low = np.clip(np.floor(places.min((0, 1))).astype(int), 0, patch.pixels.shape)
    high = np.clip(np.ceil(places.max((0, 1))).astype(int) + 1, 0, patch.pixels.shape)
    if (high <= low).any():
        return None
    grid = Grid(patch.grid.to_image(low), patch.grid.step)
    block = block_on(image, record.frame, grid, tuple(high - low))
    if block is None:
        return None
    rest = block.read() - patch.pixels[low[0] : high[0], low[1] : high[1]]
    return mean_across(rest, points - low, half_width)


def across(points: Float[np.ndarray, "P 2"], half_width: Along) -> Float[np.ndarray, "P Q 2"]:
    """Places on a body's cross-sections, from edge to edge, px; one where no width is known."""
    reach = np.nan_to_num(half_width, nan=0.0, posinf=0.0)
    count = 1 + 2 * int(np.ceil(reach.max(initial=0.0) / SPACING))
    share = np.linspace(-1, 1, count) if count > 1 else np.zeros(1)
    return points[:, None] + (reach[:, None] * share)[..., None] * normals(points)[:, None]


def mean_across(
    picture: Real[np.ndarray, "H W"], points: Float[np.ndarray, "P 2"], half_width: Along
) -> Along:
    """Average a picture over a body's cross-section at each point of its centreline.

    Pixels that are not finite are left out, as are those beyond the picture; NaN where none is
    left. Points and half-widths as for `across`, in pixels of the picture.
    """
    where = np.moveaxis(across(points, half_width), -1, 0)
    finite = np.isfinite(picture)
    filled = np.where(finite, picture, 0.0).astype(float)
    values = map_coordinates(filled, where, order=1, cval=0.0).sum(axis=1)
    # Weights fall to zero with the pixels that are missing, as the values do.
    total = map_coordinates(finite.astype(float), where, order=1, cval=0.0).sum(axis=1)
    return np.divide(values, total, out=np.full(len(points), np.nan), where=total > 1e-6)

"""Plots beside the table: of the selected curve along it, and of its body over the frames."""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, cast

import numpy as np
import pyqtgraph as pg
from jaxtyping import Float
from napari.utils.theme import get_theme
from qtpy.QtCore import QRectF, Qt
from superqt.utils import qdebounced

from napari_splinesketch.engine.types import Curve, InputError
from napari_splinesketch.grids import Along
from napari_splinesketch.plugin.columns import RAMP, half_widths
from napari_splinesketch.plugin.layers import results, space
from napari_splinesketch.plugin.layers.pictures import residual_along
from napari_splinesketch.plugin.model import Record
from napari_splinesketch.tracking import kymograph

SMALL = "8pt"  # size of the text
LEFT = 38  # room for the numbers at the left, px: both plots begin at the same place
AROUND = 2, 9, 16, 9  # room at all sides, px: half of the last number stands beside its axis
MARGIN = 12  # at both sides of a hint, at least, px
AFTER_MS = 30  # without a change, until plots are drawn: that takes as much again
LINE, ZERO, SHADE = "#2a8fd0", "#c86a00", "#2a8fd059"  # told apart in dark and light windows
SIGNED = ("#0072b2", "#56b4e9", "#f7f7f7", "#e69f00", "#a34700")  # told apart by everybody
SHARE = 98.0  # of the values that the colours span, %: few that stand out do not flatten the others
EMPTY = "Select a curve to see its half-width along it", "… and what the model leaves unexplained"
RESIDUAL = "Image − model, across"
NO_MODEL = "There is no model of this frame to compare with"


@dataclass(frozen=True, eq=False)
class Plot:
    """A quantity along a curve, (P,), or of its body over the frames too, (T, P), or NaN."""

    title: str
    unit: str
    distance: Along  # from the first point, in the unit; the mean over frames
    values: Float[np.ndarray, "*T P"]
    signed: bool = True  # zero is in the middle of the colours, or a line
    sd: Along | None = None  # how far values may be off
    frames: tuple[int, int] = (0, 0)  # first and last

    @property
    def span(self) -> tuple[float, float]:
        """What the ends of the colours stand for."""
        known = np.abs(self.values[np.isfinite(self.values)])
        high = (float(np.percentile(known, SHARE)) if known.size else 0.0) or 1.0
        return -high if self.signed else 0.0, high


def profiles(work: results.Work, record: Record, ruler: space.Ruler) -> tuple[Plot | str, ...]:
    """Say what there is to draw of a curve: its half-width, and the image minus the model."""
    curve, patch = record.curve, work.state.patches.get(record.frame)
    sd = np.nan_to_num(ruler.across(curve, curve.sd), posinf=0.0)
    unit, along, width = ruler.unit, ruler.along(curve.points), half_widths(curve, ruler)
    plot = Plot(f"Half-width ± sd ({unit})", unit, along, width, False, sd)
    try:
        rest = residual_along(work.image, patch, record) if patch else None
    except InputError as error:
        return plot, str(error)
    return plot, NO_MODEL if rest is None else Plot(RESIDUAL, unit, along, rest)


@lru_cache(1)  # not again where the user only judges curves, or goes along the body
def pictures(body: tuple[tuple[int, Curve], ...], ruler: space.Ruler) -> tuple[Plot, ...]:
    """Curvature, speed, and velocity along and across a body; nothing of one in a single frame."""
    if len(body) < 2:
        return ()
    scale, unit = np.array([*ruler.scale, 1.0]), ruler.unit
    scaled = {
        frame: replace(curve, knots=curve.knots * scale, points=curve.points * ruler.scale)
        for frame, curve in body
    }
    made, along = kymograph(scaled), [ruler.along(curve.points) for _, curve in body]
    frames = int(made.frames[0]), int(made.frames[-1])
    named = (
        (f"Curvature (1/{unit})", made.curvature, True),
        (f"Speed ({unit}/frame)", np.hypot(made.along, made.across), False),
        (f"Along it ({unit}/frame)", made.along, True),
        (f"Across it ({unit}/frame)", made.across, True),
    )
    mean = np.mean(along, axis=0)
    return tuple(Plot(title, unit, mean, v, signed, None, frames) for title, v, signed in named)


class CurvePlots(pg.GraphicsLayoutWidget):
    """Half-width and residual against arc length, or two pictures over the frames."""

    def __init__(self, theme: str):
        super().__init__()
        self._plots = cast(Any, self.ci)
        self._plots.setContentsMargins(*AROUND)
        cast(Any, self.sceneObj).contextMenu.clear()  # Export: as SVG it fails with Qt 6.11
        self._font = self.font()
        self._font.setPointSize(8)
        self.setMinimumSize(280, 130)  # a window of 1000 px has room for it
        self.setFocusPolicy(Qt.FocusPolicy.NoFocus)  # a click leaves the keys to the canvas
        self.setAccessibleName("Plots of the selected curve")
        self._soon = qdebounced(self._draw, AFTER_MS)
        self.show_plots()
        self.show_theme(theme)

    def show_theme(self, name: str) -> None:
        """Take the colours of another theme."""
        theme = get_theme(name)
        self._text = theme.text.as_hex(format="long")
        self.setBackground(theme.background.as_hex(format="long"))
        self._soon()

    def show_plots(self, *plots: Plot | str, frame: int = 0) -> None:
        """Draw two plots, of a body with a frame marked, or say why there is none."""
        self.shown, self._frame = plots or EMPTY, frame
        self._soon()

    def _draw(self) -> None:
        self._plots.clear()
        for plot in self.shown:
            if isinstance(plot, str):
                label = self._plots.addLabel(plot, size=SMALL, color=self._text)
                label.item.setTextWidth(self.minimumWidth() / 2 - MARGIN)
                label.updateMin()
            else:
                (self._add_line if plot.values.ndim == 1 else self._add_picture)(plot)
        # Everything has its place before it is painted, not after.
        self._plots.layout.activate()
        self._plots.setGeometry(cast(Any, self.range))  # it may have been broader for what was here
        for each in self._plots.items:
            if hasattr(each, "vb"):
                each.layout.activate()

    def _add_plot(self, made: Plot) -> Any:
        plot = self._plots.addPlot()
        plot.setTitle(made.title, size=SMALL, color=self._text)
        # Over all columns, or a long title would push the other plot out of view.
        plot.layout.addItem(plot.titleLabel, 0, 0, 1, plot.layout.columnCount())
        plot.setLabel("bottom", f"distance along it ({made.unit})", **{"font-size": SMALL})
        for side in ("left", "bottom"):
            self._style(plot.getAxis(side))
        plot.getAxis("left").setWidth(LEFT)
        return plot

    def _style(self, axis: Any) -> None:
        axis.enableAutoSIPrefix(False)
        axis.setTextPen(self._text)
        axis.setStyle(tickFont=self._font, maxTickLevel=0, hideOverlappingLabels=False)

    def _add_line(self, made: Plot) -> None:
        plot, x, y = self._add_plot(made), made.distance, made.values
        known = np.isfinite(y)
        if made.sd is not None:
            sides = [np.maximum(side, 0) for side in (y - made.sd, y + made.sd)]
            edges = [pg.PlotDataItem(x[known], side[known]) for side in sides]
            plot.addItem(pg.FillBetweenItem(*edges, brush=SHADE))
            plot.setYRange(0, np.max(sides[1], where=known, initial=0.0) or 1.0)
        plot.setXRange(x[0], x[-1], padding=0.02)
        if made.signed:
            plot.addLine(y=0, pen=pg.mkPen(ZERO, width=1.5, style=Qt.PenStyle.DashLine))
        if known.any():
            plot.plot(x, y, pen=pg.mkPen(LINE, width=1.5), connect="finite")

    def _add_picture(self, made: Plot) -> None:
        plot, (first, last) = self._add_plot(made), made.frames
        colours = SIGNED if made.signed else RAMP
        ramp = pg.ColorMap(np.linspace(0, 1, len(colours)), colours)
        image = pg.ImageItem(made.values, axisOrder="row-major", levels=made.span)
        image.setRect(QRectF(0, first - 0.5, made.distance[-1], last - first + 1))
        plot.addItem(image)
        bar = plot.addColorBar(image, colorMap=ramp, values=made.span, interactive=False, width=8)
        self._style(bar.axis)
        plot.invertY(True)
        # Between frames there is nothing.
        plot.getAxis("left").setTickSpacing(max(1, (last - first + 1) // 4), 1)
        for edge in (self._frame - 0.5, self._frame + 0.5):
            plot.addItem(pg.InfiniteLine(edge, angle=0, pen=pg.mkPen(self._text)))

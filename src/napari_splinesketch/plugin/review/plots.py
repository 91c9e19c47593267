"""Plots beside the table: width and what is left unexplained, along the selected curve."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.backends.backend_qtagg import FigureCanvasQTAgg
from matplotlib.collections import FillBetweenPolyCollection
from matplotlib.figure import Figure
from qtpy.QtGui import QResizeEvent

from napari_splinesketch.plugin.theme import Theme

Along = Float[np.ndarray, " P"]
SMALL = 8
"""Size of the text, pt."""
LEFT, RIGHT, TOP, BOTTOM, BETWEEN = 44, 12, 24, 38, 52
"""Margins around the axes and room between them, px."""
ROOM = 0.08
"""Left free above and below the lines, as a share of what they span."""


@dataclass(frozen=True, eq=False)
class Profile:
    """What is drawn of one curve.

    Attributes
    ----------
    name
        Of the curve.
    unit
        Of all lengths.
    distance
        From the curve's first point.
    half_width, sd
        There, with its standard error.
    mean
        Half-width of all curves at the same share of their lengths, or None.
    residual
        Image minus reconstruction there, or None where there is no reconstruction.
    """

    name: str
    unit: str
    distance: Along
    half_width: Along
    sd: Along
    mean: Along | None = None
    residual: Along | None = None


class CurvePlots(FigureCanvasQTAgg):
    """Half-width and residual against arc length.

    Lines are made once and get new data: a full redraw of axes would lag behind the arrow keys.
    """

    def __init__(self, theme: Theme):
        figure = Figure()
        super().__init__(figure)
        self.figure = figure
        width, residual = figure.subplots(1, 2)
        self.axes: tuple[Axes, Axes] = width, residual
        (self._width,) = width.plot([], [], lw=1.8, label="curve ± sd")
        (self._mean,) = width.plot([], [], lw=1.4, ls=(0, (4, 2)), label="mean of all")
        self._band = width.fill_between([], [], [], lw=0, alpha=0.35)
        assert isinstance(self._band, FillBetweenPolyCollection)
        (self._residual,) = residual.plot([], [], lw=1.4)
        self._zero = residual.axhline(0, lw=1, ls=(0, (4, 2)))
        self._legend = width.legend(
            fontsize=SMALL - 1,
            loc="upper left",
            frameon=False,
            ncols=2,
            borderaxespad=0,
            handlelength=1.4,
            columnspacing=1.0,
        )
        self._titles = [axes.set_title("", loc="left", fontsize=SMALL) for axes in self.axes]
        for axes in self.axes:
            axes.set_xlabel("", fontsize=SMALL)
            axes.spines[["top", "right"]].set_visible(False)
        self.setMinimumSize(320, 130)
        self.setAccessibleName("Half-width and residual along the selected curve")
        self.profile: Profile | None = None
        self.show_theme(theme)
        self.show_profile(None)

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Keep the margins, whatever the size."""
        wide, high = max(self.width(), 2), max(self.height(), 2)
        axes = max((wide - LEFT - RIGHT - BETWEEN) / 2, 1)
        self.figure.subplots_adjust(
            left=min(LEFT / wide, 0.4),
            right=max(1 - RIGHT / wide, 0.6),
            bottom=min(BOTTOM / high, 0.4),
            top=max(1 - TOP / high, 0.6),
            wspace=BETWEEN / axes,
        )
        super().resizeEvent(event)

    def show_theme(self, theme: Theme) -> None:
        """Take the window's colours."""
        self.figure.set_facecolor(theme.background)
        self._width.set_color(theme.line)
        self._band.set_color(theme.line)
        self._residual.set_color(theme.line)
        self._mean.set_color(theme.other)
        self._zero.set_color(theme.other)
        for text in (*self._titles, *self._legend.get_texts()):
            text.set_color(theme.text)
        for axes in self.axes:
            axes.set_facecolor(theme.background)
            axes.tick_params(colors=theme.text, labelsize=SMALL)
            axes.xaxis.label.set_color(theme.text)
            axes.spines[["left", "bottom"]].set_color(theme.faint)
        self.draw_idle()

    def show_profile(self, profile: Profile | None) -> None:
        """Draw a curve, or say that none is selected."""
        self.profile = profile
        for artist in (self._width, self._band, self._legend):
            artist.set_visible(profile is not None)
        self._mean.set_visible(profile is not None and profile.mean is not None)
        self._residual.set_visible(profile is not None and profile.residual is not None)
        if profile is None:
            self._titles[0].set_text("Select a curve: its half-width along it")
            self._titles[1].set_text("What the model leaves unexplained")
        else:
            self._draw_width(profile)
            self._draw_residual(profile)
        self.draw_idle()

    def _draw_width(self, profile: Profile) -> None:
        x, y = profile.distance, profile.half_width
        sd = np.where(np.isfinite(profile.sd), profile.sd, 0.0)
        self._width.set_data(x, y)
        self._band.set_data(x, np.maximum(y - sd, 0), y + sd)
        lines = [y + sd, y - sd]
        if profile.mean is not None:
            self._mean.set_data(x, profile.mean)
            lines.append(profile.mean)
        axes = self.axes[0]
        self._titles[0].set_text(f"Half-width of {profile.name} ({profile.unit})")
        _fit(axes, x, np.concatenate([*lines, [0.0]]), above=0.25)
        axes.xaxis.label.set_text(f"distance along it ({profile.unit})")

    def _draw_residual(self, profile: Profile) -> None:
        axes = self.axes[1]
        axes.xaxis.label.set_text(f"distance along it ({profile.unit})")
        if profile.residual is None:
            self._titles[1].set_text("No model of this frame to compare with")
            return
        self._residual.set_data(profile.distance, profile.residual)
        self._titles[1].set_text("Image − model, mean across it")
        _fit(axes, profile.distance, np.append(profile.residual, 0.0))


def _fit(axes: Axes, x: Along, y: Along, above: float = ROOM) -> None:
    """Let the axes show all finite values."""
    known = y[np.isfinite(y)]
    low, high = (known.min(), known.max()) if len(known) else (0.0, 1.0)
    span = (high - low) or 1.0
    axes.set_ylim(low - ROOM * span, high + above * span)
    axes.set_xlim(x[0], x[-1] if x[-1] > x[0] else x[0] + 1)

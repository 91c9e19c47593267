"""What the colour of a curve says, and the legend that tells."""

from collections.abc import Sequence

from qtpy.QtCore import Signal  # pyright: ignore[reportPrivateImportUsage]
from qtpy.QtWidgets import QComboBox, QFrame, QHBoxLayout, QLabel, QVBoxLayout, QWidget

from napari_splinesketch.engine.types import Curve
from napari_splinesketch.plugin.adapter.colours import COLOUR_BY, RAMP, ColourBy, scale_of
from napari_splinesketch.plugin.adapter.look import COLOURS, MARKS
from napari_splinesketch.plugin.measures import Ruler, three_digits
from napari_splinesketch.plugin.text_label import TextLabel
from napari_splinesketch.plugin.words import STATUS_WORDS

NAMES: dict[ColourBy, str] = {
    "status": "status",
    "length": "length",
    "half_width": "mean half-width",
    "sd": "standard error",
    "residual": "residual",
}
LENGTHS: tuple[ColourBy, ...] = ("length", "half_width", "sd")
STATUS_LEGEND = " &nbsp; ".join(
    f'<span style="color: {COLOURS[status]}">■</span> {word} {MARKS[status]}'.rstrip()
    for status, word in STATUS_WORDS.items()
)


class LookBox(QWidget):
    """A combo box and a legend."""

    valueChanged = Signal(str)

    def __init__(self, parent: QWidget | None = None):
        super().__init__(parent)
        self._seen: object = None
        self.by = QComboBox()
        self.by.addItems([f"Colour by {NAMES[by]}" for by in COLOUR_BY])
        self.by.setMinimumWidth(60)
        self.by.setToolTip("What the colour of a curve says; its marks always tell its status")
        self.words = TextLabel()
        self.ramp = QFrame()
        stops = ", ".join(f"stop: {i / (len(RAMP) - 1)} {c}" for i, c in enumerate(RAMP))
        self.ramp.setStyleSheet(
            f"QFrame {{ background: qlineargradient(x1: 0, y1: 0, x2: 1, y2: 0, {stops}); }}"
        )
        self.ramp.setMinimumSize(40, 10)
        self.low, self.high = QLabel(), QLabel()
        self.scale = QWidget()
        row = QHBoxLayout(self.scale)
        row.setContentsMargins(0, 0, 0, 0)
        row.addWidget(self.low)
        row.addWidget(self.ramp, 1)
        row.addWidget(self.high)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(2)
        for widget in (self.by, self.words, self.scale):
            layout.addWidget(widget)
        self.by.activated.connect(lambda index: self.valueChanged.emit(COLOUR_BY[index]))

    def show_look(self, by: ColourBy, curves: Sequence[Curve], ruler: Ruler) -> None:
        """Show what the colours of these curves say."""
        seen = by, ruler, tuple(map(id, curves))
        if seen == self._seen:
            return
        self._seen = seen
        self.by.setCurrentIndex(COLOUR_BY.index(by))
        scale = scale_of(curves, by, ruler)
        self.scale.setVisible(scale is not None)
        self.words.say(STATUS_LEGEND if by == "status" else "")
        if scale is not None:
            unit = f" {ruler.unit}" if by in LENGTHS else ""
            self.low.setText(three_digits(scale.low))
            self.high.setText(three_digits(scale.high) + unit)

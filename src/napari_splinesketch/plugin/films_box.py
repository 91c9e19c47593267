"""Buttons that suggest sketches and carry curves through a film."""

from qtpy.QtCore import Qt
from qtpy.QtWidgets import QHBoxLayout, QPushButton, QSlider, QWidget

from napari_splinesketch.plugin.films import SUGGEST_TIP, Films

NEXT_TIP = "Carry the curves of this frame to the next one, refine them there and show it"
TRACK_TIP = (
    "Carry the curves of this frame to the last one;\n"
    "what you have accepted, locked, drawn or changed there stays as it is"
)


class SuggestRow(QWidget):
    """Suggest, and how much is taken for a body.

    Parameters
    ----------
    films
        Who suggests.
    """

    def __init__(self, films: Films, parent: QWidget | None = None):
        super().__init__(parent)
        self._films = films
        self.button = QPushButton("Suggest")
        self.button.setMinimumWidth(30)
        self.slider = QSlider(Qt.Orientation.Horizontal)
        self.slider.setRange(0, 100)
        self.slider.setValue(round(100 * films.sensitivity))
        self.slider.setMinimumWidth(40)
        layout = QHBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(self.button)
        layout.addWidget(self.slider, 1)
        self.button.clicked.connect(films.suggest)
        self.slider.valueChanged.connect(self._on_slider)
        self._on_slider(self.slider.value())

    def show_state(self) -> None:
        """Show what can be done now."""
        problem = self._films.problem()
        self.button.setEnabled(not problem)
        self.button.setToolTip(problem or SUGGEST_TIP)

    def _on_slider(self, value: int) -> None:
        self._films.sensitivity = value / 100
        self.slider.setToolTip(
            f"Sensitivity of Suggest, {value} %: to the left only what stands out,\n"
            "to the right also what is faint or short"
        )


class TrackRow(QWidget):
    """Next frame, and Track to the end; hidden where there is but one frame.

    Parameters
    ----------
    films
        Who tracks.
    """

    def __init__(self, films: Films, parent: QWidget | None = None):
        super().__init__(parent)
        self._films = films
        self.next = QPushButton("Next frame")
        self.track = QPushButton("Track to the end")
        layout = QHBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(4)
        for button in (self.next, self.track):
            button.setMinimumWidth(30)
            layout.addWidget(button)
        self.next.clicked.connect(films.next_frame)
        self.track.clicked.connect(films.track)

    def show_state(self) -> None:
        """Show what can be done now."""
        self.setVisible(self._films.frames() > 1)
        problem = self._films.tracking_problem()
        for button, tip in (
            (self.next, NEXT_TIP),
            (self.track, TRACK_TIP),
        ):
            button.setEnabled(not problem)
            button.setToolTip(problem or tip)

"""Where a running refinement stands, and the button that ends it."""

from qtpy.QtCore import Signal  # pyright: ignore[reportPrivateImportUsage]
from qtpy.QtWidgets import QHBoxLayout, QProgressBar, QPushButton, QVBoxLayout, QWidget

from napari_splinesketch.engine.types import Progress
from napari_splinesketch.plugin.text_label import TextLabel


class ProgressBox(QWidget):
    """Bar, stage and Cancel; hidden while nothing runs."""

    cancelled = Signal()

    def __init__(self, parent: QWidget | None = None):
        super().__init__(parent)
        self.bar = QProgressBar()
        self.bar.setRange(0, 100)
        self.bar.setToolTip("How far the refinement is")
        self.bar.setMinimumWidth(60)
        self.cancel = QPushButton("Cancel")
        self.cancel.setToolTip("Stop refining; everything stays as it was")
        self.stage = TextLabel()
        row = QHBoxLayout()
        row.addWidget(self.bar, 1)
        row.addWidget(self.cancel)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addLayout(row)
        layout.addWidget(self.stage)
        self.cancel.clicked.connect(self.cancelled)
        self.hide()

    def show_progress(self, progress: Progress | None, cancellable: bool = True) -> None:
        """Show where the refinement stands, and whether it can be cancelled; None: none runs."""
        self.cancel.setEnabled(cancellable)
        if progress is not None:
            self.bar.setValue(round(100 * progress.fraction))
            self.stage.say(f"{progress.stage.capitalize()}…")
        self.setVisible(progress is not None)

"""Sentences that are shown when one asks for them."""

from qtpy.QtCore import Qt
from qtpy.QtWidgets import QToolButton, QVBoxLayout, QWidget

from napari_splinesketch.plugin.text_label import TextLabel


class FoldedText(QWidget):
    """A title with an arrow that unfolds a text; takes no room while there is none.

    Parameters
    ----------
    title
        What the text is about.
    tip
        Tooltip of the title.
    """

    def __init__(self, title: str, tip: str, parent: QWidget | None = None):
        super().__init__(parent)
        self.title = QToolButton()
        self.title.setText(title)
        self.title.setToolTip(tip)
        self.title.setCheckable(True)
        self.title.setToolButtonStyle(Qt.ToolButtonStyle.ToolButtonTextBesideIcon)
        self.title.setStyleSheet("QToolButton { border: none; background: transparent; }")
        self.text = TextLabel()
        self._said = ""
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(self.title)
        layout.addWidget(self.text)
        self.title.toggled.connect(self._show)
        self.say("")

    def say(self, text: str) -> None:
        """Have a rich text to show, or none."""
        self._said = text
        self.setVisible(bool(text))
        self._show()

    def _show(self) -> None:
        unfolded = self.title.isChecked()
        self.title.setArrowType(Qt.ArrowType.DownArrow if unfolded else Qt.ArrowType.RightArrow)
        self.text.say(self._said if unfolded else "")

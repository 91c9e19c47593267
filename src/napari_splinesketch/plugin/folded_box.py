"""Something that is shown when one asks for it."""

from qtpy.QtCore import Qt
from qtpy.QtWidgets import QToolButton, QVBoxLayout, QWidget


class FoldedBox(QWidget):
    """A title with an arrow that unfolds a widget.

    Parameters
    ----------
    title
        What it is about.
    tip
        Tooltip of the title.
    content
        What is unfolded.
    """

    def __init__(self, title: str, tip: str, content: QWidget, parent: QWidget | None = None):
        super().__init__(parent)
        self.title = QToolButton()
        self.title.setText(title)
        self.title.setToolTip(tip)
        self.title.setCheckable(True)
        self.title.setToolButtonStyle(Qt.ToolButtonStyle.ToolButtonTextBesideIcon)
        self.title.setStyleSheet("QToolButton { border: none; background: transparent; }")
        self.content = content
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(self.title)
        layout.addWidget(content)
        self.title.toggled.connect(self._show)
        self._show()

    def _show(self) -> None:
        unfolded = self.title.isChecked()
        self.title.setArrowType(Qt.ArrowType.DownArrow if unfolded else Qt.ArrowType.RightArrow)
        self.content.setVisible(unfolded)

"""Sentences that are shown when one asks for them."""

from qtpy.QtWidgets import QWidget

from napari_splinesketch.plugin.folded_box import FoldedBox
from napari_splinesketch.plugin.text_label import TextLabel


class FoldedText(FoldedBox):
    """A title with an arrow that unfolds a text; takes no room while there is none.

    Parameters
    ----------
    title
        What the text is about.
    tip
        Tooltip of the title.
    """

    def __init__(self, title: str, tip: str, parent: QWidget | None = None):
        self.text = TextLabel()
        self._said = ""
        super().__init__(title, tip, self.text, parent)
        self.say("")

    def say(self, text: str) -> None:
        """Have a rich text to show, or none."""
        self._said = text
        self.setVisible(bool(text))
        self._show()

    def _show(self) -> None:
        super()._show()
        self.text.say(self._said if self.title.isChecked() else "")

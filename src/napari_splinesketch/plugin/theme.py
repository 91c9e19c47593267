"""napari's colours for what is not drawn by Qt's style."""

from dataclasses import dataclass

from napari.utils.theme import get_theme


@dataclass(frozen=True)
class Theme:
    """Colours that can be told apart by everybody, on the window's background.

    Attributes
    ----------
    background, text, faint
        Of the window, of words, of lines in the background.
    line, other
        Blue and orange of Okabe and Ito, dark or light enough for the background.
    """

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

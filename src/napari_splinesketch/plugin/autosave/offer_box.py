"""The question whether to go on with work that was saved."""

from collections.abc import Sequence
from datetime import UTC, datetime
from html import escape

from qtpy.QtWidgets import QFrame, QHBoxLayout, QPushButton, QVBoxLayout, QWidget

from napari_splinesketch.plugin import words
from napari_splinesketch.plugin.autosave.resume import read_curves, resume, take_up
from napari_splinesketch.plugin.autosave.saver import Offer, Saver
from napari_splinesketch.plugin.controller import Controller
from napari_splinesketch.plugin.widgets import TextLabel

LISTED = 4
"""Of several; more would push the rest of the dock out of view."""


class OfferBox(QFrame):
    """Says what was found, with a button to go on and one to start anew; hidden otherwise.

    Parameters
    ----------
    controller
        Whose image it is about.
    saver
        Who finds saved work.
    """

    def __init__(self, controller: Controller, saver: Saver, parent: QWidget | None = None):
        super().__init__(parent)
        self._controller, self._saver = controller, saver
        self.setFrameShape(QFrame.Shape.StyledPanel)
        self.said = TextLabel()
        self.resume = QPushButton("Resume")
        self.resume.setToolTip("Bring the saved lines and curves back, in a layer of their own")
        self.decline = QPushButton("Ignore saved work")
        self.decline.setToolTip("Do not ask again; the saved work stays on the disk")
        self.labels = QPushButton()
        self.labels.setToolTip("Take these curves up as results, as they were judged")
        self.problem = TextLabel()
        row = QHBoxLayout()
        for button in (self.resume, self.decline):
            button.setMinimumWidth(30)
            row.addWidget(button)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(6, 4, 6, 4)
        layout.addWidget(self.said)
        layout.addLayout(row)
        layout.addWidget(self.labels)
        layout.addWidget(self.problem)
        self.resume.clicked.connect(lambda: resume(controller, saver))
        self.decline.clicked.connect(saver.decline)
        self.labels.clicked.connect(lambda: take_up(controller))
        saver.found.connect(self.show_offers)
        self.destroyed.connect(lambda: saver.found.disconnect(self.show_offers, missing_ok=True))
        controller.changed.connect(self._show_running)
        self.show_offers()

    def show_offers(self) -> None:
        """Show what is offered now."""
        offers = self._saver.offers()
        self.said.say(describe(offers))
        for button in (self.resume, self.decline):
            button.setVisible(bool(offers))
        self.problem.say(words.notice("failed", self._saver.problem))
        self._show_running()

    def _show_running(self) -> None:
        idle, curves = self._controller.progress is None, read_curves(self._controller)
        for button in (self.resume, self.labels):
            button.setEnabled(idle)
        self.labels.setVisible(bool(curves))
        # Once there are results, they need the room.
        working = bool(self._controller.records())
        self.said.setVisible(bool(self.said.text()) and not working)
        self.resume.setText("Resume saved work" if working else "Resume")
        self.decline.setText("Ignore" if working else "Ignore saved work")
        self.labels.setText(f"Continue with these {words.count(curves, 'curve')}")
        self.setVisible(bool(curves or self._saver.offers() or self._saver.problem))


def describe(offers: Sequence[Offer]) -> str:
    """Say what was saved, and when; rich text."""
    if len(offers) < 2:
        return "".join(f"<b>Saved work</b> ({_when(o.summary.saved)}): {_held(o)}." for o in offers)
    shown = offers[:LISTED]
    lines = [f"• {escape(o.summary.layer)} ({_when(o.summary.saved)}): {_held(o)}" for o in shown]
    if len(offers) > LISTED:
        lines.append(f"and {len(offers) - LISTED} more")
    return "<br>".join([f"<b>Saved work</b> in {len(offers)} layers of sketches:", *lines])


def _held(offer: Offer) -> str:
    held = offer.summary
    parts = [words.count(held.sketches, "sketch"), words.count(held.curves, "curve")]
    where = f" in {held.frames} frames" if held.frames > 1 else ""
    return f"{' and '.join(parts)}{where}"


def _when(saved: datetime) -> str:
    minutes = int((datetime.now(UTC) - saved).total_seconds() / 60)
    if 0 <= minutes < 90:
        return "just now" if minutes < 2 else f"{minutes} minutes ago"
    return saved.astimezone().strftime("%d %B %Y, %H:%M")

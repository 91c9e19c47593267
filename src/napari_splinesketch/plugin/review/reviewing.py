"""Going from curve to curve: accept, reject, next."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from napari_splinesketch.plugin.adapter.camera import look_at
from napari_splinesketch.plugin.measures import severity
from napari_splinesketch.plugin.records import Key, Record, Review, key_of

if TYPE_CHECKING:
    from napari_splinesketch.plugin.controller import Controller


class Reviewing:
    """Says what the user thinks of the selected curve, and goes on to the next.

    Parameters
    ----------
    controller
        Owns the curves.

    Attributes
    ----------
    order
        Gives the curves in the order in which they are gone through; the worst first, unless a
        table shows another order.
    """

    def __init__(self, controller: Controller):
        self.controller = controller
        self.order: Callable[[], Sequence[Record]] = self.worst_first

    def worst_first(self) -> list[Record]:
        """Give all curves, those that need review most first."""
        records = self.controller.records()
        return sorted(records, key=lambda record: severity(record.curve), reverse=True)

    def accept(self) -> None:
        """Accept the selected curves and go on."""
        self._judge("accepted")

    def reject(self) -> None:
        """Reject the selected curves and go on."""
        self._judge("rejected")

    def reopen(self) -> None:
        """Take back what was said of the selected curves."""
        if self.controller.selection:
            self.controller.review("open")

    def next(self) -> None:
        """Go on to the next curve that is not reviewed."""
        self._go_on(self.order())

    def go_to(self, key: Key) -> None:
        """Select a curve, and bring it to the middle of the canvas."""
        controller, work = self.controller, self.controller.work
        record = next((r for r in controller.records() if key_of(r) == key), None)
        if work is None or record is None:
            return
        controller.selected = key
        look_at(controller.viewer, work.image, record.frame, record.curve.points)

    def _judge(self, review: Review) -> None:
        if self.controller.selection:
            before = self.order()
            self.controller.review(review)
            self._go_on(before)
        else:
            self.next()

    def _go_on(self, order: Sequence[Record]) -> None:
        """Go to the first open curve after the selected one, or to the first of all."""
        now = {key_of(r): r for r in self.controller.records()}
        keys = [key_of(r) for r in order if key_of(r) in now]
        selection = self.controller.selection
        at = max((i for i, key in enumerate(keys) if key in selection), default=-1)
        ahead = [k for k in (*keys[at + 1 :], *keys[: at + 1]) if now[k].review == "open"]
        if ahead:
            self.go_to(ahead[0])

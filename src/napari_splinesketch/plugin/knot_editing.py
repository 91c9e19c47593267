"""Moving a curve by its knots."""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
from jaxtyping import Float
from qtpy.QtCore import QTimer

from napari_splinesketch.engine.types import Curve
from napari_splinesketch.plugin import shaping
from napari_splinesketch.plugin.adapter.knots import KnotLayer
from napari_splinesketch.plugin.adapter.preview import Preview
from napari_splinesketch.plugin.history import History
from napari_splinesketch.plugin.keeper import Keeper, Notice
from napari_splinesketch.plugin.records import Record, key_of
from napari_splinesketch.plugin.work import Work

FEWEST = 3
HELP = "Drag its knots; Enter refines from there, Done keeps it so, Esc takes it back."

Knots = Float[np.ndarray, "K 2"]


class KnotEditing:
    """Shows the knots of the selected curve, and the curve as they are dragged.

    Parameters
    ----------
    keeper
        Keeps the curves.
    refine
        Called to refine the selected curves.
    """

    def __init__(self, keeper: Keeper, refine: Callable[[], None]):
        self._keeper = keeper
        self._refine = refine
        self._record: Record | None = None
        self._layer: KnotLayer | None = None
        self._preview: Preview | None = None
        self._history: History[Knots] = History(np.zeros((0, 2)))

    @property
    def active(self) -> bool:
        """Whether knots are shown."""
        return self._layer is not None

    @property
    def steps(self) -> History[Knots]:
        """The knots, and where they were."""
        return self._history

    def toggle(self) -> None:
        """Show the knots of the selected curve, or keep the curve as it is now."""
        if self.active:
            self.keep()
        else:
            self.begin()

    def begin(self) -> None:
        """Show the knots of the selected curve."""
        keeper, work, key = self._keeper, self._keeper.work, self._keeper.selected
        record = work.state.record(key) if work and key else None
        if work is None or record is None or record.locked or keeper.progress:
            locked = record is not None and record.locked
            said = "The curve is locked." if locked else "Select one curve to edit its knots."
            self._say(Notice("failed", said))
            return
        self._record = record
        self._history = History(record.curve.knots[:, :2])
        name = f"{work.name} knots of curve {record.id}"
        keys = {"Enter": self.refine, "Escape": self.discard}
        image, knots = work.image, self._history.value
        self._layer = KnotLayer(keeper.viewer, image, name, record.frame, knots, keys)
        self._preview = Preview(keeper.viewer, image, f"{work.name} edited")
        self._layer.moving.connect(self._show)
        # Later: napari is still busy with the edit that it tells of.
        self._layer.moved.connect(lambda: QTimer.singleShot(0, self._on_moved))
        keeper.viewer.layers.events.removed.connect(self._on_removed)
        self._show()
        self._say(Notice("none", HELP))

    def keep(self) -> bool:
        """Put the curve where its knots are; say if they were moved."""
        work, record = self._work(), self._record
        moved = bool(self._history.done) and record is not None
        curve = self._curve() if moved else None
        self.discard()
        if work is not None and record is not None and curve is not None:
            changed = replace(record, curve=curve, edited=True, review="open")
            state = work.state.with_records(changed)
            self._keeper.apply(f"Move knots of curve {record.id}", state)
            self._keeper.selected = key_of(record)
        return moved

    def refine(self) -> None:
        """Refine the curve from where its knots are, and no other."""
        record = self._record
        self.keep()
        if record is not None:
            self._keeper.selected = key_of(record)
            self._refine()

    def discard(self) -> None:
        """Leave the curve as it was."""
        layer, preview = self._layer, self._preview
        self._layer = self._preview = self._record = None
        if layer is not None and preview is not None:
            self._keeper.viewer.layers.events.removed.disconnect(self._on_removed)
            preview.remove()
            layer.close()
            self._say(Notice())

    def undo(self) -> None:
        """Put the knots back to where they were before the last move."""
        self._history.undo()
        self._go_back()

    def redo(self) -> None:
        """Move the knots again."""
        self._history.redo()
        self._go_back()

    def _go_back(self) -> None:
        if self._layer is not None:
            self._layer.set_value(self._history.value)
            self._show()
            self._keeper.changed.emit()

    def _work(self) -> Work | None:
        """Give the work that the curve belongs to, if it is still what it was."""
        work = self._keeper.work
        known = work.state.record(key_of(self._record)) if work and self._record else None
        return work if known is self._record else None

    def _curve(self) -> Curve | None:
        if self._layer is None or self._record is None:
            return None
        return shaping.moved(self._record.curve, self._layer.value())

    def _show(self) -> None:
        curve = self._curve()
        if curve is not None and self._preview is not None and self._record is not None:
            self._preview.show(self._record.frame, [curve.points])

    def _on_moved(self) -> None:
        if self._layer is None:
            return
        knots = _in_order(self._history.value, self._layer.value())
        if len(knots) < FEWEST:
            self._say(Notice("failed", f"A curve has at least {FEWEST} knots."))
        else:
            self._history.apply("move knots", knots)
        self._layer.set_value(self._history.value)
        self._show()
        self._keeper.changed.emit()

    def _on_removed(self) -> None:
        if self._layer is not None and not self._layer.there:
            self.discard()

    def _say(self, notice: Notice) -> None:
        self._keeper.notice = notice
        self._keeper.changed.emit()


def _in_order(before: Knots, now: Knots) -> Knots:
    """Put a knot that was added, and so comes last, where it lies among the others."""
    if len(now) != len(before) + 1:
        return now
    rest, new = now[:-1], now[-1]
    detours = [
        np.linalg.norm(a - new) + np.linalg.norm(b - new) - np.linalg.norm(a - b)
        for a, b in pairwise(rest)
    ]
    detours = [2 * np.linalg.norm(rest[0] - new), *detours, 2 * np.linalg.norm(rest[-1] - new)]
    return np.insert(rest, int(np.argmin(detours)), new, axis=0)

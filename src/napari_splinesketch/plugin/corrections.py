"""Correcting curves: each a step that can be taken back."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from napari_splinesketch.engine.types import Curve
from napari_splinesketch.plugin import shaping
from napari_splinesketch.plugin.adapter.space import pointer
from napari_splinesketch.plugin.keeper import Keeper, Notice
from napari_splinesketch.plugin.records import Record, key_of

REACH = 8.0
"""How far from a curve the pointer may be to mean it, px, where its body is not broader."""


class Corrections:
    """What the user can do to the shape of a curve: the one selected, or the one pointed at.

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

    def flip(self) -> None:
        """Let the selected curves begin where they ended."""
        chosen = self._chosen()
        if chosen:
            turned = [replace(r, curve=shaping.flipped(r.curve)) for r in chosen]
            self._apply("Flip", turned)

    def split(self) -> None:
        """Cut a curve at the point that is nearest to the pointer."""
        record = self._one("Select the curve to split, and point at the place.")
        if record is None:
            return
        try:
            pieces = shaping.split(record.curve, shaping.nearest(record.curve, self._place())[0])
        except ValueError as error:
            self._say(str(error))
            return
        work = self._keeper.work
        known = (*work.state.records, *work.state.deleted) if work else ()
        number = max(other.id for other in known) + 1
        second = Record(number, record.frame, pieces[1].points, pieces[1], drawn=False, edited=True)
        self._apply("Split", [_edited(record, pieces[0]), second])

    def join(self) -> None:
        """Make one curve of the two that are selected; it keeps the first one's number."""
        chosen = self._chosen()
        work = self._keeper.work
        if len(chosen) != 2 or chosen[0].frame != chosen[1].frame or work is None:
            self._say("Select two curves of this frame to join: click one, Shift-click the other.")
            return
        first, second = chosen
        made = _edited(first, shaping.joined(first.curve, second.curve))
        state = work.state.without([key_of(second)]).with_records(made)
        self._keeper.apply(f"Join curves {first.id} and {second.id}", state)
        self._keeper.selected = key_of(made)

    def extend(self) -> None:
        """Lengthen the end nearest to the pointer by the body's width, and refine."""
        record = self._one("Select the curve to extend, and point at its end.")
        if record is not None:
            curve, place = record.curve, self._place()
            apart = np.linalg.norm(curve.points[[0, -1]] - place, axis=1)
            longer = shaping.extended(curve, bool(apart[1] <= apart[0]), shaping.body_width(curve))
            self._apply("Extend", [_edited(record, longer)])
            self._refine()

    def pick(self, *, add: bool = False) -> None:
        """Select the curve that the pointer is at, beside those selected or instead of them."""
        keeper = self._keeper
        found = self._pointed()
        chosen = keeper.selection if add else ()
        if found is not None:
            key = key_of(found)
            chosen = tuple(k for k in chosen if k != key) if key in chosen else (*chosen, key)
        keeper.select(chosen)

    def _pointed(self) -> Record | None:
        """Give the curve in view that the pointer is at."""
        place = self._place()
        near = [
            (shaping.nearest(record.curve, place)[1], record)
            for record in self._keeper.records(self._keeper.frame)
        ]
        reached = [
            (apart, record)
            for apart, record in near
            if apart < max(REACH, shaping.body_width(record.curve))
        ]
        return min(reached, key=lambda pair: pair[0])[1] if reached else None

    def _chosen(self) -> list[Record]:
        """Give the selected curves, or else the one pointed at; say so if there is none."""
        work = self._keeper.work
        found = [work.state.record(key) for key in self._keeper.selection] if work else []
        chosen = [record for record in found if record is not None]
        if not chosen:
            pointed = self._pointed()
            chosen = [pointed] if pointed else []
        if not chosen:
            self._say("Select a curve first, or point at it.")
        locked = [record for record in chosen if record.locked]
        if locked:
            self._say("Curve " + ", ".join(str(r.id) for r in locked) + " is locked.")
        return [] if locked else chosen

    def _one(self, otherwise: str) -> Record | None:
        chosen = self._chosen()
        if len(chosen) > 1:
            self._say(otherwise)
        return chosen[0] if len(chosen) == 1 else None

    def _apply(self, verb: str, changed: list[Record]) -> None:
        work = self._keeper.work
        if work is not None:
            what = f"{verb} curve {changed[0].id}" if verb != "Flip" else _flip(changed)
            self._keeper.apply(what, work.state.with_records(*changed))
            self._keeper.select(map(key_of, changed))

    def _say(self, text: str) -> None:
        self._keeper.notice = Notice("failed", text)
        self._keeper.changed.emit()

    def _place(self) -> Float[np.ndarray, "2"]:
        """(row, col) that the pointer is at, px of the image."""
        image = self._keeper.choices.image
        return pointer(self._keeper.viewer, image) if image else np.full(2, np.nan)


def _edited(record: Record, curve: Curve) -> Record:
    """Put a changed curve into a record; what was said of the old one no longer holds."""
    return replace(record, curve=curve, edited=True, review="open")


def _flip(changed: list[Record]) -> str:
    return f"Flip curve {changed[0].id}" if len(changed) == 1 else f"Flip {len(changed)} curves"

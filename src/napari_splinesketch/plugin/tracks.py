"""Between what is known of a film and what tracking takes and gives; free of Qt and napari."""

from collections import Counter
from collections.abc import Sequence

from napari_splinesketch.plugin import words
from napari_splinesketch.plugin.engine import refined_of
from napari_splinesketch.plugin.model import Record, State
from napari_splinesketch.tracking import Body, Given, Tracked

NUMBERS = 6
"""Most bodies that are named."""


def bodies_at(state: State, frame: int, way: int = 1) -> tuple[Body, ...]:
    """Give the bodies of a frame, with where they were in the frame before on that way."""
    found = []
    for record in state.records:
        if record.frame == frame and _usable(record):
            before = [
                (r.frame, r.curve)
                for r in state.records
                if r.id == record.id and r.frame == frame - way and _usable(r)
            ]
            found.append(Body(record.id, (*before, (frame, record.curve))))
    return tuple(found)


def given_in(state: State, frame: int) -> Given:
    """Give what stays as it is: what the user has accepted, locked, drawn or changed."""
    here = [record for record in state.records if record.frame == frame]
    kept = [record for record in here if _decided(record)]
    curves = {record.id: record.curve for record in kept if _usable(record)}
    accepted = [record.review == "accepted" or record.locked for record in here]
    return Given(curves, whole=bool(here) and all(accepted))


def taken_in(state: State, tracked: Tracked) -> State:
    """Put a tracked frame into what is known; what was decided meanwhile stays."""
    view, refinement = tracked.view, tracked.refinement
    if view is None or refinement is None:
        return state
    frame = tracked.frame
    decided = {r.id for r in state.records if r.frame == frame and _decided(r)}
    deleted = {r.id for r in state.deleted if r.frame == frame}
    fresh = [
        Record(number, frame, sketch, curve, drawn=False)
        for number, sketch, curve in zip(tracked.ids, tracked.sketches, tracked.curves, strict=True)
        if number not in decided | deleted
    ]
    return state.refined(frame, fresh, refined_of(view, refinement, tracked.curves))


def _usable(record: Record) -> bool:
    return record.curve.status != "failed" and record.review != "rejected"


def _decided(record: Record) -> bool:
    """Whether the user has decided on a curve, or made it herself."""
    return record.review == "accepted" or record.locked or record.drawn or record.edited


class Progressing:
    """How far tracking has come, and what became of the bodies.

    Parameters
    ----------
    frames
        To be tracked.
    bodies
        How many there were to begin with.

    Attributes
    ----------
    begun
        Whether any frame has been taken over.
    """

    def __init__(self, frames: Sequence[int], bodies: int):
        self.begun = False
        self._frames, self._bodies = frames, bodies
        self._taken: list[Tracked] = []

    def new(self, results: Sequence[Tracked]) -> list[Tracked]:
        """Give the results that have come since the last call."""
        fresh = list(results[len(self._taken) :])
        self._taken += fresh
        return fresh

    def cancelled(self) -> str:
        """Say what became of it when the user has cancelled."""
        kept = len(self._taken)
        if not kept:
            return "Nothing was changed."
        return f"{words.count(kept, 'frame')} tracked by then {'stays' if kept == 1 else 'stay'}."

    def said(self, error: str) -> str:
        """Say what came of it."""
        if not self._taken:
            return error or "Nothing was tracked."
        last = self._taken[-1]
        arrived = len(last.ids) + len(last.given)
        lost = {number: one.frame for one in self._taken for number in one.lost}
        drifting = Counter(number for one in self._taken for number in one.drifting)
        text = [f"Tracked to frame {last.frame}: {words.count(arrived, 'curve')} there."]
        if lost:
            named = [f"{n} (frame {f})" for n, f in list(lost.items())[:NUMBERS]]
            more = f" and {len(lost) - NUMBERS} more" if len(lost) > NUMBERS else ""
            text.append(f"Lost: {', '.join(named)}{more}.")
        if drifting:
            total = sum(drifting.values())
            text.append(f"{words.count(total, 'curve')} to check for drift.")
        bad = [one for one in self._taken if one.error]
        text += [f"Frame {one.frame} could not be refined: {one.error}" for one in bad[:1]]
        if error:
            text.append(error)
        return " ".join(text)

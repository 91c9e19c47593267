"""Between what is known of a film and what tracking takes and gives; free of Qt and napari."""

from collections.abc import Collection, Sequence
from dataclasses import replace

from napari_splinesketch.engine.types import Curve
from napari_splinesketch.plugin import words
from napari_splinesketch.plugin.engine import refined_of
from napari_splinesketch.plugin.model import Key, Record, State, by_frame, key_of
from napari_splinesketch.tracking import Body, Given, Tracked
from napari_splinesketch.tracking.bodies import MEMORY
from napari_splinesketch.tracking.follow import DIVIDED, LEFT, PATIENCE

NUMBERS = 6
"""Most bodies that are named."""
ENDS = {LEFT: "Left the image", DIVIDED: "Divided"}
"""What is said of bodies that end, by how the reason begins; of others that they are lost."""


def bodies_at(state: State, frame: int, way: int = 1) -> tuple[Body, ...]:
    """Give the bodies that are known in a frame or not long before on that way.

    What comes before tells how they move; one that is not in the frame itself is out of sight
    there, unless it was deleted.
    """
    ways: dict[int, list[tuple[int, Curve]]] = {}
    for record in filter(usable, sorted(state.records, key=lambda r: way * r.frame)):
        if 0 <= way * (frame - record.frame) < PATIENCE:
            ways.setdefault(record.id, []).append((record.frame, record.curve))
    ended = {r.id for r in (*state.deleted, *state.records) if r.frame == frame}
    return tuple(
        Body(number, tuple(seen[-MEMORY:]), abs(frame - seen[-1][0]))
        for number, seen in ways.items()
        if seen[-1][0] == frame or number not in ended
    )


def corrected_at(state: State, frame: int, selected: Collection[Key]) -> tuple[Body, ...]:
    """Give the bodies that the user has corrected in a frame and that are in others as well.

    Of the selected curves, if any of them is in the frame.
    """
    beside = {r.id for r in state.records if abs(r.frame - frame) == 1 and not _decided(r)}
    mine = [
        r
        for r in state.records
        if r.frame == frame and (r.drawn or r.edited) and usable(r) and r.id in beside
    ]
    chosen = [r for r in mine if key_of(r) in selected] or mine
    return tuple(Body(r.id, ((frame, r.curve),)) for r in chosen)


def curves_by_frame(state: State) -> dict[int, dict[int, Curve]]:
    """Give all curves that may stay as they are, by frame and number."""
    return {
        frame: {r.id: r.curve for r in here if usable(r)}
        for frame, here in by_frame(state.records).items()
    }


def given_by_frame(state: State) -> dict[int, Given]:
    """Give what stays as it is: what the user has accepted, locked, drawn or changed."""
    return {
        frame: Given(
            {r.id: r.curve for r in here if _decided(r) and usable(r)},
            whole=all(r.review == "accepted" or r.locked for r in here),
        )
        for frame, here in by_frame(state.records).items()
    }


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


def usable(record: Record) -> bool:
    """Whether a curve can be carried on."""
    return record.curve.status != "failed" and record.review != "rejected"


def _decided(record: Record) -> bool:
    """Whether the user has decided on a curve, or made it herself."""
    return record.review == "accepted" or record.locked or record.drawn or record.edited


class Progressing:
    """How far tracking has come over some `frames`, and what became of the bodies.

    Where curves were `corrected` in a frame, those around it are fitted again. It has `begun` once
    any frame has been taken over; `results` are those that are still to be.
    """

    def __init__(self, frames: Sequence[int], corrected: int | None = None):
        self.begun, self.results = False, list[Tracked]()
        self._frames, self._corrected = frames, corrected
        self._taken: list[Tracked] = []

    @property
    def name(self) -> str:
        """Name of the step."""
        if self._corrected is not None:
            return f"Refit around frame {self._corrected}"
        return f"Track to frame {self._frames[-1]}"

    @property
    def single(self) -> int | None:
        """The frame, where there is but one to go to."""
        return self._frames[0] if len(self._frames) == 1 and self._corrected is None else None

    def new(self) -> list[Tracked]:
        """Give the results that have come since the last call; of those before little is kept."""
        fresh = [self.results.pop(0) for _ in range(len(self.results))]
        # The pictures of a long film would fill the memory.
        self._taken += [replace(one, view=None, refinement=None) for one in fresh]
        return fresh

    def cancelled(self) -> str:
        """Say what became of it when the user has cancelled."""
        kept = len(self._taken)
        if not kept:
            return "Nothing was changed."
        return f"{words.count(kept, 'frame')} tracked by then {'stays' if kept == 1 else 'stay'}."

    def said(self) -> str:
        """Say what came of it."""
        if self._corrected is not None:
            frames = sorted(one.frame for one in self._taken)
            span = f", from {frames[0]} to {frames[-1]}" if frames else ""
            fitted = words.count(len(frames), "frame")
            return f"Refitted {fitted} around frame {self._corrected}{span}."
        if not self._taken:
            return "Nothing was tracked."
        last = self._taken[-1]
        arrived = words.count(len(last.ids) + len(last.given), "curve")
        text = [f"Tracked to frame {last.frame}: {arrived} there.", *self._ended()]
        entered = [one.frame for one in self._taken for _ in one.entered]
        if entered:
            said = words.count(len(entered), "body").replace("bodys", "bodies")
            where = _some([str(frame) for frame in entered])
            text.append(f"{said} came into view, without a curve: frame {where}.")
        drifting = sum(len(one.drifting) for one in self._taken)
        if drifting:
            text.append(f"{words.count(drifting, 'curve')} to check for drift.")
        bad = [one for one in self._taken if one.error]
        text += [f"Frame {one.frame} could not be refined: {one.error}" for one in bad[:1]]
        return " ".join(text)

    def _ended(self) -> list[str]:
        """Name the bodies that are not followed to the end, by what became of them."""
        ended: dict[str, list[str]] = {}
        for one in self._taken:
            for number in one.lost:
                why = one.missing.get(number, "")
                kind = next((said for begin, said in ENDS.items() if why.startswith(begin)), "Lost")
                ended.setdefault(kind, []).append(f"{number} (frame {one.frame})")
        return [f"{kind}: {_some(named)}." for kind, named in ended.items()]


def _some(named: Sequence[str]) -> str:
    more = f" and {len(named) - NUMBERS} more" if len(named) > NUMBERS else ""
    return ", ".join(named[:NUMBERS]) + more

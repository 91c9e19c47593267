"""All that the plugin knows of an image, as one immutable value; what changes it gives another."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from napari_splinesketch.plugin.adapter.film import Patch, patched
from napari_splinesketch.plugin.engine import Refined
from napari_splinesketch.plugin.records import Key, Line, Record, Review, key_of
from napari_splinesketch.plugin.suggestions import Suggestion


@dataclass(frozen=True, eq=False)
class State:
    """The curves of an image and what came with them.

    Whatever the plugin shows and the user may want to take back belongs in here: one step of
    undo is one such value.

    Attributes
    ----------
    records
        The curves of all frames.
    suggestions
        Lines that were suggested.
    deleted
        Curves that the user has deleted, the latest last; their lines are not refined again.
    patches
        Reconstructions by frame, the latest last.
    seconds
        How long the engine took, by frame.
    notes
        What the scene needed and why, by frame.
    """

    records: tuple[Record, ...] = ()
    suggestions: tuple[Suggestion, ...] = ()
    deleted: tuple[Record, ...] = ()
    patches: Mapping[int, Patch] = field(default_factory=dict)
    seconds: Mapping[int, float] = field(default_factory=dict)
    notes: Mapping[int, tuple[str, ...]] = field(default_factory=dict)

    def record(self, key: Key) -> Record | None:
        """Give a record by frame and id."""
        return self.by_key.get(key)

    @cached_property
    def by_key(self) -> Mapping[Key, Record]:
        """Records by frame and id."""
        return {key_of(record): record for record in self.records}

    def with_records(self, *changed: Record) -> "State":
        """Put records in the place of those with the same frame and id, or add them."""
        keys = {key_of(record) for record in changed}
        kept = [record for record in self.records if key_of(record) not in keys]
        return replace(self, records=tuple(sorted([*kept, *changed], key=key_of)))

    def reviewed(self, keys: Collection[Key], review: Review) -> "State":
        """Note what the user says of some curves."""
        return self.with_records(*(replace(r, review=review) for r in self._among(keys)))

    def locked(self, keys: Collection[Key], locked: bool) -> "State":
        """Let some curves stay as they are, or free them."""
        return self.with_records(*(replace(r, locked=locked) for r in self._among(keys)))

    def without(self, keys: Collection[Key]) -> "State":
        """Delete some curves."""
        gone = self._among(keys)
        left = set(self.records).difference(gone)
        kept = tuple(record for record in self.records if record in left)
        return replace(self, records=kept, deleted=(*self.deleted, *gone))

    def restored(self, key: Key) -> "State":
        """Bring a deleted curve back."""
        back = [record for record in self.deleted if key_of(record) == key][-1:]
        left = tuple(record for record in self.deleted if key_of(record) != key)
        return replace(self.with_records(*back), deleted=left)

    def set_aside(self, keys: Collection[Key]) -> "State":
        """Delete curves that are drawn again: under other numbers, as theirs go on."""
        last = max((record.id for record in (*self.records, *self.deleted)), default=0)
        aside = [replace(r, id=last + i) for i, r in enumerate(self._among(keys), 1)]
        return replace(self, deleted=(*self.deleted, *aside))

    def _among(self, keys: Collection[Key]) -> list[Record]:
        return [record for key in sorted(set(keys)) if (record := self.record(key)) is not None]

    def suggested(self, frame: int, lines: Collection[Line]) -> "State":
        """Suggest lines in a frame, in the place of those that have not become curves."""
        refined = {_print(r.sketch) for r in (*self.records, *self.deleted) if r.frame == frame}
        kept = [
            one for one in self.suggestions if one.frame != frame or _print(one.line) in refined
        ]
        fresh = [Suggestion(frame, line) for line in lines]
        return replace(self, suggestions=(*kept, *fresh))

    def refined(self, frame: int, fresh: Collection[Record], refined: Refined) -> "State":
        """Take in the refinement of some curves of a frame."""
        keys = {key_of(record) for record in fresh}
        patch, older = refined.patch, dict(self.patches)
        before = older.pop(frame, None)
        if before and any(r.frame == frame and key_of(r) not in keys for r in self.records):
            patch = patched(before, patch, *refined.region)
        return replace(
            self.with_records(*fresh),
            deleted=tuple(record for record in self.deleted if key_of(record) not in keys),
            patches={**older, frame: patch},
            seconds={**self.seconds, frame: refined.seconds},
            notes={**self.notes, frame: refined.notes},
        )


def _print(line: Line) -> bytes:
    """Lines that have been in a layer are of single precision."""
    return np.round(line, 2).tobytes()


def bytes_beside(state: State, other: State) -> int:
    """Bytes of the pictures that one state holds and another does not."""
    shared = {id(patch) for patch in other.patches.values()}
    own = [patch for patch in state.patches.values() if id(patch) not in shared]
    return sum(patch.nbytes for patch in own)

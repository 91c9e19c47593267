"""All that the plugin knows of an image, as immutable values, and the steps that lead there."""

from collections.abc import Callable, Collection, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import accumulate, count
from operator import attrgetter
from typing import Any, Concatenate, Generic, ParamSpec, TypeVar
from weakref import WeakKeyDictionary

import numpy as np
from jaxtyping import Bool, Float
from psygnal import Signal, SignalGroup
from scipy.optimize import linear_sum_assignment

from napari_splinesketch.engine.spline import apart, resample
from napari_splinesketch.engine.types import Curve, Line, Status
from napari_splinesketch.grids import Patch, patched
from napari_splinesketch.labels.types import Review

V = TypeVar("V", bound=Hashable)
T = TypeVar("T")
A = ParamSpec("A")
Key = tuple[int, int]  # (frame, id) of a record
Marked = tuple[int, bytes]  # (frame, print) of a line

SAME = 2  # decimals of a pixel to which a line is the same as before
SAMPLES = 16  # points at which two lines are compared
# A line is over the body of a curve that it lies so near to, in half-widths on average, and is as
# long as but for a factor: lines over bodies that touch are two apart.
WITHIN, LIKE, APART = 1.25, 0.6, 2.0
LEAST = 1.5  # half-width that counts at least, px: a hand is no steadier
SAME_BODY = 0.25  # lengths of the shorter of two lines over one body, at most, between them
PICTURES = 2**30  # what pictures may hold, bytes: those of the latest frames stay
STEPS = 200  # that are remembered, at most
WEIGHT = 2**29  # what the values that are remembered may hold, bytes
CURVE = 2**13  # what a curve holds of that, about, with what was worked out for it


class Changes(SignalGroup):
    """All that may change, a signal for each kind: whoever shows something listens to that."""

    layers = Signal(description="There are other layers; one is chosen, or has another name")
    edited = Signal(description="What lies in the chosen layers, and where, or what is in view")
    lines = Signal(description="The same, once for many edits in a row where there are many lines")
    drawn = Signal(description="The user has finished a line")
    curves = Signal(description="What is known of the curves, and what can be undone")
    selection = Signal(description="Which curves are selected")
    erased = Signal(description="Delete was pressed in the layer of curves")
    clicked = Signal(bool, description="A click into the layer of curves; with Shift, or without")
    shown = Signal(description="Which layers of results are there and in view")
    mode = Signal(description="The active layer; whether knots are shown; Refine while drawing")
    busy = Signal(description="Whether something runs, and can be cancelled")
    progress = Signal(description="Where what runs stands")
    said = Signal(description="What the dock says came of something")
    settings = Signal(description="What the user chose")
    saved = Signal(description="Where work is saved, and which there is to go on with")


@dataclass(frozen=True, eq=False)
class Record:
    """A curve of one frame, and the (N, 2) sketch it was refined from, px."""

    id: int  # from 1; the same body keeps it when it is refined again
    frame: int
    sketch: Line
    curve: Curve
    review: Review = "open"
    locked: bool = False  # stays as it is
    drawn: bool = True  # the sketch is a line of the user's, not what another curve left
    edited: bool = False  # changed by the user since
    corrected: bool = False  # the same, and refined from there; or turned round, where not drawn
    from_file: bool = False  # its line came with it, from a file

    @property
    def carried(self) -> bool:
        """Whether tracking or a file put it there, and no line of the user's."""
        return self.from_file or not self.drawn

    @property
    def shaped(self) -> bool:
        """Whether the user has changed the curve itself, since or before it was refined."""
        return self.edited or self.corrected

    @property
    def by_hand(self) -> bool:
        """Whether the user drew or changed it: tracking goes on from there."""
        return not self.carried or self.shaped

    @property
    def standing(self) -> Status | Review:
        """Its status, until the user has judged it: then it is good, or rejected."""
        verdict = self.review if self.review != "accepted" else "good"
        return self.curve.status if verdict == "open" else verdict

    @property
    def decided(self) -> bool:
        """Whether the user wants it to stay as it is."""
        return self.locked or self.review == "accepted"

    @property
    def settled(self) -> bool:
        """Whether tracking leaves it as it is."""
        return self.decided or self.by_hand

    @property
    def usable(self) -> bool:
        """Whether it says where a body is."""
        return self.curve.status != "failed" and self.review != "rejected"


@dataclass(frozen=True, eq=False)
class Refined:
    """A refinement in pixels of the image: a curve for each line that was given."""

    curves: tuple[Curve, ...]
    patch: Patch
    notes: tuple[str, ...]  # what the scene needed and why, one sentence each
    # (low, high) corners of the part of the reconstruction that bodies are drawn in
    region: tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]


def once(find: Callable[Concatenate[V, A], T]) -> Callable[Concatenate[V, A], T]:
    """Remember what a function gave for each value, while the value lives, and for the rest."""
    known: WeakKeyDictionary[V, dict[Any, T]] = WeakKeyDictionary()

    def found(value: V, *rest: A.args, **no: A.kwargs) -> T:
        made = known.setdefault(value, {})
        if rest not in made:
            made[rest] = find(value, *rest, **no)
        return made[rest]

    return found


key_of: Callable[[Record], Key] = attrgetter("frame", "id")  # tells it from others


def by_frame(values: Iterable[Any]) -> dict[int, list[Any]]:
    """Give records, or other values that have a frame, by frame."""
    found: dict[int, list[Any]] = {}
    for value in values:
        found.setdefault(value.frame, []).append(value)
    return found


def changed(lines: Sequence[Any], change: Callable[[Any], Any]) -> list[Any]:
    """Change the points of lines, all at once."""
    ends = np.cumsum([len(line) for line in lines])
    return np.split(change(np.concatenate(lines)), ends[:-1]) if lines else []


def prints_of(lines: Sequence[Line]) -> list[bytes]:
    """What lines have in common that are the same, in the single precision of layers or not."""
    rounded = changed(lines, lambda p: np.round(p.astype("f4").astype(float), SAME) + 0.0)
    return [line.tobytes() for line in rounded]


def lengths_of(lines: Sequence[Line]) -> Float[np.ndarray, " N"]:
    """Lengths of lines, px."""
    steps = changed(lines, lambda points: np.hypot(*np.diff(points, axis=0, append=np.nan).T))
    return np.array([each[:-1].sum() for each in steps])


@once
def print_of_sketch(record: Record) -> bytes:
    """What a curve's sketch has in common with lines that are the same."""
    return prints_of([record.sketch])[0]


def identify(
    lines: Sequence[Line],
    known: Sequence[Record],
    others: Iterable[Record],
    sure: Collection[int] = (),
) -> list[int]:
    """Give each sketch of a frame, px, the number it had before, or one that nobody has.

    It is recognised while it lies, on average, within half of its length of where it was; of curves
    that are `sure`, nearer than a body beside it can be.
    """
    ids = [0] * len(lines)
    if known and lines:
        reach = lengths_of(lines)[:, None] / 2
        distance = _distances(lines, [record.sketch for record in known])
        widths = [np.fmax(r.curve.typical_half_width, LEAST) for r in known]
        far = [APART * w if r.id in sure else np.inf for r, w in zip(known, widths, strict=True)]
        distance[distance >= far] = np.inf
        for i, j in zip(*linear_sum_assignment(np.minimum(distance, reach)), strict=True):
            if distance[i, j] < reach[i]:
                ids[i] = known[j].id
    new = count(1 + max([record.id for record in (*known, *others)], default=0))
    return [number or next(new) for number in ids]


def _distances(a: Sequence[Line], b: Sequence[Line]) -> Float[np.ndarray, "A B"]:
    others = np.array([resample(line, SAMPLES) for line in b])
    both = np.stack([others, others[:, ::-1]])
    each = (np.linalg.norm(both - resample(line, SAMPLES), axis=3) for line in a)
    return np.array([away.mean(axis=2).min(axis=0) for away in each])


def new_among(lines: Sequence[Line], known: Sequence[Line]) -> Bool[np.ndarray, " N"]:
    """Say which lines are over bodies that have none already."""
    if not (lines and known):
        return np.ones(len(lines), dtype=bool)
    sizes = np.minimum.outer(lengths_of(lines), lengths_of(known))
    return np.all(_distances(lines, known) >= SAME_BODY * sizes, axis=1)


def lying_over(lines: Sequence[Line], here: Sequence[Record]) -> list[dict[int, float]]:
    """Say over which curves each line lies: their numbers, and how far from it, half-widths.

    A straight line joins the ends of a curve, however that one bends.
    """
    if not here:
        return [{} for _ in lines]
    points = np.stack([record.curve.points for record in here])
    widths = np.fmax([record.curve.typical_half_width for record in here], LEAST)
    near = WITHIN * widths[:, None]
    low, high = points.min(axis=1) - near, points.max(axis=1) + near
    found = []
    for line, length in zip(lines, lengths_of(lines), strict=True):
        beside = (line.min(axis=0) <= high) & (line.max(axis=0) >= low)
        over = dict[int, float]()
        for k in np.flatnonzero(beside.all(axis=1)).tolist():
            curve, share = here[k].curve, length / max(here[k].curve.length, 1e-9)
            far = np.inf
            if LIKE < share < 1 / LIKE:
                far = apart(resample(line, SAMPLES), curve.points).mean()
            if len(line) == 2:
                ends = np.stack([line, line[::-1]]) - curve.points[[0, -1]]
                far = min(far, np.linalg.norm(ends, axis=2).mean(axis=1).min())
            far = float(far / widths[k])
            if curve.status != "failed" and far < WITHIN:
                over[here[k].id] = far
        found.append(over)
    return found


@dataclass(frozen=True, eq=False)
class State:
    """The curves of an image and what came with them: what the user may want to take back."""

    records: tuple[Record, ...] = ()
    suggestions: Mapping[Marked, Line] = field(default_factory=dict)  # that nobody has drawn, px
    deleted: tuple[Record, ...] = ()  # the latest is last; their lines are not refined again
    patches: Mapping[int, Patch] = field(default_factory=dict)  # by frame, the latest is last
    notes: Mapping[int, tuple[str, ...]] = field(default_factory=dict)

    @property
    def last(self) -> int:
        """The highest number that a curve has had."""
        return max([record.id for record in (*self.records, *self.deleted)], default=0)

    @cached_property
    def by_key(self) -> Mapping[Key, Record]:
        """Records by frame and id."""
        return {key_of(record): record for record in self.records}

    def with_records(self, *changed: Record) -> "State":
        """Put records in the place of those with the same frame and id, or add them."""
        keys = {key_of(record) for record in changed}
        kept = [record for record in self.records if key_of(record) not in keys]
        return replace(self, records=tuple(sorted([*kept, *changed], key=key_of)))

    def marked(self, keys: Collection[Key], **marks: Any) -> "State":
        """Note what the user says of some curves, or that they are to stay as they are."""
        known = [self.by_key[key] for key in self.by_key.keys() & keys]
        fresh = [r for r in known if any(getattr(r, name) != m for name, m in marks.items())]
        return self.with_records(*(replace(r, **marks) for r in fresh)) if fresh else self

    def without(self, keys: Collection[Key]) -> "State":
        """Delete some curves."""
        gone = {key: self.by_key[key] for key in sorted(self.by_key.keys() & keys)}
        kept = tuple([record for record in self.records if key_of(record) not in gone])
        return replace(self, records=kept, deleted=(*self.deleted, *gone.values()))

    def restored(self, keys: Collection[Key]) -> "State":
        """Bring deleted curves back, of several with the same frame and id the last."""
        back = {key_of(r): r for r in self.deleted if key_of(r) in keys}
        left = tuple([r for r in self.deleted if key_of(r) not in back])
        return replace(self.with_records(*back.values()), deleted=left)

    def set_aside(self, records: Sequence[Record]) -> "State":
        """Keep curves that were drawn again, as deleted: under other numbers, as theirs go on."""
        aside = [replace(r, id=self.last + i) for i, r in enumerate(records, 1)]
        return replace(self, deleted=(*self.deleted, *aside))

    def suggested(self, frame: int, lines: Sequence[Line]) -> "State":
        """Suggest lines in a frame, in the place of those that have not become curves."""
        there = [record for record in (*self.records, *self.deleted) if record.frame == frame]
        refined = {(frame, print_of_sketch(record)) for record in there}
        known = self.suggestions.items()
        kept = {mark: line for mark, line in known if mark[0] != frame or mark in refined}
        new = {(frame, p): line for p, line in zip(prints_of(lines), lines, strict=True)}
        return replace(self, suggestions=kept | new)

    def refined(self, frame: int, fresh: Collection[Record], refined: Refined) -> "State":
        """Take in the refinement of some curves of a frame."""
        keys = {key_of(record) for record in fresh}
        patch, older = refined.patch, dict(self.patches)
        before = older.pop(frame, None)
        if before and any(r.frame == frame and key_of(r) not in keys for r in self.records):
            patch = patched(before, patch, *refined.region)
        left = tuple([record for record in self.deleted if key_of(record) not in keys])
        latest = [*older.items(), (frame, patch)]
        held = accumulate(known.nbytes for _, known in latest[::-1])
        patches = dict(latest[-max(sum(size <= PICTURES for size in held), 1) :])
        notes = {**self.notes, frame: refined.notes}
        return replace(self.with_records(*fresh), deleted=left, patches=patches, notes=notes)


def bytes_beside(state: State, other: State) -> int:
    """Bytes of the curves and pictures that one state holds and another does not."""
    own = set(state.patches.values()).difference(other.patches.values())
    curves = {record.curve for record in (*state.records, *state.deleted)}
    curves.difference_update(record.curve for record in (*other.records, *other.deleted))
    return sum(patch.nbytes for patch in own) + CURVE * len(curves)


class History(Generic[T]):
    """A value, the ones before it, and those taken back.

    `weigh` gives what a value holds beside the next one, bytes.
    """

    def __init__(self, value: T, weigh: Callable[[T, T], int] = lambda old, new: 0):
        self._weigh = weigh
        self._steps = [("", value, 0)]  # with what the value before it holds beside it, bytes
        self._at = 0

    @property
    def value(self) -> T:
        """The present one."""
        return self._steps[self._at][1]

    @property
    def done(self) -> str:
        """What `undo` would take back; empty if there is nothing."""
        return self._steps[self._at][0]

    @property
    def undone(self) -> str:
        """What `redo` would do again; empty if there is nothing."""
        return self._steps[self._at + 1][0] if self._at + 1 < len(self._steps) else ""

    def apply(self, what: str, value: T) -> None:
        """Put a value in the place of the present one; `what` says why."""
        self._at += 1
        self.amend(value, what)

    def amend(self, value: T, what: str = "") -> None:
        """Put a value in the place of the present one, as part of the last step."""
        what = what or self.done
        del self._steps[self._at :]
        beside = self._weigh(self._steps[-1][1], value) if self._steps else 0
        self._steps.append((what, value, beside))
        # The oldest go where there are too many, or too heavy ones, but not the last.
        weights = accumulate(weight for *_, weight in self._steps[:0:-1])
        light = sum(weight <= WEIGHT for weight in weights)
        self._at = min(max(light, 1), STEPS, len(self._steps) - 1)
        self._steps = self._steps[-1 - self._at :]
        self._steps[0] = ("", self._steps[0][1], 0)

    def undo(self) -> str:
        """Go back by one value; give what was taken back, or nothing."""
        what = self.done
        self._at -= bool(what)
        return what

    def redo(self) -> str:
        """Take back the last `undo`; give what was done again, or nothing."""
        what = self.undone
        self._at += bool(what)
        return what

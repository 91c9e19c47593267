"""What Refine would take up now, with the layers as they are, and what it leaves alone."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

from napari_splinesketch.engine.types import Curve
from napari_splinesketch.plugin import model
from napari_splinesketch.plugin.layers.drawn import Drawn
from napari_splinesketch.plugin.model import Key, Line, Record, State
from napari_splinesketch.tracking.drift import turned

Scope = Literal["new", "selected", "all"]


@dataclass(frozen=True, eq=False)
class Target:
    """A curve to refine, by its number, from its sketch, px, or from where the user has put it."""

    id: int
    sketch: Line
    start: Line
    new: bool = True  # there is no such curve yet
    again: Record | None = None  # of the same body, which it replaces, with the line it has by now
    known: Record | None = None  # it goes on from this one, as the user has left it

    def refined(self, frame: int, curve: Curve) -> Record:
        """Give what becomes of it."""
        if self.known is None:
            return Record(self.id, frame, self.sketch, curve)
        shaped = self.known.shaped
        return replace(self.known, curve=curve, review="open", edited=False, corrected=shaped)


@dataclass(frozen=True, eq=False)
class Plan:
    """What a refinement of one frame would do: the curves that it moves, or takes as they are."""

    scope: Scope = "new"
    targets: tuple[Target, ...] = ()
    fixed: tuple[Curve, ...] = ()
    decided: int = 0  # lines left out, as their curves were accepted or locked
    orphans: tuple[int, ...] = ()  # curves without a line any more; they stay
    deleted: int = 0  # lines left out, as their curves were deleted
    frame: int = 0
    drawn: Drawn = field(default_factory=Drawn)
    problem: str = ""  # why there is nothing to do


def make_plan(
    state: State,
    frame: int,
    drawn: Drawn,
    scope: Scope,
    chosen: Collection[int] = (),
    selection: Collection[Key] = (),
) -> Plan:
    """Decide what to refine of what is known of a frame, and of all its sketches, px.

    A line is new if it has no curve, and changed if its curve was refined from another one. What
    the user has accepted or locked never moves; what she rejected or deleted is left alone until
    she changes its line or selects it: by its position among the `chosen`, or its curve.
    """
    lines, here = drawn.lines, [record for record in state.records if record.frame == frame]
    gone = [record for record in state.deleted if record.frame == frame]
    by_id = {record.id: record for record in (*gone, *here)}
    deleted = {record.id for record in gone} - {record.id for record in here}
    ids, same = _matched(lines, here, gone, state)
    ids, again = _drawn_again(lines, ids, same, here)
    lined, selection, replaced = set(ids), set(selection), set(again.values())
    line_of = {n: lines[i] for i, n in enumerate(ids) if n in replaced and i not in again}
    found = [(i, again.get(i, n)) for i, n in enumerate(ids) if i in again or n not in replaced]
    alone = [] if chosen else [(-1, record.id) for record in here if record.id not in lined]
    targets, decided = dict[int, Target](), 0  # of lines that are the same, one
    for i, number in (*found, *alone):
        known, kept = by_id.get(number), i < 0 or same[i]
        goes_on = i < 0 or (known is not None and (known.shaped or known.from_file))
        asked = i in chosen or (scope != "new" and (frame, number) in selection)
        if not (asked or (not chosen and _wanted(scope, known, kept, number in deleted))):
            continue
        if known is not None and number not in deleted and known.decided:
            decided += asked or i >= 0
        elif known and kept and goes_on and number not in deleted:
            start = known.curve.points
            targets[number] = Target(number, known.sketch, start, new=False, known=known)
        else:
            start = lines[i]
            if known is not None and (kept or known.carried):
                # As its curve runs, which the user may have turned, or its body in other frames.
                start = turned(start, known.curve.points)
            over = known if i in again or (known and known.from_file and not kept) else None
            if over and number in line_of:  # that line may have been moved since
                over = replace(over, sketch=line_of[number], drawn=True)
            targets[number] = Target(number, lines[i], start, known is None, again=over)
    orphans = tuple([r.id for r in here if r.drawn and r.id not in lined])
    fixed = tuple([r.curve for r in here if r.usable and r.id not in targets])
    left_alone = len((lined & deleted).difference(targets))
    return Plan(scope, tuple(targets.values()), fixed, decided, orphans, left_alone, frame, drawn)


def _wanted(scope: Scope, known: Record | None, same: bool, gone: bool) -> bool:
    """Whether a line, or a curve without one, is taken up though nobody has selected it."""
    if scope == "selected":
        return False
    if known is None or not same:
        return True
    return not gone and (known.edited or (scope == "all" and known.review == "open"))


def _matched(
    lines: Sequence[Line], here: Sequence[Record], gone: Sequence[Record], state: State
) -> tuple[list[int], list[bool]]:
    """Give each line its curve's number, or a new one; and whether it is as it was."""
    drawn = [record for record in (*here, *gone) if record.drawn]
    exact: dict[bytes, list[int]] = {}
    for record in drawn:
        exact.setdefault(model.print_of_sketch(record), []).append(record.id)
    named = (exact.get(known, [0]) for known in model.prints_of(lines))
    # The same line twice, as pasting makes it: each has its own curve, or both have the only one.
    found = [ids.pop(0) if len(ids) > 1 else ids[0] for ids in named]
    taken = set(found)
    rest = [line for line, number in zip(lines, found, strict=True) if not number]
    # A line over a curve that was carried here from another frame puts that one right, also where
    # it was deleted; but beside a good one there may be another body.
    elsewhere = {r.id for r in state.records if r.frame != (here[0].frame if here else -1)}
    known = (*gone, *(r for r in here if not r.decided))
    carried = {r: None for r in known if r.id in elsewhere and r.carried}
    # The line that a file brought for a curve is there, too, where another one puts it right.
    either = dict.fromkeys((*drawn, *carried))
    left = [r for r in either if r.id not in taken or (r.from_file and r in carried)]
    unmoved = (r for r in here if r.carried and (not r.drawn or r.id in taken))
    sure = {r.id for r in unmoved if r.curve.status == "good"}
    numbers = iter(model.identify(rest, left, (*state.records, *state.deleted), sure))
    return [number or next(numbers) for number in found], [bool(number) for number in found]


def _drawn_again(
    lines: Sequence[Line], ids: Sequence[int], same: Sequence[bool], here: Sequence[Record]
) -> tuple[list[int], dict[int, int]]:
    """Find new lines that lie within a body that has a curve; the numbers of these curves.

    Of a line that was moved and a new one over its body, the later is the new one. Numbers of all
    lines come first.
    """
    ids, known = list(ids), {record.id for record in here}
    fresh = [i for i, number in enumerate(ids) if number not in known]
    found: dict[int, int] = {}
    for i, over in zip(fresh, model.lying_over([lines[i] for i in fresh], here), strict=True):
        apart = {far: number for number, far in over.items() if number not in found.values()}
        if apart:
            found[i] = number = apart[min(apart)]
            moved = ids.index(number) if number in ids else 0
            if moved > i and not same[moved]:
                ids[i], ids[moved] = number, ids[i]
                found[moved] = found.pop(i)
    return ids, found

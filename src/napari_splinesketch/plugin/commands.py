"""What the user can do: one table, which buttons, keys, tooltips and the manifest follow."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from napari.components import ViewerModel
from napari.utils.key_bindings import coerce_keybinding

from napari_splinesketch import editing
from napari_splinesketch.engine.types import Curve, InputError
from napari_splinesketch.plugin import films, words
from napari_splinesketch.plugin.layers import looks, space
from napari_splinesketch.plugin.model import Key, Record, Review, key_of

if TYPE_CHECKING:
    from napari_splinesketch.plugin.controller import Controller
else:
    Controller = Any

REACH = 8.0  # how far from a curve the pointer may be to mean it, px, where its body is not broader
RUNNING = "Something is running: wait until it is finished"
Place = Literal["", "curve", "film", "steps", "review"]  # where a command has a button
ANY, ONE, TWO = "a curve", "one curve", "two curves"  # that have to be selected for a command


@dataclass(frozen=True, eq=False)
class Command:
    """Something that the user can do."""

    id: str  # by which settings know it
    name: str
    key: str  # as napari writes it: "Ctrl+Z"
    run: Callable[[Controller], object]
    tip: str
    place: Place = ""
    curves: str = ""  # how many have to be selected
    problem: Callable[[Controller], str] = lambda c: ""  # why else it cannot be done now
    label: Callable[[Controller], str] | None = None  # of the button, if not the name
    about: Callable[[Controller], str] = lambda c: ""  # at the end of the tooltip
    meanwhile: bool = False  # also while something runs


def _flipped(record: Record) -> Record:
    shaped = record.corrected or record.carried
    return replace(record, curve=editing.flipped(record.curve), corrected=shaped)


def _split(c: Controller, record: Record) -> list[Record]:
    at = editing.nearest(record.curve, _place_beside(c, record))[0]
    first, rest = editing.split(record.curve, at)
    number, place = c.state.last + 1, record.frame
    other = Record(number, place, rest.points, rest, drawn=False, edited=True)
    return [edited(record, first), other]


def _join(c: Controller, first: Record, second: Record) -> list[Record]:
    if first.frame != second.frame:
        raise InputError("Select two curves of this frame to join.")
    return [edited(first, editing.joined(first.curve, second.curve))]


def _extend(c: Controller, record: Record) -> list[Record]:
    curve = record.curve
    apart = np.linalg.norm(curve.points[[0, -1]] - _place_beside(c, record), axis=1)
    longer = editing.extended(curve, bool(apart[1] <= apart[0]), editing.body_width(curve))
    return [edited(record, longer)]


def _shape(verb: str, change: Callable[..., list[Record]]) -> Callable[[Controller], bool]:

    def run(c: Controller) -> bool:
        chosen = c.selected_records()
        locked = [record for record in chosen if record.locked]
        try:
            if locked:
                raise InputError(words.locked(locked))
            made = change(c, *chosen)
        except InputError as error:
            c.say(str(error))
            return False
        keys, before = list(map(key_of, made)), list(map(key_of, chosen))
        gone = [key for key in before if key not in keys]
        c.apply(f"{verb} {words.curves(before)}", c.state.without(gone).with_records(*made))
        c.select(keys)
        return True

    return run


def _place_beside(c: Controller, record: Record) -> np.ndarray:
    """Where the pointer is, px; for a button, where the curve was clicked."""
    if problem := space.plane_problem(c.viewer, c.image):
        raise InputError(problem)
    if c.actions.by_button and not _reached(record, c.clicked):
        raise InputError("Click the curve there first, or point there and press the key.")
    return c.clicked if c.actions.by_button else _place(c)


def _reached(record: Record, place: np.ndarray) -> bool:
    return editing.nearest(record.curve, place)[1] < max(REACH, editing.body_width(record.curve))


def _all_locked(controller: Controller) -> bool:
    chosen = controller.selected_records()
    return bool(chosen) and all(record.locked for record in chosen)


def pick(controller: Controller, *, add: bool = False) -> None:
    """Select the curve that the pointer is at, beside those selected or instead of them."""
    controller.clicked = place = _place(controller)
    reached = [record for record in controller.records(controller.frame) if _reached(record, place)]
    chosen = controller.selection if add else ()
    if reached:
        key = key_of(min(reached, key=lambda record: editing.nearest(record.curve, place)[1]))
        chosen = tuple(k for k in chosen if k != key) if key in chosen else (*chosen, key)
    controller.select(chosen)


def _empty(c: Controller) -> str:
    return "" if c.records() else "There are no curves yet: refine first"


def _restore(c: Controller) -> None:
    c.restore()
    if c.unseen:
        go_to(c, c.selection[0])


def worst_first(records: Sequence[Record]) -> list[Record]:
    """Give curves in the order in which they need review."""
    return sorted(records, key=lambda record: looks.severity(record.curve), reverse=True)


def judge(controller: Controller, review: Review | None = None) -> None:
    """Say what the user thinks of the selected curves, and go on to the next open one, if any.

    Of a curve that is not in view nothing is said: it is shown first.
    """
    order, chosen = controller.order(controller.records()), set(controller.selection)
    if review and controller.unseen:
        go_to(controller, min(chosen))
        controller.tell()
        return
    if review and chosen:
        controller.review(review)
    now = controller.state.by_key
    keys = [key for key in map(key_of, order) if key in now]
    at = max((i for i, key in enumerate(keys) if key in chosen), default=-1)
    ahead = (key for key in (*keys[at + 1 :], *keys[: at + 1]) if now[key].review == "open")
    if key := next(ahead, None):
        go_to(controller, key)
    else:
        controller.tell("No curve is left to review here.")


def go_to(controller: Controller, key: Key) -> None:
    """Select a curve, and bring it to the middle of the canvas."""
    record, image = controller.state.by_key.get(key), controller.image
    if record is not None and image is not None:
        controller.select((key,))
        space.look_at(controller.viewer, image, record.frame, record.curve.points)


def edited(record: Record, curve: Curve) -> Record:
    """Put a changed curve into a record; what was said of the old one no longer holds."""
    return replace(record, curve=curve, edited=True, review="open")


def _place(controller: Controller) -> np.ndarray:
    """(row, col) that the pointer is at, px of the image."""
    viewer, image = controller.viewer, controller.image
    if image is None:
        return np.full(2, np.nan)
    position = np.array(viewer.cursor.position)[None, -image.ndim :]
    return space.from_world(viewer, image, position)[0, -2:]


COMMANDS = (
    Command("draw", "Draw lines", "H", lambda c: c.draw(or_select=not c.actions.by_button),
            "Draw lines: press where a body begins, release where it ends",
            problem=lambda c: space.plane_problem(c.viewer, c.image), meanwhile=True),
    Command("refine", "Refine", "G", lambda c: c.refine(),
            "Fit a smooth curve with width to the body under each line",
            problem=lambda c: "" if c.knots else c.request().problem,
            label=lambda c: f"Refine curve {c.knots.number}" if c.knots else
            words.button(c.request())),
    Command("at_once", "Refine while drawing", "Shift+G", lambda c: c.toggle_at_once(),
            "Refine each line as soon as it is drawn, while you draw the next", meanwhile=True),
    Command("knots", "Knots", "U", lambda c: c.toggle_knots(),
            "Drag the knots of the selected curve", "curve", ONE,
            label=lambda c: "Done" if c.knots else "Knots"),
    Command("flip", "Flip", "Shift+H",
            _shape("Flip", lambda c, *of: [_flipped(record) for record in of]),
            "Swap head and tail of the selected curves", "curve", ANY),
    Command("split", "Split", "Shift+U", _shape("Split", _split),
            "Cut the curve where you point, or clicked it", "curve", ONE),
    Command("join", "Join", "Shift+J", _shape("Join", _join),
            "Join the two selected curves into one", "curve", TWO),
    Command("extend", "Extend", "Shift+N",
            lambda c: _shape("Extend", _extend)(c) and c.refine("selected"),
            "Lengthen the end you point at, or clicked, and refine", "curve", ONE),
    Command("lock", "Lock", "Shift+K", lambda c: c.lock(not _all_locked(c)),
            "Keep the selected curves as they are", "curve", ANY,
            label=lambda c: "Unlock" if _all_locked(c) else "Lock"),
    Command("delete", "Delete", "Shift+Q", lambda c: c.delete(),
            "Delete the selected curves; their lines stay", "curve", ANY),
    Command("restore", "Restore", "Shift+W", _restore,
            "Bring the last deleted curve back", "curve",
            problem=lambda c: "" if c.state.deleted else "No curve is deleted"),
    Command("undo", "Undo", "Ctrl+Z", lambda c: c.undo(), "Undo the last step", "steps",
            problem=lambda c: "" if c.steps.done else "There is nothing to undo",
            about=lambda c: f": {c.steps.done[:1].lower()}{c.steps.done[1:]}"),
    Command("redo", "Redo", "Ctrl+Shift+Z", lambda c: c.redo(), "Redo what was undone", "steps",
            problem=lambda c: "" if c.steps.undone else "There is nothing to redo",
            about=lambda c: f": {c.steps.undone[:1].lower()}{c.steps.undone[1:]}"),
    Command("accept", "Accept", "J", lambda c: judge(c, "accepted"),
            "Accept the curve and go on to the next", "review", problem=_empty, meanwhile=True),
    Command("reject", "Reject", "K", lambda c: judge(c, "rejected"),
            "Reject the curve and go on to the next", "review", problem=_empty, meanwhile=True),
    Command("next", "Next", "N", judge, "Go on to the next curve to review", "review",
            problem=_empty, meanwhile=True),
    Command("suggest", "Suggest lines", "W", lambda c: c.suggestions.suggest(),
            "Draw a line over each body that stands out in this frame",
            problem=lambda c: c.problem),
    Command("previous_frame", "◂ Previous", "Shift+F", lambda c: films.track(c, -1, 1),
            "Carry the curves to the previous frame, refine them there and show it", "film",
            problem=lambda c: films.tracking_problem(c, -1)),
    Command("next_frame", "Next ▸", "Q", lambda c: films.track(c, 1, 1),
            "Carry the curves to the next frame, refine them there and show it", "film",
            problem=lambda c: films.tracking_problem(c, 1)),
    Command("track_back", "◂ Track to first", "", lambda c: films.track(c, -1),
            "Carry the curves back to the first frame", "film",
            problem=lambda c: films.tracking_problem(c, -1)),
    Command("track", "Track to last ▸", "", lambda c: films.track(c, 1),
            "Carry the curves on to the last frame", "film",
            problem=lambda c: films.tracking_problem(c, 1)),
    Command("around", "Refit around", "", films.around,
            "Carry the curves that you corrected in this frame, or just the selected ones,\n"
            "to the frames before and after it, as far as that changes anything", "film",
            problem=films.around_problem),
)  # fmt: skip


def _as_napari_writes(key: str) -> str:
    """Write a key as napari does, whatever its case; empty if there is no such key."""
    binding = coerce_keybinding(key)
    return str(binding) if all(part.key for part in binding.parts) else ""


class Commands:
    """The commands that act on a controller, by keys that nobody else in its viewer wants."""

    def __init__(self, controller: Controller, table: tuple[Command, ...] = COMMANDS):
        self._controller, self._viewer = controller, controller.viewer
        self.table = {command.id: command for command in table}
        self.keys: dict[str, str] = {}
        self._bound: dict[Any, Callable[[ViewerModel], None]] = {}
        self.rebind({})

    def run(self, name: str, *, by_button: bool = False) -> None:
        """Do it, to the curve that is pointed at where none in view is selected; or say why not."""
        command, c, self.by_button = self.table[name], self._controller, by_button
        unselected = f"Select {command.curves}"
        lacking = command.curves and (c.unseen or (not c.selection and unselected))
        if lacking and self.problem(name) == lacking:
            before = c.selection
            pick(c)
            c.select(c.selection or before)
        problem = self.problem(name)
        if problem == unselected:
            two = command.curves == TWO
            problem += ": click one, Shift-click the other." if two else ", or point at it."
        if not problem:
            command.run(c)
        elif command.place:
            c.say(problem)

    def tip(self, name: str) -> str:
        """Say what a command does, and by which key."""
        key = f" ({self.keys[name]})" if self.keys[name] else ""
        return f"{self.table[name].tip}{key}{self.table[name].about(self._controller)}"

    def problem(self, name: str) -> str:
        """Say why a command cannot be carried out now; empty if it can."""
        command, c = self.table[name], self._controller
        if name == "knots" and c.knots:  # they can be put away, whatever is selected by now
            return ""
        if c.progress and not command.meanwhile:
            return RUNNING
        if command.curves and c.unseen:
            return c.unseen
        number = len(c.selection) if command.curves else 0
        enough = {"": True, ANY: number > 0, ONE: number == 1, TWO: number == 2}[command.curves]
        return command.problem(c) or ("" if enough else f"Select {command.curves}")

    def label(self, name: str) -> str:
        """Say what the button of a command is called now."""
        command, key = self.table[name], self.keys[name]
        said = command.label(self._controller) if command.label else command.name
        return f"{said} ({key})" if command.place == "review" and key else said  # with room for it

    def rebind(self, keys: Mapping[str, str]) -> str:
        """Give commands other keys; one that was given a key gets it before its usual owner.

        Says what is no key: napari would take it for all keys that it does not know.
        """
        usual = {command.id: command.key for command in self.table.values()}
        given = {name: keys.get(name, key) for name, key in usual.items()}
        wanted = {name: _as_napari_writes(key) for name, key in given.items()}
        last = sorted(wanted, key=lambda name: wanted[name] != usual[name])
        owners = {wanted[name]: name for name in last}
        self.keys = {name: key if owners[key] == name else "" for name, key in wanted.items()}
        self.close()
        for name, key in self.keys.items():
            if key:
                self._bind(name, coerce_keybinding(key))
        wrong = [name for name, key in given.items() if key.strip() and not wanted[name]]
        return words.no_keys({self.table[name].name: given[name] for name in wrong})

    def _bind(self, name: str, key: Any) -> None:
        def press(viewer: ViewerModel) -> None:
            if self._controller.is_meant():
                self.run(name)

        press.__name__, press.__doc__ = name, self.table[name].tip
        taken = self._viewer.keymap.get(key)
        # One that is ours is of a dock that was closed, or shown again: this one takes over.
        if taken is None or getattr(taken, "__module__", "") == __name__:
            self._bound[key] = press
            self._viewer.bind_key(key, press, overwrite=True)

    def close(self) -> None:
        """Give all keys back."""
        for key, press in self._bound.items():
            if self._viewer.keymap.get(key) is press:
                self._viewer.bind_key(key, None)
        self._bound.clear()

"""What the user can do: one table, which buttons, keys, tooltips and the manifest follow."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from sys import maxsize
from typing import TYPE_CHECKING, Any, Literal
from weakref import WeakSet

from napari.components import ViewerModel
from napari.utils.key_bindings import coerce_keybinding

if TYPE_CHECKING:
    from napari_splinesketch.plugin.controller import Controller
else:
    Controller = Any

Place = Literal["", "curve", "film", "review"]
"""Where a command has a button: with the selected curve, with a film, in the table of curves."""
ANY, ONE, TWO = range(1, maxsize), range(1, 2), range(2, 3)
"""How many curves a command is for."""


@dataclass(frozen=True, eq=False)
class Command:
    """Something that the user can do.

    Attributes
    ----------
    id
        By which settings know it.
    name
        What its button says.
    key
        The key that does it, as napari writes it ("Ctrl+Z"); empty for none.
    run
        Does it.
    tip
        What it does, in one sentence.
    place
        Where it has a button, if not one of its own.
    curves
        How many curves have to be selected for its button; None where that does not matter.
    """

    id: str
    name: str
    key: str
    run: Callable[[Controller], object]
    tip: str
    place: Place = ""
    curves: range | None = None


COMMANDS = (
    Command("draw", "Draw lines", "H", lambda c: c.draw_or_select(),
            "Draw lines, or go back to selecting curves"),
    Command("refine", "Refine", "G", lambda c: c.refine(), "Refine what is new or changed"),
    Command("at_once", "Refine while drawing", "Shift+G", lambda c: c.toggle_at_once(),
            "Refine each line as soon as it is drawn, while you draw the next"),
    Command("knots", "Knots", "U", lambda c: c.knots.toggle(),
            "Drag the knots of the selected curve", "curve", ONE),
    Command("flip", "Flip", "Shift+H", lambda c: c.corrections.flip(),
            "Swap head and tail of the selected curves", "curve", ANY),
    Command("split", "Split", "Shift+U", lambda c: c.corrections.split(),
            "Cut the curve where you point", "curve", ONE),
    Command("join", "Join", "Shift+J", lambda c: c.corrections.join(),
            "Make one curve of the two that are selected", "curve", TWO),
    Command("extend", "Extend", "Shift+N", lambda c: c.corrections.extend(),
            "Lengthen the end you point at, and refine", "curve", ONE),
    Command("lock", "Lock", "Shift+K", lambda c: c.toggle_lock(),
            "Keep the selected curves as they are", "curve", ANY),
    Command("delete", "Delete", "Shift+Q", lambda c: c.delete(),
            "Delete the selected curves; their lines stay", "curve", ANY),
    Command("restore", "Restore", "Shift+W", lambda c: c.restore(),
            "Bring the last deleted curve back", "curve"),
    Command("undo", "Undo", "Ctrl+Z", lambda c: c.undo(), "Undo the last step"),
    Command("redo", "Redo", "Ctrl+Shift+Z", lambda c: c.redo(), "Redo what was undone"),
    Command("accept", "Accept", "J", lambda c: c.reviewing.accept(),
            "Accept the curve and go on to the next", "review"),
    Command("reject", "Reject", "K", lambda c: c.reviewing.reject(),
            "Reject the curve and go on to the next", "review"),
    Command("next", "Next", "N", lambda c: c.reviewing.next(),
            "Go on to the next curve to review", "review"),
    Command("suggest", "Suggest lines", "W", lambda c: c.films.suggest(),
            "Draw a line over each body that stands out in this frame"),
    Command("previous_frame", "◂ Previous", "Shift+F", lambda c: c.films.track(-1, 1),
            "Carry the curves to the previous frame, refine them there and show it", "film"),
    Command("next_frame", "Next ▸", "Q", lambda c: c.films.track(1, 1),
            "Carry the curves to the next frame, refine them there and show it", "film"),
    Command("track_back", "◂ Track to first", "", lambda c: c.films.track(-1),
            "Carry the curves back to the first frame", "film"),
    Command("track", "Track to last ▸", "", lambda c: c.films.track(1),
            "Carry the curves on to the last frame", "film"),
)  # fmt: skip


Bound = Callable[[ViewerModel], None]


class Commands:
    """The commands, bound to keys of a viewer.

    The keys of napari's layers and of other plugins come first: these are only heard where
    nobody else wants them.

    Parameters
    ----------
    viewer
        Whose keys are bound.
    controller
        What the commands act on.
    heard
        Whether a key is meant for us, when it is pressed.
    table
        What there is to do.
    """

    def __init__(
        self,
        viewer: ViewerModel,
        controller: Any,
        heard: Callable[[], bool],
        table: tuple[Command, ...] = COMMANDS,
    ):
        self._viewer, self._controller, self._heard = viewer, controller, heard
        self._commands: dict[str, Command] = {}
        self._bound: dict[str, Bound] = {}
        self._put(*table)

    def __iter__(self) -> Iterator[Command]:
        return iter(self._commands.values())

    def __getitem__(self, name: str) -> Command:
        return self._commands[name]

    def at(self, place: Place) -> list[str]:
        """Give the commands whose buttons belong to a place."""
        return [command.id for command in self if command.place == place]

    def run(self, name: str) -> None:
        """Do it."""
        self._commands[name].run(self._controller)

    def tip(self, name: str) -> str:
        """Say what a command does, and by which key."""
        command = self._commands[name]
        return f"{command.tip} ({command.key})" if command.key else command.tip

    def rebind(self, keys: Mapping[str, str]) -> None:
        """Give commands other keys, by their ids; with an empty one, none."""
        chosen = [replace(c, key=keys[c.id]) for c in self if c.id in keys]
        for command in chosen:
            self._unbind(command.id)
        self._put(*chosen)

    def bound(self, name: str) -> bool:
        """Whether a command has its key: another plugin may have taken it first."""
        return name in self._bound

    def close(self) -> None:
        """Give all keys back."""
        for name in list(self._bound):
            self._unbind(name)

    def _put(self, *commands: Command) -> None:
        for command in commands:
            self._commands[command.id] = command
            if not command.key:
                continue
            key = coerce_keybinding(command.key)
            taken = self._viewer.keymap.get(key)
            if taken is None or taken in _ours:
                self._bound[command.id] = bound = self._key_of(command)
                self._viewer.bind_key(key, bound, overwrite=True)

    def _unbind(self, name: str) -> None:
        bound = self._bound.pop(name, None)
        if bound is not None:
            key = coerce_keybinding(self._commands[name].key)
            if self._viewer.keymap.get(key) is bound:
                self._viewer.bind_key(key, None)

    def _key_of(self, command: Command) -> Bound:
        """Give what is bound: a plain function, as napari wants it, that is known as ours."""

        def press(viewer: ViewerModel) -> None:
            if self._heard():
                command.run(self._controller)

        press.__name__, press.__doc__ = command.id, command.tip
        _ours.add(press)
        return press


_ours: WeakSet[Bound] = WeakSet()
"""Of all docks: one that is opened again takes the keys over."""

"""What can be done with a key: one table, which the dock lists and settings may change."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from weakref import WeakSet

from napari.components import ViewerModel
from napari.utils.key_bindings import coerce_keybinding

Bound = Callable[[ViewerModel], None]


@dataclass(frozen=True, eq=False)
class Action:
    """Something that the user can do.

    Attributes
    ----------
    id
        By which settings know it.
    name
        What it is called in the dock.
    key
        The key that does it, as napari writes it ("Ctrl+Z"); empty for none.
    run
        Does it.
    tip
        What it does, in one sentence.
    """

    id: str
    name: str
    key: str
    run: Callable[[], object]
    tip: str


class Actions:
    """The actions, bound to keys of a viewer.

    The keys of napari's layers and of other plugins come first: these are only heard where
    nobody else wants them.

    Parameters
    ----------
    viewer
        Whose keys are bound.
    heard
        Whether a key is meant for us, when it is pressed.
    """

    def __init__(self, viewer: ViewerModel, heard: Callable[[], bool]):
        self._viewer = viewer
        self._heard = heard
        self._actions: dict[str, Action] = {}
        self._bound: dict[str, Bound] = {}

    def __iter__(self) -> Iterator[Action]:
        return iter(self._actions.values())

    def __getitem__(self, name: str) -> Action:
        return self._actions[name]

    def add(self, *actions: Action) -> None:
        """Take actions into the table, and bind their keys."""
        for action in actions:
            self._unbind(action.id)
            self._actions[action.id] = action
            self._bind(action)

    def rebind(self, keys: Mapping[str, str]) -> None:
        """Give actions other keys, by their ids; an empty one takes the key away."""
        chosen = [replace(a, key=keys[a.id]) for a in self if a.id in keys]
        for action in chosen:
            self._unbind(action.id)
        self.add(*chosen)

    def bound(self, name: str) -> bool:
        """Whether an action has its key: another plugin may have taken it first."""
        return name in self._bound

    def close(self) -> None:
        """Give all keys back."""
        for name in list(self._bound):
            self._unbind(name)

    def _bind(self, action: Action) -> None:
        if not action.key:
            return
        key = coerce_keybinding(action.key)
        taken = self._viewer.keymap.get(key)
        if taken is None or taken in _ours:
            self._bound[action.id] = bound = _key_of(action, self._heard)
            self._viewer.bind_key(key, bound, overwrite=True)

    def _unbind(self, name: str) -> None:
        bound = self._bound.pop(name, None)
        if bound is not None:
            key = coerce_keybinding(self._actions[name].key)
            if self._viewer.keymap.get(key) is bound:
                self._viewer.bind_key(key, None)


def _key_of(action: Action, heard: Callable[[], bool]) -> Bound:
    """Give what is bound: a plain function, as napari wants it, that is known as ours."""

    def press(viewer: ViewerModel) -> None:
        if heard():
            action.run()

    press.__name__, press.__doc__ = action.id, action.tip
    _ours.add(press)
    return press


_ours: WeakSet[Bound] = WeakSet()
"""Of all docks: one that is opened again takes the keys over."""

"""What was found of a value that never changes need not be found again."""

from collections.abc import Callable, Hashable
from typing import TypeVar
from weakref import WeakKeyDictionary

V = TypeVar("V", bound=Hashable)
T = TypeVar("T")


def once(find: Callable[[V], T]) -> Callable[[V], T]:
    """Remember what a function gave for each value, while the value lives."""
    known: WeakKeyDictionary[V, T] = WeakKeyDictionary()

    def found(value: V) -> T:
        try:
            return known[value]
        except KeyError:
            return known.setdefault(value, find(value))

    return found

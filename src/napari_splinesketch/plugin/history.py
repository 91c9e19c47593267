"""Steps that can be taken back: immutable values, one after the other."""

from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")

STEPS = 200
"""That are remembered, at most."""
WEIGHT = 2**29
"""What the values that are remembered may hold, bytes."""


class History(Generic[T]):
    """A value, the ones before it, and those that were taken back.

    Parameters
    ----------
    value
        The first value.
    weigh
        Gives the bytes that a value holds and does not share with the one before it.
    """

    def __init__(self, value: T, weigh: Callable[[T, T], int] = lambda new, old: 0):
        self.value = value
        self._weigh = weigh
        self._done: list[tuple[str, T]] = []
        self._undone: list[tuple[str, T]] = []

    @property
    def done(self) -> str:
        """What `undo` would take back; empty if there is nothing."""
        return self._done[-1][0] if self._done else ""

    @property
    def undone(self) -> str:
        """What `redo` would do again; empty if there is nothing."""
        return self._undone[-1][0] if self._undone else ""

    def apply(self, what: str, value: T) -> None:
        """Put a value in the place of the present one; `what` says why."""
        self._done.append((what, self.value))
        self._undone.clear()
        self.value = value
        self._forget()

    def amend(self, value: T) -> None:
        """Put a value in the place of the present one, as part of the last step."""
        self._undone.clear()
        self.value = value
        self._forget()

    def undo(self) -> str:
        """Go back by one value; give what was taken back, or nothing."""
        return self._step(self._done, self._undone)

    def redo(self) -> str:
        """Take back the last `undo`; give what was done again, or nothing."""
        return self._step(self._undone, self._done)

    def _step(self, source: list[tuple[str, T]], target: list[tuple[str, T]]) -> str:
        if not source:
            return ""
        what, value = source.pop()
        target.append((what, self.value))
        self.value = value
        return what

    def _forget(self) -> None:
        """Drop the oldest values where there are too many, or too heavy ones."""
        weight, newer = 0, self.value
        for i in range(len(self._done) - 1, -1, -1):
            older = self._done[i][1]
            weight += self._weigh(older, newer)
            if len(self._done) - i > STEPS or weight > WEIGHT:
                del self._done[: i + 1]
                return
            newer = older

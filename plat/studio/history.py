"""Undo and redo over immutable states."""

from collections.abc import Hashable
from typing import Generic, TypeVar

__all__ = ["History"]

State = TypeVar("State")


class History(Generic[State]):
    """Undo history: the current state, earlier ones and undone ones.

    Args:
        state: to begin with.
        limit: how many steps can be undone.

    >>> history = History("a")
    >>> history.do("b"); history.do("c")
    >>> history.undo(); history.state
    'b'
    >>> history.redo(); history.state
    'c'
    """

    def __init__(self, state: State, limit: int = 500):
        self.state = state
        """The present state; to assign to it is no step of its own."""
        self._limit = limit
        self._past: list[State] = []
        self._future: list[State] = []
        self._gesture: Hashable = None

    @property
    def can_undo(self) -> bool:
        """Return whether there is a step to undo."""
        return bool(self._past)

    @property
    def can_redo(self) -> bool:
        """Return whether there is an undone step."""
        return bool(self._future)

    def do(self, state: State, gesture: Hashable = None) -> None:
        """Go to a new state.

        Args:
            state: the new state.
            gesture: what it is part of: steps of one gesture that follow each other, such as those of a slider that is
                being dragged, are undone together.
        """
        if gesture is None or gesture != self._gesture:
            self._past = [*self._past, self.state][-self._limit :]
        self._gesture = gesture
        self._future.clear()
        self.state = state

    def end_gesture(self) -> None:
        """End the gesture: the next step is undone separately."""
        self._gesture = None

    def undo(self) -> None:
        """Go back to the state before the last step, if there is one."""
        self._swap(self._past, self._future)

    def redo(self) -> None:
        """Go forward by one undone step, if there is one."""
        self._swap(self._future, self._past)

    def _swap(self, source: list[State], target: list[State]) -> None:
        self._gesture = None
        if source:
            target.append(self.state)
            self.state = source.pop()

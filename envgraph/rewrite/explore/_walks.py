"""Navigation of a model between the states of an exploration, and back to the first state."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator

from envgraph.graph import Model, Savepoint, Shelf, Version, guarded


class Walk(ABC):
    """A position in the tree of the states found so far; state 0 is the first.

    The caller calls `attempt`, makes a move, and calls either `back`, or `keep` and then `park`.
    """

    @abstractmethod
    def attempt(self) -> None:
        """Prepare for a move from the current state."""

    @abstractmethod
    def back(self) -> None:
        """Undo the attempted move."""

    @abstractmethod
    def keep(self) -> Version | None:
        """Accept the new state after the move. Return its version, or None if the walk stores no versions."""

    @abstractmethod
    def park(self, state: int) -> None:
        """Store the new state under a number for `go`, and undo the move."""

    @abstractmethod
    def go(self, state: int) -> None:
        """Restore a state that `park` has stored, or the first state."""


class SavepointWalk(Walk):
    """A walk inside a transaction, with one savepoint for each move from the first state to the current one.

    The time to restore a state is proportional to the changes on the path between the two states in the tree.
    """

    def __init__(self, model: Model) -> None:
        self._model = model
        self._attempt: Savepoint | None = None
        self._marks: list[Savepoint] = [model.graph.history.savepoint()]
        self._path = [0]
        self._known: dict[int, tuple[int, int, Shelf | None]] = {0: (0, 0, None)}

    def attempt(self) -> None:
        self._attempt = self._model.graph.history.savepoint()

    def back(self) -> None:
        assert self._attempt is not None
        self._model.graph.history.rollback(self._attempt)

    def keep(self) -> None:
        """Do nothing and return None: `park` stores the state."""

    def park(self, state: int, savepoint: Savepoint | None = None) -> None:
        """Store the current state, and undo the moves since `savepoint`, by default the savepoint of `attempt`."""
        savepoint = savepoint or self._attempt
        assert savepoint is not None
        self._known[state] = self._path[-1], len(self._path), self._model.graph.history.shelve(savepoint)

    def go(self, state: int) -> None:
        path, down = self._path, []
        parent, depth, shelf = self._known[state]
        while depth >= len(path) or path[depth] != state:
            assert shelf is not None, "the first state is always on the path"
            down.append((state, shelf))
            state = parent
            parent, depth, shelf = self._known[state]
        while len(path) > depth + 1:
            path.pop()
            self._model.graph.history.rollback(self._marks.pop())
        for below, shelf in reversed(down):
            self._marks.append(self._model.graph.history.resume(shelf))
            path.append(below)


@guarded
def walk_of_savepoints(model: Model) -> Iterator[SavepointWalk]:
    """Yield a walk inside a transaction. At the end, or after an exception, restore the state of the model."""
    with model.transaction():
        depth = model.graph.history.depth
        yield SavepointWalk(model)
        model.graph.history.unwind(depth)


class VersionWalk(Walk):
    """A walk outside of transactions that stores every state as a version."""

    def __init__(self, model: Model) -> None:
        self._model = model
        self._here = model.commit()
        self._versions = {0: self._here}
        self._kept = self._here

    def attempt(self) -> None:
        """Do nothing: the current state is already a version."""

    def back(self) -> None:
        self._model.checkout(self._here, discard=True)

    def keep(self) -> Version:
        self._kept = self._model.commit()
        return self._kept

    def park(self, state: int) -> None:
        self._versions[state] = self._kept
        self.back()

    def go(self, state: int) -> None:
        self._here = self._versions[state]
        self.back()


@guarded
def walk_of_versions(model: Model) -> Iterator[Walk]:
    """Yield a walk outside of transactions. At the end, or after an exception, restore the version of the model."""
    start = model.commit()
    try:
        yield VersionWalk(model)
    finally:
        model.checkout(start, discard=True)

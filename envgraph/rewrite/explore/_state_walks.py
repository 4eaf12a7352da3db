"""Navigation of a model between the states of an exploration, and back to the first state."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator

from envgraph.graph import Model, Savepoint, UndoneChanges, Version, guarded_contextmanager


class StateWalk(ABC):
    """A position in the tree of the states found so far; state 0 is the first.

    The caller calls `begin_move`, makes a move, and calls either `undo_move`, or `accept_move` and then `store_state`.

    Attributes:
        repeated: number of moves that `restore_state` has undone or made again.
    """

    repeated = 0

    @abstractmethod
    def begin_move(self) -> None:
        """Prepare for a move from the current state."""

    @abstractmethod
    def undo_move(self) -> None:
        """Undo the attempted move."""

    @abstractmethod
    def accept_move(self) -> Version | None:
        """Accept the new state after the move. Return its version, or None if the walk stores no versions."""

    @abstractmethod
    def store_state(self, state: int) -> None:
        """Store the new state under a number for `restore_state`, and undo the move."""

    @abstractmethod
    def restore_state(self, state: int) -> None:
        """Restore a state that `store_state` has stored, or the first state."""


class SavepointWalk(StateWalk):
    """A walk inside a transaction, with one savepoint for each move from the first state to the current one.

    The time to restore a state is proportional to the changes on the path between the two states in the tree.
    """

    def __init__(self, model: Model) -> None:
        self._model = model
        self._move_savepoint: Savepoint | None = None
        self._savepoints: list[Savepoint] = [model.graph.history.savepoint()]
        self._path = [0]
        self._stored: dict[int, tuple[int, int, UndoneChanges | None]] = {0: (0, 0, None)}

    def begin_move(self) -> None:
        self._move_savepoint = self._model.graph.history.savepoint()

    def undo_move(self) -> None:
        assert self._move_savepoint is not None
        self._model.graph.history.rollback(self._move_savepoint)

    def accept_move(self) -> None:
        """Do nothing and return None: `store_state` stores the state."""

    def store_state(self, state: int, savepoint: Savepoint | None = None) -> None:
        """Store the current state, and undo the moves since `savepoint`, by default the savepoint of `begin_move`."""
        savepoint = savepoint or self._move_savepoint
        assert savepoint is not None
        self._stored[state] = self._path[-1], len(self._path), self._model.graph.history.undo_to(savepoint)

    def restore_state(self, state: int) -> None:
        path, down = self._path, []
        parent, depth, shelf = self._stored[state]
        while depth >= len(path) or path[depth] != state:
            assert shelf is not None, "the first state is always on the path"
            down.append((state, shelf))
            state = parent
            parent, depth, shelf = self._stored[state]
        self.repeated += max(len(path) - depth - 1, 0) + len(down)
        while len(path) > depth + 1:
            path.pop()
            self._model.graph.history.rollback(self._savepoints.pop())
        for below, shelf in reversed(down):
            self._savepoints.append(self._model.graph.history.redo(shelf))
            path.append(below)


@guarded_contextmanager
def walk_of_savepoints(model: Model) -> Iterator[SavepointWalk]:
    """Yield a walk inside a transaction. At the end, or after an exception, restore the state of the model."""
    with model.transaction():
        depth = model.graph.history.savepoint_depth
        yield SavepointWalk(model)
        model.graph.history.unwind(depth)


class VersionWalk(StateWalk):
    """A walk outside of transactions that stores every state as a version."""

    def __init__(self, model: Model) -> None:
        self._model = model
        self._current_version = model.commit()
        self._versions = {0: self._current_version}
        self._accepted_version = self._current_version

    def begin_move(self) -> None:
        """Do nothing: the current state is already a version."""

    def undo_move(self) -> None:
        self._model.checkout(self._current_version, discard=True)

    def accept_move(self) -> Version:
        self._accepted_version = self._model.commit()
        return self._accepted_version

    def store_state(self, state: int) -> None:
        self._versions[state] = self._accepted_version
        self.undo_move()

    def restore_state(self, state: int) -> None:
        self._current_version = self._versions[state]
        self.undo_move()


@guarded_contextmanager
def walk_of_versions(model: Model) -> Iterator[StateWalk]:
    """Yield a walk outside of transactions. At the end, or after an exception, restore the version of the model."""
    start = model.commit()
    try:
        yield VersionWalk(model)
    finally:
        model.checkout(start, discard=True)

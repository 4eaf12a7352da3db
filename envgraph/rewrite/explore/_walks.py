"""Going from one state of an exploration to another, and back to where it began."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator

from envgraph.graph import Model, Savepoint, Shelf, Version, guarded


class Walk(ABC):
    """Where the model stands in the tree of the states that were found; 0 is the first.

    After `attempt` a move is made, and then comes one of `back`, or `keep` and `park`.
    """

    @abstractmethod
    def attempt(self) -> None:
        """A move from the present state follows."""

    @abstractmethod
    def back(self) -> None:
        """Undo the attempted move."""

    @abstractmethod
    def keep(self) -> Version | None:
        """The move leads to a new state: its version, where there is one."""

    @abstractmethod
    def park(self, state: int) -> None:
        """Leave the new state, for `go`; this is its number."""

    @abstractmethod
    def go(self, state: int) -> None:
        """Go to a state that was parked, or to the first."""


class SavepointWalk(Walk):
    """Inside one savepoint, with one more for each move from the first state to the present one.

    Going from one state to another costs what lies between them in the tree.
    """

    def __init__(self, model: Model) -> None:
        self._model = model
        self._attempt: Savepoint | None = None
        self._marks: list[Savepoint] = [model.savepoint()]
        self._path = [0]
        self._known: dict[int, tuple[int, int, Shelf | None]] = {0: (0, 0, None)}

    def attempt(self) -> None:
        self._attempt = self._model.savepoint()

    def back(self) -> None:
        assert self._attempt is not None
        self._model.rollback(self._attempt)

    def keep(self) -> None:
        """Nothing: `park` has all there is to know."""

    def park(self, state: int, savepoint: Savepoint | None = None) -> None:
        """Leave the state that a move has led to since a savepoint, by default that of the attempt."""
        savepoint = savepoint or self._attempt
        assert savepoint is not None
        self._known[state] = self._path[-1], len(self._path), self._model.shelve(savepoint)

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
            self._model.rollback(self._marks.pop())
        for below, shelf in reversed(down):
            self._marks.append(self._model.resume(shelf))
            path.append(below)


@guarded
def walk_of_savepoints(model: Model) -> Iterator[SavepointWalk]:
    """A walk inside one transaction; at the end, however it comes, the model is as it was."""
    with model.transaction():
        depth = model.depth
        yield SavepointWalk(model)
        model.unwind(depth)


class VersionWalk(Walk):
    """Every state is a version. Outside of any transaction."""

    def __init__(self, model: Model) -> None:
        self._model = model
        self._here = model.commit()
        self._versions = {0: self._here}
        self._kept = self._here

    def attempt(self) -> None:
        """Nothing: the present state is a version."""

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
    """A walk outside of any transaction; at the end, however it comes, the model is as it was."""
    start = model.commit()
    try:
        yield VersionWalk(model)
    finally:
        model.checkout(start, discard=True)

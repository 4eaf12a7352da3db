"""Going from one state of an exploration to another, and back to where it began."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator

from envgraph.graph import Model, Savepoint, Shelf, Version, guarded


class Walk(ABC):
    """Where the model stands in the tree of the states that were found; 0 is the first.

    After `attempt` a move is made, and then comes one of `back`, or `keep` and one of `park` and `descend`.
    """

    @abstractmethod
    def attempt(self) -> None:
        """A move from the present state follows."""

    @abstractmethod
    def back(self) -> None:
        """Undo the attempted move."""

    @abstractmethod
    def keep(self) -> Version | None:
        """The move leads to a new state, the next in number."""

    @abstractmethod
    def park(self) -> None:
        """Leave the new state, for `go`."""

    @abstractmethod
    def descend(self) -> None:
        """Stay in the new state, until `ascend`."""

    @abstractmethod
    def ascend(self) -> None:
        """Go back to the state before the present one."""

    @abstractmethod
    def go(self, state: int) -> None:
        """Go to a state that was parked, or to the first."""


class SavepointWalk(Walk):
    """Inside one savepoint, with one more for each move from the first state to the present one."""

    def __init__(self, model: Model) -> None:
        self._model = model
        self._marks: list[Savepoint] = [model.savepoint()]
        self._path = [0]
        self._parents = [(0, 0)]
        self._shelves: dict[int, Shelf] = {}

    def attempt(self) -> None:
        self._marks.append(self._model.savepoint())

    def back(self) -> None:
        self._model.rollback(self._marks.pop())

    def keep(self) -> None:
        self._parents.append((self._path[-1], len(self._path)))

    def park(self) -> None:
        self._shelves[len(self._parents) - 1] = self._model.shelve(self._marks.pop())

    def descend(self) -> None:
        self._path.append(len(self._parents) - 1)

    def ascend(self) -> None:
        self._path.pop()
        self.back()

    def go(self, state: int) -> None:
        path, down = self._path, []
        parent, depth = self._parents[state]
        while depth >= len(path) or path[depth] != state:
            down.append(state)
            state = parent
            parent, depth = self._parents[state]
        while len(path) > depth + 1:
            self.ascend()
        for below in reversed(down):
            self._marks.append(self._model.resume(self._shelves[below]))
            path.append(below)


@guarded
def walk_of_savepoints(model: Model) -> Iterator[Walk]:
    """A walk inside one transaction; at the end, however it comes, the model is as it was."""
    with model.transaction():
        depth = model.depth
        yield SavepointWalk(model)
        model.unwind(depth)


class VersionWalk(Walk):
    """Every state is a version. Outside of any transaction."""

    def __init__(self, model: Model) -> None:
        self._model = model
        self.versions = [model.commit()]
        self._path = [self.versions[0]]

    def attempt(self) -> None:
        """Nothing: the present state is a version."""

    def back(self) -> None:
        self._model.checkout(self._path[-1], discard=True)

    def keep(self) -> Version:
        self.versions.append(self._model.commit())
        return self.versions[-1]

    def park(self) -> None:
        self.back()

    def descend(self) -> None:
        self._path.append(self.versions[-1])

    def ascend(self) -> None:
        self._path.pop()
        self.back()

    def go(self, state: int) -> None:
        self._path = [self.versions[state]]
        self.back()


@guarded
def walk_of_versions(model: Model) -> Iterator[Walk]:
    """A walk outside of any transaction; at the end, however it comes, the model is as it was."""
    start = model.commit()
    try:
        yield VersionWalk(model)
    finally:
        model.checkout(start, discard=True)

"""The undo log: one flat list, and the sequences whose changes it can take back exactly.

An entry is four items, `container, key, old, opcode`, the opcode last because undoing reads backwards. Flat, because
entries that were tuples would keep the garbage collector busy. Undoing a stretch of entries gives the inverse
stretch, so redo is the same mechanism.

Whatever must follow rollbacks and versions keeps its state in lists, dicts and `IndexedSet`s and records here; a
structure with another shape implements `Exchangeable`.
"""

from __future__ import annotations

from collections.abc import Hashable
from typing import Any, Final, Protocol, TypeVar

Item = TypeVar("Item", bound=Hashable)

SET: Final = 0
"""Undone by `container[key] = old`."""
OUT: Final = 1
"""Undone by `container.take(key)`; `old` is None."""
IN: Final = 2
"""Undone by `container.put(key, old)`; `old` is the position."""
EXCHANGE: Final = 3
"""Undone by `container.exchange(key, old)`."""

Journal = list[Any]


class Exchangeable(Protocol):
    """A structure of another shape that still takes part in the journal."""

    def exchange(self, key: Any, state: Any) -> Any:
        """Put `state` at `key` and return what was there, so that exchanging that again is the inverse."""


class IndexedSet(list[Item]):
    """A set in a list, and the position of each element: adding, removing and random choice take constant time.

    A removal moves the last element into the gap. `put` reverses it, so the order is a function of the changes that
    are in force, not of those that were made and taken back. Only `add`, `take` and `put` may change it.
    """

    __slots__ = ("position",)

    def __init__(self, items: tuple[Item, ...] = ()) -> None:
        super().__init__(items)
        self.position = {item: index for index, item in enumerate(items)}

    def __contains__(self, item: object) -> bool:
        return item in self.position

    def add(self, item: Item) -> None:
        """Append an element that is not in the set."""
        self.position[item] = len(self)
        self.append(item)

    def take(self, item: Item) -> int:
        """Remove an element; the last one moves into its place, which is returned."""
        index = self.position.pop(item)
        last = self.pop()
        if index < len(self):
            self[index] = last
            self.position[last] = index
        return index

    def put(self, item: Item, index: int) -> None:
        """Take back a `take` that returned `index`."""
        if index < len(self):
            moved = self[index]
            self.position[moved] = len(self)
            self.append(moved)
            self[index] = item
        else:
            self.append(item)
        self.position[item] = index


class Extent(list[int]):
    """The objects of exactly one class, as an `IndexedSet` whose positions stand in a column shared by all extents.

    It also keeps the class of its members in the shared column `classes`, so that entering and leaving an extent is
    all there is to creating, retyping and deleting.
    """

    __slots__ = ("classes", "number", "place")

    def __init__(self, number: int, classes: list[int], place: list[int]) -> None:
        super().__init__()
        self.number = number
        self.classes = classes
        self.place = place

    def add(self, node: int) -> None:
        """Append an object that is in no extent."""
        self.place[node] = len(self)
        self.append(node)
        self.classes[node] = self.number

    def take(self, node: int) -> int:
        """Remove a member; the last one moves into its place, which is returned."""
        index = self.place[node]
        last = self.pop()
        if index < len(self):
            self[index] = last
            self.place[last] = index
        self.classes[node] = -1
        return index

    def put(self, node: int, index: int) -> None:
        """Take back a `take` that returned `index`."""
        if index < len(self):
            moved = self[index]
            self.place[moved] = len(self)
            self.append(moved)
            self[index] = node
        else:
            self.append(node)
        self.place[node] = index
        self.classes[node] = self.number


def revert(journal: Journal, mark: int) -> None:
    """Undo and drop all entries from `mark` on."""
    backwards = reversed(journal[mark:])
    for opcode, old, key, container in zip(backwards, backwards, backwards, backwards, strict=True):
        if opcode == SET:
            container[key] = old
        elif opcode == OUT:
            container.take(key)
        elif opcode == IN:
            container.put(key, old)
        else:
            container.exchange(key, old)
    del journal[mark:]


def invert(journal: Journal) -> Journal:
    """Undo all entries, and return those that undo the undoing."""
    inverse: Journal = []
    backwards = reversed(journal)
    for opcode, old, key, container in zip(backwards, backwards, backwards, backwards, strict=True):
        if opcode == SET:
            inverse.extend((container, key, container[key], SET))
            container[key] = old
        elif opcode == OUT:
            inverse.extend((container, key, container.take(key), IN))
        elif opcode == IN:
            container.put(key, old)
            inverse.extend((container, key, None, OUT))
        else:
            inverse.extend((container, key, container.exchange(key, old), EXCHANGE))
    return inverse

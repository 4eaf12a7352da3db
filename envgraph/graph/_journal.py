"""The undo log: one flat list, and the sequences whose changes it can take back exactly.

An entry is four items, `container, key, old, opcode`, the opcode last because undoing reads backwards. Flat, because
entries that were tuples would keep the garbage collector busy. Undoing a stretch of entries gives the inverse
stretch, so redo is the same mechanism.

Whatever must follow rollbacks and versions keeps its state in lists, dicts and `IndexedSet`s and records here; a
structure with another shape implements `Exchangeable`.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable
from itertools import repeat
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


Contents = tuple[int, dict[int, Item]]
"""Length of a sequence, and elements by position; those that are not named are as they are."""


class Exchangeable(Protocol):
    """A structure of another shape that still takes part in the journal."""

    def exchange(self, key: Any, state: Any) -> Any:
        """Put `state` at `key` and return what was there, so that exchanging that again is the inverse.

        Keys are independent of each other, and of other structures: of several exchanges at one key in a row, only the
        last one counts.
        """


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

    def where(self, item: Item) -> int:
        """Position of an element."""
        return self.position[item]

    def exchange(self, _: None, state: Contents[Item]) -> Contents[Item]:
        """Overwrite elements, and return what undoes that."""
        length, items = state
        before = _overwritten(self, length, items)
        for item in before[1].values():
            del self.position[item]
        _overwrite(self, length, items)
        for index, item in items.items():
            self.position[item] = index
        return before


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

    def where(self, node: int) -> int:
        """Position of a member."""
        return self.place[node]

    def exchange(self, _: None, state: Contents[int]) -> Contents[int]:
        """Overwrite members, and return what undoes that."""
        length, nodes = state
        before = _overwritten(self, length, nodes)
        for node in before[1].values():
            if self.classes[node] == self.number:  # else it is in another extent already
                self.classes[node] = -1
        _overwrite(self, length, nodes)
        for index, node in nodes.items():
            self.place[node] = index
            self.classes[node] = self.number
        return before


def _overwritten(sequence: list[Item], length: int, items: Iterable[int]) -> Contents[Item]:
    now = len(sequence)
    before = {index: sequence[index] for index in items if index < now}
    before.update((index, sequence[index]) for index in range(length, now))
    return now, before


def _overwrite(sequence: list[Item], length: int, items: dict[int, Item]) -> None:
    if length > len(sequence):
        # Every position past the old end is among the items: the filler never stays.
        sequence.extend(repeat(next(iter(items.values())), length - len(sequence)))
    del sequence[length:]
    for index, item in items.items():
        sequence[index] = item


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


def invert_net(journal: Journal) -> Journal:
    """As `invert`, but the entries returned name each place once, however often it was written."""
    sets: dict[tuple[int, Any], tuple[Any, Any, Any]] = {}
    exchanges: dict[tuple[int, Any], tuple[Any, Any, Any]] = {}
    sequences: dict[int, _Trace] = {}
    backwards = reversed(journal)
    for opcode, old, key, container in zip(backwards, backwards, backwards, backwards, strict=True):
        if opcode == SET:
            sets.setdefault((id(container), key), (container, key, container[key]))
            container[key] = old
        elif isinstance(container, IndexedSet | Extent):
            trace = sequences.get(id(container))
            if trace is None:
                trace = sequences[id(container)] = _Trace(container)
            trace.undo(key, old, opcode)
        else:
            exchanges.setdefault((id(container), key), (container, key, container.exchange(key, old)))
    inverse: Journal = []
    for container, key, value in sets.values():
        if container[key] is not value:
            inverse.extend((container, key, value, SET))
    for trace in sequences.values():
        length, items = trace.net()
        if items or length != len(trace.sequence):
            inverse.extend((trace.sequence, None, (length, items), EXCHANGE))
    for container, key, value in exchanges.values():
        inverse.extend((container, key, value, EXCHANGE))
    return inverse


class _Trace:
    """What a sequence held where it has been written since."""

    def __init__(self, sequence: IndexedSet[Any] | Extent) -> None:
        self.sequence = sequence
        self.length = len(sequence)
        self.items: dict[int, Any] = {}

    def undo(self, key: Any, old: Any, opcode: int) -> None:
        sequence = self.sequence
        if opcode == OUT:
            self._touch((sequence.where(key), len(sequence) - 1))
            sequence.take(key)
        elif opcode == IN:
            self._touch((old,))
            sequence.put(key, old)
        else:
            self._touch(old[1])
            self._touch(range(old[0], len(sequence)))
            sequence.exchange(None, old)

    def _touch(self, indexes: Iterable[int]) -> None:
        for index in indexes:
            if index < self.length and index not in self.items:
                self.items[index] = self.sequence[index]

    def net(self) -> Contents[Any]:
        now = self.sequence
        changed = {i: item for i, item in self.items.items() if i >= len(now) or now[i] is not item}
        return self.length, changed

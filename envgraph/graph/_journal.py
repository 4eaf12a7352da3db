"""The undo log: one flat list, and the sequences whose changes it can take back exactly.

An entry is four items, `container, key, old, opcode`, the opcode last because undoing reads backwards. Flat, because
entries that were tuples would keep the garbage collector busy. Undoing a stretch of entries gives the inverse
stretch, so redo is the same mechanism.

Whatever must follow rollbacks and versions keeps its state in lists, dicts and `IndexedSet`s and records here; a
structure with another shape implements `Exchangeable`.

An entry is written before the change that it takes back. So whatever interrupts a change, such as Ctrl-C, leaves only
the last entry in doubt, which `make_sure` settles.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator
from itertools import repeat
from operator import length_hint
from typing import Any, Final, Protocol, TypeVar

from envgraph.graph._torn import Torn

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

    def withdraw(self, item: Item, inverse: Journal) -> None:
        """`take`, after writing down what undoes that."""
        index = self.position[item]
        inverse.extend((self, item, index, IN))
        del self.position[item]
        last = self.pop()
        if index < len(self):
            self[index] = last
            self.position[last] = index

    def contents(self, state: Contents[Item]) -> Contents[Item]:
        """What undoes an `exchange`."""
        return _overwritten(self, *state)

    def exchange(self, _: None, state: Contents[Item]) -> Contents[Item]:
        """Overwrite elements, and return what undoes that."""
        before = self.contents(state)
        for item in before[1].values():
            self.position.pop(item, None)
        self[:] = _overwrite(self, *state)
        for index, item in state[1].items():
            self.position[item] = index
        return before

    def mend(self, item: Item) -> None:
        """After an interrupted `add`, `take` or `put` the element is in, or it is not; else nothing happens."""
        items = dict.fromkeys(self)
        if len(items) < len(self):  # `put` has copied what makes room
            self.pop()
        else:  # `add` has not appended the element yet, or `take` not put back the one that fills the gap
            end = len(self)
            self.extend([each for each, at in self.position.items() if at >= end and each not in items])
        self.reindex()

    def reindex(self) -> None:
        """Make the positions those of the elements."""
        self.position.clear()
        self.position.update({item: index for index, item in enumerate(self)})


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

    def withdraw(self, node: int, inverse: Journal) -> None:
        """`take`, after writing down what undoes that."""
        index = self.place[node]
        inverse.extend((self, node, index, IN))
        last = self.pop()
        if index < len(self):
            self[index] = last
            self.place[last] = index
        self.classes[node] = -1

    def contents(self, state: Contents[int]) -> Contents[int]:
        """What undoes an `exchange`."""
        return _overwritten(self, *state)

    def exchange(self, _: None, state: Contents[int]) -> Contents[int]:
        """Overwrite members, and return what undoes that."""
        before = self.contents(state)
        for node in before[1].values():
            if self.classes[node] == self.number:  # else it is in another extent already
                self.classes[node] = -1
        self[:] = _overwrite(self, *state)
        for index, node in state[1].items():
            self.place[node] = index
            self.classes[node] = self.number
        return before

    def mend(self, node: int) -> None:
        """After an interrupted `add`, `take` or `put` the object is a member, or it is not; else nothing happens."""
        members = dict.fromkeys(self)
        if len(members) < len(self):  # `put` has copied what makes room
            self.pop()
        else:  # `take` has not put back the member that fills the gap
            own = self.number
            known = enumerate(self.classes)
            self.extend([n for n, cls in known if cls == own and n != node and n not in members])
        if node in self:
            self.classes[node] = self.number
        elif self.classes[node] == self.number:
            self.classes[node] = -1
        for index, member in enumerate(self):
            self.place[member] = index


def _overwritten(sequence: list[Item], length: int, items: Iterable[int]) -> Contents[Item]:
    now = len(sequence)
    before = {index: sequence[index] for index in items if index < now}
    before.update((index, sequence[index]) for index in range(length, now))
    return now, before


def _overwrite(sequence: list[Item], length: int, items: dict[int, Item]) -> list[Item]:
    """A copy with other elements."""
    after = list(sequence)
    if length > len(after):
        # Every position past the old end is among the items: the filler never stays.
        after.extend(repeat(next(iter(items.values())), length - len(after)))
    del after[length:]
    for index, item in items.items():
        after[index] = item
    return after


# --- undoing


def revert(journal: Journal, mark: int, torn: Torn) -> None:
    """Undo and drop all entries from `mark` on.

    After an interruption the journal holds what is left, as soon as `torn` is finished.
    """
    entries = journal[mark:]
    backwards = reversed(entries)
    try:
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
    except BaseException:
        torn.append((_reverted, (journal, mark, entries, backwards)))
        raise


def _reverted(journal: Journal, mark: int, entries: Journal, backwards: Iterator[Any]) -> None:
    left = length_hint(backwards)
    if left < len(entries):
        container, key, old, opcode = entries[left : left + 4]
        _undo_again(container, key, old, opcode)
    del journal[mark + left :]


def _undo_again(container: Any, key: Any, old: Any, opcode: int) -> None:
    """Undo an entry of which nothing, something or everything is undone already."""
    if opcode == SET:
        container[key] = old
    elif opcode == EXCHANGE:
        if isinstance(container, IndexedSet):
            container.reindex()
        container.exchange(key, old)
    else:
        container.mend(key)
        if opcode == OUT and key in container:
            container.take(key)
        elif opcode == IN and key not in container:
            container.put(key, old)


def make_sure(journal: Journal) -> None:
    """After an interruption: the change of the last entry is made, or it is not, and the entry is dropped."""
    if journal:
        container, key, _, opcode = journal[-4:]
        if opcode in (OUT, IN):
            container.mend(key)
            if (key in container) == (opcode == IN):
                del journal[-4:]
        elif opcode == EXCHANGE and isinstance(container, IndexedSet):
            container.reindex()


def invert(journal: Journal, inverse: Journal) -> None:
    """Undo all entries, and add those that undo the undoing to `inverse`."""
    backwards = reversed(journal)
    for opcode, old, key, container in zip(backwards, backwards, backwards, backwards, strict=True):
        if opcode == SET:
            inverse.extend((container, key, container[key], SET))
            container[key] = old
        elif opcode == OUT:
            container.withdraw(key, inverse)
        elif opcode == IN:
            inverse.extend((container, key, None, OUT))
            container.put(key, old)
        elif isinstance(container, IndexedSet | Extent):
            inverse.extend((container, key, container.contents(old), EXCHANGE))
            container.exchange(key, old)
        else:
            inverse.extend((container, key, container.exchange(key, old), EXCHANGE))


def turn_back(inverse: Journal, torn: Torn) -> None:
    """Take an interrupted `invert` back."""
    make_sure(inverse)
    revert(inverse, 0, torn)


def invert_net(journal: Journal, inverse: Journal, torn: Torn) -> None:
    """As `invert`, but `inverse` names each place once, however often it was written.

    After an interruption nothing is undone, as soon as `torn` is finished.
    """
    before = _Before()
    backwards = reversed(journal)
    try:
        for opcode, old, key, container in zip(backwards, backwards, backwards, backwards, strict=True):
            before.note(container, key, old, opcode)
            if opcode == SET:
                container[key] = old
            elif opcode == OUT:
                container.take(key)
            elif opcode == IN:
                container.put(key, old)
            elif isinstance(container, IndexedSet | Extent):
                container.exchange(key, old)
            else:
                before.exchange(container, key, old)
        inverse.extend(before.inverse())
    except BaseException:
        torn.append((_turn_net_back, (before, journal, backwards, torn)))
        raise


def _turn_net_back(before: _Before, journal: Journal, backwards: Iterator[Any], torn: Torn) -> None:
    left = length_hint(backwards)
    if left < len(journal):
        container, key, old, opcode = journal[left : left + 4]
        if opcode in (OUT, IN):
            container.mend(key)
            if (key in container) == (opcode == OUT):  # then it was not noted, perhaps
                before.note(container, key, old, opcode)
        else:
            before.note(container, key, old, opcode)
        if opcode != EXCHANGE or isinstance(container, IndexedSet | Extent):
            _undo_again(container, key, old, opcode)
    revert(before.inverse(), 0, torn)


class _Before:
    """What each place held before it was undone."""

    def __init__(self) -> None:
        self._sets: dict[tuple[int, Any], tuple[Any, Any, Any]] = {}
        self._exchanges: dict[tuple[int, Any], tuple[Any, Any, Any]] = {}
        self._sequences: dict[int, _Trace] = {}

    def note(self, container: Any, key: Any, old: Any, opcode: int) -> None:
        """An entry is going to be undone."""
        if opcode == SET:
            self._sets.setdefault((id(container), key), (container, key, container[key]))
        elif isinstance(container, IndexedSet | Extent):
            trace = self._sequences.get(id(container))
            if trace is None:
                trace = self._sequences[id(container)] = _Trace(container)
            trace.note(key, old, opcode)

    def exchange(self, container: Exchangeable, key: Any, old: Any) -> None:
        """Undo an entry of a structure of another shape."""
        self._exchanges.setdefault((id(container), key), (container, key, container.exchange(key, old)))

    def inverse(self) -> Journal:
        """What leads back."""
        inverse: Journal = []
        for container, key, value in self._sets.values():
            if container[key] is not value:
                inverse.extend((container, key, value, SET))
        for trace in self._sequences.values():
            length, items = trace.net()
            if items or length != len(trace.sequence):
                inverse.extend((trace.sequence, None, (length, items), EXCHANGE))
        for container, key, value in self._exchanges.values():
            inverse.extend((container, key, value, EXCHANGE))
        return inverse


class _Trace:
    """What a sequence held where it has been written since."""

    def __init__(self, sequence: IndexedSet[Any] | Extent) -> None:
        self.sequence = sequence
        self.length = len(sequence)
        self.items: dict[int, Any] = {}

    def note(self, key: Any, old: Any, opcode: int) -> None:
        """An entry is going to be undone."""
        sequence = self.sequence
        if opcode == OUT:
            self._touch((sequence.where(key), len(sequence) - 1))
        elif opcode == IN:
            self._touch((old,))
        else:
            self._touch(old[1])
            self._touch(range(old[0], len(sequence)))

    def _touch(self, indexes: Iterable[int]) -> None:
        for index in indexes:
            if index < self.length and index not in self.items:
                self.items[index] = self.sequence[index]

    def net(self) -> Contents[Any]:
        now = self.sequence
        changed = {i: item for i, item in self.items.items() if i >= len(now) or now[i] is not item}
        return self.length, changed

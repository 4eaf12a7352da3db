"""The undo log: one flat list, and the sequences whose changes it can undo exactly.

An entry is four items, `container, key, old, opcode`, the opcode last because undoing reads backwards. Flat, because
entries that were tuples would keep the garbage collector busy. Undoing a stretch of entries gives the inverse
stretch, so redo is the same mechanism.

Whatever must follow rollbacks and versions keeps its state in lists, dicts and `IndexedSet`s and records here. A
structure with another shape has a method `exchange`, see `EXCHANGE`.

An entry is written before the change that it undoes (a write-ahead log). So an exception in the middle of a change,
such as that of Ctrl-C, leaves only the last entry in doubt: `take_back` settles it.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator
from itertools import chain, repeat
from typing import Any, Final, TypeVar

Item = TypeVar("Item", bound=Hashable)

SET: Final = 0
"""Undone by `container[key] = old`."""
OUT: Final = 1
"""Undone by `container.take(key)`; `old` is None."""
IN: Final = 2
"""Undone by `container.put(key, old)`; `old` is the position."""
EXCHANGE: Final = 3
"""Undone by `container.exchange(key, old)`."""
MOVE: Final = 4
"""Undone by `container.move(key, old)`; `old` is the position."""

_NEAR: Final = 64
"""An element that moves have shifted by less is looked for; see the benchmark `growth`."""

Journal = list[Any]


Contents = tuple[int, dict[int, Item]]
"""Length of a sequence, and elements by position; those that are not named are as they are."""


class IndexedSet(list[Item]):
    """A set in a list, and the position of each element: adding, removing and random choice take constant time.

    A removal moves the last element into the gap. `put` reverses it, so the order is a function of the changes that
    are in force, not of those that were made and undone. Only `add`, `take`, `put` and `move` may change it.

    After a `move` the positions of the elements between are out of date. The elements are distinct, so a look at the
    list tells, and a question whose element is not near its old position corrects all positions.
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
        index = self.where(item)
        del self.position[item]
        last = self.pop()
        if index < len(self):
            self[index] = last
            self.position[last] = index
        return index

    def move(self, item: Item, index: int) -> None:
        """Move an element to another position; those between shift by one. An exception leaves all or nothing done."""
        at = self.where(item)
        if at < index:
            self[at : index + 1] = [*self[at + 1 : index + 1], item]
        else:
            self[index : at + 1] = [item, *self[index:at]]
        self.position[item] = index

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
        index = self.position[item]
        if index < len(self) and self[index] == item:
            return index
        try:
            return self.index(item, max(0, index - _NEAR), index + _NEAR)
        except ValueError:
            self.position.update(zip(self, range(len(self)), strict=True))
        return self.position[item]

    def contents(self, state: Contents[Item]) -> Contents[Item]:
        """Return what undoes an `exchange`."""
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

    def mend(self, item: Item | None = None) -> bool:
        """After an interrupted `add`, `take` or `put` decide whether the element is in, and return that."""
        items = dict.fromkeys(self)
        if len(items) < len(self):  # `put` has copied what makes room
            self.pop()
        else:  # `add` has not appended the element yet, or `take` not put back the one that fills the gap
            end = len(self)
            self.extend([each for each, at in self.position.items() if at >= end and each not in items])
        self.reindex()
        return item in self.position

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

    def contents(self, state: Contents[int]) -> Contents[int]:
        """Return what undoes an `exchange`."""
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

    def mend(self, node: int) -> bool:
        """After an interrupted `add`, `take` or `put` decide whether the object is a member, and return that."""
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
        return self.classes[node] == self.number


class Ordered(list[Any]):
    """Values in an order, not all of them distinct; they are inserted and removed at positions.

    A key of the journal is the position, the value, and the number of values with it.
    """

    __slots__ = ()

    def take(self, key: tuple[int, Any, int]) -> None:
        """Remove a value."""
        del self[key[0]]

    def put(self, key: tuple[int, Any, int], _: object) -> None:
        """Insert a value."""
        self.insert(key[0], key[1])

    def where(self, key: tuple[int, Any, int]) -> int:
        """Position of a value."""
        return key[0]

    def mend(self, key: tuple[int, Any, int]) -> bool:
        """Return whether the value is in; an exception leaves nothing half done."""
        return len(self) == key[2]


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


def undo(backwards: Iterator[Any]) -> None:
    """Undo entries."""
    for opcode, old, key, container in zip(backwards, backwards, backwards, backwards, strict=True):
        if opcode == SET:
            container[key] = old
        elif opcode == OUT:
            container.take(key)
        elif opcode == IN:
            container.put(key, old)
        elif opcode == MOVE:
            container.move(key, old)
        else:
            container.exchange(key, old)


def take_back(journal: Journal, mark: int) -> None:
    """Undo and drop all entries from `mark` on, of which the last one may be made, undone, or half of either.

    If it is interrupted it can be called again.
    """
    settle(journal)
    while len(journal) > mark:
        undo(reversed(journal[-4:]))
        del journal[-4:]


def settle(journal: Journal) -> None:
    """After an exception: the change of the last entry is made, or it is not, and the entry is dropped."""
    if journal:
        container, key, _, opcode = journal[-4:]
        if opcode in (OUT, IN) and container.mend(key) == (opcode == IN):
            del journal[-4:]
        elif opcode == EXCHANGE and isinstance(container, IndexedSet):
            container.reindex()


def invert(backwards: Iterator[Any], inverse: Journal) -> None:
    """Undo entries, and add those that undo the undoing to `inverse`, each before its entry is undone."""
    for opcode, old, key, container in zip(backwards, backwards, backwards, backwards, strict=True):
        if opcode == SET:
            inverse.extend((container, key, container[key], SET))
            container[key] = old
        elif opcode == OUT:
            inverse.extend((container, key, container.where(key), IN))
            container.take(key)
        elif opcode == IN:
            inverse.extend((container, key, None, OUT))
            container.put(key, old)
        elif opcode == MOVE:
            inverse.extend((container, key, container.where(key), MOVE))
            container.move(key, old)
        elif isinstance(container, IndexedSet | Extent):
            inverse.extend((container, key, container.contents(old), EXCHANGE))
            container.exchange(key, old)
        else:
            inverse.extend((container, key, container.exchange(key, old), EXCHANGE))


def net_changes(journal: Journal) -> Journal:
    """Entries that undo what these undo, from the present state, and name each place once.

    Those of a sequence whose elements were shifted stay as they are.
    """
    places: dict[tuple[int, Any], tuple[Any, Any, Any, int]] = {}
    sequences: dict[int, _Sequence] = {}
    codes = zip(journal[::4], journal[3::4], strict=True)
    shifted = {id(one) for one, code in codes if code == MOVE or isinstance(one, Ordered)}
    shifts: list[tuple[Any, Any, Any, int]] = []
    backwards = reversed(journal)
    for opcode, old, key, container in zip(backwards, backwards, backwards, backwards, strict=True):
        if id(container) in shifted:
            shifts.append((container, key, old, opcode))
        elif isinstance(container, IndexedSet | Extent) and opcode != SET:
            sequence = sequences.get(id(container))
            if sequence is None:
                sequence = sequences[id(container)] = _Sequence(container)
            sequence.undo(key, old, opcode)
        else:
            places[id(container), key] = (container, key, old, opcode)
    net: Journal = []
    for entry in places.values():
        container, key, old, opcode = entry
        if opcode != SET or container[key] is not old:
            net.extend(entry)
    for sequence in sequences.values():
        length, items = sequence.net()
        if items or length != len(sequence.now):
            net.extend((sequence.now, None, (length, items), EXCHANGE))
    net.extend(chain.from_iterable(reversed(shifts)))
    return net


class _Sequence:
    """What a sequence would be if entries were undone."""

    def __init__(self, now: IndexedSet[Any] | Extent) -> None:
        self.now = now
        self._length = len(now)
        self._items: dict[int, Any] = {}
        self._places: dict[Any, int] = {}

    def undo(self, key: Any, old: Any, opcode: int) -> None:
        """As undoing the entry does."""
        if opcode == OUT:
            self._length -= 1
            place = self._places[key] if key in self._places else self.now.where(key)
            if place < self._length:
                self._put(place, self._at(self._length))
        elif opcode == IN:
            if old < self._length:
                self._put(self._length, self._at(old))
            self._put(old, key)
            self._length += 1
        else:
            self._length, items = old
            for place, item in items.items():
                self._put(place, item)

    def _put(self, place: int, item: Any) -> None:
        self._items[place] = item
        self._places[item] = place

    def _at(self, place: int) -> Any:
        return self._items[place] if place in self._items else self.now[place]

    def net(self) -> Contents[Any]:
        """Length, and elements where they differ from those of now."""
        now = self.now
        items = self._items.items()
        return self._length, {
            place: item
            for place, item in items
            if place < self._length and (place >= len(now) or now[place] is not item)
        }

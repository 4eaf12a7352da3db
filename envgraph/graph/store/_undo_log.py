"""The undo log (journal): one flat list of entries, and the sequences whose changes it undoes exactly.

An entry is four items, `container, key, old, opcode`. The opcode is last because undoing reads backwards. The list is
flat because tuples as entries would cost time in the garbage collector. Undoing some entries yields the inverse
entries, so redo is the same mechanism.

Data that must follow rollbacks and versions is stored in lists, dicts and `IndexedSet`s, and its changes are recorded
here. A structure of another kind has a method `exchange`, see `OVERWRITTEN`.

An entry is written before its change is made (a write-ahead log). So an exception in the middle of a change leaves
only the last entry in doubt. `undo_after_exception` and `settle_last_entry` decide about that entry.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator
from itertools import chain, repeat
from typing import Any, Final, TypeVar

Item = TypeVar("Item", bound=Hashable)

ASSIGNED: Final = 0
"""Undone by `container[key] = old`."""
ADDED: Final = 1
"""Undone by `container.take(key)`; `old` is None."""
REMOVED: Final = 2
"""Undone by `container.put(key, old)`; `old` is the position."""
OVERWRITTEN: Final = 3
"""Undone by `container.exchange(key, old)`."""
MOVED: Final = 4
"""Undone by `container.move(key, old)`; `old` is the position."""

_SEARCH_DISTANCE: Final = 64
"""Largest shift for which an element is searched before all positions are recomputed; see the benchmark `growth`."""

Journal = list[Any]


SequenceState = tuple[int, dict[int, Item]]
"""Length of a sequence, and new elements by position. Elements at other positions stay unchanged."""


class IndexedSet(list[Item]):
    """A set stored as a list with the position of each element. Insertion, removal and random choice take O(1) time.

    A removal moves the last element into the gap, and `put` reverses the removal. So the order depends only on the
    changes that are in force, not on changes that were made and undone. Only `add`, `take`, `put`, `move` and
    `exchange` may change the set.

    After a `move` the recorded positions of the elements between are out of date. `where` notices an outdated position,
    because elements are distinct. If the element is not close to that position, `where` corrects all positions.
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
        """Remove an element, and move the last element into the gap. Return the index of the gap."""
        index = self.where(item)
        del self.position[item]
        last = self.pop()
        if index < len(self):
            self[index] = last
            self.position[last] = index
        return index

    def move(self, item: Item, index: int) -> None:
        """Move an element to another index and shift the elements between by one, as one atomic change."""
        at = self.where(item)
        if at < index:
            self[at : index + 1] = [*self[at + 1 : index + 1], item]
        else:
            self[index : at + 1] = [item, *self[index:at]]
        self.position[item] = index

    def put(self, item: Item, index: int) -> None:
        """Insert an element that `take` removed from `index`, so that the former order is restored."""
        if index < len(self):
            moved = self[index]
            self.position[moved] = len(self)
            self.append(moved)
            self[index] = item
        else:
            self.append(item)
        self.position[item] = index

    def where(self, item: Item) -> int:
        """Return the index of an element of the set. If its recorded position is far off, update all positions."""
        index = self.position[item]
        if index < len(self) and self[index] == item:
            return index
        try:
            return self.index(item, max(0, index - _SEARCH_DISTANCE), index + _SEARCH_DISTANCE)
        except ValueError:
            self.position.update(zip(self, range(len(self)), strict=True))
        return self.position[item]

    def exchange(self, _: None, state: SequenceState[Item]) -> SequenceState[Item]:
        """Set the length (first item of `state`) and the elements at some indexes (second item).

        Return the old length and the old elements, with which a second call undoes this one. The key `_` is ignored.
        """
        before = state_before_overwriting(self, *state)
        for item in before[1].values():
            self.position.pop(item, None)
        self[:] = _overwritten_copy(self, *state)
        for index, item in state[1].items():
            self.position[item] = index
        return before

    def mend(self, item: Item | None = None) -> bool:
        """Complete or undo an interrupted `add`, `take` or `put`. Return True if the element is in the set afterwards.

        Without an element the list and the positions are repaired all the same, and the result has no meaning.
        """
        items = dict.fromkeys(self)
        if len(items) < len(self):  # an interrupted `put` has appended a second copy of an element
            self.pop()
        else:  # `add` has not appended the element yet, or `take` has not moved the last element into the gap
            end = len(self)
            self.extend([each for each, at in self.position.items() if at >= end and each not in items])
        self.reindex()
        return item in self.position

    def reindex(self) -> None:
        """Recompute the recorded positions of all elements from the list."""
        self.position.clear()
        self.position.update({item: index for index, item in enumerate(self)})


class Extent(list[int]):
    """The objects of exactly one class, ordered as in an `IndexedSet`.

    The positions are stored in `place`, a column shared by all extents. An extent also writes the number of its class
    to the shared column `classes`, or -1 for a removed object. So an object is created, retyped and deleted only by
    insertions into and removals from extents.
    """

    __slots__ = ("classes", "number", "place")

    def __init__(self, number: int, classes: list[int], place: list[int]) -> None:
        super().__init__()
        self.number = number
        self.classes = classes
        self.place = place

    def add(self, node: int) -> None:
        """Append an object that is in no extent, and record its class."""
        self.place[node] = len(self)
        self.append(node)
        self.classes[node] = self.number

    def take(self, node: int) -> int:
        """Remove a member, so that it has no class, and move the last member into the gap. Return the gap's index."""
        index = self.place[node]
        last = self.pop()
        if index < len(self):
            self[index] = last
            self.place[last] = index
        self.classes[node] = -1
        return index

    def put(self, node: int, index: int) -> None:
        """Insert a member that `take` removed from `index`, record its class, and so restore the former order."""
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
        """Return the index of a member."""
        return self.place[node]

    def exchange(self, _: None, state: SequenceState[int]) -> SequenceState[int]:
        """Set the length and the members at some indexes, as `state` says, and record the classes of these objects.

        Return the old length and the old members, with which a second call undoes this one. The key `_` is ignored.
        """
        before = state_before_overwriting(self, *state)
        for node in before[1].values():
            if self.classes[node] == self.number:  # otherwise the object is already in another extent
                self.classes[node] = -1
        self[:] = _overwritten_copy(self, *state)
        for index, node in state[1].items():
            self.place[node] = index
            self.classes[node] = self.number
        return before

    def mend(self, node: int) -> bool:
        """Complete or undo an interrupted `add`, `take` or `put` of an object. Return True if it is a member then."""
        members = dict.fromkeys(self)
        if len(members) < len(self):  # an interrupted `put` has appended a second copy of a member
            self.pop()
        else:  # `take` has not moved the last member into the gap
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


class OrderedValues(list[Any]):
    """A list of attribute values that may contain duplicates. Values are inserted and removed at positions.

    A key in the journal is a tuple of the position, the value, and the length of the list that contains the value.
    """

    __slots__ = ()

    def take(self, key: tuple[int, Any, int]) -> None:
        """Remove the value at the position of the key."""
        del self[key[0]]

    def put(self, key: tuple[int, Any, int], _: object) -> None:
        """Insert the value of the key at its position. The second argument is ignored."""
        self.insert(key[0], key[1])

    def where(self, key: tuple[int, Any, int]) -> int:
        """Return the position that the key contains."""
        return key[0]

    def mend(self, key: tuple[int, Any, int]) -> bool:
        """Return True if the value of the key is in the list. Nothing needs repair, because changes are atomic."""
        return len(self) == key[2]


def state_before_overwriting(sequence: list[Item], length: int, items: Iterable[int]) -> SequenceState[Item]:
    """Return the state with which a second `exchange` undoes `exchange` with the given length and indexes."""
    now = len(sequence)
    before = {index: sequence[index] for index in items if index < now}
    before.update((index, sequence[index]) for index in range(length, now))
    return now, before


def _overwritten_copy(sequence: list[Item], length: int, items: dict[int, Item]) -> list[Item]:
    """Return a copy of a sequence, cut or extended to `length`, with the elements `items` at their indexes."""
    after = list(sequence)
    if length > len(after):
        # The items contain every position past the old end, so each filler is overwritten.
        after.extend(repeat(next(iter(items.values())), length - len(after)))
    del after[length:]
    for index, item in items.items():
        after[index] = item
    return after


# --- undoing


def undo_entries(backwards: Iterator[Any]) -> None:
    """Undo the given journal entries by changing their containers. The journal itself is not changed.

    Args:
        backwards: the items of the entries from the last to the first, four items an entry.
    """
    for opcode, old, key, container in zip(backwards, backwards, backwards, backwards, strict=True):
        if opcode == ASSIGNED:
            container[key] = old
        elif opcode == ADDED:
            container.take(key)
        elif opcode == REMOVED:
            container.put(key, old)
        elif opcode == MOVED:
            container.move(key, old)
        else:
            container.exchange(key, old)


def undo_after_exception(journal: Journal, mark: int) -> None:
    """Undo and remove all journal entries from index `mark` on, after an exception.

    The change of the last entry may have been made, undone, or interrupted. The function may be called again if it is
    interrupted itself.
    """
    settle_last_entry(journal)
    while len(journal) > mark:
        undo_entries(reversed(journal[-4:]))
        del journal[-4:]


def settle_last_entry(journal: Journal) -> None:
    """Repair the container of the last journal entry after an exception may have interrupted its change.

    The entry is removed if it records an insertion or removal that was not made. Entries of other kinds stay, because
    undoing them is correct in both cases.
    """
    if journal:
        container, key, _, opcode = journal[-4:]
        if opcode in (ADDED, REMOVED) and container.mend(key) == (opcode == REMOVED):
            del journal[-4:]
        elif opcode == OVERWRITTEN and isinstance(container, IndexedSet):
            container.reindex()


def undo_and_invert(backwards: Iterator[Any], inverse: Journal) -> None:
    """Undo the given journal entries, and append to `inverse` the entries that redo their changes.

    Each inverse entry is appended before its entry is undone.

    Args:
        backwards: the items of the entries from the last to the first, four items an entry.
        inverse: the journal to extend.
    """
    for opcode, old, key, container in zip(backwards, backwards, backwards, backwards, strict=True):
        if opcode == ASSIGNED:
            inverse.extend((container, key, container[key], ASSIGNED))
            container[key] = old
        elif opcode == ADDED:
            inverse.extend((container, key, container.where(key), REMOVED))
            container.take(key)
        elif opcode == REMOVED:
            inverse.extend((container, key, None, ADDED))
            container.put(key, old)
        elif opcode == MOVED:
            inverse.extend((container, key, container.where(key), MOVED))
            container.move(key, old)
        elif isinstance(container, IndexedSet | Extent):
            inverse.extend((container, key, state_before_overwriting(container, *old), OVERWRITTEN))
            container.exchange(key, old)
        else:
            inverse.extend((container, key, container.exchange(key, old), OVERWRITTEN))


def net_journal(journal: Journal) -> Journal:
    """Return a journal that is usually shorter and has the same effect when it is undone from the current state.

    The result writes each cell at most once. Only the entries of `OrderedValues` lists, and of containers with a
    `MOVED` entry, are all kept as they are.
    """
    places: dict[tuple[int, Any], tuple[Any, Any, Any, int]] = {}
    sequences: dict[int, _SimulatedSequence] = {}
    codes = zip(journal[::4], journal[3::4], strict=True)
    shifted = {id(one) for one, code in codes if code == MOVED or isinstance(one, OrderedValues)}
    shifts: list[tuple[Any, Any, Any, int]] = []
    backwards = reversed(journal)
    for opcode, old, key, container in zip(backwards, backwards, backwards, backwards, strict=True):
        if id(container) in shifted:
            shifts.append((container, key, old, opcode))
        elif isinstance(container, IndexedSet | Extent) and opcode != ASSIGNED:
            sequence = sequences.get(id(container))
            if sequence is None:
                sequence = sequences[id(container)] = _SimulatedSequence(container)
            sequence.undo_entry(key, old, opcode)
        else:
            places[id(container), key] = (container, key, old, opcode)
    net: Journal = []
    for entry in places.values():
        container, key, old, opcode = entry
        if opcode != ASSIGNED or container[key] is not old:
            net.extend(entry)
    for sequence in sequences.values():
        length, items = sequence.net_state()
        if items or length != len(sequence.now):
            net.extend((sequence.now, None, (length, items), OVERWRITTEN))
    net.extend(chain.from_iterable(reversed(shifts)))
    return net


class _SimulatedSequence:
    """A simulation of undoing journal entries of an `IndexedSet` or `Extent`, which itself does not change."""

    def __init__(self, now: IndexedSet[Any] | Extent) -> None:
        self.now = now
        self._length = len(now)
        self._items: dict[int, Any] = {}
        self._places: dict[Any, int] = {}

    def undo_entry(self, key: Any, old: Any, opcode: int) -> None:
        """Undo one journal entry in the simulation. The arguments are the last three items of the entry."""
        if opcode == ADDED:
            self._length -= 1
            place = self._places[key] if key in self._places else self.now.where(key)
            if place < self._length:
                self._set_item(place, self._item_at(self._length))
        elif opcode == REMOVED:
            if old < self._length:
                self._set_item(self._length, self._item_at(old))
            self._set_item(old, key)
            self._length += 1
        else:
            self._length, items = old
            for place, item in items.items():
                self._set_item(place, item)

    def _set_item(self, place: int, item: Any) -> None:
        self._items[place] = item
        self._places[item] = place

    def _item_at(self, place: int) -> Any:
        return self._items[place] if place in self._items else self.now[place]

    def net_state(self) -> SequenceState[Any]:
        """Return the simulated length, and by index the simulated elements that differ from the real sequence."""
        now = self.now
        items = self._items.items()
        return self._length, {
            place: item
            for place, item in items
            if place < self._length and (place >= len(now) or now[place] is not item)
        }

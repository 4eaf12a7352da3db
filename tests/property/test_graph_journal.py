"""Undo and redo of the journal's own sequences."""

from __future__ import annotations

from hypothesis import given, strategies as st

from envgraph.graph import ADDED, ASSIGNED, OVERWRITTEN, REMOVED, IndexedSet
from envgraph.graph.store._undo_log import (
    MOVED,
    Extent,
    Journal,
    net_journal,
    undo_after_exception,
    undo_and_invert as _invert,
)


class Register:
    """The smallest structure that exchanges."""

    def __init__(self) -> None:
        self.state: dict[str, int] = {}

    def exchange(self, key: str, state: int) -> int:
        """As the protocol says."""
        before = self.state.get(key, 0)
        self.state[key] = state
        return before


class JournaledStructures:
    """A dict, a set, two extents that share their columns, and a register; changed at random, with a journal."""

    def __init__(self) -> None:
        self.journal: Journal = []
        self.values = dict.fromkeys(range(4), 0)
        self.set: IndexedSet[int] = IndexedSet((0, 1, 2))
        classes, place = [-1] * 12, [0] * 12
        self.extents = [Extent(number, classes, place) for number in range(2)]
        self.register = Register()
        self.classes = classes

    def change(self, kind: str, key: int, value: int) -> None:
        """One change; `key` and `value` are below 12."""
        if kind == "set":
            self.journal.extend((self.values, key % 4, self.values[key % 4], ASSIGNED))
            self.values[key % 4] = value
        elif kind == "exchange":
            self.journal.extend((self.register, "r", self.register.exchange("r", value), OVERWRITTEN))
        elif kind == "set member":
            self._toggle(self.set, key)
        else:
            held = self.classes[key]
            if held >= 0:
                self._toggle(self.extents[held], key)
            if value % 3:
                self._toggle(self.extents[value % 2], key) if held != value % 2 else None

    def _toggle(self, sequence: IndexedSet[int] | Extent, key: int) -> None:
        if key in sequence:
            self.journal.extend((sequence, key, sequence.take(key), REMOVED))
        else:
            sequence.add(key)
            self.journal.extend((sequence, key, None, ADDED))

    def snapshot(self) -> object:
        """Everything, order included."""
        return (
            dict(self.values),
            list(self.set),
            dict(self.set.position),
            [list(extent) for extent in self.extents],
            [(node, extent.where(node)) for extent in self.extents for node in extent],
            list(self.classes),
            dict(self.register.state) or {"r": 0},
        )


def invert(journal: Journal) -> Journal:
    """The entries that undo the undoing."""
    inverse: Journal = []
    _invert(reversed(journal), inverse)
    return inverse


def invert_net(journal: Journal) -> Journal:
    """The same, each place once."""
    inverse: Journal = []
    _invert(reversed(journal), inverse)
    return net_journal(inverse)


CHANGES = st.lists(
    st.tuples(
        st.sampled_from(["set", "exchange", "set member", "extent member", "extent member"]),
        st.integers(0, 11),
        st.integers(0, 11),
    ),
    max_size=30,
)


def make(changes: list[tuple[str, int, int]], world: JournaledStructures) -> Journal:
    """The journal of some more changes."""
    world.journal = []
    for change in changes:
        world.change(*change)
    return world.journal


@given(CHANGES, CHANGES)
def test_reverting_the_journal_to_a_mark_restores_all_structures(first: list, second: list) -> None:
    world = JournaledStructures()
    journal = make(first, world)
    mark, before = len(journal), world.snapshot()
    for change in second:
        world.change(*change)
    undo_after_exception(journal, mark)
    assert world.snapshot() == before
    assert len(journal) == mark


@given(CHANGES, st.lists(st.booleans(), min_size=1, max_size=6))
def test_inverted_journal_segments_undo_and_redo_the_changes(changes: list, nets: list[bool]) -> None:
    world = JournaledStructures()
    ends = [world.snapshot()]
    segment = make(changes, world)
    ends.append(world.snapshot())
    for step, net in enumerate(nets):
        segment = invert_net(segment) if net else invert(segment)
        assert world.snapshot() == ends[step % 2]


@given(st.lists(CHANGES, min_size=2, max_size=5), st.data())
def test_reduced_journal_segments_can_be_concatenated_and_reduced_again(parts: list[list], data: st.DataObject) -> None:
    world = JournaledStructures()
    start = world.snapshot()
    joined: Journal = []
    for changes in parts:
        segment = make(changes, world)
        if data.draw(st.booleans()):
            segment = invert_net(invert_net(segment))
        joined += segment
    end = world.snapshot()
    back = invert_net(joined)
    assert world.snapshot() == start
    again = invert(back) if data.draw(st.booleans()) else invert_net(back)
    assert world.snapshot() == end
    invert(again)
    assert world.snapshot() == start


@given(CHANGES)
def test_reduced_journal_segment_contains_every_changed_entry_once(changes: list) -> None:
    world = JournaledStructures()
    segment = invert_net(make(changes, world))
    places = list(zip(map(id, segment[::4]), segment[1::4], strict=True))
    assert len(places) == len(set(places))


@given(CHANGES)
def test_journal_segment_without_net_change_is_reduced_to_an_empty_one(changes: list) -> None:
    world = JournaledStructures()
    there = make([change for change in changes if change[0] != "exchange"], world)
    before = world.snapshot()
    back = invert(there)
    # Undoing `back` leads to the end, undoing `there` from the end to the start.
    assert invert_net(there + back) == []
    invert(back)
    assert world.snapshot() == before


def test_other_structures_can_use_the_journal() -> None:
    # As a view above the model would: its own entries between those of the model.
    class Counter:
        def __init__(self) -> None:
            self.counts: dict[str, int | None] = {}

        def exchange(self, key: str, state: int) -> int | None:
            before = self.counts.get(key)
            self.counts[key] = state
            return before

    matches, counter = IndexedSet[tuple[int, int]](()), Counter()
    index: dict[int, object] = {}
    journal: Journal = []
    journal.extend((matches, (1, 2), None, ADDED))
    matches.add((1, 2))
    journal.extend((counter, "p", counter.exchange("p", 1), OVERWRITTEN))
    journal.extend((index, 1, index.get(1), ASSIGNED))
    index[1] = (1, 2)
    mark = len(journal)
    journal.extend((matches, (1, 2), matches.take((1, 2)), REMOVED))
    undo_after_exception(journal, mark)
    assert matches == [(1, 2)]
    back: Journal = []
    _invert(reversed(journal), back)
    assert (matches, counter.counts, index) == ([], {"p": None}, {1: None})
    _invert(reversed(back), [])
    assert (matches, counter.counts, index) == ([(1, 2)], {"p": 1}, {1: (1, 2)})


def test_moving_an_item_updates_indices_and_can_be_undone() -> None:
    items = IndexedSet(tuple(range(300)))
    journal: Journal = []
    for item, index in ((299, 0), (5, 200), (0, 299), (150, 150), (299, 298)):
        journal.extend((items, item, items.where(item), MOVED))
        items.move(item, index)
        assert items[index] == item and [items.where(one) for one in items] == [*range(300)]
    after = list(items)
    back: Journal = []
    _invert(reversed(journal), back)
    assert items == [*range(300)]
    _invert(reversed(back), [])
    assert items == after
    assert items.take(299) == 298 and items.take(1) == after.index(1)
    assert [items.where(one) for one in items] == [*range(298)]

"""Operators of a view network. Each stores one relation, and updates it when the network processes the operator.

The consumers of an operator are the operators that read it; it calls their hooks for each changed tuple. The tuple is
present while the hooks run: it is inserted before, and deleted after.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from envgraph.graph import Store
from envgraph.match.views.operators._sets import Groups, Index, MatchSet, Row, become
from envgraph.match.views.operators._upkeep import changes

Hook = Callable[..., object]


class Operator(ABC):
    """A node of a view network: it stores one relation, a set of tuples that other operators (its consumers) read.

    Attributes:
        name: unique in the network.
        added: called with the values of a tuple after its insertion; None without consumers.
        removing: called with the values of a tuple before its deletion; None without consumers.
    """

    def __init__(self, name: str, store: Store) -> None:
        self.name = name
        self.store = store
        self.added: Hook | None = None
        self.removing: Hook | None = None

    @property
    @abstractmethod
    def pending(self) -> bool:
        """Return True if changes wait for `process`."""

    @abstractmethod
    def process(self) -> None:
        """Apply the pending changes to the relation, and call the hooks of the consumers.

        All relations that the operator reads must be up to date.
        """

    @abstractmethod
    def forget(self) -> None:
        """Discard the pending changes without applying them."""

    @abstractmethod
    def fill(self) -> None:
        """Recompute the whole relation from the relations that the operator reads, without calling consumers."""

    @abstractmethod
    def size(self) -> float:
        """Return the number of tuples."""


class Rows(Operator):
    """An operator that stores the tuples of its relation.

    Attributes:
        rows: the tuples.
        groups: the groups of tuples that consumers read, by key positions and item position.
        listed: False if only the groups are stored, because consumers read nothing else.
        asked: True if a consumer other than a closure reads the rows or groups.
    """

    def __init__(self, name: str, store: Store) -> None:
        super().__init__(name, store)
        self.rows = MatchSet(store)
        self.groups: dict[tuple[tuple[int, ...], int | None], Groups] = {}
        self.listed = True
        self.asked = False

    def size(self) -> float:
        if not self.listed:
            return float(sum(map(len, next(iter(self.groups.values())).table.values())))
        return float(len(self.rows))

    def group_table(self, positions: tuple[int, ...]) -> Mapping[Any, Collection[Any]]:
        """Return the tuples grouped by their values at some positions, and mark the operator as `asked`."""
        self.asked = True
        return self.group(positions).table

    def unlist(self) -> None:
        """Delete the stored rows, and store only the groups from now on."""
        self.listed = False
        self.rows.replace([])

    def group(self, positions: tuple[int, ...], item: int | None = None) -> Groups:
        """Return groups of the tuples, or of their values at `item`, by the values at `positions`; create them once."""
        key = (positions, item)
        if key not in self.groups:
            groups = self.groups[key] = Groups(self.store, positions, item)
            groups.fill(self.rows)
        return self.groups[key]

    def appear(self, row: Row) -> None:
        """Insert a tuple into the rows and groups, then call the consumers."""
        self.rows.appear(row)
        for groups in self.groups.values():
            groups.add(row)
        if self.added is not None:
            self.added(*row)

    def vanish(self, row: Row) -> None:
        """Call the consumers, then delete a tuple from the groups and rows."""
        if self.removing is not None:
            self.removing(*row)
        for groups in self.groups.values():
            groups.drop(row)
        self.rows.vanish(row)

    def hold(self, row: Row) -> None:
        """Insert a tuple into the rows and groups without calling consumers."""
        self.rows.appear(row)
        for groups in self.groups.values():
            groups.add(row)

    def set_rows(self, rows: Sequence[Row]) -> None:
        """Replace all tuples in the rows and groups without calling consumers."""
        self.rows.replace(rows if self.listed else [])
        for groups in self.groups.values():
            groups.fill(rows)

    def check(self, rows: Iterable[Row]) -> None:
        """Assert that exactly these tuples are stored, and that positions, indexes and groups agree with them."""
        if not self.listed:
            for groups in self.groups.values():
                groups.check(list(dict.fromkeys(rows)))
            return
        assert set(self.rows) == set(rows), self.name
        assert len(set(self.rows)) == len(self.rows)
        assert self.rows.position == {row: index for index, row in enumerate(self.rows)}
        for positions, index in self.rows.indexes.items():
            assert index.table == Index(positions, self.rows).table
        for groups in self.groups.values():
            groups.check(self.rows)


class View(Rows):
    """A materialized view: the tuples that have at least one derivation.

    Attributes:
        counts: the support count (number of derivations) of each tuple; None if no tuple has several.
        queue: pending derivations, flat: a tuple, then True if it is inserted, False if deleted.
        list_derivations: lists the tuples of all derivations, with repetitions.
        derive, underive: add or remove one derivation of a tuple; with the first or last one insert or delete it.
        work: processes the whole queue with `derive` and `underive`.
    """

    def __init__(self, name: str, store: Store, counted: bool) -> None:
        super().__init__(name, store)
        self.counts: dict[Row, int] | None = {} if counted else None
        self.queue: list[Any] = []
        self.list_derivations: Callable[[], list[Row]] = list
        self.derive: Callable[[Row], None] = _unmade
        self.underive: Callable[[Row], None] = _unmade
        self.work: Callable[[], None] = _unmade

    @property
    def pending(self) -> bool:
        return bool(self.queue)

    def forget(self) -> None:
        self.queue.clear()

    def make(self, arity: int) -> None:
        """Generate `derive`, `underive` and `work` for the present consumers and groups, in place of earlier functions.

        Args:
            arity: the number of values in a row.
        """
        self.derive, self.underive, self.work = changes(self, self.counts, arity)

    def process(self) -> None:
        self.work()

    def fill(self) -> None:
        found = self.list_derivations()
        if self.counts is None:
            self.set_rows(found)
            return
        counts: dict[Row, int] = {}
        for row in found:
            counts[row] = counts.get(row, 0) + 1
        become(self.store, self.counts, counts, 0)
        self.set_rows(list(counts))

    def check_derivations(self) -> None:
        """Assert that no change is pending, and that tuples and support counts equal those of a new computation."""
        assert not self.queue
        found = self.list_derivations()
        self.check(found)
        if self.counts is None:
            assert len(found) == len(set(found)), f"{self.name}: a tuple with two derivations"
            return
        counts: dict[Row, int] = {}
        for row in found:
            counts[row] = counts.get(row, 0) + 1
        assert {row: count for row, count in self.counts.items() if count} == counts, self.name


def fill_unrecorded(operator: Operator) -> None:
    """Recompute the relation of an operator without journalling, so a rollback does not restore its former tuples."""
    with unrecorded(operator.store):
        operator.fill()


@contextmanager
def unrecorded(store: Store) -> Iterator[None]:
    """Turn off the journal of a store in a `with` block. A rollback does not undo the changes of the block."""
    recording, store.recording = store.recording, False
    try:
        yield
    finally:
        store.recording = recording


def _unmade(*_: object) -> None:
    """Raise an `AssertionError`, because the update functions of the view do not exist yet."""
    raise AssertionError("the view is not connected yet")


class Evaluated(Rows):
    """An operator for a pattern without delta functions, which is evaluated again after every change of the model.

    Args:
        name: the name of the pattern.
        store: its revision shows when the rows may be out of date.
        evaluate: lists the rows.
    """

    def __init__(self, name: str, store: Store, evaluate: Callable[[], Sequence[Row]]) -> None:
        super().__init__(name, store)
        self._evaluate = evaluate
        self._revision = -1

    @property
    def pending(self) -> bool:
        return self._revision != self.store.revision

    def forget(self) -> None:
        self._revision = self.store.revision

    def process(self) -> None:
        self._revision = self.store.revision
        rows = self._evaluate()
        now = dict.fromkeys(rows)
        for row in [row for row in self.rows if row not in now]:
            self.vanish(row)
        known = self.rows.position
        for row in [row for row in rows if row not in known]:
            self.appear(row)

    def fill(self) -> None:
        self._revision = self.store.revision
        self.set_rows(self._evaluate())

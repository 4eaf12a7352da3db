"""Operators of a view network. Each stores one relation, and updates it when the network processes the operator.

The consumers of an operator are the operators that read it; it calls their hooks for each changed tuple. The tuple is
present while the hooks run: it is inserted before, and deleted after.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from envgraph.graph import Store
from envgraph.match.views.operators._row_set import MatchSet, Row, RowGroups, RowIndex, set_contents
from envgraph.match.views.operators._support_count import make_update_functions

Hook = Callable[..., object]


class Operator(ABC):
    """A node of a view network: it stores one relation, a set of tuples that other operators (its consumers) read.

    Attributes:
        name: unique in the network.
        on_inserted: called with the values of a tuple after its insertion; None without consumers.
        on_deleting: called with the values of a tuple before its deletion; None without consumers.
    """

    def __init__(self, name: str, store: Store) -> None:
        self.name = name
        self.store = store
        self.on_inserted: Hook | None = None
        self.on_deleting: Hook | None = None

    @property
    @abstractmethod
    def is_pending(self) -> bool:
        """Return True if changes wait for `process`."""

    @abstractmethod
    def process(self) -> None:
        """Apply the pending changes to the relation, and call the hooks of the consumers.

        All relations that the operator reads must be up to date.
        """

    @abstractmethod
    def discard_pending(self) -> None:
        """Discard the pending changes without applying them."""

    @abstractmethod
    def recompute(self) -> None:
        """Recompute the whole relation from the relations that the operator reads, without calling consumers."""

    @abstractmethod
    def size(self) -> float:
        """Return the number of tuples."""


class RowOperator(Operator):
    """An operator that stores the tuples of its relation.

    Attributes:
        rows: the tuples.
        groups: the groups of tuples that consumers read, by key positions and item position.
        stores_rows: False if only the groups are stored, because consumers read nothing else.
        is_read: True if a consumer other than a closure reads the rows or groups.
    """

    def __init__(self, name: str, store: Store) -> None:
        super().__init__(name, store)
        self.rows = MatchSet(store)
        self.groups: dict[tuple[tuple[int, ...], int | None], RowGroups] = {}
        self.stores_rows = True
        self.is_read = False

    def size(self) -> float:
        if not self.stores_rows:
            return float(sum(map(len, next(iter(self.groups.values())).table.values())))
        return float(len(self.rows))

    def group_table(self, positions: tuple[int, ...]) -> Mapping[Any, Collection[Any]]:
        """Return the tuples grouped by their values at some positions, and mark the operator as `is_read`."""
        self.is_read = True
        return self.group(positions).table

    def drop_rows(self) -> None:
        """Delete the stored rows, and store only the groups from now on."""
        self.stores_rows = False
        self.rows.replace([])

    def group(self, positions: tuple[int, ...], item: int | None = None) -> RowGroups:
        """Return groups of the tuples, or of their values at `item`, by the values at `positions`; create them once."""
        key = (positions, item)
        if key not in self.groups:
            groups = self.groups[key] = RowGroups(self.store, positions, item)
            groups.replace_rows(self.rows)
        return self.groups[key]

    def insert(self, row: Row) -> None:
        """Insert a tuple into the rows and groups, then call the consumers."""
        self.rows.insert_row(row)
        for groups in self.groups.values():
            groups.add(row)
        if self.on_inserted is not None:
            self.on_inserted(*row)

    def delete(self, row: Row) -> None:
        """Call the consumers, then delete a tuple from the groups and rows."""
        if self.on_deleting is not None:
            self.on_deleting(*row)
        for groups in self.groups.values():
            groups.drop(row)
        self.rows.delete_row(row)

    def insert_silently(self, row: Row) -> None:
        """Insert a tuple into the rows and groups without calling consumers."""
        self.rows.insert_row(row)
        for groups in self.groups.values():
            groups.add(row)

    def set_rows(self, rows: Sequence[Row]) -> None:
        """Replace all tuples in the rows and groups without calling consumers."""
        self.rows.replace(rows if self.stores_rows else [])
        for groups in self.groups.values():
            groups.replace_rows(rows)

    def check_rows(self, rows: Iterable[Row]) -> None:
        """Assert that exactly these tuples are stored, and that positions, indexes and groups agree with them."""
        if not self.stores_rows:
            for groups in self.groups.values():
                groups.check(list(dict.fromkeys(rows)))
            return
        assert set(self.rows) == set(rows), self.name
        assert len(set(self.rows)) == len(self.rows)
        assert self.rows.position == {row: index for index, row in enumerate(self.rows)}
        for positions, index in self.rows.indexes.items():
            assert index.table == RowIndex(positions, self.rows).table
        for groups in self.groups.values():
            groups.check(self.rows)


class MaterializedView(RowOperator):
    """A materialized view: the tuples that have at least one derivation.

    Attributes:
        counts: the support count (number of derivations) of each tuple; None if no tuple has several.
        queue: pending derivations, flat: a tuple, then True if it is inserted, False if deleted.
        list_derivations: lists the tuples of all derivations, with repetitions.
        add_derivation, remove_derivation: add or remove one derivation of a tuple; with the first or last one
            insert or delete it.
        process_queue: processes the whole queue with `add_derivation` and `remove_derivation`.
    """

    def __init__(self, name: str, store: Store, counted: bool) -> None:
        super().__init__(name, store)
        self.counts: dict[Row, int] | None = {} if counted else None
        self.queue: list[Any] = []
        self.list_derivations: Callable[[], list[Row]] = list
        self.add_derivation: Callable[[Row], None] = _refuse_update
        self.remove_derivation: Callable[[Row], None] = _refuse_update
        self.process_queue: Callable[[], None] = _refuse_update

    @property
    def is_pending(self) -> bool:
        return bool(self.queue)

    def discard_pending(self) -> None:
        self.queue.clear()

    def build_functions(self, arity: int) -> None:
        """Generate `add_derivation`, `remove_derivation` and `process_queue` for the present consumers and groups, in
        place of earlier functions.

        Args:
            arity: the number of values in a row.
        """
        self.add_derivation, self.remove_derivation, self.process_queue = make_update_functions(
            self, self.counts, arity
        )

    def process(self) -> None:
        self.process_queue()

    def recompute(self) -> None:
        found = self.list_derivations()
        if self.counts is None:
            self.set_rows(found)
            return
        counts = dict(Counter(found))
        set_contents(self.store, self.counts, counts, 0)
        self.set_rows(list(counts))

    def check_derivations(self) -> None:
        """Assert that no change is pending, and that tuples and support counts equal those of a new computation."""
        assert not self.queue
        found = self.list_derivations()
        self.check_rows(found)
        if self.counts is None:
            assert len(found) == len(set(found)), f"{self.name}: a tuple with two derivations"
            return
        assert {row: count for row, count in self.counts.items() if count} == Counter(found), self.name


def recompute_unrecorded(operator: Operator) -> None:
    """Recompute the relation of an operator without journalling, so a rollback does not restore its former tuples."""
    with unrecorded(operator.store):
        operator.recompute()


@contextmanager
def unrecorded(store: Store) -> Iterator[None]:
    """Turn off the journal of a store in a `with` block. A rollback does not undo the changes of the block."""
    recording, store.recording = store.recording, False
    try:
        yield
    finally:
        store.recording = recording


def _refuse_update(*_: object) -> None:
    """Raise an `AssertionError`, because the update functions of the view do not exist yet."""
    raise AssertionError("the view is not connected yet")


class RecomputedRows(RowOperator):
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
    def is_pending(self) -> bool:
        return self._revision != self.store.revision

    def discard_pending(self) -> None:
        self._revision = self.store.revision

    def process(self) -> None:
        self._revision = self.store.revision
        rows = self._evaluate()
        now = dict.fromkeys(rows)
        for row in [row for row in self.rows if row not in now]:
            self.delete(row)
        known = self.rows.position
        for row in [row for row in rows if row not in known]:
            self.insert(row)

    def recompute(self) -> None:
        self._revision = self.store.revision
        self.set_rows(self._evaluate())

"""The stored rows of operators: row sets, groups, indexes and logs. Rollbacks and checkouts restore sets and groups."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from envgraph.graph import ADDED, ASSIGNED, OVERWRITTEN, REMOVED, IndexedSet, Store, state_before_overwriting
from envgraph.match._match_costs import VIEWS

Row = tuple[Any, ...]


class RowLog(list[Any]):
    """A log of inserted and deleted rows, flat: a row, then True if it was inserted, False if deleted."""

    __slots__ = ("_shortest",)

    def __init__(self) -> None:
        super().__init__()
        self._shortest = 0

    def shorten(self) -> None:
        """Replace the log by its net changes, deletions first, if it has more than doubled since it was shortened."""
        if len(self) > 2 * self._shortest + VIEWS.long_log:
            appeared, disappeared = net_rows(self)
            gone = [part for row in disappeared for part in (row, False)]
            self[:] = [
                *gone,
                *(part for row in appeared for part in (row, True)),
            ]  # in one step, so that an interruption leaves a valid log
            self._shortest = len(self)


class RowIndex:
    """An index of rows by their values at some positions.

    The index is not journalled. Its `MatchSet` updates it at all insertions and deletions, also by rollbacks and
    checkouts.

    Attributes:
        table: maps a key to its rows, in no meaningful order; keys without rows are absent.
    """

    __slots__ = ("_key", "table")

    def __init__(self, positions: tuple[int, ...], rows: Sequence[Row]) -> None:
        self._key = make_key_function(positions)
        self.table: dict[Any, dict[Row, None]] = {}
        for row in rows:
            self.insert(row)

    def insert(self, row: Row) -> None:
        """Add a row under its key."""
        self.table.setdefault(self._key(row), {})[row] = None

    def delete(self, row: Row) -> None:
        """Remove a row, and its key, too, if no other row has this key."""
        key = self._key(row)
        group = self.table[key]
        del group[row]
        if not group:
            del self.table[key]


class MatchSet(IndexedSet[Row]):
    """The rows of a view, in an order that depends only on the version of the model.

    Attributes:
        store: the store whose journal records the changes.
        log: all insertions and deletions, also those of rollbacks and checkouts; None if no subscriber needs them.
        indexes: the indexes that lookups have created, by key positions; emptied after an interruption.
    """

    __slots__ = ("indexes", "log", "store")

    def __init__(self, store: Store) -> None:
        super().__init__()
        self.store = store
        self.log: RowLog | None = None
        self.indexes: dict[tuple[int, ...], RowIndex] = {}

    def insert_row(self, row: Row) -> None:
        """Append a new row, write this to the journal and the log, and update the indexes."""
        if self.log is not None:
            self.log.extend((row, True))
        store = self.store
        if store.recording:
            store.journal.extend((self, row, None, ADDED))
        self.position[row] = len(self)
        self.append(row)
        if self.indexes:
            self.inserted(row)

    def delete_row(self, row: Row) -> None:
        """Delete a row, move the last row to its position, write this to journal and log, and update the indexes."""
        if self.log is not None:
            self.log.extend((row, False))
        index = self.position[row]
        store = self.store
        if store.recording:
            store.journal.extend((self, row, index, REMOVED))
        del self.position[row]
        last = self.pop()
        if index < len(self):
            self[index] = last
            self.position[last] = index
        if self.indexes:
            self.deleted(row)

    def inserted(self, row: Row) -> None:
        """Add an inserted row to all indexes."""
        for index in self.indexes.values():
            index.insert(row)

    def deleted(self, row: Row) -> None:
        """Remove a deleted row from all indexes."""
        for index in self.indexes.values():
            index.delete(row)

    # --- called by the journal during undo and redo

    def take(self, item: Row) -> int:
        """Remove a row during undo or redo, update log and indexes, and return its position before the removal."""
        if self.log is not None:
            self.log.extend((item, False))
        index = super().take(item)
        if self.indexes:
            self.deleted(item)
        return index

    def put(self, item: Row, index: int) -> None:
        """Insert a row at a position during undo or redo, and update log and indexes."""
        if self.log is not None:
            self.log.extend((item, True))
        super().put(item, index)
        if self.indexes:
            self.inserted(item)

    def add(self, item: Row) -> None:
        """Append a row during undo or redo, and update log and indexes."""
        if self.log is not None:
            self.log.extend((item, True))
        super().add(item)
        if self.indexes:
            self.inserted(item)

    def exchange(self, key: None, state: tuple[int, dict[int, Row]]) -> tuple[int, dict[int, Row]]:
        """Set the number of rows and the rows at some positions to a journalled `state`, and update log and indexes.

        Called during undo and redo. Return the state that reverses this call.
        """
        if self.log is None and not self.indexes:
            return super().exchange(key, state)
        before = state_before_overwriting(self, *state)
        rows: list[Row] = list(self)
        rows.extend([()] * (state[0] - len(rows)))
        del rows[state[0] :]
        for index, row in state[1].items():
            rows[index] = row
        # Rows at changed positions before, and rows at these positions now.
        gone = list(before[1].values())
        come = [rows[index] for index in sorted({*before[1], *state[1]}) if index < len(rows)]
        self._set_rows(rows, gone, come)
        for row in gone if self.indexes else ():
            self.deleted(row)
        for row in come if self.indexes else ():
            self.inserted(row)
        return before

    def replace(self, rows: Sequence[Row]) -> None:
        """Replace all rows, write this to the journal and the log, and discard the indexes."""
        if self.store.recording:
            self.store.journal.extend((self, None, (len(self), dict(enumerate(self))), OVERWRITTEN))
        self.indexes.clear()
        self._set_rows(list(rows), list(self), rows)

    def _set_rows(self, rows: list[Row], deleted: Sequence[Row], inserted: Sequence[Row]) -> None:
        """Set the rows and their positions. Append the deleted rows (`deleted`) and inserted rows (`inserted`) to the
        log.
        """
        if self.log is not None:
            log = type(self.log)()
            list.extend(log, self.log)
            list.extend(log, [part for row in deleted for part in (row, False)])
            list.extend(log, [part for row in inserted for part in (row, True)])
            self[:], self.log = rows, log
        else:
            self[:] = rows
        super().reindex()

    def reindex(self) -> None:
        """Recompute the positions, and discard the indexes. Remove the last log entry if its change did not happen."""
        self.indexes.clear()
        super().reindex()
        log = self.log
        if log and (log[-2] in self.position) != log[-1]:
            del log[-2:]


class GroupTable(dict[Any, "tuple[Any, ...] | IndexedSet[Any]"]):
    """A dict from keys to groups of items. A missing key has an empty tuple, which is not inserted."""

    __slots__ = ()

    def __missing__(self, key: Any) -> tuple[Any, ...]:
        return ()


class RowGroups:
    """The rows of a relation, or their values at one position, grouped by their values at other positions.

    Attributes:
        table: maps a key to its items: a tuple, or an `IndexedSet` for many. A group that becomes empty stays as an
            empty tuple. The key is a bare value for one position, else a tuple.

    Args:
        store: the store of the model.
        positions: the positions of the key.
        item: the position of the stored value; None for the whole row.
    """

    __slots__ = ("item", "key", "positions", "store", "table")

    def __init__(self, store: Store, positions: tuple[int, ...], item: int | None = None) -> None:
        self.store = store
        self.positions = positions
        self.item = item
        self.table = GroupTable()
        self.key = make_key_function(positions)

    def add(self, row: Row) -> None:
        """Add a row, or its value at `item`, to the group of its key, and journal the change."""
        self.store.add_item(self.table, self.key(row), row if self.item is None else row[self.item])

    def drop(self, row: Row) -> None:
        """Remove a row, or its value at `item`, from the group of its key, and journal the change."""
        self.store.remove_item(self.table, self.key(row), row if self.item is None else row[self.item])

    def replace_rows(self, rows: Sequence[Row]) -> None:
        """Replace all groups by the groups of these rows, and journal the changes."""
        table: dict[Any, list[Any]] = {}
        key, item = self.key, self.item
        for row in rows:
            table.setdefault(key(row), []).append(row if item is None else row[item])
        set_contents(
            self.store,
            self.table,
            {key: self.store.as_adjacency(group) for key, group in table.items()},
            (),
        )

    def check(self, rows: Sequence[Row]) -> None:
        """Assert that the groups contain exactly these rows, each once and under its key."""
        assert sum(map(len, self.table.values())) == len(rows)
        for row in rows:
            assert (row if self.item is None else row[self.item]) in self.table[self.key(row)]
        for group in self.table.values():
            assert type(group) is type(self.store.as_adjacency(group))
            assert len(set(group)) == len(group)


def set_contents(store: Store, table: dict[Any, Any], values: dict[Any, Any], missing_value: Any) -> None:
    """Set the contents of a dict to `values`, and journal the changes if the journal is on.

    With the journal on, keys that are not in `values` remain, with the value `missing_value`, which means a missing
    key.
    """
    if not store.recording:
        table.clear()
        table.update(values)
        return
    record = store.journal.extend
    for key, old in table.items():
        if key not in values and old != missing_value:
            record((table, key, old, ASSIGNED))
            table[key] = missing_value
    for key, value in values.items():
        old = table.get(key, missing_value)
        if old != value:
            record((table, key, old, ASSIGNED))
            table[key] = value


def make_key_function(positions: tuple[int, ...]) -> Callable[[Row], Any]:
    """Return a function that returns the key of a row: a bare value for one position, else a tuple."""
    if len(positions) == 1:
        (position,) = positions
        return lambda row: row[position]
    return lambda row: tuple([row[position] for position in positions])


def net_rows(log: Sequence[Any]) -> tuple[list[Row], list[Row]]:
    """Return the rows that a log inserts on balance, and those that it deletes on balance, in the order of the log."""
    balance: dict[Row, int] = {}
    entries = iter(log)
    for row, came in zip(entries, entries, strict=True):
        balance[row] = balance.get(row, 0) + (1 if came else -1)
    return [row for row, sum_ in balance.items() if sum_ > 0], [r for r, sum_ in balance.items() if sum_ < 0]

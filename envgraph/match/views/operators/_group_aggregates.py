"""Aggregates of groups. Small groups are recomputed when they change, large groups are updated by each change."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from itertools import islice
from typing import Any, Protocol

from envgraph.graph import SET, Store
from envgraph.match._aggregates import aggregate
from envgraph.match._costs import VIEWS
from envgraph.match.views.operators._operators import Hook, Operator, Rows
from envgraph.match.views.operators._running_aggregates import Change, Extremes, Totals
from envgraph.match.views.operators._sets import Row, become


class Grouped(Protocol):
    """The interface of relations that can be aggregated by group."""

    name: str
    store: Store

    def group_table(self, positions: tuple[int, ...]) -> Mapping[Any, Collection[Any]]:
        """Return the tuples grouped by their values at some positions."""


class Values(dict[Row, Any]):
    """The aggregate values of groups. A missing group has the value of an empty group, and is not inserted."""

    __slots__ = ("empty",)

    def __init__(self, empty: Any) -> None:
        super().__init__()
        self.empty = empty

    def __missing__(self, key: Row) -> Any:
        return self.empty


class Fold(Operator):
    """An operator that stores an aggregate for each group of a relation. A missing group has the value of an empty one.

    Args:
        name: unique in the network.
        source: the aggregated relation.
        group: the positions whose values distinguish the groups.
        function: count, sum, min, max or avg.
        column: the aggregated position; None for count.
    """

    def __init__(
        self, name: str, source: Grouped, group: tuple[int, ...], function: str, column: int | None
    ) -> None:
        super().__init__(name, source.store)
        self.source = source
        self.function = function
        self.column = column
        self.empty = aggregate(function, [])
        self.values = Values(self.empty)
        self._table = source.group_table(group)
        self._bare = len(group) == 1
        self.group = group
        self._dirty: dict[Row, list[Change]] = {}
        self._running: dict[Row, Totals | Extremes | None] = {}

    @property
    def pending(self) -> bool:
        return bool(self._dirty)

    def forget(self) -> None:
        self._dirty.clear()

    def size(self) -> float:
        return float(len(self.values))

    @property
    def hooks(self) -> tuple[Hook, Hook]:
        """Return the hook to call for an inserted tuple of the source, and the hook for a deleted tuple."""
        return (self._touch, self._touch) if self.column is None else (self._changed(1), self._changed(-1))

    def _touch(self, *row: Any) -> None:
        """Mark the group of a tuple as changed, so that `process` recomputes its value."""
        self._dirty[tuple([row[position] for position in self.group])] = []

    def _changed(self, number: int) -> Callable[..., None]:
        """Return a hook that queues, for a tuple's group, one more (`number` 1) or one less (-1) of its value."""
        group, column, dirty = self.group, self.column, self._dirty
        assert column is not None

        def change(*row: Any) -> None:
            key = tuple([row[position] for position in group])
            if key in dirty:
                dirty[key].append((row[column], number))
            else:
                dirty[key] = [(row[column], number)]

        return change

    def process(self) -> None:
        dirty = self._dirty.copy()
        self._dirty.clear()
        values, counted = self.values, self.column is None
        for key, changes in dirty.items():
            old = values.get(key, self.empty)
            new = self._computed(key) if counted else self._followed(key, changes)
            if old == new:
                continue
            if old is not None and self.removing is not None:
                self.removing(*key, old)
            if self.store.recording:
                self.store.journal.extend((values, key, old, SET))
            values[key] = new
            if new is not None and self.added is not None:
                self.added(*key, new)

    def _put(self, table: dict[Row, Any], key: Row, old: Any, new: Any) -> None:
        """Set the entry of a key in a dict to the value `new`, and journal the value `old`."""
        if self.store.recording:
            self.store.journal.extend((table, key, old, SET))
        table[key] = new

    def _rows(self, key: Row) -> Collection[Row]:
        """Return the tuples of a group; an empty tuple if there are none."""
        return self._table.get(key[0] if self._bare else key, ())

    def _computed(self, key: Row) -> Any:
        """Compute the value of a group from all of its tuples."""
        rows, column = self._rows(key), self.column
        if column is None:
            return len(rows)
        return aggregate(self.function, [row[column] for row in rows])

    def _followed(self, key: Row, changes: Sequence[Change]) -> Any:
        """Return the new value of a group: recomputed or, for a group that is or was large, by a running aggregate."""
        assert self.column is not None
        running, rows = self._running.get(key), self._rows(key)
        if running is None and len(rows) <= VIEWS.large:
            return self._computed(key)
        if running is None:
            kind = Totals if self.function in ("sum", "avg") else Extremes
            running = kind(self.store, self.function, [row[self.column] for row in rows])
            self._put(self._running, key, None, running)
        else:
            running.follow(changes)
        if not rows:
            self._put(self._running, key, running, None)
            return self.empty
        return running.value() if running.knows else self._computed(key)

    def fill(self) -> None:
        keys = [(key,) if self._bare else key for key in self._table]
        become(self.store, self.values, {key: self._computed(key) for key in keys}, self.empty)
        become(self.store, self._running, {}, None)

    def check(self) -> None:
        """Assert that every value equals that of a new computation."""
        for key in {*self.values, *((k,) if self._bare else k for k in self._table)}:
            assert self.values[key] == self._computed(key), self.name
            running = self._running.get(key)
            if running is not None:
                assert self.column is not None
                running.check([row[self.column] for row in self._rows(key)])


class Nth(Fold):
    """An operator with the last value of row `number` (from 0) of each group; None for a group with fewer rows."""

    def __init__(self, name: str, source: Rows, group: tuple[int, ...], number: int) -> None:
        super().__init__(name, source, group, "min", None)
        self.function = f"row {number + 1}"
        self._number = number

    def _computed(self, key: Row) -> Any:
        return next((row[-1] for row in islice(self._rows(key), self._number, None)), None)

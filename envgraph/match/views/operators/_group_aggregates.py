"""Aggregates of groups. Small groups are recomputed when they change, large groups are updated by each change."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from itertools import islice
from typing import Any, Protocol

from envgraph.graph import ASSIGNED, Store
from envgraph.match._aggregate_values import aggregate
from envgraph.match._match_costs import VIEWS
from envgraph.match.views.operators._materialized_view import Hook, Operator, RowOperator
from envgraph.match.views.operators._row_set import Row, set_contents
from envgraph.match.views.operators._running_aggregates import Change, RunningExtreme, RunningTotal


class GroupedRelation(Protocol):
    """The interface of relations that can be aggregated by group."""

    name: str
    store: Store

    def group_table(self, positions: tuple[int, ...]) -> Mapping[Any, Collection[Any]]:
        """Return the tuples grouped by their values at some positions."""


class GroupValues(dict[Row, Any]):
    """The aggregate values of groups. A missing group has the value of an empty group, and is not inserted."""

    __slots__ = ("empty",)

    def __init__(self, empty: Any) -> None:
        super().__init__()
        self.empty = empty

    def __missing__(self, key: Row) -> Any:
        return self.empty


class AggregateOperator(Operator):
    """An operator that stores an aggregate for each group of a relation. A missing group has the value of an empty one.

    Args:
        name: unique in the network.
        source: the aggregated relation.
        group: the positions whose values distinguish the groups.
        function: count, sum, min, max or avg.
        column: the aggregated position; None for count.
    """

    def __init__(
        self, name: str, source: GroupedRelation, group: tuple[int, ...], function: str, column: int | None
    ) -> None:
        super().__init__(name, source.store)
        self.source = source
        self.function = function
        self.column = column
        self.empty = aggregate(function, [])
        self.values = GroupValues(self.empty)
        self._table = source.group_table(group)
        self._bare = len(group) == 1
        self.group = group
        self._dirty: dict[Row, list[Change]] = {}
        self._running: dict[Row, RunningTotal | RunningExtreme | None] = {}

    @property
    def is_pending(self) -> bool:
        return bool(self._dirty)

    def discard_pending(self) -> None:
        self._dirty.clear()

    def size(self) -> float:
        return float(len(self.values))

    @property
    def hooks(self) -> tuple[Hook, Hook]:
        """Return the hook to call for an inserted tuple of the source, and the hook for a deleted tuple."""
        return (
            (self._mark_group, self._mark_group)
            if self.column is None
            else (self._make_change_hook(1), self._make_change_hook(-1))
        )

    def _mark_group(self, *row: Any) -> None:
        """Mark the group of a tuple as changed, so that `process` recomputes its value."""
        self._dirty[tuple([row[position] for position in self.group])] = []

    def _make_change_hook(self, sign: int) -> Callable[..., None]:
        """Return a hook that queues, for a tuple's group, one more (`sign` 1) or one less (-1) of its value."""
        group, column, dirty = self.group, self.column, self._dirty
        assert column is not None

        def change(*row: Any) -> None:
            key = tuple([row[position] for position in group])
            if key in dirty:
                dirty[key].append((row[column], sign))
            else:
                dirty[key] = [(row[column], sign)]

        return change

    def process(self) -> None:
        dirty = self._dirty.copy()
        self._dirty.clear()
        values, counted = self.values, self.column is None
        for key, changes in dirty.items():
            old = values.get(key, self.empty)
            new = self._compute(key) if counted else self._update(key, changes)
            if old == new:
                continue
            if old is not None and self.on_deleting is not None:
                self.on_deleting(*key, old)
            if self.store.recording:
                self.store.journal.extend((values, key, old, ASSIGNED))
            values[key] = new
            if new is not None and self.on_inserted is not None:
                self.on_inserted(*key, new)

    def _put(self, table: dict[Row, Any], key: Row, old: Any, new: Any) -> None:
        """Set the entry of a key in a dict to the value `new`, and journal the value `old`."""
        if self.store.recording:
            self.store.journal.extend((table, key, old, ASSIGNED))
        table[key] = new

    def _rows(self, key: Row) -> Collection[Row]:
        """Return the tuples of a group; an empty tuple if there are none."""
        return self._table.get(key[0] if self._bare else key, ())

    def _compute(self, key: Row) -> Any:
        """Compute the value of a group from all of its tuples."""
        rows, column = self._rows(key), self.column
        if column is None:
            return len(rows)
        return aggregate(self.function, [row[column] for row in rows])

    def _update(self, key: Row, changes: Sequence[Change]) -> Any:
        """Return the new value of a group: recomputed or, for a group that is or was large, by a running aggregate."""
        assert self.column is not None
        running, rows = self._running.get(key), self._rows(key)
        if running is None and len(rows) <= VIEWS.large:
            return self._compute(key)
        if running is None:
            kind = RunningTotal if self.function in ("sum", "avg") else RunningExtreme
            running = kind(self.store, self.function, [row[self.column] for row in rows])
            self._put(self._running, key, None, running)
        else:
            running.apply_changes(changes)
        if not rows:
            self._put(self._running, key, running, None)
            return self.empty
        return running.value() if running.is_exact else self._compute(key)

    def recompute(self) -> None:
        keys = [(key,) if self._bare else key for key in self._table]
        set_contents(self.store, self.values, {key: self._compute(key) for key in keys}, self.empty)
        set_contents(self.store, self._running, {}, None)

    def check_rows(self) -> None:
        """Assert that every value equals that of a new computation."""
        for key in {*self.values, *((k,) if self._bare else k for k in self._table)}:
            assert self.values[key] == self._compute(key), self.name
            running = self._running.get(key)
            if running is not None:
                assert self.column is not None
                running.check([row[self.column] for row in self._rows(key)])


class NthRow(AggregateOperator):
    """An operator with the last value of row `number` (from 0) of each group; None for a group with fewer rows."""

    def __init__(self, name: str, source: RowOperator, group: tuple[int, ...], number: int) -> None:
        super().__init__(name, source, group, "min", None)
        self.function = f"row {number + 1}"
        self._number = number

    def _compute(self, key: Row) -> Any:
        return next((row[-1] for row in islice(self._rows(key), self._number, None)), None)

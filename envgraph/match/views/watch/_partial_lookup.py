"""The rows of a view that agree with some values."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any, Final

from envgraph.match.demand._compiled import CompiledMatcher
from envgraph.match.views.operators._operators import Rows
from envgraph.match.views.operators._sets import Index, Row, key_of

EXPENSIVE: Final = 400.0
"""Estimated accesses of a search below which nothing else is faster."""
READ: Final = 2.0
"""Accesses of a search that take as long as a look at one row of a view."""

Positions = tuple[int, ...]


class PartialLookup:
    """Questions about views with values at some positions.

    They are answered by searches until these have cost as much as a look at all rows; then once by that; then by an
    index, which is kept current from there on.

    The order of the rows must not depend on what was asked before. If the view keeps those that agree together, for
    its consumers, it is their order there; else that of the view, however they are found.

    Args:
        demand: searches.
    """

    def __init__(self, demand: CompiledMatcher) -> None:
        self._demand = demand
        self._costs: dict[tuple[str, Positions], float] = {}
        self._spent: dict[tuple[str, Positions], float] = {}

    def forget(self) -> None:
        """There are other views, or other estimates."""
        self._costs.clear()
        self._spent.clear()

    def worthwhile(self, pattern: str, view: Rows, positions: Positions) -> bool:
        """Return whether the view is read for values at some positions (ascending); else a search is about as fast."""
        held = (positions, None) in view.groups and self._demand.calls.of(pattern).searches
        return held or self._cost(pattern, positions) >= EXPENSIVE

    def possible(self, pattern: str, positions: Positions) -> bool:
        """Return whether it may be `worthwhile` for some view."""
        return self._cost(pattern, positions) >= EXPENSIVE or self._demand.calls.of(pattern).searches

    def rows(self, pattern: str, view: Rows, positions: Positions, wanted: Any) -> Sequence[Row]:
        """The rows in order; not to be changed, nor kept.

        Args:
            pattern: qualified name; its view is of use.
            view: its view, up to date.
            positions: where there are values, ascending.
            wanted: what rows with these values are filed under: see `key_of`.
        """
        groups = view.groups.get((positions, None))
        if groups is not None:
            return groups.table[wanted]
        found = self._found(pattern, view, positions, wanted)
        return sorted(found, key=view.rows.position.__getitem__) if len(found) > 1 else tuple(found)

    def first(self, pattern: str, view: Rows, positions: Positions, wanted: Any) -> Row | None:
        """The first of `rows`, or None."""
        groups = view.groups.get((positions, None))
        if groups is not None:
            return next(iter(groups.table[wanted]), None)
        found = self._found(pattern, view, positions, wanted)
        return min(found, key=view.rows.position.__getitem__, default=None)

    def count(self, pattern: str, view: Rows, positions: Positions, wanted: Any) -> int:
        """The number of `rows`, of any view."""
        groups = view.groups.get((positions, None))
        found = self._found(pattern, view, positions, wanted) if groups is None else groups.table[wanted]
        return len(found)

    def _cost(self, pattern: str, positions: Positions) -> float:
        place = pattern, positions
        cost = self._costs.get(place)
        if cost is None:
            cost = self._costs[place] = self._demand.cost(pattern, positions)
        return cost

    def _found(self, pattern: str, view: Rows, positions: Positions, wanted: Any) -> Collection[Row]:
        """The rows in any order, by what is least work."""
        rows, place = view.rows, (pattern, positions)
        index = rows.indexes.get(positions)
        if index is not None:
            return index.table.get(wanted, ())
        if not rows:
            return ()
        if len(positions) == len(rows[0]):
            row = wanted if len(positions) > 1 else (wanted,)
            return (row,) if row in rows.position else ()
        spent, whole = self._spent.get(place, 0.0), READ * len(rows)
        cost = self._cost(pattern, positions)
        if spent + cost < whole:
            self._spent[place] = spent + cost
            return self._demand.prepare(pattern, positions)(*(wanted if len(positions) > 1 else (wanted,)))
        if spent < whole:
            self._spent[place] = spent + whole
            key = key_of(positions)
            return [row for row in rows if key(row) == wanted]
        index = rows.indexes[positions] = Index(positions, rows)
        return index.table.get(wanted, ())

"""Lookups in a view: the rows that have given values at some positions."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

from envgraph.match._match_costs import VIEWS
from envgraph.match.demand._compiled_matcher import CompiledMatcher
from envgraph.match.views.operators._materialized_view import RowOperator
from envgraph.match.views.operators._row_set import Row, RowIndex, make_key_function

Positions = tuple[int, ...]


class PartialLookup:
    """Lookups in views by values at some positions.

    A lookup is a search until searches have cost as much as scanning all rows. Then one lookup scans; later ones use an
    index, which is kept up to date from then on.

    The order of the rows does not depend on earlier lookups. If the view stores groups by these positions for its
    consumers, it is the order of the group, else the order of the view.

    Args:
        demand: the matcher that searches.
    """

    def __init__(self, demand: CompiledMatcher) -> None:
        self._demand = demand
        self._costs: dict[tuple[str, Positions], float] = {}
        self._spent: dict[tuple[str, Positions], float] = {}

    def discard_costs(self) -> None:
        """Discard the cached costs of lookups, because views or estimates have changed."""
        self._costs.clear()
        self._spent.clear()

    def is_worthwhile(self, pattern: str, view: RowOperator, positions: Positions) -> bool:
        """Return True if a lookup in the view is faster than a search, for values at these positions (ascending)."""
        held = (positions, None) in view.groups and self._demand.call_graph.summary_of(pattern).has_closure_or_recursion
        return held or self._cost(pattern, positions) >= VIEWS.expensive

    def may_be_worthwhile(self, pattern: str, positions: Positions) -> bool:
        """Return True if a lookup by these positions in a view of the pattern may be faster than a search."""
        return (
            self._cost(pattern, positions) >= VIEWS.expensive
            or self._demand.call_graph.summary_of(pattern).has_closure_or_recursion
        )

    def rows(self, pattern: str, view: RowOperator, positions: Positions, wanted: Any) -> Sequence[Row]:
        """Return the rows that have the wanted values at the positions. The sequence must not be modified or stored.

        Args:
            pattern: qualified name; a lookup in its view is worthwhile.
            view: its view, up to date.
            positions: the positions with values, ascending.
            wanted: the key of these values, as returned by `make_key_function`.
        """
        groups = view.groups.get((positions, None))
        if groups is not None:
            return groups.table[wanted]
        found = self._find_rows(pattern, view, positions, wanted)
        return sorted(found, key=view.rows.position.__getitem__) if len(found) > 1 else tuple(found)

    def first(self, pattern: str, view: RowOperator, positions: Positions, wanted: Any) -> Row | None:
        """Return the first row that `rows` would return, or None if there is none."""
        groups = view.groups.get((positions, None))
        if groups is not None:
            return next(iter(groups.table[wanted]), None)
        found = self._find_rows(pattern, view, positions, wanted)
        return min(found, key=view.rows.position.__getitem__, default=None)

    def count(self, pattern: str, view: RowOperator, positions: Positions, wanted: Any) -> int:
        """Return the number of rows that have the wanted values, also if a lookup is not worthwhile."""
        groups = view.groups.get((positions, None))
        found = self._find_rows(pattern, view, positions, wanted) if groups is None else groups.table[wanted]
        return len(found)

    def _cost(self, pattern: str, positions: Positions) -> float:
        """Return the estimated cost of a search; cached."""
        place = pattern, positions
        cost = self._costs.get(place)
        if cost is None:
            cost = self._costs[place] = self._demand.cost(pattern, positions)
        return cost

    def _find_rows(self, pattern: str, view: RowOperator, positions: Positions, wanted: Any) -> Collection[Row]:
        """Return the rows in any order by index, search or scan; create the index when the others have cost enough."""
        rows, place = view.rows, (pattern, positions)
        index = rows.indexes.get(positions)
        if index is not None:
            return index.table.get(wanted, ())
        if not rows:
            return ()
        if len(positions) == len(rows[0]):
            row = wanted if len(positions) > 1 else (wanted,)
            return (row,) if row in rows.position else ()
        spent, whole = self._spent.get(place, 0.0), VIEWS.read * len(rows)
        cost = self._cost(pattern, positions)
        if spent + cost < whole:
            self._spent[place] = spent + cost
            return self._demand.prepare(pattern, positions)(*(wanted if len(positions) > 1 else (wanted,)))
        if spent < whole:
            self._spent[place] = spent + whole
            key = make_key_function(positions)
            return [row for row in rows if key(row) == wanted]
        index = rows.indexes[positions] = RowIndex(positions, rows)
        return index.table.get(wanted, ())

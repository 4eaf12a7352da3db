"""The rows of a view that agree with some values, of patterns for which a search is expensive."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any, Final

from envgraph.match._compiled import CompiledMatcher
from envgraph.match.views._operators import Rows
from envgraph.match.views._sets import Row, key_of

EXPENSIVE: Final = 400.0
"""Estimated accesses of a search below which nothing else is faster."""
READ: Final = 2.0
"""Accesses of a search that take as long as a look at one row of a view."""

Index = dict[Any, list[Row]]


class Agreeing:
    """Questions about views with values at some positions.

    The order of the rows must not depend on what was asked before. If the view keeps those that agree together, for
    its consumers, it is their order there; else that of the view, however they are found.

    Args:
        demand: searches.
    """

    def __init__(self, demand: CompiledMatcher) -> None:
        self._demand = demand
        self._costs: dict[tuple[str, tuple[int, ...]], float] = {}
        self._asked: dict[tuple[str, tuple[int, ...]], tuple[int, int]] = {}
        self._indexes: dict[tuple[str, tuple[int, ...]], Index] = {}

    def forget(self) -> None:
        """There are other views, or other estimates."""
        self._costs.clear()
        self._asked.clear()
        self._indexes.clear()

    def worthwhile(self, pattern: str, view: Rows, positions: tuple[int, ...]) -> bool:
        """Whether the view is of use with values at some positions (ascending); else a search is about as fast."""
        place = pattern, positions
        cost = self._costs.get(place)
        if cost is None:
            cost = self._costs[place] = self._demand.cost(pattern, positions)
        held = (positions, None) in view.groups and self._demand.calls.searches(pattern)
        return cost >= EXPENSIVE or held

    def rows(
        self, pattern: str, view: Rows, positions: tuple[int, ...], known: Sequence[Any]
    ) -> Collection[Row]:
        """The rows, by what is least work. The collection must not be changed, nor kept.

        Args:
            pattern: qualified name; its view is of use.
            view: its view, up to date.
            positions: where there are values, ascending.
            known: as many as there are parameters, with the values at these positions.
        """
        key, rows = key_of(positions), view.rows
        wanted = key(tuple(known))
        groups = view.groups.get((positions, None))
        if groups is not None:
            return groups.table[wanted]
        place, present = (pattern, positions), self._demand.model.revision
        revision, times = self._asked.get(place, (-1, 0))
        if revision != present:
            times = 0
            self._indexes.pop(place, None)
        self._asked[place] = present, times + 1
        index = self._indexes.get(place)
        if index is None and (times + 1) * self._costs[place] < READ * len(rows):
            found = self._demand.prepare(pattern, positions)(*[known[position] for position in positions])
            return sorted(found, key=rows.position.__getitem__) if len(found) > 1 else found
        if index is None:
            if not times:
                return [row for row in rows if key(row) == wanted]
            index = {}
            for row in rows:
                index.setdefault(key(row), []).append(row)
            self._indexes[place] = index
        return index.get(wanted, ())

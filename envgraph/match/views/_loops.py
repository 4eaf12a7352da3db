"""Patterns that a loop lists again and again are watched until it ends."""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from typing import Final

from envgraph.match._matcher import FREE, Row
from envgraph.match.demand._compiled import CompiledMatcher
from envgraph.match.views._kept import KeptViews
from envgraph.metamodel import reached

LONG: Final = 100_000
"""Rows that are listed in the time that it takes to make a view: 10 ms, see `benchmarks/bench_questions.py`."""
SPREAD: Final = 4
"""So many matches for each object are kept; more are looked for again."""
SORTED: Final = 16
"""Accesses to the model in the time that it takes to sort one row into the order of a search."""


class Loops:
    """The loops that run, one inside the other, and what they list.

    Listing the matches of a pattern in each round takes time that is quadratic in their number; keeping them current
    does not, but a view has to be made first. It is made when so many rows have been listed that this took as long.
    From then on rows are listed in its order.

    Searches that list few rows may take as long. Then a view is kept aside: its rows are sorted as the search lists
    them, so that nothing depends on whether and when this is done.

    A view that is made inside a transaction knows nothing of the states before. So it is made where a round begins, and
    given up when that loop ends: whatever is rolled back meanwhile was done after it was made.

    Args:
        kept: makes the views.
        demand: counts the matches of patterns.

    Attributes:
        depth: how many loops run.
        due: whether there is something for `turn` to do.
        orders: for each search the key that sorts rows as it lists them; None where nobody knows.
    """

    def __init__(self, kept: KeptViews, demand: CompiledMatcher) -> None:
        self._kept = kept
        self._demand = demand
        self._listed: dict[str, float] = {}
        self._wanted: dict[str, None] = {}
        self._searches: dict[str, int] = {}
        self._costly: dict[str, int] = {}
        self._made: tuple[list[str], list[str]] = [], []
        self._owner = 0
        self.depth = 0
        self.due = False
        self.orders: dict[Callable[[], list[Row]], Callable[[Row], list[int]] | None] = {}

    def begin(self) -> None:
        """A loop begins."""
        self.depth += 1

    def turn(self) -> None:
        """A round of the innermost loop begins: what it lists is watched, if an outer loop has no views yet."""
        if self._owner in (0, self.depth) or (self._wanted and not self._made[0]):
            costly = {name: depth for name, depth in self._costly.items() if name not in self._wanted}
            made = [*self._wanted], [name for name, depth in costly.items() if depth >= self.depth]
            self.due = len(made[1]) < len(costly)
            if made != self._made:
                self._made = made
                if self._kept.watch_briefly(*made, SPREAD * len(self._kept.model) + LONG):
                    self._owner = self.depth

    def end(self) -> None:
        """The innermost loop has ended."""
        self.back_to(self.depth - 1)

    def back_to(self, depth: int) -> None:
        """No more than `depth` loops run: the others have ended, or an exception has left them."""
        if self._owner > depth:
            self._owner = 0
            self._made = [], []
            self._kept.give_up()
            self.due = depth > 0
            self._costly = dict.fromkeys(self._costly, depth)  # other inner loops would make the views again
            self._searches.clear()
        self.depth = depth
        if not depth:
            for each in (self._listed, self._wanted, self._searches, self._costly):
                each.clear()
            self._made = [], []
            self.due = False

    def rows(self, pattern: str, search: Callable[[], list[Row]]) -> list[Row]:
        """Return the rows that a search lists, in its order."""
        view, key = self._kept.aside(pattern), self.orders[search]

        def few(number: int) -> bool:
            return number < 2 or (key is not None and SORTED * number < self._demand.work(pattern))

        if view is not None and few(len(view.rows)):
            rows = sorted(view.rows, key=key)
        else:
            rows = search()
            if self._is_costly(pattern) and few(len(rows)):
                self._costly[pattern] = self.depth
                self.due = True
        self.listed(pattern, len(rows))
        return rows

    def _is_costly(self, pattern: str) -> bool:
        """Note a search; return whether these have cost as much as a view that could be made, and is not yet due."""
        number = self._searches[pattern] = self._searches.get(pattern, 0) + 1
        if self._costly.get(pattern, 0) >= self.depth or number * len(self._kept.model) <= LONG:
            return False
        work = self._demand.work(pattern)
        dear = number * work > LONG + 2 * work
        return dear and pattern not in self._kept.too_large and self._watchable(pattern)

    def listed(self, pattern: str, rows: int) -> None:
        """So many matches of a pattern have been looked for."""
        seen = self._listed[pattern] = self._listed.get(pattern, 0) + rows
        if seen > LONG:
            self._listed[pattern] = -inf  # decided
            if self._worth_watching(pattern):
                self._wanted[pattern] = None
                self.due = True

    def sought(self, pattern: str) -> None:
        """The first match of a pattern has been looked for: among all objects, as far as anybody knows."""
        if not self._demand.calls.of(pattern).searches:
            self.listed(pattern, len(self._kept.model))

    def _worth_watching(self, pattern: str) -> bool:
        """Return whether a view of a pattern is not too large, and made of nothing larger."""
        free = (FREE,) * len(self._demand.library.parameter_types(pattern))
        most = SPREAD * len(self._kept.model)
        return self._watchable(pattern) and self._demand.count(pattern, free) <= most

    def _watchable(self, pattern: str) -> bool:
        calls, library = self._demand.calls, self._demand.library
        asked = library.get(pattern).strategy == "search" or library.inputs(pattern)
        return not asked and not any(map(calls.recursive, reached([pattern], calls.called)))

"""Temporary views for patterns that a running loop lists repeatedly."""

from __future__ import annotations

from collections.abc import Callable
from math import inf

from envgraph.match._match_costs import VIEWS
from envgraph.match._matcher import FREE, Row
from envgraph.match.demand._compiled_matcher import CompiledMatcher
from envgraph.match.views.watch._watched_views import WatchedViews
from envgraph.metamodel import reachable_nodes


class LoopViews:
    """The running loops of units, and the patterns that are watched for their duration. Loops may be nested.

    Listing the matches of a pattern in each round (iteration) takes time quadratic in their number. A view avoids this,
    but takes time to make. It is made after listing rows has taken as long. From then on rows are listed in the order
    of the view.

    Searches with few results may also take that long. From their views, the rows are sorted into the order of the
    search, so results do not depend on when a view is made.

    A view made inside a transaction cannot be rolled back to a state before it was made. So it is made when a round
    begins, and discarded when that loop ends: rollbacks in between only undo later changes.

    Args:
        kept: makes the views.
        demand: counts the matches of patterns.

    Attributes:
        depth: the number of running loops.
        due: True if `turn` may have views to make.
        sort_keys: for each search function the key that sorts rows into its order; None if there is no such key.
    """

    def __init__(self, kept: WatchedViews, demand: CompiledMatcher) -> None:
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
        self.sort_keys: dict[Callable[[], list[Row]], Callable[[Row], list[int]] | None] = {}

    def begin(self) -> None:
        """Enter a loop: add 1 to the number of running loops."""
        self.depth += 1

    def turn(self) -> None:
        """Begin a round of the innermost loop: make views that pay off, unless an outer loop has made views."""
        if self._owner in (0, self.depth) or (self._wanted and not self._made[0]):
            costly = {name: depth for name, depth in self._costly.items() if name not in self._wanted}
            made = [*self._wanted], [name for name, depth in costly.items() if depth >= self.depth]
            self.due = len(made[1]) < len(costly)
            if made != self._made:
                self._made = made
                if self._kept.watch_temporarily(*made, VIEWS.spread * len(self._kept.model) + VIEWS.long_loop):
                    self._owner = self.depth

    def end(self) -> None:
        """Leave the innermost loop, and discard the views made in it."""
        self.leave_loops_above(self.depth - 1)

    def leave_loops_above(self, depth: int) -> None:
        """Leave all loops but the outermost `depth`, and discard the views made in the loops that are left."""
        if self._owner > depth:
            self._owner = 0
            self._made = [], []
            self._kept.end_temporary()
            self.due = depth > 0
            self._costly = dict.fromkeys(self._costly, depth)  # so that other inner loops do not make the views again
            self._searches.clear()
        self.depth = depth
        if not depth:
            for each in (self._listed, self._wanted, self._searches, self._costly):
                each.clear()
            self._made = [], []
            self.due = False

    def rows(self, pattern: str, search: Callable[[], list[Row]]) -> list[Row]:
        """Return the rows of a search in its own order, perhaps from a temporary view; count the listed rows."""
        view, key = self._kept.sorted_view(pattern), self.sort_keys[search]

        def few(number: int) -> bool:
            """Return True if sorting this number of rows is cheaper than a search."""
            return number < 2 or (key is not None and VIEWS.sorted * number < self._demand.measured_cost(pattern))

        if view is not None and few(len(view.rows)):
            rows = sorted(view.rows, key=key)
        else:
            rows = search()
            if self._count_search(pattern) and few(len(rows)):
                self._costly[pattern] = self.depth
                self.due = True
        self.count_listed(pattern, len(rows))
        return rows

    def _count_search(self, pattern: str) -> bool:
        """Count a search. Return True if a view is now worth its cost and allowed, and not already due."""
        number = self._searches[pattern] = self._searches.get(pattern, 0) + 1
        if self._costly.get(pattern, 0) >= self.depth or number * len(self._kept.model) <= VIEWS.long_loop:
            return False
        work = self._demand.measured_cost(pattern)
        is_expensive = number * work > VIEWS.long_loop + 2 * work
        return is_expensive and pattern not in self._kept.too_large and self._may_watch(pattern)

    def count_listed(self, pattern: str, rows: int) -> None:
        """Count matches that searches of a pattern have listed. At a limit decide if the pattern is worth a view."""
        seen = self._listed[pattern] = self._listed.get(pattern, 0) + rows
        if seen > VIEWS.long_loop:
            self._listed[pattern] = -inf  # so that this is decided only once
            free = (FREE,) * len(self._demand.library.parameter_types(pattern))
            most = VIEWS.spread * len(self._kept.model)
            if self._may_watch(pattern) and self._demand.count(pattern, free) <= most:
                self._wanted[pattern] = None
                self.due = True

    def count_first_search(self, pattern: str) -> None:
        """Count a search for a first match as if it had listed all objects; not if it needs recursion or a closure."""
        if not self._demand.call_graph.summary_of(pattern).has_closure_or_recursion:
            self.count_listed(pattern, len(self._kept.model))

    def _may_watch(self, pattern: str) -> bool:
        """Return True if loops may watch a pattern: it is no `search` pattern, has no inputs, and no recursion."""
        calls, library = self._demand.call_graph, self._demand.library
        asked = library.get(pattern).strategy == "search" or library.inputs(pattern)
        return not asked and not any(map(calls.is_recursive, reachable_nodes([pattern], calls.called_patterns)))

"""Patterns that a loop lists again and again are watched until it ends."""

from __future__ import annotations

from typing import Final

from envgraph.match._matcher import FREE
from envgraph.match.demand._compiled import CompiledMatcher
from envgraph.match.views._kept import KeptViews

LONG: Final = 100_000
"""Rows that are listed in the time that it takes to make a view: 10 ms, see `benchmarks/bench_questions.py`."""
SPREAD: Final = 4
"""So many matches for each object are kept; more are looked for again."""


class Loops:
    """The loops that run, one inside the other, and what they list.

    Listing the matches of a pattern in each round takes time that is quadratic in their number; keeping them current
    does not, but a view has to be made first. It is made when so many rows have been listed that this took as long.

    A view that is made inside a transaction knows nothing of the states before. So it is made where a round begins, and
    given up when that loop ends: whatever is rolled back meanwhile was done after it was made.

    Args:
        kept: makes the views.
        demand: counts the matches of patterns.

    Attributes:
        depth: how many loops run.
        due: whether there is something for `turn` to do.
    """

    __slots__ = ("_demand", "_done", "_kept", "_listed", "_owner", "_wanted", "depth", "due")

    def __init__(self, kept: KeptViews, demand: CompiledMatcher) -> None:
        self._kept = kept
        self._demand = demand
        self._listed: dict[str, int] = {}
        self._wanted: dict[str, None] = {}
        self._done: set[str] = set()
        self._owner = 0
        self.depth = 0
        self.due = False

    def begin(self) -> None:
        """A loop begins."""
        self.depth += 1

    def turn(self) -> None:
        """A round of the innermost loop begins: what it lists is watched, if an outer loop has no views yet."""
        if self._owner in (0, self.depth):
            self.due = False
            if self._kept.watch_briefly(tuple(self._wanted)):
                self._owner = self.depth

    def end(self) -> None:
        """The innermost loop has ended."""
        self.back_to(self.depth - 1)

    def back_to(self, depth: int) -> None:
        """No more than `depth` loops run: the others have ended, or an exception has left them."""
        if self._owner > depth:
            self._owner = 0
            self._kept.give_up()
            self.due = depth > 0
        self.depth = depth
        if not depth:
            self._listed.clear()
            self._wanted.clear()
            self._done.clear()
            self.due = False

    def listed(self, pattern: str, rows: int) -> None:
        """So many matches of a pattern have been looked for."""
        seen = self._listed[pattern] = self._listed.get(pattern, 0) + rows
        if seen > LONG and pattern not in self._done:
            self._done.add(pattern)
            if self._worth_watching(pattern):
                self._wanted[pattern] = None
                self.due = True

    def sought(self, pattern: str) -> None:
        """The first match of a pattern has been looked for: among all objects, as far as anybody knows."""
        self.listed(pattern, len(self._kept.model))

    def _worth_watching(self, pattern: str) -> bool:
        """Return whether a view of a pattern is not too large, and made of nothing larger."""
        demand, library = self._demand, self._demand.library
        if library.get(pattern).strategy == "search" or library.inputs(pattern):
            return False
        if demand.calls.of(pattern).searches:
            return False
        free = (FREE,) * len(library.parameter_types(pattern))
        return demand.count(pattern, free) <= SPREAD * len(self._kept.model)

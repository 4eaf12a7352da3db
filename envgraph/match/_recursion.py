"""Rows of patterns that call themselves, by tabling.

Every call of a recursive component, a pattern with values at its bound positions, has a table. A call is evaluated
again whenever a table that it read has gained rows (Tamaki and Sato 1986, without the search-tree bookkeeping), until
none has anything new to read. Calls inside a component are positive, so tables only grow.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Final

from envgraph.errors import EvaluationError
from envgraph.graph import Model
from envgraph.match._calls import CallGraph
from envgraph.match._matcher import Row

MOST_ROWS: Final = 1_000_000
"""Rows and calls of one evaluation; only an `eval` that makes new values without end needs more."""
MOST_KEPT: Final = 200_000
"""Rows that are remembered for the present state of the model."""

Call = tuple[str, tuple[int, ...], tuple[object, ...]]
"""Pattern, bound positions, and the values there."""
Evaluate = Callable[[str, tuple[int, ...]], Callable[..., list[Row]]]
"""Gives the function that evaluates calls of a pattern once, reading the tables for calls in its component."""


class Run:
    """The tables of one component while they are being filled."""

    def __init__(self, evaluate: Evaluate) -> None:
        self._evaluate = evaluate
        self._rows: dict[Call, list[Row]] = {}
        self._known: dict[Call, set[Row]] = {}
        self._readers: dict[Call, dict[Call, None]] = {}
        self._pending: dict[Call, None] = {}
        self._current: Call | None = None
        self._size = 0

    def read(self, call: Call) -> list[Row]:
        """The rows of a call so far; the call that is being evaluated will be told of more."""
        if call not in self._rows:
            self._rows[call] = []
            self._known[call] = set()
            self._readers[call] = {}
            self._pending[call] = None
            self._grow(call)
        if self._current is not None:
            self._readers[call][self._current] = None
        return self._rows[call]

    def finish(self) -> None:
        """Evaluate calls, the newest first, until no table grows."""
        while self._pending:
            call, _ = self._pending.popitem()
            self._current = call
            pattern, bound, values = call
            known, rows = self._known[call], self._rows[call]
            # The evaluation must be over before its own table grows: it may be reading it.
            fresh = [row for row in self._evaluate(pattern, bound)(*values) if row not in known]
            self._current = None
            if fresh:
                known.update(fresh)
                rows.extend(fresh)
                self._pending.update(self._readers[call])
                self._grow(call, len(fresh))

    def _grow(self, call: Call, amount: int = 1) -> None:
        self._size += amount
        if self._size > MOST_ROWS:
            raise EvaluationError(
                f"recursive pattern `{call[0]}` has more than {MOST_ROWS:,} partial results"
            )


class Recursion:
    """Answers calls of recursive patterns, and remembers the answers for as long as the model does not change.

    Args:
        model: its revision tells when answers are out of date.
        calls: which patterns are recursive together.
        evaluate: see `Evaluate`.
    """

    def __init__(self, model: Model, calls: CallGraph, evaluate: Evaluate) -> None:
        self._store = model.store
        self._calls = calls
        self._evaluate = evaluate
        self._running: dict[frozenset[str], Run] = {}
        self._answers: dict[Call, list[Row]] = {}
        self._kept = 0
        self._revision = -1

    def reader(self, pattern: str, bound: tuple[int, ...]) -> Callable[..., list[Row]]:
        """Calls from inside the component: the rows so far."""
        return partial(self._read, self._calls.component(pattern), pattern, bound)

    def solver(self, pattern: str, bound: tuple[int, ...]) -> Callable[..., list[Row]]:
        """Calls from outside: all rows, in ascending order. The list must not be changed."""
        return partial(self._solve, self._calls.component(pattern), pattern, bound)

    def _read(
        self, component: frozenset[str], pattern: str, bound: tuple[int, ...], *values: object
    ) -> list[Row]:
        return self._running[component].read((pattern, bound, values))

    def _solve(
        self, component: frozenset[str], pattern: str, bound: tuple[int, ...], *values: object
    ) -> list[Row]:
        if self._revision != self._store.revision:
            self._revision = self._store.revision
            self._answers.clear()
            self._kept = 0
        call = (pattern, bound, values)
        if call in self._answers:
            return self._answers[call]
        run = self._running[component] = Run(self._evaluate)
        try:
            rows = run.read(call)
            run.finish()
        finally:
            del self._running[component]
        # Sorted, because the order of discovery depends on which call of the component came first.
        answer = sorted(rows)
        self._keep(call, answer)
        return answer

    def _keep(self, call: Call, answer: list[Row]) -> None:
        self._kept += len(answer) + 1
        if self._kept > MOST_KEPT:
            self._answers.clear()
            self._kept = len(answer) + 1
        self._answers[call] = answer

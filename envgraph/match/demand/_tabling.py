"""Evaluation of recursive patterns by tabling.

Every call of a recursive component (a pattern with values at its bound positions) has a table of rows. A consumer of a
table is suspended, and continues once with each row of the table (Chen and Warren 1996; calls inside a component are
positive, so nothing is delayed). So no row is derived twice from the same rows, and only requested calls are evaluated.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from functools import cached_property
from typing import Any

from envgraph.errors import RAISE_LIMIT_HINT, EvaluationError, scaled_limit
from envgraph.graph import Model
from envgraph.match._match_costs import DEMAND
from envgraph.match._matcher import Row
from envgraph.match.passes._call_graph import CallGraph
from envgraph.match.plan._step_candidates import Unplannable
from envgraph.pattern import Library, ObjectType

Evaluate = Callable[..., None]
"""Evaluates a call. Arguments: the table of the call, and its values at bound positions; see `evaluation_source`."""
Continuation = Callable[..., None]
"""A continuation. Arguments: the values stored at its suspension, and the values of a row at the unbound positions."""


class TableConsumer:
    """A suspended reader of a table: a continuation, its stored values, and the number of rows it has consumed.

    It consumes at most `most` rows; None for all rows.
    """

    __slots__ = ("goes_on", "most", "next", "queued", "rows", "values")

    def __init__(self, goes_on: Continuation, values: tuple[Any, ...], rows: list[Row], most: int | None) -> None:
        self.goes_on = goes_on
        self.values = values
        self.rows = rows
        self.most = most
        self.next = 0
        self.queued = False


class CallTable:
    """The table of one call: the rows found so far, as values at the unbound positions.

    Attributes:
        calls: the pattern and bound positions of the call.
        values: the values at the bound positions.
        rows: the rows in the order of discovery.
        answer: the complete rows in ascending order, or None before they are first requested.
    """

    __slots__ = ("_consumers", "_entered", "_known", "_run", "_waiting", "answer", "calls", "rows", "values")

    def __init__(self, run: ComponentEvaluation, calls: TabledCalls, values: tuple[Any, ...]) -> None:
        self._run = run
        self.calls = calls
        self.values = values
        self.rows: list[Row] = []
        self.answer: list[Row] | None = None
        self._known: set[Row] = set()
        self._consumers: list[TableConsumer] = []
        self._waiting: set[tuple[Continuation, tuple[Any, ...]]] = set()
        self._entered: set[tuple[TabledCalls, tuple[Any, ...]]] = {(calls, values)}

    def add(self, row: Row) -> None:
        """Add a row if it is new, and schedule all consumers."""
        if row not in self._known:
            self._known.add(row)
            self.rows.append(row)
            run = self._run
            for consumer in self._consumers:
                if not consumer.queued:
                    consumer.queued = True
                    run.reading.append(consumer)
            run.count_result(self.calls.pattern)

    def add_consumer(self, continuation: Continuation, values: tuple[Any, ...], max_rows: int | None = None) -> None:
        """Schedule a continuation for each present and future row, or for `max_rows` rows. Ignore a repeated
        request.
        """
        reader = continuation, values
        if reader not in self._waiting:
            self._waiting.add(reader)
            consumer = TableConsumer(continuation, values, self.rows, max_rows)
            self._consumers.append(consumer)
            if self.rows:
                consumer.queued = True
                self._run.reading.append(consumer)

    def evaluate_into(self, calls: TabledCalls, values: tuple[Any, ...]) -> None:
        """Schedule another call whose rows are rows of this table, too. Ignore a repeated request."""
        call = calls, values
        if call not in self._entered:
            self._entered.add(call)
            self._run.pending.append((calls, self, values))
            self._run.count_result(calls.pattern)

    def known(self, row: Row) -> bool:
        """Return True if a row has been found."""
        return row in self._known

    def discard_consumers(self) -> None:
        """Discard the consumers, because all rows are known."""
        self._consumers.clear()
        self._waiting.clear()
        self._entered.clear()


class ComponentEvaluation:
    """The evaluation of one recursive component: its open tables, pending calls and scheduled consumers."""

    def __init__(self) -> None:
        self.reading: list[TableConsumer] = []
        self.pending: list[tuple[TabledCalls, CallTable, tuple[Any, ...]]] = []
        self.open: list[CallTable] = []
        self._size = 0
        self._most = scaled_limit("matches")

    def count_result(self, pattern: str) -> None:
        """Count one more row or call.

        Raises:
            EvaluationError: there are too many.
        """
        self._size += 1
        if self._size > self._most:
            message = f"recursive pattern `{pattern}` has more than {self._most:,} results, its inner calls included"
            raise EvaluationError(message, hint=RAISE_LIMIT_HINT)

    def run_to_fixpoint(self) -> int:
        """Evaluate calls and run consumers until none is pending. Return the number of rows and calls counted."""
        reading, pending = self.reading, self.pending
        try:
            while reading or pending:
                while pending:
                    calls, table, values = pending.pop()
                    calls.evaluate(table, *values)
                while reading:
                    consumer = reading.pop()
                    consumer.queued = False
                    goes_on, values, first = consumer.goes_on, consumer.values, consumer.next
                    consumer.next = len(consumer.rows)
                    for row in consumer.rows[first : consumer.most]:
                        goes_on(*values, *row)
            for table in self.open:
                table.discard_consumers()
            return self._size
        finally:
            self.reading.clear()
            self.pending.clear()
            self.open.clear()
            self._size = 0


class TabledCalls:
    """All calls of a pattern with the same bound positions.

    Attributes:
        tables: the tables by the values at the bound positions.
    """

    def __init__(
        self,
        run: ComponentEvaluation,
        pattern: str,
        bound: tuple[int, ...],
        evaluation: Callable[[str, tuple[int, ...]], Evaluate],
    ) -> None:
        self.pattern = pattern
        self.bound = bound
        self.tables: dict[tuple[Any, ...], CallTable] = {}
        self._run = run
        self._evaluation = evaluation

    @cached_property
    def evaluate(self) -> Evaluate:
        """Return the function that evaluates a call. It is created at first use, since calls may form long chains.

        Raises:
            Unplannable: these calls cannot be evaluated.
        """
        return self._evaluation(self.pattern, self.bound)

    def table(self, values: tuple[Any, ...]) -> CallTable:
        """Return the table of a call; a new table is scheduled for evaluation."""
        found = self.tables.get(values)
        if found is None:
            run = self._run
            found = self.tables[values] = CallTable(run, self, values)
            run.open.append(found)
            run.pending.append((self, found, values))
            run.count_result(self.pattern)
        return found

    # --- called by generated evaluation functions

    def read(self, values: tuple[Any, ...], continuation: Continuation, stored_values: tuple[Any, ...]) -> None:
        """Schedule a continuation for each row of a call. `stored_values` are the values stored with the
        continuation.
        """
        self.table(values).add_consumer(continuation, stored_values)

    def once(self, values: tuple[Any, ...], continuation: Continuation, stored_values: tuple[Any, ...]) -> None:
        """Schedule a continuation that runs once if a call has a row."""
        self.table(values).add_consumer(continuation, stored_values, 1)

    def again(self, values: tuple[Any, ...], continuation: Continuation, stored_values: tuple[CallTable]) -> None:
        """Schedule a continuation for each row of a call that repeats the evaluated call at the start of its body.

        If the evaluated call was entered from another call of its kind, its rows are also rows of that call's table. So
        the continuation is registered at the table of the owner, and nothing else is needed.
        """
        (owner,) = stored_values
        if owner.calls is self:
            owner.add_consumer(continuation, stored_values)
        else:
            self.table(values).add_consumer(continuation, stored_values)

    def enter(self, owner: CallTable, values: tuple[Any, ...]) -> None:
        """Schedule a call whose rows are added to the table of its caller, `owner`."""
        owner.evaluate_into(self, values)


class RecursionEvaluator:
    """The evaluator of recursive patterns. It caches results until the model changes.

    Args:
        model: its revision shows when cached results are out of date.
        library: the patterns.
        graph: their call graph.
        evaluation: returns the function that evaluates calls of a pattern with values at some positions.
    """

    def __init__(
        self,
        model: Model,
        library: Library,
        graph: CallGraph,
        evaluation: Callable[[str, tuple[int, ...]], Evaluate],
    ) -> None:
        self._store = model.graph.store
        self._library = library
        self._graph = graph
        self._evaluation = evaluation
        self._runs: dict[frozenset[str], ComponentEvaluation] = {}
        self._calls: dict[tuple[str, tuple[int, ...]], TabledCalls] = {}
        self._asked: Counter[tuple[str, int, Any]] = Counter()
        self._kept = 0
        self._revision = -1

    def calls(self, pattern: str, bound: tuple[int, ...]) -> TabledCalls:
        """Return the `TabledCalls` of a pattern with values at these positions, created at first use."""
        place = pattern, bound
        if place not in self._calls:
            run = self._runs.setdefault(self._graph.component(pattern), ComponentEvaluation())
            self._calls[place] = TabledCalls(run, pattern, bound, self._evaluation)
        return self._calls[place]

    def row_function(self, pattern: str, bound: tuple[int, ...]) -> Callable[..., list[Row]]:
        """Return a function that lists the rows for values at bound positions, ascending. The list must not be changed.

        Raises:
            Unplannable: a parameter without a value cannot be enumerated.
        """
        size = len(self._library.parameter_types(pattern))
        if len(bound) == size > 1:
            return self._row_test(pattern, size)
        calls = self._plannable(pattern, bound)

        def solve(*values: Any) -> list[Row]:
            table = self._solve(calls, values)
            if table.answer is None:
                # Sorted, because the order of discovery depends on which call of the component came first.
                table.answer = sorted(_complete_row(size, bound, values, row) for row in table.rows)
            return table.answer

        return solve

    def _row_test(self, pattern: str, size: int) -> Callable[..., list[Row]]:
        """Return a function that takes a full row, and returns a list of the row if it is a match, else an empty list.

        If calls with the same value repeat, all rows with this value are computed once. For components that are not
        linear this is no more work than one row.
        """
        calls = self._plannable(pattern, tuple(range(size)))
        narrower = self._single_position_calls(pattern, size)
        made_of_rows = not self._graph.summary_of(pattern).is_linear

        def holds(*row: Any) -> list[Row]:
            self._discard_outdated()
            for each in narrower:
                table = each.tables.get((row[each.bound[0]],))
                if table is not None:
                    return _among(table, row)
            often = [each for each in narrower if self._is_repeated(each, row)]
            if narrower and (often or made_of_rows):
                each = (often or narrower)[0]
                return _among(self._solve(each, (row[each.bound[0]],)), row)
            return [row] if self._solve(calls, row).rows else []

        return holds

    def _single_position_calls(self, pattern: str, size: int) -> list[TabledCalls]:
        """Return the calls with one bound position that have a plan; [] if a parameter has data values.

        With data values, the rows of such a call could be infinitely many.
        """
        types = (t for name in self._graph.component(pattern) for t in self._library.parameter_types(name))
        if not all(isinstance(type_, ObjectType) for type_ in types):
            return []
        found = []
        for position in range(size):
            with suppress(Unplannable):
                found.append(self._plannable(pattern, (position,)))
        return found

    def _plannable(self, pattern: str, bound: tuple[int, ...]) -> TabledCalls:
        """Return the calls of a pattern with values at some positions; raise `Unplannable` if they have no plan."""
        found = self.calls(pattern, bound)
        _ = found.evaluate
        return found

    def _is_repeated(self, calls: TabledCalls, row: Row) -> bool:
        """Count a call with one value of a row. Return True if it has been repeated and many rows are cached."""
        (position,) = calls.bound
        place = calls.pattern, position, row[position]
        self._asked[place] += 1
        return self._asked[place] > DEMAND.few_times and self._kept > DEMAND.few_rows

    def _discard_outdated(self) -> None:
        """Discard all cached tables if the model has changed."""
        if self._revision != self._store.revision:
            self._discard_tables()
            self._revision = self._store.revision  # last: an interruption before leaves no outdated table

    def _solve(self, calls: TabledCalls, values: tuple[Any, ...]) -> CallTable:
        """Return the complete table of a call, evaluated unless cached. An exception discards all tables."""
        self._discard_outdated()
        table = calls.tables.get(values)
        if table is not None:
            return table
        if self._kept > DEMAND.most_rows:
            self._discard_tables()
        try:
            table = calls.table(values)
            self._kept += self._runs[self._graph.component(calls.pattern)].run_to_fixpoint()
        except BaseException:
            self._discard_tables()  # tables may be incomplete
            raise
        return table

    def _discard_tables(self) -> None:
        """Discard all cached tables, and the counts of repeated calls."""
        for each in self._calls.values():
            each.tables.clear()
        self._asked.clear()
        self._kept = 0


def _among(table: CallTable, row: Row) -> list[Row]:
    """Return `[row]` if the table of a call with one bound position contains the row's other values; else []."""
    (position,) = table.calls.bound
    return [row] if table.known((*row[:position], *row[position + 1 :])) else []


def _complete_row(size: int, bound: tuple[int, ...], values: tuple[Any, ...], row: Row) -> Row:
    """Return a complete row: the values at the bound positions, and those of a table's row at the other positions."""
    given = dict(zip(bound, values, strict=True))
    others = iter(row)
    return tuple(given[position] if position in given else next(others) for position in range(size))

"""Rows of patterns that call themselves, by tabling.

Every call of a recursive component, a pattern with values at its bound positions, has a table. Whoever reads a table
is suspended there, and goes on with each of its rows, once (Chen and Warren 1996; calls inside a component are
positive, so there is nothing to delay). So no row is derived from the same rows twice, and nothing is computed that no
call has asked for.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from functools import cached_property
from typing import Any, Final

from envgraph.errors import RAISE_LIMIT, EvaluationError, limit
from envgraph.graph import Model
from envgraph.match._matcher import Row
from envgraph.match.passes._calls import CallGraph
from envgraph.match.plan._options import Unplannable
from envgraph.pattern import Library, ObjectType

MOST_ROWS: Final = 1_000_000
"""Rows and calls of one evaluation; only an `eval` that makes new values without end needs more."""
MOST_KEPT: Final = 200_000
"""Rows and calls that are remembered for the present state of the model."""
FEW_TIMES: Final = 3
"""Questions about all values of a row, with the same one among them, before all rows with that one are computed."""
FEW_ROWS: Final = 1_000
"""Rows and calls that such questions may take before."""

Evaluate = Callable[..., None]
"""Evaluates a call once: gets its table and the values at its bound positions, see `evaluation_source`."""
Suspended = Callable[..., None]
"""Goes on with values that were known when it was suspended, and those of a row at the free positions."""


class Consumer:
    """Somebody who reads a table, and how far."""

    __slots__ = ("goes_on", "most", "next", "queued", "rows", "values")

    def __init__(
        self, goes_on: Suspended, values: tuple[Any, ...], rows: list[Row], most: int | None
    ) -> None:
        self.goes_on = goes_on
        self.values = values
        self.rows = rows
        self.most = most
        self.next = 0
        self.queued = False


class Table:
    """The rows of a call so far: values at the free positions.

    Attributes:
        calls: what is called.
        values: those at the bound positions.
        rows: in the order in which they were found.
        answer: full rows in ascending order, when all are known and somebody has asked.
    """

    __slots__ = ("_consumers", "_entered", "_known", "_run", "_waiting", "answer", "calls", "rows", "values")

    def __init__(self, run: Run, calls: Calls, values: tuple[Any, ...]) -> None:
        self._run = run
        self.calls = calls
        self.values = values
        self.rows: list[Row] = []
        self.answer: list[Row] | None = None
        self._known: set[Row] = set()
        self._consumers: list[Consumer] = []
        self._waiting: set[tuple[Suspended, tuple[Any, ...]]] = set()
        self._entered: set[tuple[Calls, tuple[Any, ...]]] = {(calls, values)}

    def add(self, row: Row) -> None:
        """There is a row."""
        if row not in self._known:
            self._known.add(row)
            self.rows.append(row)
            run = self._run
            for consumer in self._consumers:
                if not consumer.queued:
                    consumer.queued = True
                    run.reading.append(consumer)
            run.grow(self.calls.pattern)

    def read(self, goes_on: Suspended, values: tuple[Any, ...], most: int | None = None) -> None:
        """Go on with each row, or with so many, those that are still to come included."""
        reader = goes_on, values
        if reader not in self._waiting:
            self._waiting.add(reader)
            consumer = Consumer(goes_on, values, self.rows, most)
            self._consumers.append(consumer)
            if self.rows:
                consumer.queued = True
                self._run.reading.append(consumer)

    def enter(self, calls: Calls, values: tuple[Any, ...]) -> None:
        """Whatever another call finds is a row here: it is evaluated for this table, and needs none of its own."""
        call = calls, values
        if call not in self._entered:
            self._entered.add(call)
            self._run.pending.append((calls, self, values))
            self._run.grow(calls.pattern)

    def known(self, row: Row) -> bool:
        """Return whether a row has been found."""
        return row in self._known

    def finish(self) -> None:
        """All rows are known."""
        self._consumers.clear()
        self._waiting.clear()
        self._entered.clear()


class Run:
    """The tables of one component."""

    def __init__(self) -> None:
        self.reading: list[Consumer] = []
        self.pending: list[tuple[Calls, Table, tuple[Any, ...]]] = []
        self.open: list[Table] = []
        self._size = 0
        self._most = limit(MOST_ROWS)

    def grow(self, pattern: str) -> None:
        """There is another row or call."""
        self._size += 1
        if self._size > self._most:
            message = f"recursive pattern `{pattern}` has more than {self._most:,} partial results"
            raise EvaluationError(message, hint=RAISE_LIMIT)

    def finish(self) -> int:
        """Go on until nobody has a row to read; returns how many rows and calls that were."""
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
                table.finish()
            return self._size
        finally:
            self.reading.clear()
            self.pending.clear()
            self.open.clear()
            self._size = 0


class Calls:
    """All calls of a pattern with values at the same positions.

    Attributes:
        tables: by the values.
    """

    def __init__(
        self,
        run: Run,
        pattern: str,
        bound: tuple[int, ...],
        evaluation: Callable[[str, tuple[int, ...]], Evaluate],
    ) -> None:
        self.pattern = pattern
        self.bound = bound
        self.tables: dict[tuple[Any, ...], Table] = {}
        self._run = run
        self._evaluation = evaluation

    @cached_property
    def evaluate(self) -> Evaluate:
        """See `Evaluate`; made late, since patterns may call each other in long chains."""
        return self._evaluation(self.pattern, self.bound)

    def prepare(self) -> None:
        """Raises `Unplannable` if these calls cannot be evaluated."""
        _ = self.evaluate

    def table(self, values: tuple[Any, ...]) -> Table:
        """The table of a call."""
        found = self.tables.get(values)
        if found is None:
            run = self._run
            found = self.tables[values] = Table(run, self, values)
            run.open.append(found)
            run.pending.append((self, found, values))
            run.grow(self.pattern)
        return found

    # --- what evaluations do

    def read(self, values: tuple[Any, ...], goes_on: Suspended, known: tuple[Any, ...]) -> None:
        """Go on with each row of a call."""
        self.table(values).read(goes_on, known)

    def once(self, values: tuple[Any, ...], goes_on: Suspended, known: tuple[Any, ...]) -> None:
        """Go on if a call has a row."""
        self.table(values).read(goes_on, known, 1)

    def again(self, values: tuple[Any, ...], goes_on: Suspended, known: tuple[Table]) -> None:
        """As `read`, for a call of the same kind and values as the one that is evaluated, which begins with this.

        The one that is evaluated may have been entered from another call of its kind. What it would read are rows of
        that one, too, and that one goes on with all its rows in the same way. So nothing but that needs to be done.
        """
        (owner,) = known
        if owner.calls is self:
            owner.read(goes_on, known)
        else:
            self.table(values).read(goes_on, known)

    def enter(self, owner: Table, values: tuple[Any, ...]) -> None:
        """Whatever a call finds is a row of the owner."""
        owner.enter(self, values)


class Recursion:
    """Answers calls of recursive patterns, and remembers the answers for as long as the model does not change.

    Args:
        model: its revision tells when answers are out of date.
        library: the patterns.
        graph: which of them are recursive together.
        evaluation: gives the function that evaluates calls of a pattern with values at some positions.
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
        self._runs: dict[frozenset[str], Run] = {}
        self._calls: dict[tuple[str, tuple[int, ...]], Calls] = {}
        self._asked: Counter[tuple[str, int, Any]] = Counter()
        self._kept = 0
        self._revision = -1

    def calls(self, pattern: str, bound: tuple[int, ...]) -> Calls:
        """The calls of a pattern with values at some positions."""
        place = pattern, bound
        if place not in self._calls:
            run = self._runs.setdefault(self._graph.component(pattern), Run())
            self._calls[place] = Calls(run, pattern, bound, self._evaluation)
        return self._calls[place]

    def solver(self, pattern: str, bound: tuple[int, ...]) -> Callable[..., list[Row]]:
        """Calls from outside: all rows, in ascending order. The list must not be changed.

        Raises:
            Unplannable: a free parameter cannot be enumerated.
        """
        size = len(self._library.parameter_types(pattern))
        if len(bound) == size > 1:
            return self._tester(pattern, size)
        calls = self._plannable(pattern, bound)

        def solve(*values: Any) -> list[Row]:
            table = self._solved(calls, values)
            if table.answer is None:
                # Sorted, because the order of discovery depends on which call of the component came first.
                table.answer = sorted(_full(size, bound, values, row) for row in table.rows)
            return table.answer

        return solve

    def _tester(self, pattern: str, size: int) -> Callable[..., list[Row]]:
        """Return whether a row is one: it alone, or nothing.

        Where one value is asked about again and again, all rows with it are computed once. Where rows are made of rows
        of the same component, that is no more work than for one row.
        """
        calls = self._plannable(pattern, tuple(range(size)))
        narrower = self._narrower(pattern, size)
        made_of_rows = not self._graph.of(pattern).linear

        def holds(*row: Any) -> list[Row]:
            self._look()
            for each in narrower:
                table = each.tables.get((row[each.bound[0]],))
                if table is not None:
                    return _among(table, row)
            often = [each for each in narrower if self._often(each, row)]
            if narrower and (often or made_of_rows):
                each = (often or narrower)[0]
                return _among(self._solved(each, (row[each.bound[0]],)), row)
            return [row] if self._solved(calls, row).rows else []

        return holds

    def _narrower(self, pattern: str, size: int) -> list[Calls]:
        """The calls with a value at one position alone, if they come to an end: objects are not made without end."""
        types = (t for name in self._graph.component(pattern) for t in self._library.parameter_types(name))
        if not all(isinstance(type_, ObjectType) for type_ in types):
            return []
        found = []
        for position in range(size):
            with suppress(Unplannable):
                found.append(self._plannable(pattern, (position,)))
        return found

    def _plannable(self, pattern: str, bound: tuple[int, ...]) -> Calls:
        """The calls; raises `Unplannable`."""
        found = self.calls(pattern, bound)
        found.prepare()
        return found

    def _often(self, calls: Calls, row: Row) -> bool:
        """Whether a value has been asked about so often, and with so much work, that all its rows should be known."""
        (position,) = calls.bound
        place = calls.pattern, position, row[position]
        self._asked[place] += 1
        return self._asked[place] > FEW_TIMES and self._kept > FEW_ROWS

    def _look(self) -> None:
        """Forget everything if there is a new state of the model."""
        if self._revision != self._store.revision:
            self._forget()
            self._revision = self._store.revision  # last: Ctrl-C before leaves nothing out of date

    def _solved(self, calls: Calls, values: tuple[Any, ...]) -> Table:
        """The table of a call, with all rows."""
        self._look()
        table = calls.tables.get(values)
        if table is not None:
            return table
        if self._kept > MOST_KEPT:
            self._forget()
        try:
            table = calls.table(values)
            self._kept += self._runs[self._graph.component(calls.pattern)].finish()
        except BaseException:
            self._forget()  # tables may lack rows
            raise
        return table

    def _forget(self) -> None:
        for each in self._calls.values():
            each.tables.clear()
        self._asked.clear()
        self._kept = 0


def _among(table: Table, row: Row) -> list[Row]:
    """The row, if a table of all rows with one of its values has it."""
    (position,) = table.calls.bound
    return [row] if table.known((*row[:position], *row[position + 1 :])) else []


def _full(size: int, bound: tuple[int, ...], values: tuple[Any, ...], row: Row) -> Row:
    """Values at bound positions, and the others, as one row."""
    given = dict(zip(bound, values, strict=True))
    others = iter(row)
    return tuple(given[position] if position in given else next(others) for position in range(size))

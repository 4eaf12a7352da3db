"""Emit functions that find matches in the arrays: rows of all matches, a test, a count, or a sampled match."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import Enum, auto

from envgraph import code
from envgraph.env.compiled.layout._model_changes import StaticPatterns
from envgraph.env.compiled.layout._not_compiled import NotCompiled, add_missing_span
from envgraph.env.compiled.layout._program_layout import (
    ONE,
    RF,
    RI,
    TOP,
    ZERO,
    D,
    emit_call,
    emit_entry,
    emit_error,
    emit_sum,
)
from envgraph.env.compiled.matching._aggregate_code import COUNT
from envgraph.env.compiled.matching._body_code import CAPACITY, BodyEmitter
from envgraph.env.compiled.matching._model_reading import ModelReader
from envgraph.match.generate import SolutionSink
from envgraph.match.plan import CallGraph, PatternPlan, PatternQuery, Planner
from envgraph.metamodel import Scalar
from envgraph.pattern import ObjectType, StaticType


class RowSource(Enum):
    """The way in which emitted code finds rows: without a loop, so at most ONE; each once and in order, as bits of
    WORDS or one by one (ORDERED); or in ANY other way.
    """

    ONE = auto()
    WORDS = auto()
    ORDERED = auto()
    ANY = auto()


WriteSolution = Callable[[BodyEmitter, RowSource], code.Body]
"""Returns the statements for a solution of a body, inside its loops, given how these find the rows."""
RowCode = Callable[[Sequence[code.Expression]], code.Body]
"""Returns the statements for the values of a row."""


class MatchEmitter:
    """An emitter of functions that find the rows of a view: the values of a pattern's matches at its output positions.

    The functions get values for the bound positions. In all methods, `sure` means that given objects are known to be of
    the classes of the parameters. `NotCompiled` is raised for recursive patterns.

    Args:
        facts: reads the model.
        planner: plans of the views.
        static: patterns whose matches are tables.
        calls: the call graph of the patterns.
    """

    def __init__(self, facts: ModelReader, planner: Planner, static: StaticPatterns, calls: CallGraph) -> None:
        self.facts = facts
        self.module = facts.module
        self.planner = planner
        self.static = static
        self.calls = calls

    def emit_rows(self, key: PatternQuery, classes_known: bool = True) -> str:
        """Emit a function that stores the distinct rows in sorted order, and returns their number. Return its name."""
        return self._emit_once("rows", key, classes_known, self._emit_rows_body)

    def emit_exists(self, key: PatternQuery, classes_known: bool = True) -> str:
        """Emit a function that returns True if the pattern has a match for given values. Return the function's name."""
        return self._emit_once("exists", key, classes_known, self._emit_exists_body)

    def emit_count(self, key: PatternQuery, classes_known: bool = True) -> str:
        """Emit a function that returns the number of distinct rows. Return the function's name."""
        return self._emit_once("count", key, classes_known, self._emit_count_body)

    def emit_sample(
        self, key: PatternQuery, given: Sequence[code.Local], then: RowCode, nothing: code.Return
    ) -> code.Body:
        """Emit the body of a function that samples a row, and uses its values.

        Args:
            key: the view of the rows.
            given: the values at the bound positions.
            then: returns the statements for a row's values; they end with a return.
            nothing: the return statement if there is no row.
        """
        number, row = self.module.new_local("n"), self.module.new_local("k")

        def write(body: BodyEmitter, source: RowSource) -> code.Body:
            if source is RowSource.ONE:
                return then(body.output_values(key))
            words = source is RowSource.WORDS
            return (body.words.emit_count(number),) if words else self._append_output(body, key, number)

        def write_nth(body: BodyEmitter, _: RowSource) -> code.Body:
            return body.words.emit_for_nth(row, lambda: then(body.output_values(key)))

        found, source = self._emit_bodies(key, given, True, write)
        if source is RowSource.ONE:
            return (*found, nothing)
        sampled = code.emit_call("pick", D, number)
        check = code.If(code.emit_equal(number, ZERO), (nothing,))
        if source is RowSource.WORDS:
            nth, _ = self._emit_bodies(key, given, True, write_nth)
            return (code.Assign(number, ZERO), *found, check, code.Assign(row, sampled), *nth, nothing)
        loads, values = self.load_row(key, row)
        chosen = code.Assign(row, emit_sum(TOP, sampled))
        return (*self._emit_sorting(key, found, source, number), check, chosen, *loads, *then(values))

    def emit_each(self, key: PatternQuery, given: Sequence[code.Local], then: RowCode, sure: bool = True) -> code.Body:
        """Emit code that runs `then` for the values of each row, in any order; rows may be repeated."""

        def write(body: BodyEmitter, _: RowSource) -> code.Body:
            body.words.emit_bits()
            return then(body.output_values(key))

        return self._emit_bodies(key, given, sure, write)[0]

    def load_row(self, key: PatternQuery, row: code.Expression, first: int = 0) -> tuple[code.Body, list[code.Local]]:
        """Return statements that read a row, which begins at a column, into variables, and the variables."""
        return self.load_values(self.column_types(key), row, first)

    def load_values(
        self, types: Sequence[StaticType], row: code.Expression, first: int = 0
    ) -> tuple[code.Body, list[code.Local]]:
        """Return statements that read a row with values of some types into variables, and the variables."""
        found = [self.facts.new_local_for(type_) for type_ in types]
        places = self.row_cells(types, row, first)
        return tuple(code.Assign(local, place) for local, place in zip(found, places, strict=True)), found

    def row_cells(self, types: Sequence[StaticType], row: code.Expression, first: int = 0) -> list[code.Subscript]:
        """Return the cells that store the values of a row, from a column on; make the row buffers wide enough."""
        self.module.width = max(self.module.width, first + len(types))
        spaces = [RF if type_ is Scalar.FLOAT else RI for type_ in types]
        return [emit_entry(space, row, column) for column, space in enumerate(spaces, first)]

    def column_types(self, key: PatternQuery) -> list[StaticType]:
        """Return the types of the columns of a view's rows."""
        types = self.facts.library.parameter_types(key.pattern)
        return [types[position] for position in key.outputs]

    def _emit_once(
        self,
        what: str,
        key: PatternQuery,
        sure: bool,
        write: Callable[[PatternQuery, Sequence[code.Local], bool], code.Body],
    ) -> str:
        def emit_inputs_and_body() -> tuple[Sequence[code.Local], code.Body]:
            given = [self.facts.new_local_for(type_) for type_ in self._input_types(key)]
            with add_missing_span(self.facts.library.get(key.pattern).span):
                self._check_recursion(key.pattern)
                return given, write(key, given, sure)

        return self.module.function_for((what, key, sure), what, emit_inputs_and_body)

    def _emit_bodies(
        self,
        key: PatternQuery,
        given: Sequence[code.Local],
        sure: bool,
        write: WriteSolution,
    ) -> tuple[code.Body, RowSource]:
        """Return code that finds the solutions of all bodies, and how it finds them."""
        block, view, source = code.BodyBuilder(), self.planner.plan_pattern(key), RowSource.ONE
        for each in view.bodies:
            body = BodyEmitter(self, each.conjunction, block, words=True)
            place = block.position
            body.bind_inputs(key, given, sure)
            body.emit_steps(each.plan.steps, _output_sink(view, body, write))
            block.close_to(place)
            source = _row_source(view, body)
        return block.finish_body(), source

    def _check_recursion(self, pattern: str) -> None:
        if self.calls.is_recursive(pattern):
            raise NotCompiled(f"a recursive pattern whose matches change (`{pattern}`)")

    def _input_types(self, key: PatternQuery) -> list[StaticType]:
        types = self.facts.library.parameter_types(key.pattern)
        return [types[position] for position in key.bound]

    def _store_row(
        self, types: Sequence[StaticType], values: Sequence[code.Expression], row: code.Expression
    ) -> code.Body:
        """Return statements that store values in a row."""
        cells = self.row_cells(types, row)
        return tuple(code.Assign(cell, value) for cell, value in zip(cells, values, strict=True))

    def append_row(
        self, types: Sequence[StaticType], values: Sequence[code.Expression], number: code.Local
    ) -> code.Body:
        """Return statements that append a row to the first `number` rows; if all are used, they set OVERFLOW."""
        more = (*self._store_row(types, values, emit_sum(TOP, number)), code.Assign(number, ONE, "+="))
        return (code.If(code.Operation("<", (number, CAPACITY)), more, (emit_error("OVERFLOW"),)),)

    def _append_output(self, body: BodyEmitter, key: PatternQuery, number: code.Local) -> code.Body:
        """Return statements that append a row with the output values of a solution to `number` rows."""
        body.words.emit_bits()
        return self.append_row(self.column_types(key), body.output_values(key), number)

    def _emit_sorting(self, key: PatternQuery, found: code.Body, source: RowSource, number: code.Local) -> code.Body:
        """Return code that stores the distinct rows in sorted order, and sets `number` to their count.

        Args:
            key: the view of the rows.
            found: appends a row for each solution.
            source: how `found` finds the rows.
            number: the number of rows.
        """
        view, types = self.planner.plan_pattern(key), self.column_types(key)
        whole = (code.Assign(number, ZERO), *found)
        if not types:
            return (*whole, code.Assign(number, code.emit_call("min", number, ONE)))
        if source is RowSource.ORDERED:
            return whole
        kinds = sum(1 << column for column, type_ in enumerate(types) if type_ is Scalar.FLOAT)
        numbers = (len(types), kinds, 0 if view.is_distinct else 1)
        in_order = code.emit_call("sort_rows", RI, RF, TOP, number, *map(code.Constant, numbers))
        return (*whole, code.Assign(number, in_order))

    def _emit_rows_body(self, key: PatternQuery, given: Sequence[code.Local], sure: bool) -> code.Body:
        def write(body: BodyEmitter, source: RowSource) -> code.Body:
            if source is RowSource.ONE:
                return (*self._store_row(self.column_types(key), body.output_values(key), TOP), code.Return(ONE))
            return self._append_output(body, key, COUNT)

        found, source = self._emit_bodies(key, given, sure, write)
        if source is RowSource.ONE:
            return (*found, code.Return(ZERO))
        return (*self._emit_sorting(key, found, source, COUNT), code.Return(COUNT))

    def emit_search(self, step: str, star: bool, forward: bool) -> str:
        """Emit a breadth-first search along a binary pattern that returns the number of objects found. Return its name.

        The search stores the objects in column 0 of the rows from `top` on, in the order in which they were found. In
        column 1 it marks them by object number.

        Args:
            step: the pattern.
            star: True if the start object counts as found.
            forward: True to search from sources to targets.
        """
        return self.module.function_for(
            (step, star, forward), "search", lambda: self._emit_search_body(step, star, forward)
        )

    def _emit_search_body(self, step: str, star: bool, forward: bool) -> tuple[Sequence[code.Local], code.Body]:
        self._check_recursion(step)
        start = self.module.new_local("v", "object")
        near, far = (0, 1) if forward else (1, 0)
        rows = self.emit_rows(PatternQuery(step, (near,), (far,)), classes_known=False)
        self.module.record_call(rows, 1)
        self.module.width = max(self.module.width, 2)
        fresh = self.module.new_local
        above, node, head, going = (fresh(prefix) for prefix in "tvhg")
        number, row, other, stride = (fresh(prefix) for prefix in "nivs")

        def row_cell(place: code.Expression, which: code.Expression) -> code.Subscript:
            return emit_entry(RI, emit_sum(TOP, place), which)

        def emit_mark_reached(found: code.Expression) -> code.Body:
            stored = code.Assign(row_cell(found, ONE), ONE), code.Assign(row_cell(COUNT, ZERO), found)
            return (*stored, code.Assign(COUNT, ONE, "+="))

        new = code.emit_equal(row_cell(other, ONE), ZERO)
        read = code.Assign(other, emit_entry(RI, emit_sum(above, row), ZERO))
        each = code.For(row, code.emit_call("range", number), (read, code.If(new, emit_mark_reached(other))))
        follow = code.Assign(node, row_cell(head, ZERO)), code.Assign(head, ONE, "+=")
        more = code.If(code.Operation("<", (head, COUNT)), follow, (code.Assign(going, ZERO),))
        found = code.Assign(number, emit_call(rows, node, top=above))
        whole: list[code.Statement] = [
            code.Assign(COUNT, ZERO),
            code.Assign(stride, self.facts.layout.stride()),
            code.If(code.Operation(">", (stride, CAPACITY)), (emit_error("OVERFLOW"), code.Return(ZERO))),
            code.For(row, code.emit_call("range", stride), (code.Assign(row_cell(row, ONE), ZERO),)),
            code.Assign(above, emit_sum(TOP, CAPACITY)),
            code.Assign(node, start),
            code.Assign(head, ZERO),
            code.Assign(going, ONE),
            code.While(code.emit_equal(going, ONE), (found, each, more)),
        ]
        if star:
            type_ = self.facts.library.parameter_types(step)[0]
            assert isinstance(type_, ObjectType)
            itself = (
                code.emit_equal(row_cell(start, ONE), ZERO),
                self.facts.emit_is_instance(start, type_.cls),
            )
            whole.append(code.If(code.Operation("and", itself), emit_mark_reached(start)))
        return [start], (*whole, code.Return(COUNT))

    def _emit_exists_body(self, key: PatternQuery, given: Sequence[code.Local], sure: bool) -> code.Body:
        return (*self.emit_each(key, given, lambda _: (code.Return(code.TRUE),), sure), code.Return(code.FALSE))

    def _emit_count_body(self, key: PatternQuery, given: Sequence[code.Local], sure: bool) -> code.Body:
        """Return code that counts distinct rows; it stores them if some may be equal."""
        is_distinct = bool(key.outputs) and self.planner.plan_pattern(key).is_distinct

        def write(body: BodyEmitter, source: RowSource) -> code.Body:
            counts = is_distinct or source is RowSource.ONE
            return (body.words.emit_count(COUNT),) if counts else self._append_output(body, key, COUNT)

        found, source = self._emit_bodies(key, given, sure, write)
        if is_distinct or source is RowSource.ONE:
            return (code.Assign(COUNT, ZERO), *found, code.Return(COUNT))
        return (*self._emit_sorting(key, found, source, COUNT), code.Return(COUNT))


def _output_sink(view: PatternPlan, body: BodyEmitter, write: WriteSolution) -> SolutionSink:
    """Return a sink with the statements that `write` returns, which read the output values of a body."""
    outputs = tuple(body.conjunction.parameters[position] for position in view.key.outputs)
    return SolutionSink(outputs, (), lambda _: write(body, _row_source(view, body)), ())


def _row_source(view: PatternPlan, body: BodyEmitter) -> RowSource:
    """Return how the loops of a body find the rows of its view."""
    if len(view.bodies) > 1:
        return RowSource.ANY
    if not body.loop_variables:
        return RowSource.ONE
    if not (view.key.outputs and view.is_distinct and body.is_ascending(view.key)):
        return RowSource.ANY
    return RowSource.ORDERED if body.words.word is None else RowSource.WORDS

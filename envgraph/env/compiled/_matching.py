"""Emit functions that find matches in the arrays: rows of all matches, a test, a count, or a sampled match."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import Enum, auto

from envgraph import code
from envgraph.env.compiled._aggregate_code import COUNT, emit_count
from envgraph.env.compiled._body_code import (
    CAPACITY,
    BodyEmitter,
    OnSolution,
    emit_for_nth,
    emit_return_true,
)
from envgraph.env.compiled._changes import StaticPatterns
from envgraph.env.compiled._model_reading import ModelReader
from envgraph.env.compiled._not_compiled import NotCompiled, add_missing_span
from envgraph.env.compiled._program_layout import (
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
from envgraph.match.plan import CallGraph, PatternPlan, PatternQuery, Planner, Unplannable
from envgraph.metamodel import Scalar
from envgraph.pattern import (
    ObjectType,
    StaticType,
)


class RowSource(Enum):
    """The way in which rows are found: without a loop, so at most ONE; as bits of WORDS, in order; or sorted ROWS."""

    ONE = auto()
    WORDS = auto()
    ROWS = auto()


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
        self._shapes: dict[tuple[PatternQuery, bool], RowSource] = {}

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
        self,
        key: PatternQuery,
        given: Sequence[code.Local],
        then: Callable[[Sequence[code.Expression]], code.Body],
        nothing: code.Return,
    ) -> code.Body:
        """Emit the body of a function that samples a row, and uses its values.

        Args:
            key: the view of the rows.
            given: the values at the bound positions.
            then: returns the statements for a row's values; they end with a return.
            nothing: the return statement if there is no row.
        """
        shape = self._row_source(key, True)
        number, row = self.module.new_local("n"), self.module.new_local("k")
        if shape is RowSource.ONE:
            found = self._emit_bodies(key, given, True, lambda body: body.block.add(*then(body.output_values(key))))
            return (*found, nothing)
        if shape is RowSource.WORDS:
            return (
                *self._emit_counting(key, given, True, number),
                code.If(code.emit_equal(number, ZERO), (nothing,)),
                code.Assign(row, code.emit_call("pick", D, number)),
                *self._emit_bodies(
                    key,
                    given,
                    True,
                    lambda body: emit_for_nth(body, row, lambda: then(body.output_values(key))),
                    words=True,
                ),
                nothing,
            )
        loads, values = self.load_row(key, row)
        return (
            *self._emit_sorted_rows(key, given, True, number),
            code.If(code.emit_equal(number, ZERO), (nothing,)),
            code.Assign(row, emit_sum(TOP, code.emit_call("pick", D, number))),
            *loads,
            *then(values),
        )

    def load_row(self, key: PatternQuery, row: code.Expression, first: int = 0) -> tuple[code.Body, list[code.Local]]:
        """Return statements that read a row, which begins at a column, into variables, and the variables."""
        found = [self.facts.new_local_for(type_) for type_ in self.column_types(key)]
        places = self.row_cells(key, row, first)
        return tuple(code.Assign(local, place) for local, place in zip(found, places, strict=True)), found

    def row_cells(self, key: PatternQuery, row: code.Expression, first: int = 0) -> list[code.Subscript]:
        """Return the cells that store the values of a row, from a column on; make the row buffers wide enough."""
        types = self.column_types(key)
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
        found: OnSolution,
        *,
        words: bool = False,
    ) -> code.Body:
        block = code.BodyBuilder()
        for each in self._view_plan(key).bodies:
            body = BodyEmitter(self, each.conjunction, block, words=words)
            place = block.position
            body.bind_inputs(key, given, sure)
            body.emit_steps(each.plan.steps, found)
            block.close_to(place)
        return block.finish_body()

    def _check_recursion(self, pattern: str) -> None:
        if self.calls.is_recursive(pattern):
            raise NotCompiled(f"a recursive pattern whose matches change (`{pattern}`)")

    def _view_plan(self, key: PatternQuery) -> PatternPlan:
        try:
            return self.planner.plan_pattern(key)
        except Unplannable:
            raise NotCompiled(f"a call of `{key.pattern}` before its inputs have values") from None

    def _row_source(self, key: PatternQuery, sure: bool) -> RowSource:
        """Return how the rows of a view are found, by emitting its bodies on trial."""
        if (key, sure) not in self._shapes:
            bodies: list[BodyEmitter] = []
            with self.module.discarding_functions():
                given = [self.facts.new_local_for(type_) for type_ in self._input_types(key)]
                self._emit_bodies(key, given, sure, bodies.append, words=True)
            shape, first = RowSource.ROWS, bodies[0] if bodies else None
            if first is None or (len(bodies) == 1 and not first.loop_variables):
                shape = RowSource.ONE  # or no row at all: the goals of a body may be impossible
            elif (
                len(bodies) == 1 and first.word is not None and first.is_ascending(key) and self._has_distinct_rows(key)
            ):
                shape = RowSource.WORDS
            self._shapes[key, sure] = shape
        return self._shapes[key, sure]

    def _has_distinct_rows(self, key: PatternQuery) -> bool:
        """Return True if no row is found twice. Return False without output positions, since rows are then equal."""
        return bool(key.outputs) and self._view_plan(key).is_distinct

    def _emit_counting(
        self, key: PatternQuery, given: Sequence[code.Local], sure: bool, number: code.Local
    ) -> code.Body:
        """Emit code that sets `number` to the number of rows. Call only if no row is found twice."""
        counted = self._emit_bodies(key, given, sure, lambda body: emit_count(body, number), words=True)
        return (code.Assign(number, ZERO), *counted)

    def _input_types(self, key: PatternQuery) -> list[StaticType]:
        types = self.facts.library.parameter_types(key.pattern)
        return [types[position] for position in key.bound]

    def _emit_store(self, body: BodyEmitter, key: PatternQuery, row: code.Expression) -> code.Body:
        """Return statements that store the output values of a solution in a row."""
        places = zip(self.row_cells(key, row), body.output_values(key), strict=True)
        return tuple(code.Assign(place, value) for place, value in places)

    def _emit_sorted_rows(
        self, key: PatternQuery, given: Sequence[code.Local], sure: bool, number: code.Local
    ) -> code.Body:
        """Emit code that stores the distinct rows in sorted order, and sets `number` to their count.

        If the row buffers are too small, the code sets the error OVERFLOW.
        """
        view, types = self._view_plan(key), self.column_types(key)
        ordered = view.is_distinct and len(view.bodies) == 1

        def write(body: BodyEmitter) -> None:
            nonlocal ordered
            ordered = ordered and body.is_ascending(key)
            room = code.Operation("<", (number, CAPACITY))
            stores = self._emit_store(body, key, emit_sum(TOP, number))
            more = (*stores, code.Assign(number, ONE, "+="))
            body.block.add(code.If(room, more, (emit_error("OVERFLOW"),)))

        whole = (code.Assign(number, ZERO), *self._emit_bodies(key, given, sure, write))
        if not types:
            return (*whole, code.Assign(number, code.emit_call("min", number, ONE)))
        if ordered:
            return whole
        kinds = sum(1 << column for column, type_ in enumerate(types) if type_ is Scalar.FLOAT)
        numbers = (len(types), kinds, 0 if view.is_distinct else 1)
        in_order = code.emit_call("sort_rows", RI, RF, TOP, number, *map(code.Constant, numbers))
        return (*whole, code.Assign(number, in_order))

    def _emit_rows_body(self, key: PatternQuery, given: Sequence[code.Local], sure: bool) -> code.Body:
        if self._row_source(key, sure) is not RowSource.ONE:
            return (*self._emit_sorted_rows(key, given, sure, COUNT), code.Return(COUNT))

        def write(body: BodyEmitter) -> None:
            body.block.add(*self._emit_store(body, key, TOP), code.Return(ONE))

        return (*self._emit_bodies(key, given, sure, write), code.Return(ZERO))

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
        found = self._emit_bodies(key, given, sure, emit_return_true)
        return (*found, code.Return(code.FALSE))

    def _emit_count_body(self, key: PatternQuery, given: Sequence[code.Local], sure: bool) -> code.Body:
        if not (self._has_distinct_rows(key) or self._row_source(key, sure) is RowSource.ONE):
            name = self.emit_rows(key, sure)
            self.module.record_call(name, 1)
            return (code.Return(emit_call(name, *given, top=emit_sum(TOP, CAPACITY))),)
        return (*self._emit_counting(key, given, sure, COUNT), code.Return(COUNT))

"""Emit functions that find matches in the arrays: rows of all matches, a test, a count, or a sampled match."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import Enum, auto

from envgraph import code
from envgraph.env.compiled._aggregates import COUNT, count_solutions
from envgraph.env.compiled._bodies import (
    CAPACITY,
    Body,
    Found,
    do_with_nth,
    found_one,
)
from envgraph.env.compiled._changes import StaticPatterns
from envgraph.env.compiled._facts import Facts
from envgraph.env.compiled._layout import ONE, RF, RI, TOP, ZERO, D, call, entry, failed, plus
from envgraph.env.compiled._refused import NotCompiled, standing
from envgraph.match.plan import CallGraph, Planner, Unplannable, ViewKey, ViewPlan
from envgraph.metamodel import Scalar
from envgraph.pattern import (
    ObjectType,
    StaticType,
)


class Shape(Enum):
    """The way in which rows are found: without a loop, so at most ONE; as bits of WORDS, in order; or sorted ROWS."""

    ONE = auto()
    WORDS = auto()
    ROWS = auto()


class Matching:
    """An emitter of functions that find the rows of a view: the values of a pattern's matches at its output positions.

    The functions get values for the bound positions. In all methods, `sure` means that given objects are known to be of
    the classes of the parameters. `NotCompiled` is raised for recursive patterns.

    Args:
        facts: reads the model.
        planner: plans of the views.
        static: patterns whose matches are tables.
        calls: the call graph of the patterns.
    """

    def __init__(self, facts: Facts, planner: Planner, static: StaticPatterns, calls: CallGraph) -> None:
        self.facts = facts
        self.module = facts.module
        self.planner = planner
        self.static = static
        self.calls = calls
        self._shapes: dict[tuple[ViewKey, bool], Shape] = {}

    def rows(self, key: ViewKey, sure: bool = True) -> str:
        """Emit a function that stores the distinct rows in sorted order, and returns their number. Return its name."""
        return self._function("rows", key, sure, self._rows)

    def exists(self, key: ViewKey, sure: bool = True) -> str:
        """Emit a function that returns True if the pattern has a match for given values. Return the function's name."""
        return self._function("exists", key, sure, self._exists)

    def count(self, key: ViewKey, sure: bool = True) -> str:
        """Emit a function that returns the number of distinct rows. Return the function's name."""
        return self._function("count", key, sure, self._count)

    def chosen(
        self,
        key: ViewKey,
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
        shape = self._shape(key, True)
        number, row = self.module.fresh("n"), self.module.fresh("k")
        if shape is Shape.ONE:
            found = self._bodies(key, given, True, lambda body: body.block.add(*then(body.values(key))))
            return (*found, nothing)
        if shape is Shape.WORDS:
            return (
                *self._counted(key, given, True, number),
                code.If(code.equal(number, ZERO), (nothing,)),
                code.Assign(row, code.call("pick", D, number)),
                *self._bodies(
                    key,
                    given,
                    True,
                    lambda body: do_with_nth(body, row, lambda: then(body.values(key))),
                    words=True,
                ),
                nothing,
            )
        loads, values = self.loaded(key, row)
        return (
            *self._collected(key, given, True, number),
            code.If(code.equal(number, ZERO), (nothing,)),
            code.Assign(row, plus(TOP, code.call("pick", D, number))),
            *loads,
            *then(values),
        )

    def loaded(self, key: ViewKey, row: code.Expression) -> tuple[code.Body, list[code.Local]]:
        """Return statements that read a row into variables, and the variables."""
        found = [self.facts.local(type_) for type_ in self.types(key)]
        places = self._places(key, row)
        return tuple(code.Assign(local, place) for local, place in zip(found, places, strict=True)), found

    def _places(self, key: ViewKey, row: code.Expression) -> list[code.Index]:
        """Return the cells that store the values of a row, and make the row buffers wide enough for them."""
        types = self.types(key)
        self.module.width = max(self.module.width, len(types))
        spaces = [RF if type_ is Scalar.FLOAT else RI for type_ in types]
        return [entry(space, row, column) for column, space in enumerate(spaces)]

    def types(self, key: ViewKey) -> list[StaticType]:
        """Return the types of the columns of a view's rows."""
        types = self.facts.library.parameter_types(key.pattern)
        return [types[position] for position in key.outputs]

    def _function(
        self,
        what: str,
        key: ViewKey,
        sure: bool,
        write: Callable[[ViewKey, Sequence[code.Local], bool], code.Body],
    ) -> str:
        def written() -> tuple[Sequence[code.Local], code.Body]:
            given = [self.facts.local(type_) for type_ in self._given(key)]
            with standing(self.facts.library.get(key.pattern).span):
                self._check_recursion(key.pattern)
                return given, write(key, given, sure)

        return self.module.once((what, key, sure), what, written)

    def _bodies(
        self, key: ViewKey, given: Sequence[code.Local], sure: bool, found: Found, *, words: bool = False
    ) -> code.Body:
        block = code.Block()
        for each in self._view(key).bodies:
            body = Body(self, each.conjunction, block, words=words)
            place = block.place
            body.begin(key, given, sure)
            body.steps(each.plan.steps, found)
            block.back_to(place)
        return block.body()

    def _check_recursion(self, pattern: str) -> None:
        if self.calls.recursive(pattern):
            raise NotCompiled(f"a recursive pattern whose matches change (`{pattern}`)")

    def _view(self, key: ViewKey) -> ViewPlan:
        try:
            return self.planner.view(key)
        except Unplannable:
            raise NotCompiled(f"a call of `{key.pattern}` before its inputs have values") from None

    def _shape(self, key: ViewKey, sure: bool) -> Shape:
        """Return how the rows of a view are found, by emitting its bodies on trial."""
        if (key, sure) not in self._shapes:
            bodies: list[Body] = []
            with self.module.trial():
                given = [self.facts.local(type_) for type_ in self._given(key)]
                self._bodies(key, given, sure, bodies.append, words=True)
            shape, first = Shape.ROWS, bodies[0] if bodies else None
            if first is None or (len(bodies) == 1 and not first.looped):
                shape = Shape.ONE  # or no row at all: the goals of a body may be impossible
            elif len(bodies) == 1 and first.word is not None and first.in_order(key) and self._different(key):
                shape = Shape.WORDS
            self._shapes[key, sure] = shape
        return self._shapes[key, sure]

    def _different(self, key: ViewKey) -> bool:
        """Return True if no row is found twice. Return False without output positions, since rows are then equal."""
        return bool(key.outputs) and self._view(key).distinct

    def _counted(
        self, key: ViewKey, given: Sequence[code.Local], sure: bool, number: code.Local
    ) -> code.Body:
        """Emit code that sets `number` to the number of rows. Call only if no row is found twice."""
        counted = self._bodies(key, given, sure, lambda body: count_solutions(body, number), words=True)
        return (code.Assign(number, ZERO), *counted)

    def _given(self, key: ViewKey) -> list[StaticType]:
        types = self.facts.library.parameter_types(key.pattern)
        return [types[position] for position in key.bound]

    def _stored(self, body: Body, key: ViewKey, row: code.Expression) -> code.Body:
        """Return statements that store the output values of a solution in a row."""
        places = zip(self._places(key, row), body.values(key), strict=True)
        return tuple(code.Assign(place, value) for place, value in places)

    def _collected(
        self, key: ViewKey, given: Sequence[code.Local], sure: bool, number: code.Local
    ) -> code.Body:
        """Emit code that stores the distinct rows in sorted order, and sets `number` to their count.

        If the row buffers are too small, the code sets the error OVERFLOW.
        """
        view, types = self._view(key), self.types(key)
        ordered = view.distinct and len(view.bodies) == 1

        def write(body: Body) -> None:
            nonlocal ordered
            ordered = ordered and body.in_order(key)
            room = code.Operation("<", (number, CAPACITY))
            stores = self._stored(body, key, plus(TOP, number))
            more = (*stores, code.Assign(number, ONE, "+="))
            body.block.add(code.If(room, more, (failed("OVERFLOW"),)))

        whole = (code.Assign(number, ZERO), *self._bodies(key, given, sure, write))
        if not types:
            return (*whole, code.Assign(number, code.call("min", number, ONE)))
        if ordered:
            return whole
        kinds = sum(1 << column for column, type_ in enumerate(types) if type_ is Scalar.FLOAT)
        numbers = (len(types), kinds, 0 if view.distinct else 1)
        in_order = code.call("sort_rows", RI, RF, TOP, number, *map(code.Constant, numbers))
        return (*whole, code.Assign(number, in_order))

    def _rows(self, key: ViewKey, given: Sequence[code.Local], sure: bool) -> code.Body:
        if self._shape(key, sure) is not Shape.ONE:
            return (*self._collected(key, given, sure, COUNT), code.Return(COUNT))

        def write(body: Body) -> None:
            body.block.add(*self._stored(body, key, TOP), code.Return(ONE))

        return (*self._bodies(key, given, sure, write), code.Return(ZERO))

    def search(self, step: str, star: bool, forward: bool) -> str:
        """Emit a breadth-first search along a binary pattern that returns the number of objects found. Return its name.

        The search stores the objects in column 0 of the rows from `top` on, in the order in which they were found. In
        column 1 it marks them by object number.

        Args:
            step: the pattern.
            star: True if the start object counts as found.
            forward: True to search from sources to targets.
        """
        return self.module.once((step, star, forward), "search", lambda: self._search(step, star, forward))

    def _search(self, step: str, star: bool, forward: bool) -> tuple[Sequence[code.Local], code.Body]:
        self._check_recursion(step)
        start = self.module.fresh("v", "object")
        near, far = (0, 1) if forward else (1, 0)
        rows = self.rows(ViewKey(step, (near,), (far,)), sure=False)
        self.module.uses(rows, 1)
        self.module.width = max(self.module.width, 2)
        fresh = self.module.fresh
        above, node, head, going = (fresh(prefix) for prefix in "tvhg")
        number, row, other, stride = (fresh(prefix) for prefix in "nivs")

        def column(place: code.Expression, which: code.Expression) -> code.Index:
            return entry(RI, plus(TOP, place), which)

        def mark(found: code.Expression) -> code.Body:
            stored = code.Assign(column(found, ONE), ONE), code.Assign(column(COUNT, ZERO), found)
            return (*stored, code.Assign(COUNT, ONE, "+="))

        new = code.equal(column(other, ONE), ZERO)
        read = code.Assign(other, entry(RI, plus(above, row), ZERO))
        each = code.For(row, code.call("range", number), (read, code.If(new, mark(other))))
        follow = code.Assign(node, column(head, ZERO)), code.Assign(head, ONE, "+=")
        more = code.If(code.Operation("<", (head, COUNT)), follow, (code.Assign(going, ZERO),))
        found = code.Assign(number, call(rows, node, top=above))
        whole: list[code.Statement] = [
            code.Assign(COUNT, ZERO),
            code.Assign(stride, self.facts.layout.stride()),
            code.If(code.Operation(">", (stride, CAPACITY)), (failed("OVERFLOW"), code.Return(ZERO))),
            code.For(row, code.call("range", stride), (code.Assign(column(row, ONE), ZERO),)),
            code.Assign(above, plus(TOP, CAPACITY)),
            code.Assign(node, start),
            code.Assign(head, ZERO),
            code.Assign(going, ONE),
            code.While(code.equal(going, ONE), (found, each, more)),
        ]
        if star:
            type_ = self.facts.library.parameter_types(step)[0]
            assert isinstance(type_, ObjectType)
            itself = code.equal(column(start, ONE), ZERO), self.facts.is_instance(start, type_.cls)
            whole.append(code.If(code.Operation("and", itself), mark(start)))
        return [start], (*whole, code.Return(COUNT))

    def _exists(self, key: ViewKey, given: Sequence[code.Local], sure: bool) -> code.Body:
        found = self._bodies(key, given, sure, found_one)
        return (*found, code.Return(code.FALSE))

    def _count(self, key: ViewKey, given: Sequence[code.Local], sure: bool) -> code.Body:
        if not (self._different(key) or self._shape(key, sure) is Shape.ONE):
            name = self.rows(key, sure)
            self.module.uses(name, 1)
            return (code.Return(call(name, *given, top=plus(TOP, CAPACITY))),)
        return (*self._counted(key, given, sure, COUNT), code.Return(COUNT))

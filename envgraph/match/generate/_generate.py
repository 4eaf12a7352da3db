"""Emit code that executes the plan of one conjunction.

The code consists of nested loops over the columns of the store, with each test in the outermost loop that the plan
allows. It contains no text of the user: variables are numbered, constants and columns are parameters of `build`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

from envgraph import code
from envgraph.code import dataclass
from envgraph.match.generate._bindings import Bindings
from envgraph.match.generate._distinct_sets import END, DistinctSets
from envgraph.match.generate._narrowing import link_tests
from envgraph.match.generate._relations import Relations, same_for_all
from envgraph.match.generate._sinks import (
    COUNT,
    EXISTENCE,
    FOUND,
    OUT,
    N,
    Names,
    Sink,
    empty,
    fold,
    folding,
    row,
)
from envgraph.match.generate._symbols import Bounded, Builtin, ClosureQuestion, Column, Mode, Valued, closed
from envgraph.match.generate._value_joins import Side, ValueJoin, value_join
from envgraph.match.generate._write import Module, local
from envgraph.match.plan._distinct import Distinct, distinct_places
from envgraph.match.plan._plan import Kind, Plan, Step
from envgraph.match.plan._planner import Planner, determined
from envgraph.match.plan._sharing import alike_by, join_of, mentioned, shared_searches
from envgraph.pattern import (
    Absence,
    AggregateAtom,
    AttributeAtom,
    CallAtom,
    ClosureAtom,
    Condition,
    Conjunction,
    Expression as Term,
    InstanceAtom,
    LinkAtom,
    UnequalAtom,
    Valuation,
    arguments,
    variables,
)


@dataclass(frozen=True, slots=True)
class Executed:
    """The origin of emitted code: the step that the code executes.

    Attributes:
        step: the step.
        known: the variables with values after the step, and the code for each value.
    """

    step: Step
    known: Mapping[int, code.Expression]


class Translation:
    """A translation of the plan of one conjunction into code.

    Args:
        planner: plans called patterns.
        module: receives symbols and functions.
        conjunction: the body.
        block: receives the code; its nesting depth is restored afterwards.
        given: code for the values at the bound positions.
        relations: emits code for relations and holds the bindings; created if None.

    Attributes:
        distinct: the duplicate filters, including sets that must be created outside of loops.
        around: variables bound by a loop around the plan.
        indexes: True if later tests may restrict the objects of a loop by an index.
    """

    around: tuple[int, ...] = ()
    indexes = True

    def __init__(
        self,
        planner: Planner,
        module: Module,
        conjunction: Conjunction,
        block: code.Block,
        given: Mapping[int, code.Expression],
        relations: Relations | None = None,
    ) -> None:
        self._planner = planner
        self._module = module
        self._conjunction = conjunction
        self._block = block
        self._given = given
        self._relations = relations or Relations(planner, module, Bindings(conjunction, module))
        self._bindings = self._relations.bindings
        self.distinct = DistinctSets(module, block, self._bindings)
        self._seen: dict[int, code.Local] = {}

    bounded: Bounded | None = None
    """The function that checks the limit on the number of matches; None for no check."""
    _carried: Sequence[code.Local] = ()
    """Parameters that every inner function gets."""
    _continues = False
    """True if this function is a continuation, called inside the loops of another function."""
    _shares = True
    """True if closure searches share their work."""
    _joins = True
    """True if an existence test may become a `Join`. Not inside a `Join`, since that would never end."""

    def body(self, plan: Plan, sink: Sink) -> None:
        """Emit code that executes a plan, with the statements of the sink for each solution."""
        block = self._block
        place = block.place
        for position, given in self._given.items():
            variable = self._conjunction.parameters[position]
            if variable in self._bindings.names or variable in self._bindings.constants:
                block.test(code.equal(self._bindings.source(variable), given))
            else:
                self._bindings.names[variable] = given
        joined = self._join(plan) if sink is EXISTENCE else None
        if joined is None:
            self._steps(plan.steps, sink)
        else:
            block.test(joined)
            block.add(*sink.each(self._bindings.source))
        block.back_to(place)

    # --- steps

    def _steps(self, steps: Sequence[Step], sink: Sink) -> None:
        """Emit code for the steps, then the sink. If the loops get too deep, the rest becomes a continuation."""
        shared = shared_searches(steps, sink) if self._shares else {}
        self._begin_searches(-1, steps, shared)
        self._place_distinct(steps, sink)
        found: set[int] = set()
        for number, step in enumerate(steps):
            if id(step) in found:
                continue
            self.distinct.test(id(step))
            if self._block.full and step.kind in (Kind.LOOP, Kind.BIND):
                self._continue(steps[number:], sink)
                return
            self.distinct.begin(id(step))
            following = [each for each in steps[number + 1 :] if id(each) not in found]
            types, known = self._conjunction.types, self._bindings.changing
            join = value_join(step, following, known, self._bindings.constants, types)
            self._guard(step, sink, join)
            indexed = step.kind is Kind.LOOP and self.indexes
            if join is not None and indexed and join.usable(not self._shares):
                self._loop_joined(step, join, sink)
                found.update(map(id, join.tests))
                if join.whole and sink is COUNT:
                    return
            elif indexed and self._shares and (links := link_tests(step, following, self._bindings)):
                self._loop_common(step, links)
            elif step.kind is Kind.LOOP:
                self._loop(step)
            elif step.kind is Kind.BIND:
                self._bind(step, inline=False)
            else:
                self._block.test(self._test(step))
            self._block.come_from(Executed(step, dict(self._bindings.names)))
            self._begin_searches(number, steps, shared)
        self.distinct.test(END)
        self._block.add(*sink.each(self._bindings.source))

    def _guard(self, step: Step, sink: Sink, join: ValueJoin | None) -> None:
        """Emit a check for too many matches before a loop that no constraint connects with the outer loops."""
        if self.bounded is None or step.kind is not Kind.LOOP or not (self._block.loops or self._continues):
            return
        if join is None and not any(map(self._bindings.known, variables(step.goal))):
            name = dict(enumerate(self._conjunction.names)).get(next(iter(step.binds), -1), "")
            check = code.call(self._module.name(self.bounded), self._size(sink), self._module.literal(name))
            self._block.add(code.Do(check))

    def _size(self, sink: Sink) -> code.Expression:
        """Return code for the number of matches so far; overridden in views."""
        return sink.size

    def _place_distinct(self, steps: Sequence[Step], sink: Sink) -> None:
        """Place the duplicate filters of a plan. Do nothing in a continuation: its filters are already placed."""
        if self.distinct.placed:
            return
        found: dict[int, Distinct] = {}
        if self._shares and sink.repeatable:
            of = partial(determined, sizes=self._planner.sizes)
            found = distinct_places(
                steps, sink.variables, {*self._bindings.names, *self._bindings.constants}, of, self.around
            )
        self.distinct.place(
            steps,
            {number: each for number, each in found.items() if number < len(steps) or sink.unique},
        )

    def _begin_searches(self, number: int, steps: Sequence[Step], shared: Mapping[int, int]) -> None:
        """Emit code that creates the sets of seen nodes of closure searches that must be empty after step `number`."""
        for search, last in shared.items():
            if last == number:
                seen = self._seen[id(steps[search])] = code.Local(self._module.fresh("s"))
                self._block.add(code.Assign(seen, empty("set")))

    def _fork(self, block: code.Block, continuation: bool) -> Translation:
        """Return a new translation of the same body, without values, for an inner function or a continuation."""
        return Translation(self._planner, self._module, self._conjunction, block, {})

    def _continue(self, steps: Sequence[Step], sink: Sink) -> None:
        """Emit a continuation function for the remaining steps, and code that calls it and relays its result."""
        rest = self._function("h", steps, sink, continuation=True)
        match sink.relay:
            case "flag":
                self._block.test(rest)
                self._block.add(code.Return(code.Constant(True)))
            case "found":
                self._block.test(code.Operation("is not", (code.Let(FOUND, rest), code.Constant(None))))
                self._block.add(code.Return(FOUND))
            case "sum":
                self._block.add(code.Assign(N, rest, "+="))
            case "each":
                self._block.add(code.Yield(rest, each=True))
            case _:
                self._block.add(code.Do(rest))

    def _function(
        self, prefix: str, steps: Sequence[Step], sink: Sink, continuation: bool = False
    ) -> code.Expression:
        """Emit an inner function that executes some steps with a sink, and return a call of the function."""
        name, arguments_ = self._defined(prefix, steps, sink, continuation)
        return code.call(name, *arguments_)

    def _defined(
        self, prefix: str, steps: Sequence[Step], sink: Sink, continuation: bool = False
    ) -> tuple[code.Name, list[code.Expression]]:
        """Emit an inner function that executes some steps with a sink. Return its name and the call's arguments."""
        shared: list[code.Local] = list(sink.shared) if continuation else []
        inputs = self._inputs(steps, sink)
        inner = self._fork(code.Block(), continuation)
        inner._bindings.names.update((v, inner._bindings.local(v)) for v in inputs)
        inner._joins, inner.indexes = self._joins, self.indexes
        inner._continues = continuation
        inner.bounded = self.bounded if continuation else None
        head = () if shared else sink.head
        tail = () if shared and not sink.relay else sink.tail
        if continuation:
            inner.distinct = self.distinct.rest(inner._block, inner._bindings)
            shared += self.distinct.passed.values()
        shared += self._carried
        inner._steps(steps, sink)
        body = (*head, *inner._block.body(), *tail)
        parameters = [*shared, *(inner._bindings.local(v) for v in inputs)]
        name = self._module.function(self._module.fresh(prefix), parameters, body)
        return name, [*shared, *(self._bindings.source(v) for v in inputs)]

    def _inputs(self, steps: Sequence[Step], sink: Sink) -> list[int]:
        """Return the variables with values, constants excepted, that the steps and the sink read."""
        read = {*sink.variables, *(v for step in steps for v in mentioned(step))}
        return sorted(v for v in read if v in self._bindings.names and v not in self._bindings.constants)

    # --- loops

    def _loop(self, step: Step) -> None:
        """Emit the loop of a step over an extent, link ends, a closure or the matches of a called pattern."""
        goal = step.goal
        match goal:
            case InstanceAtom(cls, variable, exact):
                self._each([variable], self._relations.extent(cls, exact))
            case LinkAtom():
                self._each(step.binds, self._relations.ends(goal))
            case ClosureAtom(_, _, source, target):
                ends = [v for v in (source, target) if not self._bindings.known(v)]
                seen = self._seen.get(id(step))
                self._each(
                    ends,
                    self._relations.closure(goal) if seen is None else self._relations.spread(goal, seen),
                )
            case CallAtom() if self._planner.calls.recursive(goal.pattern):
                columns = [None if self._bindings.known(v) else v for v in goal.arguments]
                self._each(columns, self._relations.rows(goal), tuples=True)
            case CallAtom():
                wanted = [v for v in goal.arguments if v in step.binds]
                self._each(wanted, self._relations.view(goal, step.binds, Mode.VALUES))
            case _:
                raise AssertionError(goal)

    def _each(self, targets: Sequence[int | None], iterable: code.Expression, tuples: bool = False) -> None:
        """Emit a loop that binds target variables to the items of an iterable. A target None marks an unused value.

        The items are tuples. For a single target they are bare values, unless `tuples` is True.
        """
        names: list[code.Local] = []
        again: list[code.Expression] = []
        for variable in targets:
            name = code.Local("_") if variable is None else self._bindings.local(variable)
            if name in names and variable is not None:
                first, name = name, local("w", len(names))
                again.append(code.equal(name, first))
            names.append(name)
        self._block.loop(names[0] if len(names) == 1 and not tuples else code.Tuple(tuple(names)), iterable)
        for test in again:
            self._block.test(test)
        self._bindings.names.update((v, self._bindings.local(v)) for v in targets if v is not None)

    def _loop_joined(self, step: Step, join: ValueJoin, sink: Sink) -> None:
        """Emit a loop over the objects that a value index finds. If only their number matters, emit a count."""
        goal = step.goal
        assert isinstance(goal, InstanceAtom)
        classes = tuple(self._relations.indices(goal.cls, goal.exact))
        if join.tests:
            goals = (test.goal for test in join.tests)
            pairs = sorted(
                (one.attribute.index, one.value) for one in goals if isinstance(one, AttributeAtom)
            )
            index = self._module.name(Valued(classes, tuple(attribute for attribute, _ in pairs)))
            self._each(step.binds, code.call(index, *(self._bindings.source(value) for _, value in pairs)))
            return
        number = self._module.fresh("c")
        index = self._module.name(Valued(classes, (), tuple(join.operators), join.alone, number))
        asked: list[code.Local] = []
        for side in join.known:
            asked.append(code.Local(self._module.fresh("u")))
            found = self._side(side, self._bindings.source)
            self._block.test(code.some(code.Let(asked[-1], found)))  # None: the expression has no value
        equal = len(asked) - len(join.operators)
        entries, key = self._entries(step, join, number), code.tuple_of(*asked[:equal])
        parts: list[code.Expression] = [entries, key, *asked[equal:]]
        if join.whole and sink is COUNT:
            self._block.add(code.Assign(N, code.method(index, "count", *parts), "+="))
            return
        self._each(step.binds, code.method(index, "some" if sink is EXISTENCE else "rows", *parts))

    def _entries(self, step: Step, join: ValueJoin, name: str) -> code.Name:
        """Emit a function that yields an index entry (key, bounded value, object) per given object; return its name."""
        inner = Translation(self._planner, self._module, self._conjunction, code.Block(), {})

        def each(names: Names) -> code.Body:
            *keys, bound = (inner._side(side, names) for side in join.own)
            return (code.Yield(code.tuple_of(code.tuple_of(*keys), bound, names(step.binds[0]))),)

        nodes = code.Local("nodes")
        inner._each(step.binds, nodes)
        read = (*step.binds, *(v for side in join.own for v in side.variables))
        inner._steps(join.steps, Sink(read, (), each, (), relay="each"))
        return self._module.function(name, [nodes], inner._block.body())

    def _side(self, side: Side, names: Names) -> code.Expression:
        """Return code for one side of a comparison. `names` returns code for the values of variables."""
        found = {name: names(variable) for name, variable in side.reads}
        types = {name: self._conjunction.types[variable] for name, variable in side.reads}
        return self._module.expression(side.expression, found, types, part=True)

    def _loop_common(self, step: Step, tests: Sequence[Step]) -> None:
        """Emit a loop over link ends. If there are many, intersect them with the ends that later tests require."""
        goal = step.goal
        assert isinstance(goal, LinkAtom)
        others = [self._relations.ends(test.goal) for test in tests if isinstance(test.goal, LinkAtom)]
        ends = code.Local(self._module.fresh("e"))
        kind = code.Member(code.Let(ends, self._relations.ends(goal)), "__class__")
        short = code.Operation("is", (kind, code.Name("tuple")))  # otherwise a crowded `IndexedSet`
        common = code.call(self._module.name(Builtin("common")), ends, *others)
        self._each(step.binds, code.Choice(short, ends, common))

    # --- values

    def _bind(self, step: Step, inline: bool) -> None:
        """Emit code that binds a variable, or skips a match without value. If `inline`, the code is one expression."""
        (variable,) = step.binds
        found: code.Expression = self._bindings.local(variable)
        assert isinstance(found, code.Local)
        if isinstance(step.goal, LinkAtom):
            ends = self._bindings.local(variable, "t")
            self._block.test(code.Let(ends, self._relations.ends(step.goal)))
            if inline:
                found = code.Index(ends, code.Constant(0))
            else:
                self._block.add(code.Assign(code.Tuple((found,)), ends))
        else:
            self._block.test(code.some(code.Let(found, self._value(step))))
        self._bindings.names[variable] = found

    def _value(self, step: Step) -> code.Expression:
        """Return code for the value that a goal computes; at run time None means that there is no value."""
        goal = step.goal
        match goal:
            case AttributeAtom(attribute, owner, _):
                return code.Index(
                    self._module.name(Column("values", attribute.index)), self._bindings.source(owner)
                )
            case Valuation(expression, reads, _):
                return self._expression(expression, reads)
            case AggregateAtom():
                return self._aggregate(goal, step.inner[0])
        raise AssertionError(goal)

    def _expression(self, expression: Term, reads: tuple[tuple[str, int], ...]) -> code.Expression:
        """Return code for an expression over bound variables."""
        names = {name: self._bindings.source(variable) for name, variable in reads}
        types = {name: self._conjunction.types[variable] for name, variable in reads}
        return self._module.expression(expression, names, types)

    def _aggregate(self, goal: AggregateAtom, plan: Plan) -> code.Expression:
        """Return code for an aggregate: a value shared by several starts if possible, else one call, else loops."""
        return (
            self._alike(goal, plan)
            or self._asked(goal)
            or self._function("g", plan.steps, folding(self._module, goal))
        )

    def _asked(self, goal: AggregateAtom) -> code.Expression | None:
        """Return code for an aggregate that one existing function or column answers; None if a loop is needed."""
        if goal.column is None:
            return self._relations.count(goal.relation)
        values = self._relations.column(goal.relation, goal.column)
        return None if values is None else code.call(fold(self._module, goal), values)

    def _alike(self, goal: AggregateAtom, plan: Plan) -> code.Expression | None:
        """Return code for an aggregate that is the same for all starts that reach the same nodes; None if it is not."""
        if not self._shares:
            return None
        assert isinstance(self._planner, Planner)
        found = alike_by(self._planner, goal, self._bindings.changing)
        if found is None:
            return None
        name, given = self._defined("g", plan.steps, folding(self._module, goal))
        called = arguments(goal.relation)
        column = None if goal.column is None else called.index(goal.column)
        places = found.ends.given if found.ends else ()
        outside = row([called[place] for place in places], self._bindings.source)
        start = self._bindings.source(found.start)
        return same_for_all(self._module, found, start, name, given, outside, goal.function, column)

    # --- tests

    def _test(self, step: Step) -> code.Expression:
        """Return code for the test of a step."""
        goal = step.goal
        match goal:
            case _ if step.kind is Kind.EXISTS:
                return self._existence(step.inner[0])
            case Absence():
                return code.joined("and", [code.inverse(self._existence(plan)) for plan in step.inner], True)
            case InstanceAtom():
                return self._relations.is_instance(goal)
            case AttributeAtom() | Valuation() | AggregateAtom():
                result = goal.value if isinstance(goal, AttributeAtom) else goal.result
                return code.equal(self._value(step), self._bindings.source(result))
            case LinkAtom():
                return self._relations.is_linked(goal)
            case CallAtom(pattern) if self._planner.calls.recursive(pattern):
                return self._relations.rows(goal)
            case CallAtom():
                return self._relations.view(goal, (), Mode.EXISTS)
            case ClosureAtom(relation, _, source, target):
                if self._bindings.known(source) and self._bindings.known(target):
                    return self._relations.closure(goal)
                return self._test(replace(step, goal=CallAtom(relation, (source, target))))
            case UnequalAtom(left, right):
                return code.Operation("!=", (self._bindings.source(left), self._bindings.source(right)))
            case Condition(expression, reads):
                return self._expression(expression, reads)
        raise AssertionError(goal)

    def _existence(self, plan: Plan) -> code.Expression:
        """Return code that tests if a plan has a solution: an expression, or with loops a call of a new function."""
        if any(step.kind is Kind.LOOP for step in plan.steps):
            return self._join(plan) or self._function("g", plan.steps, EXISTENCE)
        inner = Translation(self._planner, self._module, self._conjunction, code.Block(), {})
        inner._bindings.names = dict(self._bindings.names)
        for step in plan.steps:
            if step.kind is Kind.BIND:
                inner._bind(step, inline=True)
            else:
                inner._block.test(inner._test(step))
        return code.joined("and", [test for test, _ in inner._block.tests], True)

    def _join(self, plan: Plan) -> code.Expression | None:
        """Return code for an existence test that one closure search decides; None if the plan has no such form."""
        if not (self._shares and self._joins):
            return None
        assert isinstance(self._planner, Planner)
        known = self._bindings.changing
        join = join_of(self._planner, self._conjunction, plan, known)
        if join is None:
            return None
        from_source = join.near == join.closure.source
        spread = self._module.name(closed(join.closure, ClosureQuestion.SPREAD, not from_source))
        all_ = Sink(
            (join.far,),
            (code.Assign(OUT, empty("set")),),
            lambda names: (code.Do(code.call(spread, names(join.far), OUT)),),
            (code.Return(OUT),),
            (OUT,),
            repeatable=True,
        )
        self._joins = False
        whole = self._defined("z", join.plan.steps, all_)
        direct = self._defined("g", plan.steps, EXISTENCE)
        self._joins = True
        holds = self._module.name(closed(join.closure, ClosureQuestion.JOIN, from_source))
        parts = [self._bindings.source(join.near)]
        for name, given in (whole, direct):
            parts += [name, code.Tuple(tuple(given))]
        return code.call(holds, *parts)

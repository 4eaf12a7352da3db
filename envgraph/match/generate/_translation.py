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
from envgraph.match.generate._bindings import VariableBindings
from envgraph.match.generate._duplicate_filter_code import PLAN_END, DuplicateFilterCode
from envgraph.match.generate._link_tests import link_tests
from envgraph.match.generate._relation_code import RelationCode, emit_shared_aggregate
from envgraph.match.generate._sinks import (
    COUNT,
    EXISTENCE,
    FOUND,
    OUT,
    N,
    SolutionSink,
    VariableCode,
    aggregate_function_name,
    aggregate_sink,
    emit_empty_collection,
    row,
)
from envgraph.match.generate._source_builder import SourceBuilder, local_variable
from envgraph.match.generate._symbols import (
    Builtin,
    ClosureQuestion,
    MatchLimitCheck,
    ResultMode,
    StoreColumn,
    Valued,
    closure_function,
)
from envgraph.match.generate._value_joins import ComparisonSide, ValueJoin, value_join
from envgraph.match.plan._duplicate_filters import DuplicateFilter, place_duplicate_filters
from envgraph.match.plan._planner import Planner, determined_variables
from envgraph.match.plan._search_plan import PlanStep, SearchPlan, StepKind
from envgraph.match.plan._shared_searches import (
    join_of,
    reach_aggregate_of,
    shared_searches,
    variables_used_by,
)
from envgraph.pattern import (
    AbsenceAtom,
    AggregateAtom,
    AttributeAtom,
    CallAtom,
    ClosureAtom,
    ConditionAtom,
    Conjunction,
    Expression as Term,
    InstanceAtom,
    LinkAtom,
    UnequalAtom,
    ValuationAtom,
    relation_variables,
    visible_variables,
)


@dataclass(frozen=True, slots=True)
class StepOrigin:
    """The origin of emitted code: the step that the code executes.

    Attributes:
        step: the step.
        known: the variables with values after the step, and the code for each value.
    """

    step: PlanStep
    known: Mapping[int, code.Expression]


class PlanTranslation:
    """A translation of the plan of one conjunction into code.

    Args:
        planner: plans called patterns.
        module: receives symbols and functions.
        conjunction: the body.
        block: receives the code; its nesting depth is restored afterwards.
        given: code for the values at the bound positions.
        relations: emits code for relations and holds the bindings; created if None.

    Attributes:
        duplicate_filters: the duplicate filters, including sets that must be created outside of loops.
        outer_variables: variables bound by a loop around the plan.
        uses_indexes: True if later tests may restrict the objects of a loop by an index.
    """

    outer_variables: tuple[int, ...] = ()
    uses_indexes = True

    def __init__(
        self,
        planner: Planner,
        module: SourceBuilder,
        conjunction: Conjunction,
        block: code.BodyBuilder,
        given: Mapping[int, code.Expression],
        relations: RelationCode | None = None,
    ) -> None:
        self._planner = planner
        self._module = module
        self._conjunction = conjunction
        self._block = block
        self._given = given
        self._relations = relations or RelationCode(planner, module, VariableBindings(conjunction, module))
        self._bindings = self._relations.bindings
        self.duplicate_filters = DuplicateFilterCode(module, block, self._bindings)
        self._seen: dict[int, code.Local] = {}

    limit_check: MatchLimitCheck | None = None
    """The function that checks the limit on the number of matches; None for no check."""
    _extra_parameters: Sequence[code.Local] = ()
    """Parameters that every inner function gets."""
    _is_continuation = False
    """True if this function is a continuation, called inside the loops of another function."""
    _shares_searches = True
    """True if closure searches share their work."""
    _allows_joins = True
    """True if an existence test may become a `Join`. Not inside a `Join`, since that would never end."""

    def emit_plan(self, plan: SearchPlan, sink: SolutionSink) -> None:
        """Emit code that executes a plan, with the statements of the sink for each solution."""
        block = self._block
        place = block.position
        for position, given in self._given.items():
            variable = self._conjunction.parameters[position]
            if variable in self._bindings.expressions or variable in self._bindings.constants:
                block.open_test(code.emit_equal(self._bindings.expression_of(variable), given))
            else:
                self._bindings.expressions[variable] = given
        joined = self._emit_join(plan) if sink is EXISTENCE else None
        if joined is None:
            self._emit_steps(plan.steps, sink)
        else:
            block.open_test(joined)
            block.add(*sink.emit_each(self._bindings.expression_of))
        block.close_to(place)

    # --- steps

    def _emit_steps(self, steps: Sequence[PlanStep], sink: SolutionSink) -> None:
        """Emit code for the steps, then the sink. If the loops get too deep, the rest becomes a continuation."""
        shared = shared_searches(steps, sink) if self._shares_searches else {}
        self._emit_seen_sets(-1, steps, shared)
        self._place_filters(steps, sink)
        found: set[int] = set()
        for number, step in enumerate(steps):
            if id(step) in found:
                continue
            self.duplicate_filters.emit_filter(id(step))
            if self._block.is_full and step.kind in (StepKind.LOOP, StepKind.BIND):
                self._emit_continuation_call(steps[number:], sink)
                return
            self.duplicate_filters.emit_new_sets(id(step))
            following = [each for each in steps[number + 1 :] if id(each) not in found]
            types, known = self._conjunction.types, self._bindings.bound_variables
            join = value_join(step, following, known, self._bindings.constants, types)
            self._emit_limit_check(step, sink, join)
            indexed = step.kind is StepKind.LOOP and self.uses_indexes
            if join is not None and indexed and join.is_usable(not self._shares_searches):
                self._emit_index_loop(step, join, sink)
                found.update(map(id, join.tests))
                if join.is_whole_rest and sink is COUNT:
                    return
            elif indexed and self._shares_searches and (links := link_tests(step, following, self._bindings)):
                self._emit_intersection_loop(step, links)
            elif step.kind is StepKind.LOOP:
                self._emit_loop(step)
            elif step.kind is StepKind.BIND:
                self._emit_binding(step, inline=False)
            else:
                self._block.open_test(self._emit_test(step))
            self._block.set_origin(StepOrigin(step, dict(self._bindings.expressions)))
            self._emit_seen_sets(number, steps, shared)
        self.duplicate_filters.emit_filter(PLAN_END)
        self._block.add(*sink.emit_each(self._bindings.expression_of))

    def _emit_limit_check(self, step: PlanStep, sink: SolutionSink, join: ValueJoin | None) -> None:
        """Emit a check for too many matches before a loop that no constraint connects with the outer loops."""
        if (
            self.limit_check is None
            or step.kind is not StepKind.LOOP
            or not (self._block.loop_count or self._is_continuation)
        ):
            return
        if join is None and not any(map(self._bindings.has_value, visible_variables(step.goal))):
            name = dict(enumerate(self._conjunction.names)).get(next(iter(step.binds), -1), "")
            check = code.emit_call(
                self._module.name_of(self.limit_check), self._emit_size(sink), self._module.literal(name)
            )
            self._block.add(code.ExpressionStatement(check))

    def _emit_size(self, sink: SolutionSink) -> code.Expression:
        """Return code for the number of matches so far; overridden in views."""
        return sink.size

    def _place_filters(self, steps: Sequence[PlanStep], sink: SolutionSink) -> None:
        """Place the duplicate filters of a plan. Do nothing in a continuation: its filters are already placed."""
        if self.duplicate_filters.is_placed:
            return
        found: dict[int, DuplicateFilter] = {}
        if self._shares_searches and sink.repeatable:
            of = partial(determined_variables, sizes=self._planner.sizes)
            found = place_duplicate_filters(
                steps,
                sink.variables,
                {*self._bindings.expressions, *self._bindings.constants},
                of,
                self.outer_variables,
            )
        self.duplicate_filters.set_filters(
            steps,
            {number: each for number, each in found.items() if number < len(steps) or sink.unique},
        )

    def _emit_seen_sets(self, number: int, steps: Sequence[PlanStep], shared: Mapping[int, int]) -> None:
        """Emit code after step `number` that creates an empty set of seen nodes for each closure search that begins
        anew whenever this step binds new values.
        """
        for search, last in shared.items():
            if last == number:
                seen = self._seen[id(steps[search])] = code.Local(self._module.fresh_name("s"))
                self._block.add(code.Assign(seen, emit_empty_collection("set")))

    def _new_translation(self, block: code.BodyBuilder, continuation: bool) -> PlanTranslation:
        """Return a new translation of the same body, without values, for an inner function or a continuation."""
        return PlanTranslation(self._planner, self._module, self._conjunction, block, {})

    def _emit_continuation_call(self, steps: Sequence[PlanStep], sink: SolutionSink) -> None:
        """Emit a continuation function for the remaining steps, and code that calls it and relays its result."""
        rest = self._emit_function_call("h", steps, sink, continuation=True)
        match sink.relay:
            case "flag":
                self._block.open_test(rest)
                self._block.add(code.Return(code.Constant(True)))
            case "found":
                self._block.open_test(
                    code.Operation("is not", (code.AssignmentExpression(FOUND, rest), code.Constant(None)))
                )
                self._block.add(code.Return(FOUND))
            case "sum":
                self._block.add(code.Assign(N, rest, "+="))
            case "each":
                self._block.add(code.Yield(rest, is_from=True))
            case _:
                self._block.add(code.ExpressionStatement(rest))

    def _emit_function_call(
        self, prefix: str, steps: Sequence[PlanStep], sink: SolutionSink, continuation: bool = False
    ) -> code.Expression:
        """Emit an inner function that executes some steps with a sink, and return a call of the function."""
        name, arguments_ = self._emit_function(prefix, steps, sink, continuation)
        return code.emit_call(name, *arguments_)

    def _emit_function(
        self, prefix: str, steps: Sequence[PlanStep], sink: SolutionSink, continuation: bool = False
    ) -> tuple[code.Name, list[code.Expression]]:
        """Emit an inner function that executes some steps with a sink. Return its name and the call's arguments."""
        shared: list[code.Local] = list(sink.shared) if continuation else []
        inputs = self._read_variables(steps, sink)
        inner = self._new_translation(code.BodyBuilder(), continuation)
        inner._bindings.expressions.update((v, inner._bindings.local(v)) for v in inputs)
        inner._allows_joins, inner.uses_indexes = self._allows_joins, self.uses_indexes
        inner._is_continuation = continuation
        inner.limit_check = self.limit_check if continuation else None
        head = () if shared else sink.head
        tail = () if shared and not sink.relay else sink.tail
        if continuation:
            inner.duplicate_filters = self.duplicate_filters.filters_for_rest(inner._block, inner._bindings)
            shared += self.duplicate_filters.passed.values()
        shared += self._extra_parameters
        inner._emit_steps(steps, sink)
        body = (*head, *inner._block.finish_body(), *tail)
        parameters = [*shared, *(inner._bindings.local(v) for v in inputs)]
        name = self._module.add_function(self._module.fresh_name(prefix), parameters, body)
        return name, [*shared, *(self._bindings.expression_of(v) for v in inputs)]

    def _read_variables(self, steps: Sequence[PlanStep], sink: SolutionSink) -> list[int]:
        """Return the variables with values, constants excepted, that the steps and the sink read."""
        read = {*sink.variables, *(v for step in steps for v in variables_used_by(step))}
        return sorted(v for v in read if v in self._bindings.expressions and v not in self._bindings.constants)

    # --- loops

    def _emit_loop(self, step: PlanStep) -> None:
        """Emit the loop of a step over an extent, link ends, a closure or the matches of a called pattern."""
        goal = step.goal
        match goal:
            case InstanceAtom(cls, variable, exact):
                self._emit_loop_over([variable], self._relations.emit_extent(cls, exact))
            case LinkAtom():
                self._emit_loop_over(step.binds, self._relations.emit_ends(goal))
            case ClosureAtom(_, _, source, target):
                ends = [v for v in (source, target) if not self._bindings.has_value(v)]
                seen = self._seen.get(id(step))
                self._emit_loop_over(
                    ends,
                    self._relations.emit_closure(goal) if seen is None else self._relations.emit_new_nodes(goal, seen),
                )
            case CallAtom() if self._planner.calls.is_recursive(goal.pattern):
                columns = [None if self._bindings.has_value(v) else v for v in goal.arguments]
                self._emit_loop_over(columns, self._relations.emit_recursive_call(goal), tuples=True)
            case CallAtom():
                wanted = [v for v in goal.arguments if v in step.binds]
                self._emit_loop_over(wanted, self._relations.emit_pattern_call(goal, step.binds, ResultMode.VALUES))
            case _:
                raise AssertionError(goal)

    def _emit_loop_over(self, targets: Sequence[int | None], iterable: code.Expression, tuples: bool = False) -> None:
        """Emit a loop that binds target variables to the items of an iterable. A target None marks an unused value.

        The items are tuples. For a single target they are bare values, unless `tuples` is True.
        """
        names: list[code.Local] = []
        again: list[code.Expression] = []
        for variable in targets:
            name = code.Local("_") if variable is None else self._bindings.local(variable)
            if name in names and variable is not None:
                first, name = name, local_variable("w", len(names))
                again.append(code.emit_equal(name, first))
            names.append(name)
        self._block.open_loop(names[0] if len(names) == 1 and not tuples else code.Tuple(tuple(names)), iterable)
        for test in again:
            self._block.open_test(test)
        self._bindings.expressions.update((v, self._bindings.local(v)) for v in targets if v is not None)

    def _emit_index_loop(self, step: PlanStep, join: ValueJoin, sink: SolutionSink) -> None:
        """Emit a loop over the objects that a value index finds. If only their number matters, emit a count."""
        goal = step.goal
        assert isinstance(goal, InstanceAtom)
        classes = tuple(self._relations.concrete_class_indices(goal.cls, goal.exact))
        if join.tests:
            goals = (test.goal for test in join.tests)
            pairs = sorted((one.attribute.index, one.value) for one in goals if isinstance(one, AttributeAtom))
            index = self._module.name_of(Valued(classes, tuple(attribute for attribute, _ in pairs)))
            self._emit_loop_over(
                step.binds,
                code.emit_call(index, *(self._bindings.expression_of(value) for _, value in pairs)),
            )
            return
        number = self._module.fresh_name("c")
        index = self._module.name_of(Valued(classes, (), tuple(join.operators), join.is_local, number))
        asked: list[code.Local] = []
        for side in join.known_sides:
            asked.append(code.Local(self._module.fresh_name("u")))
            found = self._emit_side(side, self._bindings.expression_of)
            self._block.open_test(
                code.emit_is_not_none(code.AssignmentExpression(asked[-1], found))
            )  # None: the expression has no value
        equal = len(asked) - len(join.operators)
        entries, key = self._emit_entries_function(step, join, number), code.emit_tuple(*asked[:equal])
        parts: list[code.Expression] = [entries, key, *asked[equal:]]
        if join.is_whole_rest and sink is COUNT:
            self._block.add(code.Assign(N, code.emit_method_call(index, "count", *parts), "+="))
            return
        self._emit_loop_over(step.binds, code.emit_method_call(index, "some" if sink is EXISTENCE else "rows", *parts))

    def _emit_entries_function(self, step: PlanStep, join: ValueJoin, name: str) -> code.Name:
        """Emit a function that yields an index entry (key, bounded value, object) per given object; return its name."""
        inner = PlanTranslation(self._planner, self._module, self._conjunction, code.BodyBuilder(), {})

        def each(names: VariableCode) -> code.Body:
            *keys, bound = (inner._emit_side(side, names) for side in join.own_sides)
            return (code.Yield(code.emit_tuple(code.emit_tuple(*keys), bound, names(step.binds[0]))),)

        nodes = code.Local("nodes")
        inner._emit_loop_over(step.binds, nodes)
        read = (*step.binds, *(v for side in join.own_sides for v in side.variables))
        inner._emit_steps(join.steps, SolutionSink(read, (), each, (), relay="each"))
        return self._module.add_function(name, [nodes], inner._block.finish_body())

    def _emit_side(self, side: ComparisonSide, names: VariableCode) -> code.Expression:
        """Return code for one side of a comparison. `names` returns code for the values of variables."""
        found = {name: names(variable) for name, variable in side.reads}
        types = {name: self._conjunction.types[variable] for name, variable in side.reads}
        return self._module.emit_expression(side.expression, found, types, part=True)

    def _emit_intersection_loop(self, step: PlanStep, tests: Sequence[PlanStep]) -> None:
        """Emit a loop over link ends. If there are many, intersect them with the ends that later tests require."""
        goal = step.goal
        assert isinstance(goal, LinkAtom)
        others = [self._relations.emit_ends(test.goal) for test in tests if isinstance(test.goal, LinkAtom)]
        ends = code.Local(self._module.fresh_name("e"))
        kind = code.AttributeAccess(code.AssignmentExpression(ends, self._relations.emit_ends(goal)), "__class__")
        short = code.Operation("is", (kind, code.Name("tuple")))  # otherwise a crowded `IndexedSet`
        common = code.emit_call(self._module.name_of(Builtin("common")), ends, *others)
        self._emit_loop_over(step.binds, code.ConditionalExpression(short, ends, common))

    # --- values

    def _emit_binding(self, step: PlanStep, inline: bool) -> None:
        """Emit code that binds a variable, or skips a match without value. If `inline`, the code is one expression."""
        (variable,) = step.binds
        found: code.Expression = self._bindings.local(variable)
        assert isinstance(found, code.Local)
        if isinstance(step.goal, LinkAtom):
            ends = self._bindings.local(variable, "t")
            self._block.open_test(code.AssignmentExpression(ends, self._relations.emit_ends(step.goal)))
            if inline:
                found = code.Subscript(ends, code.Constant(0))
            else:
                self._block.add(code.Assign(code.Tuple((found,)), ends))
        else:
            self._block.open_test(code.emit_is_not_none(code.AssignmentExpression(found, self._emit_value(step))))
        self._bindings.expressions[variable] = found

    def _emit_value(self, step: PlanStep) -> code.Expression:
        """Return code for the value that a goal computes; at run time None means that there is no value."""
        goal = step.goal
        match goal:
            case AttributeAtom(attribute, owner, _):
                return code.Subscript(
                    self._module.name_of(StoreColumn("values", attribute.index)),
                    self._bindings.expression_of(owner),
                )
            case ValuationAtom(expression, reads, _):
                return self._emit_expression(expression, reads)
            case AggregateAtom():
                return self._emit_aggregate(goal, step.inner[0])
        raise AssertionError(goal)

    def _emit_expression(self, expression: Term, reads: tuple[tuple[str, int], ...]) -> code.Expression:
        """Return code for an expression over bound variables."""
        names = {name: self._bindings.expression_of(variable) for name, variable in reads}
        types = {name: self._conjunction.types[variable] for name, variable in reads}
        return self._module.emit_expression(expression, names, types)

    def _emit_aggregate(self, goal: AggregateAtom, plan: SearchPlan) -> code.Expression:
        """Return code for an aggregate: a value shared by several starts if possible, else one call, else loops."""
        return (
            self._emit_shared_aggregate(goal, plan)
            or self._emit_direct_aggregate(goal)
            or self._emit_function_call("g", plan.steps, aggregate_sink(self._module, goal))
        )

    def _emit_direct_aggregate(self, goal: AggregateAtom) -> code.Expression | None:
        """Return code for an aggregate that one existing function or column answers; None if a loop is needed."""
        if goal.column is None:
            return self._relations.emit_count(goal.relation)
        values = self._relations.emit_column(goal.relation, goal.column)
        return None if values is None else code.emit_call(aggregate_function_name(self._module, goal), values)

    def _emit_shared_aggregate(self, goal: AggregateAtom, plan: SearchPlan) -> code.Expression | None:
        """Return code for an aggregate that is the same for all starts that reach the same nodes; None if it is not."""
        if not self._shares_searches:
            return None
        assert isinstance(self._planner, Planner)
        found = reach_aggregate_of(self._planner, goal, self._bindings.bound_variables)
        if found is None:
            return None
        name, given = self._emit_function("g", plan.steps, aggregate_sink(self._module, goal))
        called = relation_variables(goal.relation)
        column = None if goal.column is None else called.index(goal.column)
        places = found.ends.given if found.ends else ()
        outside = row([called[place] for place in places], self._bindings.expression_of)
        start = self._bindings.expression_of(found.start)
        return emit_shared_aggregate(self._module, found, start, name, given, outside, goal.function, column)

    # --- tests

    def _emit_test(self, step: PlanStep) -> code.Expression:
        """Return code for the test of a step."""
        goal = step.goal
        match goal:
            case _ if step.kind is StepKind.EXISTS:
                return self._emit_existence(step.inner[0])
            case AbsenceAtom():
                return code.emit_joined("and", [code.emit_not(self._emit_existence(plan)) for plan in step.inner], True)
            case InstanceAtom():
                return self._relations.emit_class_test(goal)
            case AttributeAtom() | ValuationAtom() | AggregateAtom():
                result = goal.value if isinstance(goal, AttributeAtom) else goal.result
                return code.emit_equal(self._emit_value(step), self._bindings.expression_of(result))
            case LinkAtom():
                return self._relations.emit_link_test(goal)
            case CallAtom(pattern) if self._planner.calls.is_recursive(pattern):
                return self._relations.emit_recursive_call(goal)
            case CallAtom():
                return self._relations.emit_pattern_call(goal, (), ResultMode.EXISTS)
            case ClosureAtom(relation, _, source, target):
                if self._bindings.has_value(source) and self._bindings.has_value(target):
                    return self._relations.emit_closure(goal)
                return self._emit_test(replace(step, goal=CallAtom(relation, (source, target))))
            case UnequalAtom(left, right):
                return code.Operation("!=", (self._bindings.expression_of(left), self._bindings.expression_of(right)))
            case ConditionAtom(expression, reads):
                return self._emit_expression(expression, reads)
        raise AssertionError(goal)

    def _emit_existence(self, plan: SearchPlan) -> code.Expression:
        """Return code that tests if a plan has a solution: an expression, or with loops a call of a new function."""
        if any(step.kind is StepKind.LOOP for step in plan.steps):
            return self._emit_join(plan) or self._emit_function_call("g", plan.steps, EXISTENCE)
        inner = PlanTranslation(self._planner, self._module, self._conjunction, code.BodyBuilder(), {})
        inner._bindings.expressions = dict(self._bindings.expressions)
        for step in plan.steps:
            if step.kind is StepKind.BIND:
                inner._emit_binding(step, inline=True)
            else:
                inner._block.open_test(inner._emit_test(step))
        return code.emit_joined("and", [test for test, _ in inner._block.pending_tests], True)

    def _emit_join(self, plan: SearchPlan) -> code.Expression | None:
        """Return code for an existence test that one closure search decides; None if the plan has no such form."""
        if not (self._shares_searches and self._allows_joins):
            return None
        assert isinstance(self._planner, Planner)
        known = self._bindings.bound_variables
        join = join_of(self._planner, self._conjunction, plan, known)
        if join is None:
            return None
        from_source = join.bound_end == join.closure.source
        spread = self._module.name_of(closure_function(join.closure, ClosureQuestion.NEW_NODES, not from_source))
        all_ = SolutionSink(
            (join.free_end,),
            (code.Assign(OUT, emit_empty_collection("set")),),
            lambda names: (code.ExpressionStatement(code.emit_call(spread, names(join.free_end), OUT)),),
            (code.Return(OUT),),
            (OUT,),
            repeatable=True,
        )
        self._allows_joins = False
        whole = self._emit_function("z", join.plan.steps, all_)
        direct = self._emit_function("g", plan.steps, EXISTENCE)
        self._allows_joins = True
        holds = self._module.name_of(closure_function(join.closure, ClosureQuestion.REACHES_ANY, from_source))
        parts = [self._bindings.expression_of(join.bound_end)]
        for name, given in (whole, direct):
            parts += [name, code.Tuple(tuple(given))]
        return code.emit_call(holds, *parts)

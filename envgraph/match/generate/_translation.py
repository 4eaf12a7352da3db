"""Emit code that executes the plan of one conjunction.

The code consists of nested loops over the columns of the store, with each test in the outermost loop that the plan
allows. It contains no text of the user: variables are numbered, constants and columns are parameters of `build`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

from envgraph import code
from envgraph.code import dataclass
from envgraph.match.generate._bindings import VariableBindings
from envgraph.match.generate._duplicate_filter_code import PLAN_END, DuplicateFilterCode
from envgraph.match.generate._link_tests import emit_common_ends, link_tests
from envgraph.match.generate._relation_code import RelationCode, emit_shared_aggregate
from envgraph.match.generate._sinks import (
    COUNT,
    EXISTENCE,
    FOUND,
    OUT,
    N,
    SolutionSink,
    VariableCode,
    aggregate_sink,
    row,
)
from envgraph.match.generate._source_builder import SourceBuilder, local_variable
from envgraph.match.generate._symbols import (
    ClosureQuestion,
    MatchLimitCheck,
    ResultMode,
    StoreColumn,
    Valued,
    closure_function,
)
from envgraph.match.generate._translator import PlanTranslator
from envgraph.match.generate._value_joins import ValueJoin, value_join
from envgraph.match.plan._planner import Planner
from envgraph.match.plan._search_plan import PlanStep, SearchPlan, StepKind
from envgraph.match.plan._shared_searches import (
    join_of,
    reach_aggregate_of,
    shared_searches,
    variables_used_by,
)
from envgraph.pattern import (
    AggregateAtom,
    AttributeAtom,
    CallAtom,
    ClosureAtom,
    ConditionAtom,
    Conjunction,
    Expression as Term,
    InstanceAtom,
    LinkAtom,
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


class PlanTranslation(PlanTranslator):
    """A translation of the plan of one conjunction into code that asks the columns of the store.

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
        bindings = VariableBindings(conjunction, lambda value, _: module.literal(value))
        self._relations = relations or RelationCode(planner, module, bindings)
        super().__init__(conjunction, block, self._relations.bindings)
        self._planner = planner
        self._module = module
        self._given = given
        self.duplicate_filters = DuplicateFilterCode(module, block, self.bindings)
        self._searches: dict[int | None, list[PlanStep]] = {}
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
    _is_inline = False
    """True if the code must be one expression."""

    def emit_plan(self, plan: SearchPlan, sink: SolutionSink) -> None:
        """Emit code that executes a plan, with the statements of the sink for each solution."""
        block = self.block
        place = block.position
        self.bind_parameters(self._given)
        joined = self._emit_join(plan) if sink is EXISTENCE else None
        if joined is None:
            self.emit_steps(plan.steps, sink)
        else:
            block.open_test(joined)
            super().emit_solution(sink)
        block.close_to(place)

    # --- steps

    def emit_steps(self, steps: Sequence[PlanStep], sink: SolutionSink) -> None:
        for search, last in (shared_searches(steps, sink) if self._shares_searches else {}).items():
            self._searches.setdefault(id(steps[last]) if last >= 0 else None, []).append(steps[search])
        self._emit_seen_sets(None)
        if not self.duplicate_filters.is_placed:  # as they are in a continuation
            sizes = self._planner.sizes if self._shares_searches and sink.repeatable else None
            self.duplicate_filters.place(steps, sink, sizes, self.outer_variables)
        super().emit_steps(steps, sink)

    def emit_first(self, steps: Sequence[PlanStep], sink: SolutionSink) -> Sequence[PlanStep] | None:
        """Emit code for the first step. If the loops get too deep, all steps become a continuation."""
        step, *following = steps
        self.duplicate_filters.emit_filter(id(step))
        if self.block.is_full and step.kind in (StepKind.LOOP, StepKind.BIND):
            self._emit_continuation_call(steps, sink)
            return None
        self.duplicate_filters.emit_new_sets(id(step))
        left: Sequence[PlanStep] | None = following
        types, known = self.conjunction.types, self.bindings.bound_variables
        join = value_join(step, following, known, self.bindings.constants, types)
        self._emit_limit_check(step, sink, join)
        indexed = step.kind is StepKind.LOOP and self.uses_indexes
        if join is not None and indexed and join.is_usable(not self._shares_searches):
            left = self._emit_index_loop(step, following, join, sink)
        elif indexed and self._shares_searches and (links := link_tests(step, following, self.bindings)):
            assert isinstance(step.goal, LinkAtom)
            self.emit_loop_over(step.binds, emit_common_ends(self._module, self._relations, step.goal, links))
        else:
            self.solve(step)
        self._emit_exclusion(step)
        self.block.set_origin(StepOrigin(step, dict(self.bindings.expressions)))
        self._emit_seen_sets(id(step))
        return left

    def emit_solution(self, sink: SolutionSink) -> None:
        self.duplicate_filters.emit_filter(PLAN_END)
        super().emit_solution(sink)

    def _emit_exclusion(self, step: PlanStep) -> None:
        """Emit a test that skips tuples that the goal of a step must not see; overridden in views."""

    def _emit_limit_check(self, step: PlanStep, sink: SolutionSink, join: ValueJoin | None) -> None:
        """Emit a check for too many matches before a loop that no constraint connects with the outer loops."""
        if (
            self.limit_check is None
            or step.kind is not StepKind.LOOP
            or not (self.block.loop_count or self._is_continuation)
        ):
            return
        if join is None and not any(map(self.is_bound, visible_variables(step.goal))):
            name = dict(enumerate(self.conjunction.names)).get(next(iter(step.binds), -1), "")
            check = code.emit_call(
                self._module.name_of(self.limit_check), self._emit_size(sink), self._module.literal(name)
            )
            self.block.add(code.ExpressionStatement(check))

    def _emit_size(self, sink: SolutionSink) -> code.Expression:
        """Return code for the number of matches so far; overridden in views."""
        return sink.size

    def _emit_seen_sets(self, place: int | None) -> None:
        """Emit code after a step, given by its identity, that creates an empty set of seen nodes for each closure
        search that begins anew whenever this step binds new values; None: before all steps.
        """
        for search in self._searches.get(place, ()):
            seen = self._seen[id(search)] = code.Local(self._module.fresh_name("s"))
            self.block.add(code.Assign(seen, code.emit_call("set")))

    def _new_part(self, continuation: bool) -> PlanTranslation:
        """Return a new translation of the same body, without values, for an inner function or a continuation."""
        return PlanTranslation(self._planner, self._module, self.conjunction, code.BodyBuilder(), {})

    def _emit_continuation_call(self, steps: Sequence[PlanStep], sink: SolutionSink) -> None:
        """Emit a continuation function for the remaining steps, and code that calls it and relays its result."""
        name, arguments_ = self._emit_function("h", steps, sink, continuation=True)
        rest = code.emit_call(name, *arguments_)
        match sink.relay:
            case "flag":
                self.block.open_test(rest)
                self.block.add(code.Return(code.Constant(True)))
            case "found":
                self.block.open_test(
                    code.Operation("is not", (code.AssignmentExpression(FOUND, rest), code.Constant(None)))
                )
                self.block.add(code.Return(FOUND))
            case "sum":
                self.block.add(code.Assign(N, rest, "+="))
            case "each":
                self.block.add(code.Yield(rest, is_from=True))
            case _:
                self.block.add(code.ExpressionStatement(rest))

    def emit_function_call(self, steps: Sequence[PlanStep], sink: SolutionSink) -> code.Expression:
        name, arguments_ = self._emit_function("g", steps, sink)
        return code.emit_call(name, *arguments_)

    def _emit_function(
        self, prefix: str, steps: Sequence[PlanStep], sink: SolutionSink, continuation: bool = False
    ) -> tuple[code.Name, list[code.Expression]]:
        """Emit an inner function that executes some steps with a sink. Return its name and the call's arguments."""
        shared: list[code.Local] = list(sink.shared) if continuation else []
        read = {*sink.variables, *(v for step in steps for v in variables_used_by(step))}
        inputs = sorted(read & self.bindings.expressions.keys() - self.bindings.constants.keys())
        inner = self._new_part(continuation)
        inner.bindings.expressions.update((v, inner.bindings.local(v)) for v in inputs)
        inner._allows_joins, inner.uses_indexes = self._allows_joins, self.uses_indexes
        inner._is_continuation = continuation
        inner.limit_check = self.limit_check if continuation else None
        head = () if shared else sink.head
        tail = () if shared and not sink.relay else sink.tail
        if continuation:
            inner.duplicate_filters = self.duplicate_filters.filters_for_rest(inner.block, inner.bindings)
            shared += self.duplicate_filters.passed.values()
        shared += self._extra_parameters
        inner.emit_steps(steps, sink)
        body = (*head, *inner.block.finish_body(), *tail)
        parameters = [*shared, *(inner.bindings.local(v) for v in inputs)]
        name = self._module.add_function(self._module.fresh_name(prefix), parameters, body)
        return name, [*shared, *(self.value_of(v) for v in inputs)]

    # --- relations

    def solve_instance(self, goal: InstanceAtom, step: PlanStep) -> None:
        if step.kind is StepKind.LOOP:
            self.emit_loop_over([goal.variable], self._relations.emit_extent(goal.cls, goal.exact))
        else:
            self.block.open_test(self._relations.emit_class_test(goal))

    def solve_attribute(self, goal: AttributeAtom, step: PlanStep) -> None:
        values = self._module.name_of(StoreColumn("values", goal.attribute.index))
        self.bind_or_test(goal.value, code.Subscript(values, self.value_of(goal.object)), step)

    def solve_link(self, goal: LinkAtom, step: PlanStep) -> None:
        if step.kind is StepKind.LOOP:
            self.emit_loop_over(step.binds, self._relations.emit_ends(goal))
            return
        if step.kind is not StepKind.BIND:
            self.block.open_test(self._relations.emit_link_test(goal))
            return
        (variable,) = step.binds
        ends, found = self.bindings.local(variable, "t"), self.bindings.local(variable)
        self.block.open_test(code.AssignmentExpression(ends, self._relations.emit_ends(goal)))
        self.bindings.expressions[variable] = code.Subscript(ends, code.Constant(0)) if self._is_inline else found
        if not self._is_inline:
            self.block.add(code.Assign(code.Tuple((found,)), ends))

    def solve_call(self, goal: CallAtom, step: PlanStep) -> None:
        recursive = self._planner.calls.is_recursive(goal.pattern)
        if step.kind is not StepKind.LOOP:
            exists = partial(self._relations.emit_pattern_call, goal, (), ResultMode.EXISTS)
            self.block.open_test(self._relations.emit_recursive_call(goal) if recursive else exists())
        elif recursive:
            columns = [None if self.is_bound(v) else v for v in goal.arguments]
            self.emit_loop_over(columns, self._relations.emit_recursive_call(goal), tuples=True)
        else:
            wanted = [v for v in goal.arguments if v in step.binds]
            self.emit_loop_over(wanted, self._relations.emit_pattern_call(goal, step.binds, ResultMode.VALUES))

    def solve_closure(self, goal: ClosureAtom, step: PlanStep) -> None:
        ends = [v for v in (goal.source, goal.target) if not self.is_bound(v)]
        if step.kind is StepKind.LOOP:
            seen, relations = self._seen.get(id(step)), self._relations
            found = relations.emit_closure(goal) if seen is None else relations.emit_new_nodes(goal, seen)
            self.emit_loop_over(ends, found)
        elif ends:  # some node is reached exactly if there is a first step
            self.solve_call(CallAtom(goal.step, (goal.source, goal.target)), step)
        else:
            self.block.open_test(self._relations.emit_closure(goal))

    def emit_loop_over(self, targets: Sequence[int | None], iterable: code.Expression, tuples: bool = False) -> None:
        """Emit a loop that binds target variables to the items of an iterable. A target None marks an unused value.

        The items are tuples. For a single target they are bare values, unless `tuples` is True.
        """
        names: list[code.Local] = []
        again: list[code.Expression] = []
        for variable in targets:
            name = code.Local("_") if variable is None else self.bindings.local(variable)
            if name in names and variable is not None:
                first, name = name, local_variable("w", len(names))
                again.append(code.emit_equal(name, first))
            names.append(name)
        self.block.open_loop(names[0] if len(names) == 1 and not tuples else code.Tuple(tuple(names)), iterable)
        for test in again:
            self.block.open_test(test)
        self.bindings.expressions.update((v, self.bindings.local(v)) for v in targets if v is not None)

    def _emit_index_loop(
        self, step: PlanStep, following: Sequence[PlanStep], join: ValueJoin, sink: SolutionSink
    ) -> Sequence[PlanStep] | None:
        """Emit a loop over the objects that a value index finds, or a count if only their number matters.

        Returns the steps left; None after a count.
        """
        goal = step.goal
        assert isinstance(goal, InstanceAtom)
        classes = tuple(self._relations.concrete_class_indices(goal.cls, goal.exact))
        if join.tests:
            goals = (test.goal for test in join.tests)
            pairs = sorted((one.attribute.index, one.value) for one in goals if isinstance(one, AttributeAtom))
            index = self._module.name_of(Valued(classes, tuple(attribute for attribute, _ in pairs)))
            values = (self.value_of(value) for _, value in pairs)
            self.emit_loop_over(step.binds, code.emit_call(index, *values))
            return [each for each in following if all(each is not test for test in join.tests)]
        number = self._module.fresh_name("c")
        index = self._module.name_of(Valued(classes, (), tuple(join.operators), join.is_local, number))
        asked: list[code.Local] = []
        for side in join.known_sides:
            asked.append(code.Local(self._module.fresh_name("u")))
            found = self._emit_expression(side.expression, side.reads, self.value_of, part=True)
            has_value = code.emit_is_not_none(code.AssignmentExpression(asked[-1], found))
            self.block.open_test(has_value)
        equal = len(asked) - len(join.operators)
        entries, key = self._emit_entries_function(step, join, number), code.emit_tuple(*asked[:equal])
        parts: list[code.Expression] = [entries, key, *asked[equal:]]
        if join.is_whole_rest and sink is COUNT:
            self.block.add(code.Assign(N, code.emit_method_call(index, "count", *parts), "+="))
            return None
        rows = code.emit_method_call(index, "some" if sink is EXISTENCE else "rows", *parts)
        self.emit_loop_over(step.binds, rows)
        return following

    def _emit_entries_function(self, step: PlanStep, join: ValueJoin, name: str) -> code.Name:
        """Emit a function that yields an index entry (key, bounded value, object) per given object; return its name."""
        inner = PlanTranslation(self._planner, self._module, self.conjunction, code.BodyBuilder(), {})

        def each(names: VariableCode) -> code.Body:
            *keys, bound = (
                self._emit_expression(side.expression, side.reads, names, part=True) for side in join.own_sides
            )
            return (code.Yield(code.emit_tuple(code.emit_tuple(*keys), bound, names(step.binds[0]))),)

        nodes = code.Local("nodes")
        inner.emit_loop_over(step.binds, nodes)
        read = (*step.binds, *(v for side in join.own_sides for v in side.variables))
        inner.emit_steps(join.steps, SolutionSink(read, (), each, (), relay="each"))
        return self._module.add_function(name, [nodes], inner.block.finish_body())

    # --- values

    def bind_or_test(self, variable: int, value: code.Expression, step: PlanStep) -> None:
        """Emit code that binds a variable to a value unless it is None, or compares the value that it has already."""
        if step.kind is not StepKind.BIND:
            self.block.open_test(code.emit_equal(value, self.value_of(variable)))
            return
        found = self.bindings.local(variable)
        self.block.open_test(code.emit_is_not_none(code.AssignmentExpression(found, value)))
        self.bindings.expressions[variable] = found

    def solve_condition(self, goal: ConditionAtom) -> None:
        self.block.open_test(self._emit_expression(goal.expression, goal.reads, self.value_of))

    def solve_valuation(self, goal: ValuationAtom, step: PlanStep) -> None:
        self.bind_or_test(goal.result, self._emit_expression(goal.expression, goal.reads, self.value_of), step)

    def solve_aggregate(self, goal: AggregateAtom, step: PlanStep) -> None:
        """Emit a value shared by several starts if possible, else one call, else loops."""
        plan = step.inner[0]
        found = self._emit_shared_aggregate(goal, plan) or self._relations.emit_aggregate(goal)
        found = found or self.emit_function_call(plan.steps, aggregate_sink(self._module, goal))
        self.bind_or_test(goal.result, found, step)

    def _emit_expression(
        self, expression: Term, reads: Sequence[tuple[str, int]], values: VariableCode, part: bool = False
    ) -> code.Expression:
        """Return code for an expression. `values` returns code for the variables that its names stand for."""
        names = {name: values(variable) for name, variable in reads}
        types = {name: self.conjunction.types[variable] for name, variable in reads}
        return self._module.emit_expression(expression, names, types, part=part)

    def _emit_shared_aggregate(self, goal: AggregateAtom, plan: SearchPlan) -> code.Expression | None:
        """Return code for an aggregate that is the same for all starts that reach the same nodes; None if it is not."""
        if not self._shares_searches:
            return None
        assert isinstance(self._planner, Planner)
        found = reach_aggregate_of(self._planner, goal, self.bindings.bound_variables)
        if found is None:
            return None
        name, given = self._emit_function("g", plan.steps, aggregate_sink(self._module, goal))
        called = relation_variables(goal.relation)
        column = None if goal.column is None else called.index(goal.column)
        places = found.ends.given if found.ends else ()
        outside = row([called[place] for place in places], self.value_of)
        start = self.value_of(found.start)
        return emit_shared_aggregate(self._module, found, start, name, given, outside, goal.function, column)

    # --- existence

    def emit_existence(self, plan: SearchPlan) -> code.Expression:
        """Return code that tests if a plan has a solution: an expression, or with loops a call of a new function."""
        if any(step.kind is StepKind.LOOP for step in plan.steps):
            return self._emit_join(plan) or super().emit_existence(plan)
        inner = PlanTranslation(self._planner, self._module, self.conjunction, code.BodyBuilder(), {})
        inner.bindings.expressions, inner._is_inline = dict(self.bindings.expressions), True
        for step in plan.steps:
            inner.solve(step)
        return code.emit_joined("and", [test for test, _ in inner.block.pending_tests], True)

    def _emit_join(self, plan: SearchPlan) -> code.Expression | None:
        """Return code for an existence test that one closure search decides; None if the plan has no such form."""
        if not (self._shares_searches and self._allows_joins):
            return None
        assert isinstance(self._planner, Planner)
        known = self.bindings.bound_variables
        join = join_of(self._planner, self.conjunction, plan, known)
        if join is None:
            return None
        from_source = join.bound_end == join.closure.source
        spread = self._module.name_of(closure_function(join.closure, ClosureQuestion.NEW_NODES, not from_source))
        all_ = SolutionSink(
            (join.free_end,),
            (code.Assign(OUT, code.emit_call("set")),),
            lambda names: (code.emit_call_statement(spread, names(join.free_end), OUT),),
            (code.Return(OUT),),
            (OUT,),
            repeatable=True,
        )
        self._allows_joins = False
        whole = self._emit_function("z", join.plan.steps, all_)
        direct = self._emit_function("g", plan.steps, EXISTENCE)
        self._allows_joins = True
        holds = self._module.name_of(closure_function(join.closure, ClosureQuestion.REACHES_ANY, from_source))
        parts = [self.value_of(join.bound_end)]
        for name, given in (whole, direct):
            parts += [name, code.Tuple(tuple(given))]
        return code.emit_call(holds, *parts)
